//! Penalised solve and the choice of smoothness by restricted marginal likelihood.
//!
//! Place in the flow: takes the normal equations of one pass, returns the new parameters, their covariance and
//! the effective degrees of freedom of each error function. Each spline carries its own penalty λ ∫ f″²; the λ
//! are found by the generalised Fellner-Schall update (Wood & Fasiolo 2017, Biometrics 73, eq. 4), which needs
//! only the normal equations, so the cost does not grow with the readings.

use crate::linear::{Factor, NotPositiveDefinite, select, symmetric_eigen};
use crate::normal::NormalEquations;
use abbe_geometry::error_function::{Basis, Closure};
use faer::Mat;
use std::ops::Range;

/// Updates after which the smoothness is taken as it is: it then changes by less than the data can tell.
const MAX_UPDATES: usize = 60;
/// Change of the effective degrees of freedom that ends the search.
const DEGREES_TOLERANCE: f64 = 0.01;
/// Bounds of the penalty relative to its start: beyond these a function is a straight line, or free.
const PENALTY_SPAN: f64 = 1e10;
/// Largest factor by which one update may move a penalty.
const PENALTY_STEP: f64 = 1e3;

/// One penalised error function.
#[derive(Debug, Clone)]
pub(crate) struct Penalty {
    /// Its parameters.
    pub(crate) range: Range<usize>,
    /// Roughness matrix, row-major.
    pub(crate) roughness: Vec<f64>,
    /// Rank of the roughness matrix.
    pub(crate) rank: f64,
    /// Sum of the logarithms of the roughness matrix' non-zero eigenvalues, less twice that of the length of the
    /// straight line's coefficients: makes likelihoods of splines with different intervals comparable.
    pub(crate) log_determinant: f64,
    /// Current factor λ, and the one it started from; 0 before the first solve.
    pub(crate) lambda: f64,
    /// First λ, which bounds the search.
    pub(crate) first_lambda: f64,
}

impl Penalty {
    /// Curvature penalty of one spline; `None` where it has no curvature to penalise.
    pub(crate) fn new(range: Range<usize>, basis: &Basis) -> Option<Penalty> {
        let n = basis.len();
        let roughness = basis.roughness();
        // The straight line is the one shape without curvature; a closed function has none left.
        let open = basis.closure() == Closure::Origin;
        let rank = n - usize::from(open);
        let (values, _) = symmetric_eigen(&Mat::from_fn(n, n, |i, j| roughness[i * n + j]))?;
        let curved: f64 = values[n - rank..].iter().map(|v| v.ln()).sum();
        let line: f64 = if open { basis.coefficients_of_power(1).iter().map(|c| c * c).sum() } else { 1.0 };
        let log_determinant = curved - line.ln();
        let penalty = Penalty { range, roughness, rank: rank as f64, log_determinant, lambda: 0.0, first_lambda: 0.0 };
        (rank > 0).then_some(penalty)
    }

    /// Log determinant of the prior's precision.
    fn log_prior(&self) -> f64 {
        self.rank * self.lambda.max(f64::MIN_POSITIVE).ln() + self.log_determinant
    }

    fn quadratic(&self, parameters: &[f64]) -> f64 {
        let n = self.range.len();
        let f = &parameters[self.range.clone()];
        (0..n).map(|i| f[i] * (0..n).map(|j| self.roughness[i * n + j] * f[j]).sum::<f64>()).sum()
    }
}

/// Result of one penalised solve.
pub(crate) struct Solution {
    /// New values of all parameters; those that are not free keep theirs.
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

/// Solves for the free parameters; `update_penalties` lets the data choose the smoothness.
pub(crate) fn solve(
    normal: &NormalEquations,
    at: &[f64],
    free: &[usize],
    penalties: &mut [Penalty],
    noise_factor: f64,
    update_penalties: bool,
) -> Result<Solution, NotPositiveDefinite> {
    let problem = Problem::new(normal, at, free);
    start_penalties(normal, penalties);
    let mut solution = problem.solve(penalties, noise_factor)?;
    if !update_penalties || penalties.is_empty() {
        return Ok(solution);
    }
    for _ in 0..MAX_UPDATES {
        for penalty in penalties.iter_mut() {
            problem.update(penalty, &solution);
        }
        let next = problem.solve(penalties, solution.noise_factor)?;
        let moved = problem.largest_change_of_degrees(penalties, &solution, &next);
        solution = next;
        if moved < DEGREES_TOLERANCE {
            break;
        }
    }
    Ok(solution)
}

/// First penalty: prior information equal to a thousandth of the data's, per function.
fn start_penalties(normal: &NormalEquations, penalties: &mut [Penalty]) {
    for penalty in penalties.iter_mut().filter(|p| p.lambda == 0.0) {
        let n = penalty.range.len();
        let data: f64 = penalty.range.clone().map(|k| normal.matrix[k * normal.size + k]).sum();
        let rough: f64 = (0..n).map(|k| penalty.roughness[k * n + k]).sum();
        penalty.lambda = 1e-3 * (data / rough.max(f64::MIN_POSITIVE)).max(f64::MIN_POSITIVE);
        penalty.first_lambda = penalty.lambda;
    }
}

/// The quadratic problem around the parameters of one pass.
struct Problem<'a> {
    normal: &'a NormalEquations,
    at: &'a [f64],
    free: &'a [usize],
    /// Position of each parameter among the free ones.
    place: Vec<Option<usize>>,
    data: Mat<f64>,
    /// Data part of the right-hand side in terms of parameters (not of changes).
    right: Vec<f64>,
}

