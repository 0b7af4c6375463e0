//! Penalised solve and the choice of smoothness by restricted marginal likelihood.
//!
//! Place in the flow: takes the normal equations of one pass, returns the new parameters, their covariance and
//! the effective degrees of freedom of each error function. Each spline carries its own penalty λ ∫ w f″² with the
//! profile w of [`crate::roughness`]; the λ are found by the generalised Fellner-Schall update (Wood & Fasiolo 2017, Biometrics 73, eq. 4), which needs
//! only the normal equations, so the cost does not grow with the readings; half of its updates are saved by [`crate::anderson`]. The standard deviation σ = λ^(−½) of each
//! curvature has the prior density ∝ σ (Chung et al. 2013, Psychometrika 78: a gamma density of shape 2 and rate 0):
//! without it the likelihood is often largest at σ = 0, where a function whose curvature the data cannot see counts
//! as certainly straight, and its uncertainty is far too small.

use crate::anderson::Anderson;
use crate::linear::{Factor, NotPositiveDefinite, select};
use crate::normal::NormalEquations;
use crate::roughness::{Curvature, Roughness};
use abbe_geometry::ErrorId;
use abbe_geometry::error_function::{Closure, FunctionKind};
use abbe_geometry::layout::Layout;
use faer::Mat;
use std::ops::Range;
use std::sync::Arc;

#[cfg(test)]
mod tests;

/// Updates after which the smoothness is taken as it is: it then changes by less than the data can tell.
const MAX_UPDATES: usize = 60;
/// Change of the effective degrees of freedom of a function that ends the search.
const DEGREES_TOLERANCE: f64 = 0.01;
/// Change that the next update still asks for, in standard deviations of what the data tell of it, below which the search may end.
const UPDATE_TOLERANCE: f64 = 0.1;
/// Growth of −2 log likelihood from which an accelerated step is not taken; less is rounding, or the noise that was estimated anew.
const WORSE: f64 = 1e-3;
/// Bounds of the penalty relative to its start: beyond these a function is a straight line, or free.
const PENALTY_SPAN: f64 = 1e10;
/// Largest factor by which one update may move a penalty.
const PENALTY_STEP: f64 = 1e3;
/// Range of the exponent: from ends like the middle to ends that may bend as polynomials do.
const EXPONENTS: (f64, f64) = (0.0, 2.0);
/// Largest change of the exponent in one update.
const EXPONENT_STEP: f64 = 0.25;

/// One penalised error function.
#[derive(Debug, Clone)]
pub(crate) struct Penalty {
    /// Its parameters.
    pub(crate) range: Range<usize>,
    /// Factor λ; 0 before the first solve.
    pub(crate) lambda: f64,
    /// First λ, which bounds the search.
    first_lambda: f64,
    /// Rank of the roughness matrix.
    rank: f64,
    /// Which of [`Smoothness::curvatures`] it has.
    curvature: usize,
    roughness: Arc<Roughness>,
}

impl Penalty {
    /// Log determinant of the prior's precision.
    fn log_prior(&self) -> f64 {
        self.rank * self.log_of_lambda() + self.roughness.log_determinant
    }

    /// Also −2 log of the density ∝ λ^(−½) of the curvature's standard deviation.
    fn log_of_lambda(&self) -> f64 {
        self.lambda.max(f64::MIN_POSITIVE).ln()
    }

    /// This λ, as far as one update may go towards it.
    fn within_bounds(&self, lambda: f64) -> f64 {
        let near = lambda.clamp(self.lambda / PENALTY_STEP, self.lambda * PENALTY_STEP);
        near.clamp(self.first_lambda / PENALTY_SPAN, self.first_lambda * PENALTY_SPAN)
    }

    /// βᵀMβ of the function's own coefficients.
    fn quadratic(&self, matrix: &[f64], parameters: &[f64]) -> f64 {
        let n = self.range.len();
        let f = &parameters[self.range.clone()];
        (0..n).map(|i| f[i] * (0..n).map(|j| matrix[i * n + j] * f[j]).sum::<f64>()).sum()
    }
}

