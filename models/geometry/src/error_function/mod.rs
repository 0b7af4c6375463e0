//! Error functions of one axis position: polynomial, piecewise linear nodes, cubic B-spline.
//!
//! Place in the flow: the machine file names a kind, identification decides how many coefficients it needs,
//! and the chain evaluates it. Every function is zero at the lower end of the stroke, straightness also at the
//! upper end (FYXZ paper, eq. 7), because squareness carries the slope: the constraints are built into the
//! basis, so no coefficient is spent on what the gauge fixes.

mod bspline;
mod nodes;
mod polynomial;

use thiserror::Error;

/// Most coefficients that are non-zero at one position, over all kinds.
pub const MAX_LOCAL: usize = 12;

/// Kind of an error function and its number of pieces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FunctionKind {
    /// Polynomial of this degree (Liang 2025, eq. 9), in Legendre form.
    Polynomial {
        /// Highest power, 1 to 10.
        degree: usize,
    },
    /// Piecewise linear between this many equidistant nodes (FYXZ paper).
    Nodes {
        /// Nodes including both ends, 2 or more.
        count: usize,
    },
    /// Cubic B-spline with this many equal intervals.
    BSpline {
        /// Intervals between knots, 1 or more.
        intervals: usize,
    },
}

/// What an error function is asked to be zero at, besides the lower end of the stroke.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Closure {
    /// Zero at the lower end only (positioning, angles).
    Origin,
    /// Zero at both ends (straightness).
    BothEnds,
}

/// Bad choice of kind or domain.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum BasisError {
    /// Number of pieces out of range.
    #[error("{kind:?}: {requirement}")]
    Pieces {
        /// The refused kind.
        kind: FunctionKind,
        /// What is allowed.
        requirement: &'static str,
    },
    /// Empty or non-finite stroke.
    #[error("the stroke from {lower_m} m to {upper_m} m is empty or not finite; the upper end must exceed the lower")]
    Stroke {
        /// Lower end (m).
        lower_m: f64,
        /// Upper end (m).
        upper_m: f64,
    },
}

/// Basis of one error function on one stroke.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Basis {
    kind: FunctionKind,
    closure: Closure,
    lower_m: f64,
    upper_m: f64,
}

/// The basis functions that are non-zero at one position.
#[derive(Debug, Clone, Copy)]
pub struct LocalBasis {
    /// Index of the first coefficient that `values` belongs to.
    pub first: usize,
    /// Number of valid entries of `values`.
    pub len: usize,
    /// Basis function values, dimensionless.
    pub values: [f64; MAX_LOCAL],
}

impl LocalBasis {
    /// Value of the function with these coefficients, in their unit.
    pub fn dot(&self, coefficients: &[f64]) -> f64 {
        (0..self.len).map(|k| self.values[k] * coefficients[self.first + k]).sum()
    }

    /// The valid values.
    pub fn values(&self) -> &[f64] {
        &self.values[..self.len]
    }
}

impl Basis {
    /// Basis of `kind` on the stroke `lower_m` … `upper_m`.
    pub fn new(kind: FunctionKind, closure: Closure, lower_m: f64, upper_m: f64) -> Result<Basis, BasisError> {
        if !(lower_m.is_finite() && upper_m.is_finite() && upper_m > lower_m) {
            return Err(BasisError::Stroke { lower_m, upper_m });
        }
        let requirement = match kind {
            FunctionKind::Polynomial { degree } if !(1..=10).contains(&degree) => {
                Some("a polynomial has degree 1 to 10")
            }
            FunctionKind::Nodes { count } if !(2..=1000).contains(&count) => {
                Some("between 2 and 1000 nodes are needed")
            }
            FunctionKind::BSpline { intervals } if !(1..=1000).contains(&intervals) => {
                Some("between 1 and 1000 intervals are needed")
            }
            _ => None,
        };
        match requirement {
            Some(requirement) => Err(BasisError::Pieces { kind, requirement }),
            None => Ok(Basis { kind, closure, lower_m, upper_m }),
        }
    }

    /// Kind and number of pieces.
    pub fn kind(&self) -> FunctionKind {
        self.kind
    }

    /// Where the function is zero.
    pub fn closure(&self) -> Closure {
        self.closure
    }

    /// Ends of the stroke (m).
    pub fn stroke_m(&self) -> (f64, f64) {
        (self.lower_m, self.upper_m)
    }

    /// Number of free coefficients, after the constraints.
    pub fn len(&self) -> usize {
        let closed = usize::from(self.closure == Closure::BothEnds);
        match self.kind {
            FunctionKind::Polynomial { degree } => degree - closed,
            FunctionKind::Nodes { count } => count - 1 - closed,
            FunctionKind::BSpline { intervals } => intervals + 2 - closed,
        }
    }

