//! How certain each error would be with targets arranged in this way, before anything is measured.
//!
//! Place in the flow: planning. The same rows as the fit; points and covariances (machine frame, m, m²) in, covariance of
//! δ (m) and ε (rad) out.

use super::solve::{design, whitening};
use super::{GuidewayError, check};
use crate::least_squares;
use nalgebra::{DVector, Matrix3, Matrix6, Vector3};

/// A planned target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArrangedTarget {
    /// Where it is (m).
    pub point_m: Vector3<f64>,
    /// Covariance of its point in one reading (m²).
    pub covariance_m2: Matrix3<f64>,
}

/// Covariance of the six errors about `reference_m` at a position near the lowest, both read once.
///
/// # Errors
/// Fewer than three targets, targets on a line, figures that are not finite, covariances that are none.
pub fn arrangement_covariance(
    targets: &[ArrangedTarget],
    reference_m: &Vector3<f64>,
) -> Result<Matrix6<f64>, GuidewayError> {
    for (k, target) in targets.iter().enumerate() {
        if target.point_m.iter().chain(reference_m).any(|v| !v.is_finite()) {
            return Err(GuidewayError::NotFinite(k + 1));
        }
        if target.covariance_m2.iter().any(|v| !v.is_finite()) || target.covariance_m2.cholesky().is_none() {
            return Err(GuidewayError::Covariance(k + 1));
        }
    }
    let points_m: Vec<Vector3<f64>> = targets.iter().map(|target| target.point_m).collect();
    check::spread_enough(&points_m, 0.0)?;
    let levers: Vec<Vector3<f64>> = points_m.iter().map(|point| point - reference_m).collect();
    // The difference of two readings has twice the covariance of one.
    let whitenings: Vec<Matrix3<f64>> = targets.iter().map(|target| whitening(&(target.covariance_m2 * 2.0))).collect();
    let matrix = design(levers.iter().zip(&whitenings));
    let found = least_squares::solve(&matrix, &DVector::zeros(matrix.nrows()))
        .map_err(|_| GuidewayError::Undetermined { position_mm: 0.0 })?;
    Ok(Matrix6::from_fn(|i, j| found.cofactor[(i, j)]))
}