/// The penalties of all splines and the profile they share.
#[derive(Debug, Clone, Default)]
pub(crate) struct Smoothness {
    pub(crate) penalties: Vec<Penalty>,
    /// Parameters with a prior about zero (turn of the ram, effects), and its standard deviation.
    pub(crate) priors: Vec<(usize, f64)>,
    curvatures: Vec<Curvature>,
    exponent: f64,
}

impl Smoothness {
    /// A penalty on the curvature of every spline.
    pub(crate) fn new(layout: &Layout) -> Smoothness {
        let mut smoothness = Smoothness::default();
        let mut known: Vec<(FunctionKind, Closure)> = Vec::new();
        for id in ErrorId::all() {
            let Some(basis) = layout.basis(id) else { continue };
            let key = (basis.kind(), basis.closure());
            if !known.contains(&key) {
                let Some(curvature) = Curvature::new(basis) else { continue };
                known.push(key);
                smoothness.curvatures.push(curvature);
            }
            let Some(curvature) = known.iter().position(|k| *k == key) else { continue };
            let own = &smoothness.curvatures[curvature];
            let Some(roughness) = own.at(EXPONENTS.0) else { continue };
            let (rank, range) = (own.rank() as f64, layout.range(id));
            let roughness = Arc::new(roughness);
            smoothness.penalties.push(Penalty { range, lambda: 0.0, first_lambda: 0.0, rank, curvature, roughness });
        }
        smoothness
    }

    /// Precision of the free parameters' prior for unit noise where the noise factor is this, and its rank.
    pub(crate) fn precision(&self, free: &[usize], noise_factor: f64) -> (Mat<f64>, usize) {
        let place = |index: usize| free.iter().position(|k| *k == index);
        let (mut precision, mut rank) = (Mat::zeros(free.len(), free.len()), 0);
        for penalty in &self.penalties {
            let n = penalty.range.len();
            let places: Vec<Option<usize>> = penalty.range.clone().map(place).collect();
            for (i, row) in places.iter().enumerate() {
                for (j, column) in places.iter().enumerate() {
                    if let (Some(a), Some(b)) = (row, column) {
                        precision[(*a, *b)] += noise_factor * penalty.lambda * penalty.roughness.matrix[i * n + j];
                    }
                }
            }
            rank += penalty.rank as usize;
        }
        for (index, size) in &self.priors {
            if let Some(a) = place(*index) {
                precision[(a, a)] += noise_factor / (size * size);
                rank += 1;
            }
        }
        (precision, rank)
    }

    /// Exponent of the profile.
    pub(crate) fn exponent(&self) -> f64 {
        self.exponent
    }

    /// Takes these penalties instead of choosing them; a function without one is free.
    pub(crate) fn believe(&mut self, exponent: f64, lambda: impl Fn(&Range<usize>) -> Option<f64>) {
        self.set_exponent(exponent);
        self.penalties.retain_mut(|penalty| {
            let believed = lambda(&penalty.range);
            (penalty.lambda, penalty.first_lambda) = (believed.unwrap_or(0.0), believed.unwrap_or(0.0));
            believed.is_some()
        });
    }

    /// Recomputes the roughness matrices for another exponent.
    fn set_exponent(&mut self, exponent: f64) {
        let Some(roughness) = self.curvatures.iter().map(|c| c.at(exponent).map(Arc::new)).collect::<Option<Vec<_>>>()
        else {
            return;
        };
        self.exponent = exponent;
        self.penalties.iter_mut().for_each(|penalty| penalty.roughness = Arc::clone(&roughness[penalty.curvature]));
    }

    /// Takes logarithms of the penalties, in their order, and the exponent, all within their bounds.
    fn take(&mut self, values: &[f64]) {
        for (penalty, log_lambda) in self.penalties.iter_mut().zip(values) {
            penalty.lambda = penalty.within_bounds(log_lambda.exp());
        }
        if let Some(exponent) = values.get(self.penalties.len()) {
            self.set_exponent(exponent.clamp(EXPONENTS.0, EXPONENTS.1));
        }
    }

