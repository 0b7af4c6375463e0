//! Residual vectors at points whose actual position another instrument knows.
//!
//! Place in the flow: corrected and actual positions (m) in, residuals in the machine frame out. The reference has a
//! frame of its own: it is brought onto the corrected points by a rigid motion first (Kabsch 1976), so that only what no
//! motion removes is a residual.

use crate::{PointResidual, ResidualError};
use abbe_measurement::alignment::RigidAlignment;
use nalgebra::{Matrix3, Vector3};

/// Points below which six numbers of a frame take too much of the field.
const LEAST_POINTS: usize = 12;

/// Residuals (actual − corrected) at known points; `u_m` is the standard uncertainty of each component, where known: of
/// the reference and of coming back to a reading together.
///
/// # Errors
/// Too few points, or points that fix no frame.
pub fn from_known_points(
    corrected_m: &[Vector3<f64>],
    actual_m: &[Vector3<f64>],
    u_m: Option<Vector3<f64>>,
) -> Result<Vec<PointResidual>, ResidualError> {
    if corrected_m.len() < LEAST_POINTS {
        return Err(ResidualError::FewPoints(corrected_m.len(), LEAST_POINTS));
    }
    let alignment = RigidAlignment::fixed(actual_m, corrected_m)?;
    let covariance_m2 = u_m.map(|u| Matrix3::from_diagonal(&u.component_mul(&u)));
    let residual = |(row, (corrected, actual)): (usize, (&Vector3<f64>, &Vector3<f64>))| PointResidual {
        row,
        point_m: *corrected,
        residual_m: alignment.apply(actual) - corrected,
        covariance_m2,
    };
    Ok(corrected_m.iter().zip(actual_m).enumerate().map(residual).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reference_in_a_frame_of_its_own_gives_residuals_in_the_machine_frame() {
        let points: Vec<Vector3<f64>> = (0..60)
            .map(|k| Vector3::new(f64::from(k % 5) * 0.2, f64::from(k / 5 % 4) * 0.2, f64::from(k / 20) * 0.3))
            .collect();
        // A field that no rigid motion imitates to first order.
        let field = |p: &Vector3<f64>| Vector3::new(0.0, 0.0, 2e-6 * (9.0 * p.x).sin() * (7.0 * p.y).cos());
        let turn = nalgebra::Rotation3::new(Vector3::new(1e-4, -2e-4, 3e-1));
        let actual: Vec<_> = points.iter().map(|p| turn * (p + field(p)) + Vector3::new(0.3, 0.1, -2.0)).collect();
        let found = from_known_points(&points, &actual, None).unwrap();
        // What alignment takes of the field is what a rigid motion can: it is the same when the field is aligned alone.
        let moved: Vec<_> = points.iter().map(|p| p + field(p)).collect();
        let alignment = RigidAlignment::between(&moved, &points).unwrap();
        for (residual, (p, q)) in found.iter().zip(points.iter().zip(&moved)) {
            assert!((residual.residual_m - (alignment.apply(q) - p)).norm() < 1e-14);
            assert!((residual.residual_m.z - field(p).z).abs() < 1e-6, "sign: actual less corrected");
        }
        let line: Vec<_> = (0..20).map(|k| Vector3::new(f64::from(k) * 0.03, 0.0, 0.1)).collect();
        let told = from_known_points(&line, &line, None).unwrap_err().to_string();
        assert!(told.contains("the points lie on a line"), "{told}");
        assert!(matches!(from_known_points(&points[..5], &actual[..5], None), Err(ResidualError::FewPoints(5, _))));
    }
}
