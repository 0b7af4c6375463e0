//! Minimum of a smooth function of a few bounded variables.
//!
//! Place in the flow: maximises the likelihood in [`super::fit`]. Projected quasi-Newton (BFGS) with Armijo's rule: variables
//! at a bound that the gradient pushes against stay there. A point where the function is not defined counts as infinite.
//! Source: Bertsekas 1982, SIAM J. Control and Optimization 20(2); Nocedal & Wright 2006, ch. 6.

use nalgebra::{DMatrix, DVector};

/// Share of the gradient's promise that a step must keep (Armijo).
const SUFFICIENT: f64 = 1e-4;
/// Halvings of a step at most.
const MOST_HALVINGS: usize = 30;
/// Longest first trial of a step in any variable: the variables are logarithms, and a factor of e² is far.
const LONGEST_STEP: f64 = 2.0;

/// Gains that rounding may hide, in gains that are asked for.
const HIDDEN: f64 = 100.0;

/// Where the descent ended.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Minimum {
    pub(crate) at: Vec<f64>,
    pub(crate) value: f64,
    /// Whether the expected further gain fell below what was asked for.
    pub(crate) is_settled: bool,
    pub(crate) steps: usize,
    /// Inverse curvature as far as it was learnt: a start for a similar function.
    pub(crate) inverse: Option<DMatrix<f64>>,
}

/// A function's value and gradient; `None` where it is not defined.
pub(crate) type Evaluation = Option<(f64, Vec<f64>)>;

/// Where to begin: variables, and the inverse curvature there if something is known of it.
pub(crate) struct Start<'a> {
    pub(crate) at: &'a [f64],
    pub(crate) inverse: Option<DMatrix<f64>>,
}

/// Descends until the gain that a further step promises is below `gain`, for `most_steps` at most. Rounding may hide gains of
/// up to a hundred times that: a search that finds nothing where no more is promised has arrived. `None` if the function is
/// not defined at the start.
pub(crate) fn minimum(
    evaluate: impl Fn(&[f64]) -> Evaluation,
    start: Start<'_>,
    bounds: &[(f64, f64)],
    gain: f64,
    most_steps: usize,
) -> Option<Minimum> {
    let clamped = |x: &DVector<f64>| DVector::from_fn(x.len(), |k, _| x[k].clamp(bounds[k].0, bounds[k].1));
    let evaluate = |x: &DVector<f64>| evaluate(x.as_slice()).map(|(f, g)| (f, DVector::from_vec(g)));
    let mut at = clamped(&DVector::from_column_slice(start.at));
    let (mut value, mut gradient) = evaluate(&at)?;
    let mut inverse = start.inverse;
    let (mut outcome, mut promised) = ((false, most_steps), f64::INFINITY);
    for step in 0..most_steps {
        let free = free(&at, &gradient, bounds);
        let direction = direction(inverse.as_ref(), &gradient, &free);
        let promise = -gradient.dot(&direction) / 2.0;
        // A promise is trusted only with a curvature that was learnt.
        if promise < gain && (inverse.is_some() || gradient_of(&gradient, &free).amax() < gain) {
            outcome = (true, step);
            break;
        }
        let Some(found) = search(&at, value, &gradient, &direction, &clamped, &evaluate) else {
            // No step along the curvature is better: follow the gradient alone. None along that either: only rounding is left,
            // and what the curvature promised says whether it hides anything that matters.
            promised = promised.min(promise);
            if promised >= HIDDEN * gain && inverse.take().is_some() {
                continue;
            }
            outcome = (promised < HIDDEN * gain, step);
            break;
        };
        promised = f64::INFINITY;
        let (next, next_value, next_gradient) = found;
        update(&mut inverse, &(&next - &at), &(&next_gradient - &gradient));
        (at, value, gradient) = (next, next_value, next_gradient);
    }
    let (is_settled, steps) = outcome;
    Some(Minimum { at: at.as_slice().to_vec(), value, is_settled, steps, inverse })
}

/// Variables that may move: not at a bound that the descent pushes against.
fn free(at: &DVector<f64>, gradient: &DVector<f64>, bounds: &[(f64, f64)]) -> Vec<bool> {
    let held = |k: usize| (at[k] <= bounds[k].0 && gradient[k] > 0.0) || (at[k] >= bounds[k].1 && gradient[k] < 0.0);
    (0..at.len()).map(|k| !held(k)).collect()
}

fn gradient_of(gradient: &DVector<f64>, free: &[bool]) -> DVector<f64> {
    DVector::from_fn(gradient.len(), |k, _| if free[k] { gradient[k] } else { 0.0 })
}

/// Quasi-Newton direction in the free variables; a scaled gradient before any curvature is known.
fn direction(inverse: Option<&DMatrix<f64>>, gradient: &DVector<f64>, free: &[bool]) -> DVector<f64> {
    let own = gradient_of(gradient, free);
    let newton = inverse.map(|inverse| gradient_of(&-(inverse * &own), free)).filter(|d| d.dot(&own) < 0.0);
    let direction = newton.unwrap_or_else(|| -&own / own.amax().max(1.0));
    let longest = direction.amax();
    if longest > LONGEST_STEP { direction * (LONGEST_STEP / longest) } else { direction }
}

