//! Rigid alignment of two sets of points, before they are compared.
//!
//! Place in the flow: a reference (verification points, another instrument) has a frame of its own; only what a
//! rotation and a translation cannot remove is an error. Input: corresponding points (m); output: residuals (m)
//! in the frame of the reference. Source: Kabsch 1976, by singular value decomposition.

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

/// Points that cannot be aligned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum AlignmentError {
    /// The lists differ in length.
    #[error("{points} points cannot be aligned with {references} references; give one reference a point")]
    Lengths {
        /// Points.
        points: usize,
        /// References.
        references: usize,
    },
    /// Three points fix a frame.
    #[error("{0} points do not fix a frame; at least 3 that are not on a line are needed")]
    TooFew(usize),
    /// A coordinate is not finite.
    #[error("a coordinate is not a finite number; correct or remove that point")]
    NotFinite,
}

/// Rotation and translation that bring points closest to their references, in the least-squares sense.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidAlignment {
    /// Rotation from the points' frame to the reference's.
    pub rotation: Matrix3<f64>,
    /// Centroid of the points (m).
    pub from_m: Vector3<f64>,
    /// Centroid of the references (m).
    pub to_m: Vector3<f64>,
}

impl RigidAlignment {
    /// Best alignment of `points_m` to `references_m`.
    pub fn between(points_m: &[Vector3<f64>], references_m: &[Vector3<f64>]) -> Result<RigidAlignment, AlignmentError> {
        if points_m.len() != references_m.len() {
            return Err(AlignmentError::Lengths { points: points_m.len(), references: references_m.len() });
        }
        if points_m.len() < 3 {
            return Err(AlignmentError::TooFew(points_m.len()));
        }
        if points_m.iter().chain(references_m).any(|p| p.iter().any(|v| !v.is_finite())) {
            return Err(AlignmentError::NotFinite);
        }
        let mean = |list: &[Vector3<f64>]| list.iter().sum::<Vector3<f64>>() / list.len() as f64;
        let (from_m, to_m) = (mean(points_m), mean(references_m));
        let pairs = points_m.iter().zip(references_m);
        let spread: Matrix3<f64> = pairs.map(|(p, r)| (p - from_m) * (r - to_m).transpose()).sum();
        let svd = spread.svd(true, true);
        let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Err(AlignmentError::NotFinite) };
        // A reflection would fit a mirrored set better; a rigid body cannot do that.
        let sign = (v_t.transpose() * u.transpose()).determinant().signum();
        let keep = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign));
        Ok(RigidAlignment { rotation: v_t.transpose() * keep * u.transpose(), from_m, to_m })
    }

    /// A point in the frame of the reference (m).
    pub fn apply(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        self.to_m + self.rotation * (point_m - self.from_m)
    }
}

/// Reference minus aligned point, for each pair (m, frame of the reference).
pub fn aligned_residuals_m(
    points_m: &[Vector3<f64>],
    references_m: &[Vector3<f64>],
) -> Result<Vec<Vector3<f64>>, AlignmentError> {
    let alignment = RigidAlignment::between(points_m, references_m)?;
    Ok(points_m.iter().zip(references_m).map(|(p, r)| r - alignment.apply(p)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud() -> Vec<Vector3<f64>> {
        (0..20)
            .map(|k| Vector3::new((f64::from(k) * 1.3).sin(), (f64::from(k) * 0.7).cos(), f64::from(k % 7) * 0.1))
            .collect()
    }

    #[test]
    fn a_rigid_motion_leaves_nothing_and_a_deformation_stays() {
        let turn = nalgebra::Rotation3::new(Vector3::new(0.4, -1.0, 2.0));
        let moved: Vec<_> = cloud().iter().map(|p| turn * p + Vector3::new(5.0, -3.0, 1.0)).collect();
        assert!(aligned_residuals_m(&cloud(), &moved).unwrap().iter().all(|r| r.norm() < 1e-14));
        let bent: Vec<_> = cloud().iter().map(|p| p + Vector3::new(0.0, 0.0, p.x * p.x * 1e-3)).collect();
        assert!(aligned_residuals_m(&cloud(), &bent).unwrap().iter().any(|r| r.norm() > 1e-4));
    }

    #[test]
    fn a_mirror_image_is_not_aligned_by_a_reflection() {
        let mirrored: Vec<_> = cloud().iter().map(|p| Vector3::new(-p.x, p.y, p.z)).collect();
        let alignment = RigidAlignment::between(&cloud(), &mirrored).unwrap();
        assert!((alignment.rotation.determinant() - 1.0).abs() < 1e-12);
        assert!(aligned_residuals_m(&cloud(), &mirrored).unwrap().iter().any(|r| r.norm() > 0.1));
    }

    #[test]
    fn what_cannot_be_aligned_is_refused() {
        assert_eq!(RigidAlignment::between(&cloud()[..2], &cloud()[..2]), Err(AlignmentError::TooFew(2)));
        let lengths = AlignmentError::Lengths { points: 4, references: 3 };
        assert_eq!(RigidAlignment::between(&cloud()[..4], &cloud()[..3]), Err(lengths));
        let mut broken = cloud();
        broken[3].y = f64::NAN;
        assert_eq!(RigidAlignment::between(&broken, &cloud()), Err(AlignmentError::NotFinite));
    }
}