    /// First penalty: prior information equal to a thousandth of the data's, per function.
    fn start(&mut self, normal: &NormalEquations) {
        for penalty in self.penalties.iter_mut().filter(|p| p.lambda == 0.0) {
            let n = penalty.range.len();
            let data: f64 = penalty.range.clone().map(|k| normal.entry(k, k)).sum();
            let rough: f64 = (0..n).map(|k| penalty.roughness.matrix[k * n + k]).sum();
            penalty.lambda = 1e-3 * (data / rough.max(f64::MIN_POSITIVE)).max(f64::MIN_POSITIVE);
            penalty.first_lambda = penalty.lambda;
        }
    }
}

/// Result of one penalised solve.
pub(crate) struct Solution {
    /// New values of all parameters; those that are not free are zero.
    pub(crate) parameters: Vec<f64>,
    /// Covariance of the free parameters, scaled by the noise factor.
    pub(crate) covariance: Mat<f64>,
    /// Effective degrees of freedom of each free parameter; their sum is the model's.
    pub(crate) effective: Vec<f64>,
    /// Noise factor φ: χ² per degree of freedom.
    pub(crate) noise_factor: f64,
    /// −2 log of the restricted marginal likelihood, up to a constant of the data; smaller is better.
    pub(crate) minus_two_log_likelihood: f64,
}

impl Solution {
    /// Largest component of the step from these parameters, in units of the uncertainty of the free ones.
    pub(crate) fn largest_step(&self, from: &[f64], free: &[usize]) -> f64 {
        let mut largest: f64 = 0.0;
        for (k, index) in free.iter().enumerate() {
            let step = (self.parameters[*index] - from[*index]).abs() / self.covariance[(k, k)].sqrt();
            // A step that is no number is not settled; `max` would pass over it.
            largest = if step.is_nan() || largest.is_nan() { f64::NAN } else { largest.max(step) };
        }
        largest
    }
}

/// Solves for the free parameters; `choose` lets the data choose the smoothness.
pub(crate) fn solve(
    normal: &NormalEquations,
    at: &[f64],
    free: &[usize],
    smoothness: &mut Smoothness,
    noise_factor: f64,
    choose: bool,
) -> Result<Solution, NotPositiveDefinite> {
    let problem = Problem::new(normal, at, free);
    smoothness.start(normal);
    let mut solution = problem.solve(smoothness, noise_factor)?;
    if !choose || smoothness.penalties.is_empty() {
        return Ok(solution);
    }
    let (mut anderson, mut moved) = (Anderson::default(), f64::INFINITY);
    for _ in 0..MAX_UPDATES {
        let update = problem.update(smoothness, &solution);
        // A function that is free or straight does not change however far its penalty still has to go.
        if moved < DEGREES_TOLERANCE && update.largest() < UPDATE_TOLERANCE {
            break;
        }
        let next = problem.step(smoothness, &solution, &update, &mut anderson)?;
        moved = problem.largest_change_of_degrees(&smoothness.penalties, &solution, &next);
        solution = next;
    }
    Ok(solution)
}

/// The quadratic problem around the parameters of one pass. Parameters that are not free go to zero: they are dropped
/// coefficients.
struct Problem<'a> {
    normal: &'a NormalEquations,
    at: &'a [f64],
    free: &'a [usize],
    /// Position of each parameter among the free ones.
    place: Vec<Option<usize>>,
    data: Mat<f64>,
    /// Data part of the right-hand side for changes of the free parameters, the others being zero.
    right: Vec<f64>,
    /// Σ w (r/u)² with the others at zero.
    weighted_square: f64,
}