impl<'a> Problem<'a> {
    fn new(normal: &'a NormalEquations, at: &'a [f64], free: &'a [usize]) -> Problem<'a> {
        let mut place = vec![None; normal.size];
        free.iter().enumerate().for_each(|(k, index)| place[*index] = Some(k));
        let data = select(&normal.matrix, normal.size, free);
        let moved = &data * Mat::from_fn(free.len(), 1, |k, _| at[free[k]]);
        let right = free.iter().enumerate().map(|(k, index)| normal.gradient[*index] + moved[(k, 0)]).collect();
        Problem { normal, at, free, place, data, right }
    }

    fn solve(&self, penalties: &[Penalty], phi: f64) -> Result<Solution, NotPositiveDefinite> {
        let mut system = self.data.clone();
        for penalty in penalties {
            let n = penalty.range.len();
            for (i, row) in penalty.range.clone().enumerate() {
                for (j, column) in penalty.range.clone().enumerate() {
                    if let (Some(a), Some(b)) = (self.place[row], self.place[column]) {
                        system[(a, b)] += phi * penalty.lambda * penalty.roughness[i * n + j];
                    }
                }
            }
        }
        let factor = Factor::new(&system)?;
        let free_values = factor.solve(&self.right);
        let inverse = factor.inverse();
        let mut parameters = self.at.to_vec();
        self.free.iter().zip(&free_values).for_each(|(index, value)| parameters[*index] = *value);
        let effective = (0..self.free.len())
            .map(|k| inverse.row(k).iter().zip(self.data.col(k).iter()).map(|(a, b)| a * b).sum())
            .collect::<Vec<f64>>();
        let chi2 = self.chi2(&free_values);
        let degrees = (self.normal.weight - effective.iter().sum::<f64>()).max(1.0);
        let noise_factor = chi2 / degrees;
        let covariance = faer::Scale(noise_factor_for_covariance(noise_factor)) * inverse;
        let minus_two_log_likelihood = chi2 / phi
            + penalties.iter().map(|p| p.lambda * p.quadratic(&parameters) - p.log_prior()).sum::<f64>()
            + (self.normal.weight - self.free.len() as f64) * phi.ln()
            + factor.log_determinant();
        Ok(Solution { parameters, covariance, effective, noise_factor, minus_two_log_likelihood })
    }

    /// χ² predicted at the new parameters by the quadratic form.
    fn chi2(&self, free_values: &[f64]) -> f64 {
        let change = Mat::from_fn(self.free.len(), 1, |k, _| free_values[k] - self.at[self.free[k]]);
        let curved = &self.data * &change;
        let reduction: f64 = (0..self.free.len())
            .map(|k| change[(k, 0)] * (2.0 * self.normal.gradient[self.free[k]] - curved[(k, 0)]))
            .sum();
        (self.normal.weighted_square - reduction).max(0.0)
    }

    /// λ ← (rank − λ tr(V S)) / (βᵀ S β).
    fn update(&self, penalty: &mut Penalty, solution: &Solution) {
        let n = penalty.range.len();
        let scale = 1.0 / noise_factor_for_covariance(solution.noise_factor) * solution.noise_factor;
        let mut trace = 0.0;
        for (i, row) in penalty.range.clone().enumerate() {
            for (j, column) in penalty.range.clone().enumerate() {
                if let (Some(a), Some(b)) = (self.place[row], self.place[column]) {
                    trace += scale * solution.covariance[(a, b)] * penalty.roughness[i * n + j];
                }
            }
        }
        let quadratic = penalty.quadratic(&solution.parameters);
        let wanted = (penalty.rank - penalty.lambda * trace).max(0.0) / quadratic.max(f64::MIN_POSITIVE);
        let stepped = wanted.clamp(penalty.lambda / PENALTY_STEP, penalty.lambda * PENALTY_STEP);
        penalty.lambda = stepped.clamp(penalty.first_lambda / PENALTY_SPAN, penalty.first_lambda * PENALTY_SPAN);
    }

    fn largest_change_of_degrees(&self, penalties: &[Penalty], before: &Solution, after: &Solution) -> f64 {
        let degrees = |penalty: &Penalty, solution: &Solution| -> f64 {
            penalty.range.clone().filter_map(|k| self.place[k]).map(|k| solution.effective[k]).sum()
        };
        penalties.iter().map(|p| (degrees(p, before) - degrees(p, after)).abs()).fold(0.0, f64::max)
    }
}

/// The declared noise is the least that is believed: a covariance is widened by misfit, never narrowed by luck.
fn noise_factor_for_covariance(noise_factor: f64) -> f64 {
    noise_factor.max(1.0)
}
