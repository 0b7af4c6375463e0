//! What is known at a point that may be a minimum: covariance, and how far the minimum still is.
//!
//! Place in the flow: after either way; a point found without derivatives gets its covariance here, and must show that a
//! Newton step would leave it where it is.

use super::PointsError;
use super::problem::Problem;
use crate::linear::{Factor, select};
use faer::Mat;

/// The least-squares problem at a point.
pub(super) struct Certificate {
    /// (JᵀWJ)⁻¹ of all unknowns, not scaled.
    pub(super) inverse: Mat<f64>,
    /// χ² per degree of freedom.
    pub(super) chi2_per_dof: f64,
    /// Largest component of the Newton step, in standard uncertainties.
    pub(super) largest_step: f64,
    /// Unknowns that the data determine: all that are fitted, or less where a penalty holds some.
    pub(super) effective: f64,
}

/// Looks at the weighted least-squares problem at these unknowns.
pub(super) fn certify(problem: &Problem, unknowns: &[f64], weights: &[f64]) -> Result<Certificate, PointsError> {
    let normal = problem.normal(unknowns, weights);
    let all: Vec<usize> = (0..normal.size).collect();
    let factor = Factor::new(&select(&normal.matrix, normal.size, &all)).map_err(|_| PointsError::Singular)?;
    let (inverse, step) = (factor.inverse(), factor.solve(&normal.gradient));
    let degrees = ((problem.dimensions() as f64) * normal.weight - problem.free() as f64).max(1.0);
    let chi2_per_dof = normal.weighted_square / degrees;
    let u = |k: usize| (inverse[(k, k)] * widening(chi2_per_dof)).sqrt();
    let largest_step = step.iter().enumerate().map(|(k, d)| d.abs() / u(k)).fold(0.0, f64::max);
    Ok(Certificate { inverse, chi2_per_dof, largest_step, effective: problem.free() as f64 })
}

/// Factor of the covariance: misfit widens it, luck does not narrow it.
pub(super) fn widening(chi2_per_dof: f64) -> f64 {
    chi2_per_dof.max(1.0)
}