type Point = (DVector<f64>, f64, DVector<f64>);

/// The first of ever shorter steps that keeps enough of its promise.
fn search(
    at: &DVector<f64>,
    value: f64,
    gradient: &DVector<f64>,
    direction: &DVector<f64>,
    clamped: &impl Fn(&DVector<f64>) -> DVector<f64>,
    evaluate: &impl Fn(&DVector<f64>) -> Option<(f64, DVector<f64>)>,
) -> Option<Point> {
    let mut length = 1.0;
    for _ in 0..MOST_HALVINGS {
        let next = clamped(&(at + direction * length));
        let promised = gradient.dot(&(&next - at));
        if let Some((next_value, next_gradient)) = evaluate(&next)
            && promised < 0.0
            && next_value <= value + SUFFICIENT * promised
        {
            return Some((next, next_value, next_gradient));
        }
        length /= 2.0;
    }
    None
}

/// BFGS update of the inverse curvature, left as it is where the step saw none. The gradient along a variable that stayed at
/// its bound changes with the others, which says nothing of the curvature among them: counted, it would make steps too long.
fn update(inverse: &mut Option<DMatrix<f64>>, step: &DVector<f64>, change: &DVector<f64>) {
    let change = &change.zip_map(step, |change, step| if step == 0.0 { 0.0 } else { change });
    let curvature = step.dot(change);
    if curvature <= 1e-12 * step.norm() * change.norm() {
        return;
    }
    let size = step.len();
    let before = inverse.take().unwrap_or_else(|| DMatrix::identity(size, size) * (curvature / change.norm_squared()));
    let left = DMatrix::identity(size, size) - step * change.transpose() / curvature;
    *inverse = Some(&left * before * left.transpose() + step * step.transpose() / curvature);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's valley.
    fn valley(x: &[f64]) -> Evaluation {
        let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
        Some((a * a + 100.0 * b * b, vec![-2.0 * a - 400.0 * x[0] * b, 200.0 * b]))
    }

    fn from(at: &[f64]) -> Start<'_> {
        Start { at, inverse: None }
    }

    #[test]
    fn a_curved_valley_is_followed_to_its_minimum() {
        let found = minimum(valley, from(&[-1.2, 1.0]), &[(-5.0, 5.0), (-5.0, 5.0)], 1e-14, 200).unwrap();
        assert!(found.is_settled && (found.at[0] - 1.0).abs() < 1e-5 && (found.at[1] - 1.0).abs() < 1e-5, "{found:?}");
    }

    #[test]
    fn a_minimum_beyond_a_bound_is_found_on_the_bound() {
        // On x = 0.5 the valley is lowest at y = 0.25.
        let found = minimum(valley, from(&[-1.2, 1.0]), &[(-5.0, 0.5), (-5.0, 5.0)], 1e-14, 200).unwrap();
        assert!(found.is_settled && found.at[0] == 0.5 && (found.at[1] - 0.25).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn a_variable_at_its_bound_does_not_disturb_the_curvature_of_the_others() {
        // A bowl in x and y; z is pushed against its bound by a gradient that changes steeply with both.
        let bowl = |v: &[f64]| {
            let [x, y, z] = [v[0], v[1], v[2]];
            let value = x * x + 4.0 * y * y + 0.5 * x * y + z * (300.0 + 100.0 * x - 60.0 * y);
            let gradient =
                vec![2.0 * x + 0.5 * y + 100.0 * z, 8.0 * y + 0.5 * x - 60.0 * z, 300.0 + 100.0 * x - 60.0 * y];
            Some((value, gradient))
        };
        let found =
            minimum(bowl, from(&[1.0, -1.5, 0.0]), &[(-2.0, 2.0), (-2.0, 2.0), (0.0, 1.0)], 1e-14, 200).unwrap();
        assert!(found.is_settled && found.steps < 15, "{found:?}");
        assert!(found.at[0].abs() < 1e-6 && found.at[1].abs() < 1e-6 && found.at[2] == 0.0, "{found:?}");
    }

    #[test]
    fn an_undefined_start_has_no_minimum_and_undefined_steps_are_shortened() {
        assert_eq!(minimum(|_| None, from(&[0.0]), &[(-1.0, 1.0)], 1e-9, 10), None);
        let half = |x: &[f64]| (x[0] > 0.0).then(|| (x[0] - x[0].ln(), vec![1.0 - 1.0 / x[0]]));
        let found = minimum(half, from(&[3.0]), &[(-10.0, 10.0)], 1e-14, 100).unwrap();
        assert!(found.is_settled && (found.at[0] - 1.0).abs() < 1e-6, "{found:?}");
    }
}
