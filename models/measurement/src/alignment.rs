//! Rigid alignment of two sets of points, before they are compared.
//!
//! Place in the flow: a reference (verification points, another instrument) has a frame of its own; only what a
//! rotation and a translation cannot remove is an error. Input: corresponding points (m); output: residuals (m)
//! in the frame of the reference. Source: Kabsch 1976, by singular value decomposition.

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

/// Numbers that an alignment fits: three of a rotation, three of a translation.
pub const UNKNOWNS: usize = 6;
/// Points that spread less across a line than this share of their spread along it fix no rotation about it: 1 mm of a metre.
const LEAST_WIDTH: f64 = 1e-3;

/// Points that cannot be aligned.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
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
    /// Points on a line leave the rotation about it open.
    #[error(
        "the points lie on a line (rms {across_mm:.3} mm across it, {along_mm:.1} mm along), about which any rotation fits; at least 3 that \
         are not on a line are needed"
    )]
    OnALine {
        /// Spread across the line (rms, mm).
        across_mm: f64,
        /// Spread along it (rms, mm).
        along_mm: f64,
    },
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

    /// The same, for whoever takes what is left as error vectors: points on a line are refused, since about it any rotation fits.
    ///
    /// # Errors
    /// What [`RigidAlignment::between`] refuses, and points on a line.
    pub fn fixed(points_m: &[Vector3<f64>], references_m: &[Vector3<f64>]) -> Result<RigidAlignment, AlignmentError> {
        let alignment = RigidAlignment::between(points_m, references_m)?;
        let scatter: Matrix3<f64> =
            points_m.iter().map(|p| (p - alignment.from_m) * (p - alignment.from_m).transpose()).sum();
        let mut squares = scatter.symmetric_eigenvalues();
        squares.as_mut_slice().sort_by(f64::total_cmp);
        let rms_mm = |square: f64| (square.max(0.0) / points_m.len() as f64).sqrt() * 1e3;
        // The wider of the two directions across.
        let (across_mm, along_mm) = (rms_mm(squares[1]), rms_mm(squares[2]));
        match across_mm > LEAST_WIDTH * along_mm {
            true => Ok(alignment),
            false => Err(AlignmentError::OnALine { across_mm, along_mm }),
        }
    }

    /// A point in the frame of the reference (m).
    pub fn apply(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        self.to_m + self.rotation * (point_m - self.from_m)
    }
}

/// Share of the true rms of independent errors that is left of them, in the mean, after the alignment of so many points has fitted its
/// six numbers to them: √(1 − 6/3n). None is left where there are no more than these numbers.
pub fn share_left(points: usize) -> Option<f64> {
    let (numbers, fitted) = (3.0 * points as f64, UNKNOWNS as f64);
    (numbers > fitted).then(|| (1.0 - fitted / numbers).sqrt())
}

/// Reference minus aligned point, for each pair (m, frame of the reference).
///
/// # Errors
/// What [`RigidAlignment::fixed`] refuses.
pub fn aligned_residuals_m(
    points_m: &[Vector3<f64>],
    references_m: &[Vector3<f64>],
) -> Result<Vec<Vector3<f64>>, AlignmentError> {
    let alignment = RigidAlignment::fixed(points_m, references_m)?;
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

    /// By simulation: 400 draws of 5 points with independent errors leave √(1 − 2/5) of them. One draw scatters by √(1/2/9), the mean
    /// square of 400 therefore by 0.024, and the bound is three of that in the root.
    #[test]
    fn an_alignment_of_few_points_takes_its_share_of_their_errors() {
        let mut seed = 1_u64;
        let mut uniform = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let mut vector = |size: f64| Vector3::new(uniform(), uniform(), uniform()) * size;
        let (mut left, mut all) = (0.0, 0.0);
        for _ in 0..400 {
            let points: Vec<_> = (0..5).map(|_| vector(1.0)).collect();
            let errors: Vec<_> = (0..5).map(|_| vector(1e-6)).collect();
            let actual: Vec<_> = points.iter().zip(&errors).map(|(p, e)| p + e).collect();
            all += errors.iter().map(Vector3::norm_squared).sum::<f64>();
            left += aligned_residuals_m(&points, &actual).unwrap().iter().map(Vector3::norm_squared).sum::<f64>();
        }
        let share = share_left(5).unwrap();
        assert!(((left / all).sqrt() - share).abs() < 0.04, "{} {share}", (left / all).sqrt());
        assert!((share_left(3).unwrap() - (1.0_f64 / 3.0).sqrt()).abs() < 1e-15 && share_left(2).is_none());
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
        let line = |width: f64| -> Vec<_> {
            (0..6).map(|k| Vector3::new(f64::from(k) * 0.1, f64::from(k % 2) * width, -0.2 * f64::from(k))).collect()
        };
        let told = aligned_residuals_m(&line(0.1e-3), &line(0.1e-3)).unwrap_err().to_string();
        assert!(told.contains("0.048 mm across it, 381.9 mm along"), "{told}");
        assert!(aligned_residuals_m(&line(2e-3), &line(2e-3)).is_ok());
        let point = vec![Vector3::new(0.1, 0.2, 0.3); 4];
        assert!(matches!(RigidAlignment::fixed(&point, &point), Err(AlignmentError::OnALine { .. })));
        let mut broken = cloud();
        broken[3].y = f64::NAN;
        assert_eq!(RigidAlignment::between(&broken, &cloud()), Err(AlignmentError::NotFinite));
    }
}
