//! Levenberg-Marquardt on the objective of measured positions.
//!
//! Place in the flow: the usual way of [`super::fit_points`]. A step solves (JᵀWJ + μ D) δ = JᵀWr with D the diagonal of JᵀJ
//! (Marquardt 1963: the damping has the units of the unknowns; all points are in D, since those that a loss keeps for the
//! moment need not see everything) and the weights that the loss gives at the present unknowns, and is taken only if the
//! objective falls. For trimmed squares these are the concentration steps of Rousseeuw & Van Driessen 2006.

use super::loss::Loss;
use super::problem::Problem;
use super::{PointProgress, PointsError};
use crate::linear::{Factor, select};
use crate::normal::NormalEquations;
use faer::Mat;

/// Length of a step, in standard deviations of the noise, from which nothing is left to gain.
const SETTLED: f64 = 1e-3;
/// The same where steps end without that: how near the minimum is, the certificate of the fit says.
const NEAR: f64 = 0.1;
/// Damping of the first step: the problem is nearly linear.
const FIRST_DAMPING: f64 = 1e-6;
/// Smallest damping: enough to hold what the kept points do not see, too little to slow down what they do.
const LEAST_DAMPING: f64 = 1e-10;
/// Damping beyond which a step no longer changes anything.
const LARGEST_DAMPING: f64 = 1e12;
/// Steps taken or tried at most.
const MAX_STEPS: usize = 300;
/// Rounds in which Huber's scale follows the residuals.
const SCALE_ROUNDS: usize = 20;
/// Relative change of the scale that ends them.
const SCALE_SETTLED: f64 = 1e-3;

/// Where the descent ended.
pub(super) struct Descent {
    pub(super) unknowns: Vec<f64>,
    pub(super) objective: f64,
    /// Robust standard deviation in units of the declared one, where the loss needs it.
    pub(super) scale: f64,
    pub(super) weights: Vec<f64>,
    pub(super) steps: usize,
}

/// From `start` to a minimum of the loss.
pub(super) fn descend(
    problem: &Problem,
    start: Vec<f64>,
    loss: Loss,
    observe: &mut dyn FnMut(PointProgress) -> bool,
) -> Result<Descent, PointsError> {
    let mut found = descend_at_scale(problem, start, loss, 1.0, 0, observe)?;
    if loss != Loss::Huber {
        return Ok(found);
    }
    for _ in 0..SCALE_ROUNDS {
        let scale = problem.scale(&found.unknowns).max(f64::MIN_POSITIVE);
        let moved = (scale / found.scale - 1.0).abs();
        found = descend_at_scale(problem, found.unknowns, loss, scale, found.steps, observe)?;
        if moved < SCALE_SETTLED {
            return Ok(found);
        }
    }
    Ok(found)
}

/// The same with a scale that stays.
pub(super) fn descend_at_scale(
    problem: &Problem,
    start: Vec<f64>,
    loss: Loss,
    scale: f64,
    steps_before: usize,
    observe: &mut dyn FnMut(PointProgress) -> bool,
) -> Result<Descent, PointsError> {
    let mut unknowns = start;
    let mut damping = FIRST_DAMPING;
    let mut objective = problem.objective(&unknowns, loss, scale);
    let mut weights = loss.weights(&problem.squares(&unknowns), unknowns.len(), scale);
    let mut normal = problem.normal(&unknowns, &weights);
    let whole = problem.normal(&unknowns, &vec![1.0; weights.len()]);
    let mut length = f64::INFINITY;
    for step in 1..=MAX_STEPS {
        let change = damped_step(&normal, &whole, damping)?;
        length = change.iter().zip(&normal.gradient).map(|(d, g)| d * g).sum::<f64>().max(0.0).sqrt();
        let tried: Vec<f64> = unknowns.iter().zip(&change).map(|(x, d)| x + d).collect();
        let value = problem.objective(&tried, loss, scale);
        let steps = steps_before + step;
        if !observe(PointProgress { step: steps, objective: value.min(objective), spread: (objective - value).abs() }) {
            return Err(PointsError::Stopped);
        }
        if value <= objective {
            (unknowns, objective) = (tried, value);
            damping = (damping / 10.0).max(LEAST_DAMPING);
            weights = loss.weights(&problem.squares(&unknowns), unknowns.len(), scale);
        }
        // A step this short that did not help met rounding, not a hill.
        if length < SETTLED {
            return Ok(Descent { unknowns, objective, scale, weights, steps });
        }
        if value > objective {
            damping *= 10.0;
            if damping > LARGEST_DAMPING {
                break;
            }
        } else {
            normal = problem.normal(&unknowns, &weights);
        }
    }
    let steps = steps_before + MAX_STEPS;
    if length < NEAR {
        return Ok(Descent { unknowns, objective, scale, weights, steps });
    }
    let remedy = "check the points for mixed-up offsets or readings";
    Err(PointsError::NotConverged { method: "Levenberg-Marquardt", steps, largest_step: length, remedy })
}

fn damped_step(normal: &NormalEquations, whole: &NormalEquations, damping: f64) -> Result<Vec<f64>, PointsError> {
    let all: Vec<usize> = (0..normal.size).collect();
    let mut matrix: Mat<f64> = select(&normal.matrix, normal.size, &all);
    for k in 0..normal.size {
        matrix[(k, k)] += damping * whole.entry(k, k);
    }
    let factor = Factor::new(&matrix).map_err(|_| PointsError::Singular)?;
    Ok(factor.solve(&normal.gradient))
}