    /// True where the constraints leave no coefficient (a straight straightness).
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Basis functions at `position_m`; beyond the stroke each goes on as a straight line.
    pub fn at(&self, position_m: f64) -> LocalBasis {
        let length = self.upper_m - self.lower_m;
        let t = (position_m - self.lower_m) / length;
        let inside = t.clamp(0.0, 1.0);
        let mut local = self.on_unit(inside, false);
        if t != inside {
            let slope = self.on_unit(inside, true);
            for k in 0..local.len {
                local.values[k] += (t - inside) * slope.values[k];
            }
        }
        local
    }

    /// Basis functions (or their first derivatives) at `t` in 0 … 1 of the stroke.
    fn on_unit(&self, t: f64, derivative: bool) -> LocalBasis {
        match self.kind {
            FunctionKind::Polynomial { degree } => polynomial::local(degree, self.closure, t, derivative),
            FunctionKind::Nodes { count } => nodes::local(count, self.closure, t, derivative),
            FunctionKind::BSpline { intervals } => bspline::local(intervals, self.closure, t, derivative),
        }
    }

    /// For nodes: the interval that `position_m` lies in, and the parabola over it that is 0 at both nodes and 1 midway.
    /// `None` for other kinds, which have no nodes, and beyond the stroke.
    pub(crate) fn between_nodes(&self, position_m: f64) -> Option<(usize, f64)> {
        let FunctionKind::Nodes { count } = self.kind else { return None };
        let t = (position_m - self.lower_m) / (self.upper_m - self.lower_m);
        let (interval, u) = nodes::interval(count, t);
        (0.0..=1.0).contains(&t).then_some((interval, 4.0 * u * (1.0 - u)))
    }

    /// Roughness matrix ∫ f″(t)² dt over the unit stroke as a row-major square of side [`Basis::len`]; zero for
    /// kinds whose order, not whose curvature, is chosen.
    pub fn roughness(&self) -> Vec<f64> {
        match self.kind {
            FunctionKind::BSpline { intervals } => bspline::roughness(intervals, self.closure),
            _ => vec![0.0; self.len() * self.len()],
        }
    }

    /// Coefficients that reproduce t^power (made zero at the ends as the closure asks), where the basis holds it.
    ///
    /// Used to look at a rich basis through its first few shapes. Exact for cubics in a B-spline.
    pub fn coefficients_of_power(&self, power: i32) -> Vec<f64> {
        self.closest(|t| t.powi(power) - if self.closure == Closure::BothEnds { t } else { 0.0 })
    }

    /// Coefficients of the function that comes closest to this one of the position (m), by least squares on a dense grid.
    pub fn coefficients_of(&self, function: impl Fn(f64) -> f64) -> Vec<f64> {
        let (lower_m, upper_m) = self.stroke_m();
        self.closest(|t| function(lower_m + t * (upper_m - lower_m)))
    }

    /// The same of a function of the place in the stroke, 0 … 1.
    fn closest(&self, function: impl Fn(f64) -> f64) -> Vec<f64> {
        let n = self.len();
        if n == 0 {
            return Vec::new();
        }
        let rows = 4 * n + 8;
        let mut matrix = nalgebra::DMatrix::zeros(rows, n);
        let mut target = nalgebra::DVector::zeros(rows);
        for row in 0..rows {
            let t = row as f64 / (rows - 1) as f64;
            let local = self.on_unit(t, false);
            for k in 0..local.len {
                matrix[(row, local.first + k)] = local.values[k];
            }
            target[row] = function(t);
        }
        match matrix.svd(true, true).solve(&target, 1e-12) {
            Ok(solution) => solution.iter().copied().collect(),
            Err(_) => vec![0.0; n],
        }
    }
}

