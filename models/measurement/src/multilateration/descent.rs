//! Levenberg-Marquardt descent for a few unknowns.
//!
//! Place in the flow: solves a station (4 unknowns) and a point (3 unknowns). With residuals F (m) and Jacobian J the
//! direction is d = −(JᵀJ + μI)⁻¹JᵀF with μ = ‖F‖, the step the largest β^k that keeps
//! ½‖F(x + β^k d)‖² ≤ ½‖F‖² + σ β^k gᵀd. Source: Chen 2020 eq. 2-10. μ is a length there and JᵀJ is not: lengths are metres
//! here, so that near the solution μ is micrometres beside ones and the descent is Gauss and Newton's.

use nalgebra::{SMatrix, SVector};

/// σ of Armijo's rule, in (0, 1).
const SUFFICIENT: f64 = 1e-4;
/// β of Armijo's rule, in (0, 1).
const SHORTER: f64 = 0.5;
/// Exponents of β that are tried.
const MOST_SHORTENINGS: i32 = 40;
/// Iterations at most; from the starts used here fewer than ten are enough.
const MOST_STEPS: usize = 100;
/// Step (m) from which nothing changes: far below what an interferometer resolves.
const SETTLED_M: f64 = 1e-12;

/// Gain of a step, relative to the sum of squares, that is not worth another: 1e-5 of the uncertainty.
const GAIN: f64 = 1e-10;
/// Rounding of a residual (m) on ranges of up to tens of metres; a gain below what it does to the sum of squares cannot be seen.
const ROUNDING_M: f64 = 1e-14;

/// Residuals (m), weighted, with their derivatives by the unknowns.
pub(crate) type Rows<const N: usize> = Vec<(SVector<f64, N>, f64)>;

/// Where the descent ended.
#[derive(Debug, Clone)]
pub(crate) struct Solved<const N: usize> {
    pub(crate) unknowns: SVector<f64, N>,
    /// JᵀJ there.
    pub(crate) normal: SMatrix<f64, N, N>,
    pub(crate) steps: usize,
}

/// Why a descent has no end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NotSolved {
    /// The equations do not fix the unknowns.
    Singular,
    /// It did not settle.
    NotConverged,
}

/// Descends from `start`; `rows` evaluates residuals and Jacobian.
pub(crate) fn descend<const N: usize>(
    start: SVector<f64, N>,
    rows: impl Fn(&SVector<f64, N>) -> Rows<N>,
) -> Result<Solved<N>, NotSolved> {
    let mut unknowns = start;
    let mut now = rows(&unknowns);
    for step in 1..=MOST_STEPS {
        let (normal, gradient) = sums(&now);
        let square: f64 = now.iter().map(|(_, f)| f * f).sum();
        let damped = normal + SMatrix::identity() * square.sqrt();
        let direction = -damped.cholesky().ok_or(NotSolved::Singular)?.solve(&gradient);
        if !direction.iter().all(|v| v.is_finite()) {
            return Err(NotSolved::Singular);
        }
        let slope = gradient.dot(&direction);
        if direction.norm() < SETTLED_M || -slope <= GAIN * square + ROUNDING_M * square.sqrt() {
            // Too short for Armijo's rule to judge, and the better for it: one step of Gauss and Newton squares the error.
            return Ok(Solved { unknowns: unknowns + direction, normal, steps: step });
        }
        let promise = SUFFICIENT * slope;
        let shortened = (0..MOST_SHORTENINGS).map(|k| SHORTER.powi(k)).find_map(|share| {
            let next = unknowns + direction * share;
            let there = rows(&next);
            let next_square: f64 = there.iter().map(|(_, f)| f * f).sum();
            (0.5 * next_square <= 0.5 * square + share * promise).then_some((next, there))
        });
        (unknowns, now) = shortened.ok_or(NotSolved::NotConverged)?;
    }
    Err(NotSolved::NotConverged)
}

fn sums<const N: usize>(rows: &Rows<N>) -> (SMatrix<f64, N, N>, SVector<f64, N>) {
    let (mut normal, mut gradient) = (SMatrix::zeros(), SVector::zeros());
    for (row, residual_m) in rows {
        normal += row * row.transpose();
        gradient += row * *residual_m;
    }
    (normal, gradient)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    #[test]
    fn a_circle_and_a_line_meet_where_they_should() {
        // x² + y² = 2, x = y, from a start far away.
        let rows = |p: &Vector2<f64>| {
            vec![(Vector2::new(2.0 * p.x, 2.0 * p.y), p.norm_squared() - 2.0), (Vector2::new(1.0, -1.0), p.x - p.y)]
        };
        let found = descend(Vector2::new(30.0, 2.0), rows).unwrap();
        assert!((found.unknowns - Vector2::new(1.0, 1.0)).norm() < 1e-11, "{found:?}");
    }

    #[test]
    fn equations_that_fix_nothing_are_no_solution() {
        let nothing = |_: &Vector2<f64>| vec![(Vector2::new(1.0, 1.0), 0.0)];
        assert_eq!(descend(Vector2::new(0.0, 0.0), nothing).unwrap_err(), NotSolved::Singular);
        let not_finite = |_: &Vector2<f64>| vec![(Vector2::new(1.0, 1.0), f64::NAN)];
        assert_eq!(descend(Vector2::new(0.0, 0.0), not_finite).unwrap_err(), NotSolved::Singular);
    }
}
