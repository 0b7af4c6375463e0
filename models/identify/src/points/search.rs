//! JADE on the objective of measured positions, from least squares with perturbations.
//!
//! Place in the flow: the other way of [`super::fit_points`]. Source: Liang 2025, eq. 10 (each member is the least-squares
//! estimate plus a small random perturbation) and eq. 11 (the objective). Perturbations are normal, in units of each
//! unknown's uncertainty, so that "small" has the same meaning for metres and radians.

use super::certificate::{certify, widening};
use super::levenberg_marquardt::Descent;
use super::loss::{Loss, kept_points};
use super::problem::Problem;
use super::{JadeChoices, PointProgress, PointsError};
use crate::jade::{Ended, Generation, JadeOptions, minimise, perturbed_population};

/// Members for each unknown, where the caller names no number; the source's populations are three to four.
const MEMBERS_PER_UNKNOWN: usize = 4;
/// The population agrees when its values differ by this share of the noise of one equation: unknowns then lie within 3 % of
/// their uncertainty.
const AGREEMENT: f64 = 1e-3;

/// JADE from a least-squares estimate; `scale` is Huber's.
pub(super) fn search(
    problem: &Problem,
    estimate: &[f64],
    (loss, scale): (Loss, f64),
    choices: &JadeChoices,
    observe: &mut dyn FnMut(PointProgress) -> bool,
) -> Result<(Descent, usize), PointsError> {
    if !(choices.perturbation.is_finite() && choices.perturbation > 0.0) {
        return Err(PointsError::Choice("the perturbation of the first population must be a finite number above 0"));
    }
    let weights = vec![1.0; problem.points.len()];
    let start = certify(problem, estimate, &weights)?;
    let widening = widening(start.chi2_per_dof);
    let deviation = |k: usize| choices.perturbation * (start.inverse[(k, k)] * widening).sqrt();
    let deviations: Vec<f64> = (0..estimate.len()).map(deviation).collect();
    let members = choices.members.unwrap_or(MEMBERS_PER_UNKNOWN * estimate.len());
    let first = perturbed_population(estimate, &deviations, members, choices.seed)?;
    let equations = match loss {
        Loss::Trimmed => 3 * kept_points(problem.points.len(), estimate.len()),
        Loss::Squares | Loss::Huber => 3 * problem.points.len(),
    };
    let noise = problem.objective(estimate, loss, scale) / equations as f64;
    let options = JadeOptions {
        seed: choices.seed,
        max_generations: choices.max_generations,
        agreement: AGREEMENT * noise,
        ..JadeOptions::default()
    };
    let function = |unknowns: &[f64]| problem.objective(unknowns, loss, scale);
    let mut report = |g: &Generation| {
        observe(PointProgress { step: g.number, objective: g.best_value, spread: g.worst_value - g.best_value })
    };
    let found = minimise(&function, first, None, &options, &mut report)?;
    if found.ended == Ended::Stopped {
        return Err(PointsError::Stopped);
    }
    let weights = loss.weights(&problem.squares(&found.point), found.point.len(), scale);
    let (unknowns, objective) = (found.point, found.value);
    Ok((Descent { unknowns, objective, scale, weights, steps: found.generations }, found.evaluations))
}