/// Drops the coefficients that the closure fixes at zero: the first, and the last of `total` for both ends.
fn without_fixed(first: usize, values: &[f64], total: usize, closure: Closure) -> LocalBasis {
    let last_free = total - 1 - usize::from(closure == Closure::BothEnds);
    let mut local = LocalBasis { first: first.max(1) - 1, len: 0, values: [0.0; MAX_LOCAL] };
    for (k, value) in values.iter().enumerate() {
        if (1..=last_free).contains(&(first + k)) {
            local.values[local.len] = *value;
            local.len += 1;
        }
    }
    local
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all_kinds() -> Vec<Basis> {
        let kinds = [
            FunctionKind::Polynomial { degree: 5 },
            FunctionKind::Nodes { count: 7 },
            FunctionKind::BSpline { intervals: 1 },
            FunctionKind::BSpline { intervals: 9 },
        ];
        let closures = [Closure::Origin, Closure::BothEnds];
        kinds.into_iter().flat_map(|k| closures.map(|c| Basis::new(k, c, -0.1, 0.7).unwrap())).collect()
    }

    #[test]
    fn every_function_is_zero_where_the_gauge_asks() {
        for basis in all_kinds() {
            for k in 0..basis.len() {
                let mut coefficients = vec![0.0; basis.len()];
                coefficients[k] = 1.0;
                assert!(basis.at(-0.1).dot(&coefficients).abs() < 1e-15, "{basis:?}");
                if basis.closure() == Closure::BothEnds {
                    assert!(basis.at(0.7).dot(&coefficients).abs() < 1e-14, "{basis:?}");
                }
            }
        }
    }

    #[test]
    fn local_functions_stay_within_the_coefficients() {
        for basis in all_kinds() {
            for step in -20..=120 {
                let local = basis.at(-0.1 + 0.8 * f64::from(step) / 100.0);
                assert!(local.len <= MAX_LOCAL && local.first + local.len <= basis.len(), "{basis:?} {step}");
            }
        }
    }

    #[test]
    fn powers_are_reproduced_by_splines_and_polynomials() {
        for basis in all_kinds().into_iter().filter(|b| !matches!(b.kind(), FunctionKind::Nodes { .. })) {
            for power in 1..=3 {
                let coefficients = basis.coefficients_of_power(power);
                for t in [0.0, 0.13, 0.5, 0.77, 1.0_f64] {
                    let chord = if basis.closure() == Closure::BothEnds { t } else { 0.0 };
                    let value = basis.at(-0.1 + 0.8 * t).dot(&coefficients);
                    assert!((value - (t.powi(power) - chord)).abs() < 1e-11, "{basis:?} {power} {t}");
                }
            }
        }
    }

    #[test]
    fn a_spline_is_the_same_with_twice_the_knots() {
        for closure in [Closure::Origin, Closure::BothEnds] {
            let of = |intervals| Basis::new(FunctionKind::BSpline { intervals }, closure, -0.1, 0.7).unwrap();
            let (coarse, fine) = (of(5), of(10));
            let coefficients: Vec<f64> = (0..coarse.len()).map(|k| (k as f64 * 1.7).sin()).collect();
            let finer = fine.coefficients_of(|x| coarse.at(x).dot(&coefficients));
            let again = coarse.coefficients_of(|x| fine.at(x).dot(&finer));
            assert!(again.iter().zip(&coefficients).all(|(a, b)| (a - b).abs() < 1e-12), "{again:?} {coefficients:?}");
        }
        let straight = Basis::new(FunctionKind::Polynomial { degree: 1 }, Closure::BothEnds, 0.0, 1.0).unwrap();
        assert_eq!(straight.coefficients_of(f64::sin), [], "a straight straightness has no coefficients");
    }

    #[test]
    fn beyond_the_stroke_the_function_is_a_straight_line() {
        for basis in all_kinds() {
            let coefficients: Vec<f64> = (0..basis.len()).map(|k| (k as f64 * 1.7).sin()).collect();
            let f = |x: f64| basis.at(x).dot(&coefficients);
            assert!((f(0.8) - f(0.7) - (f(0.9) - f(0.8))).abs() < 1e-12, "{basis:?}");
            assert!((f(0.7 + 1e-9) - f(0.7 - 1e-9)).abs() < 1e-7, "{basis:?}");
        }
    }

    #[test]
    fn roughness_is_the_integral_of_the_squared_curvature() {
        for closure in [Closure::Origin, Closure::BothEnds] {
            let basis = Basis::new(FunctionKind::BSpline { intervals: 6 }, closure, 0.0, 2.0).unwrap();
            let n = basis.len();
            let roughness = basis.roughness();
            let quadratic = |c: &[f64]| -> f64 {
                (0..n).flat_map(|i| (0..n).map(move |j| (i, j))).map(|(i, j)| c[i] * roughness[i * n + j] * c[j]).sum()
            };
            // f = t² has f″ = 2, f = t³ has f″ = 6t; the chord of a closed function has no curvature.
            assert!((quadratic(&basis.coefficients_of_power(2)) - 4.0).abs() < 1e-9);
            assert!((quadratic(&basis.coefficients_of_power(3)) - 12.0).abs() < 1e-9);
        }
    }

    #[test]
    fn bad_pieces_and_strokes_are_refused() {
        assert!(Basis::new(FunctionKind::Polynomial { degree: 0 }, Closure::Origin, 0.0, 1.0).is_err());
        assert!(Basis::new(FunctionKind::Nodes { count: 1 }, Closure::Origin, 0.0, 1.0).is_err());
        assert!(Basis::new(FunctionKind::BSpline { intervals: 3 }, Closure::Origin, 1.0, 1.0).is_err());
        assert!(Basis::new(FunctionKind::BSpline { intervals: 3 }, Closure::Origin, 0.0, f64::NAN).is_err());
    }
}