impl<'a> Problem<'a> {
    fn new(normal: &'a NormalEquations, at: &'a [f64], free: &'a [usize]) -> Problem<'a> {
        let mut place = vec![None; normal.size];
        free.iter().enumerate().for_each(|(k, index)| place[*index] = Some(k));
        let data = select(&normal.matrix, normal.size, free);
        let dropped: Vec<usize> = (0..normal.size).filter(|k| place[*k].is_none() && at[*k] != 0.0).collect();
        let coupling = |index: usize| dropped.iter().map(|d| normal.entry(index, *d) * at[*d]).sum::<f64>();
        let right = free.iter().map(|index| normal.gradient[*index] + coupling(*index)).collect();
        let grown: f64 = dropped.iter().map(|d| at[*d] * (2.0 * normal.gradient[*d] + coupling(*d))).sum();
        Problem { normal, at, free, place, data, right, weighted_square: normal.weighted_square + grown }
    }

    fn solve(&self, smoothness: &Smoothness, phi: f64) -> Result<Solution, NotPositiveDefinite> {
        let penalties = &smoothness.penalties;
        let mut system = self.data.clone();
        let mut right = self.right.clone();
        for penalty in penalties {
            let n = penalty.range.len();
            for (i, row) in penalty.range.clone().enumerate() {
                for (j, column) in penalty.range.clone().enumerate() {
                    if let (Some(a), Some(b)) = (self.place[row], self.place[column]) {
                        let stiffness = phi * penalty.lambda * penalty.roughness.matrix[i * n + j];
                        system[(a, b)] += stiffness;
                        right[a] -= stiffness * self.at[column];
                    }
                }
            }
        }
        for (index, size) in &smoothness.priors {
            if let Some(a) = self.place[*index] {
                let stiffness = phi / (size * size);
                system[(a, a)] += stiffness;
                right[a] -= stiffness * self.at[*index];
            }
        }
        let factor = Factor::new(&system)?;
        // Changes, not values, are solved for: a station stands metres away and moves by nanometres.
        let change = factor.solve(&right);
        let inverse = factor.inverse();
        let mut parameters = vec![0.0; self.at.len()];
        self.free.iter().zip(&change).for_each(|(index, change)| parameters[*index] = self.at[*index] + change);
        let effective = (0..self.free.len())
            .map(|k| inverse.col(k).iter().zip(self.data.col(k).iter()).map(|(a, b)| a * b).sum())
            .collect::<Vec<f64>>();
        let chi2 = self.chi2(&change);
        let degrees = (self.normal.weight - effective.iter().sum::<f64>()).max(1.0);
        let noise_factor = chi2 / degrees;
        let covariance = faer::Scale(noise_factor_for_covariance(noise_factor)) * inverse;
        let prior =
            |p: &Penalty| p.lambda * p.quadratic(&p.roughness.matrix, &parameters) - p.log_prior() + p.log_of_lambda();
        let minus_two_log_likelihood = chi2 / phi
            + penalties.iter().map(prior).sum::<f64>()
            + smoothness.priors.iter().map(|(k, size)| (parameters[*k] / size).powi(2) + 2.0 * size.ln()).sum::<f64>()
            + (self.normal.weight - self.free.len() as f64) * phi.ln()
            + self.normal.log_determinant
            + factor.log_determinant();
        Ok(Solution { parameters, covariance, effective, noise_factor, minus_two_log_likelihood })
    }

    /// χ² predicted after these changes by the quadratic form.
    fn chi2(&self, change: &[f64]) -> f64 {
        let curved = &self.data * Mat::from_fn(change.len(), 1, |k, _| change[k]);
        let reduction: f64 =
            change.iter().enumerate().map(|(k, change)| change * (2.0 * self.right[k] - curved[(k, 0)])).sum();
        (self.weighted_square - reduction).max(0.0)
    }

    /// Takes one update, accelerated where that explains the data no worse.
    fn step(
        &self,
        smoothness: &mut Smoothness,
        solution: &Solution,
        update: &Update,
        anderson: &mut Anderson,
    ) -> Result<Solution, NotPositiveDefinite> {
        let accelerated = anderson.step(&update.from, &update.to, &update.weights);
        if accelerated != update.to {
            let mut ahead = smoothness.clone();
            ahead.take(&accelerated);
            let next = self.solve(&ahead, solution.noise_factor).ok();
            let no_worse = solution.minus_two_log_likelihood + WORSE;
            if let Some(next) = next.filter(|next| next.minus_two_log_likelihood <= no_worse) {
                *smoothness = ahead;
                return Ok(next);
            }
            // Far from the end an update hardly changes from one to the next, and what the last ones did leads anywhere.
            anderson.forget();
            anderson.step(&update.from, &update.to, &update.weights);
        }
        smoothness.take(&update.to);
        self.solve(smoothness, solution.noise_factor)
    }

    /// One update of all that the smoothness is told by: logarithms of the penalties, in their order, and the exponent.
    fn update(&self, smoothness: &Smoothness, solution: &Solution) -> Update {
        let (exponent, information) = self.better_exponent(smoothness, solution);
        let mut update = Update { from: Vec::new(), to: Vec::new(), weights: Vec::new() };
        for penalty in &smoothness.penalties {
            let (wanted, degrees) = self.wanted(penalty, solution);
            let to = wanted.max(f64::MIN_POSITIVE).ln();
            update.push((penalty.log_of_lambda(), to), degrees / (2.0 * penalty.rank).sqrt());
        }
        update.push((smoothness.exponent, exponent), (0.5 * information).sqrt());
        update
    }

    /// λ ← (rank − λ tr(V S)) / (βᵀ S β + 1/λ); the 1/λ comes from the prior of σ. Beside it the degrees of freedom that the data determine.
    fn wanted(&self, penalty: &Penalty, solution: &Solution) -> (f64, f64) {
        let trace = self.trace(penalty, &penalty.roughness.matrix, solution);
        let quadratic = penalty.quadratic(&penalty.roughness.matrix, &solution.parameters);
        let degrees = (penalty.rank - penalty.lambda * trace).max(0.0);
        let wanted = degrees / (quadratic + 1.0 / penalty.lambda);
        (penalty.within_bounds(wanted), degrees)
    }

    /// One scoring step of the exponent: the slope of −2 log likelihood over the information that exactly known curves
    /// would give, which is an upper bound, so that the steps do not overshoot; with that information.
    fn better_exponent(&self, smoothness: &Smoothness, solution: &Solution) -> (f64, f64) {
        let (mut slope, mut information) = (0.0, 0.0);
        for penalty in &smoothness.penalties {
            let matrix = &penalty.roughness.slope;
            let spread = self.trace(penalty, matrix, solution) + penalty.quadratic(matrix, &solution.parameters);
            slope += penalty.lambda * spread - penalty.roughness.log_determinant_slope;
            information += penalty.roughness.information;
        }
        let step = (-slope / information.max(f64::MIN_POSITIVE)).clamp(-EXPONENT_STEP, EXPONENT_STEP);
        ((smoothness.exponent + step).clamp(EXPONENTS.0, EXPONENTS.1), information)
    }

    /// tr(V M) over the function's own coefficients, V without the widening of [`noise_factor_for_covariance`].
    fn trace(&self, penalty: &Penalty, matrix: &[f64], solution: &Solution) -> f64 {
        let n = penalty.range.len();
        let scale = solution.noise_factor / noise_factor_for_covariance(solution.noise_factor);
        let mut trace = 0.0;
        for (i, row) in penalty.range.clone().enumerate() {
            for (j, column) in penalty.range.clone().enumerate() {
                if let (Some(a), Some(b)) = (self.place[row], self.place[column]) {
                    trace += scale * solution.covariance[(a, b)] * matrix[i * n + j];
                }
            }
        }
        trace
    }

    fn largest_change_of_degrees(&self, penalties: &[Penalty], before: &Solution, after: &Solution) -> f64 {
        let degrees = |penalty: &Penalty, solution: &Solution| -> f64 {
            penalty.range.clone().filter_map(|k| self.place[k]).map(|k| solution.effective[k]).sum()
        };
        penalties.iter().map(|p| (degrees(p, before) - degrees(p, after)).abs()).fold(0.0, f64::max)
    }
}

/// Where an update leads, and how much a change of each number matters.
struct Update {
    from: Vec<f64>,
    to: Vec<f64>,
    weights: Vec<f64>,
}

impl Update {
    /// Largest change that it asks for, in standard deviations of what the data tell of it.
    fn largest(&self) -> f64 {
        let changes = self.from.iter().zip(&self.to).zip(&self.weights);
        changes.map(|((from, to), weight)| ((to - from) * weight).abs()).fold(0.0, f64::max)
    }

    fn push(&mut self, (from, to): (f64, f64), weight: f64) {
        self.from.push(from);
        self.to.push(to);
        self.weights.push(weight);
    }
}

/// The declared noise is the least that is believed: a covariance is widened by misfit, never narrowed by luck.
pub(crate) fn noise_factor_for_covariance(noise_factor: f64) -> f64 {
    noise_factor.max(1.0)
}
