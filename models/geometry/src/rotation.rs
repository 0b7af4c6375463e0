//! Rotation of a joint by its three angular errors, exact and in the small-angle form of the papers.
//!
//! Place in the flow: [`crate::chain`] turns what hangs on a joint with it. The exact form is the rotation
//! vector (EA, EB, EC) in rad through the exponential map, so that no order of the three angles is preferred;
//! the small-angle form is I + \[ε\]× (Liang 2025, eq. 1-7).

use nalgebra::{Matrix3, Vector3};

/// Which rotation a chain uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RotationForm {
    /// Exponential map of the rotation vector.
    Exact,
    /// I + \[ε\]×, as in the source papers.
    SmallAngle,
}

/// Cross-product matrix \[v\]×, so that `cross_matrix(v) * a == v.cross(&a)`.
pub fn cross_matrix(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// Rotation matrix of the rotation vector `angles_rad`.
pub fn rotation(form: RotationForm, angles_rad: &Vector3<f64>) -> Matrix3<f64> {
    let cross = cross_matrix(angles_rad);
    match form {
        RotationForm::SmallAngle => Matrix3::identity() + cross,
        RotationForm::Exact => {
            let (sine, cosine) = series(angles_rad.norm_squared());
            Matrix3::identity() + cross * sine + cross * cross * cosine
        }
    }
}

/// Derivative of `rotation(angles) * arm` with respect to the three angles (m/rad), exact at any angle.
pub fn rotation_partials(form: RotationForm, angles_rad: &Vector3<f64>, arm: &Vector3<f64>) -> Matrix3<f64> {
    match form {
        RotationForm::SmallAngle => -cross_matrix(arm),
        RotationForm::Exact => {
            // d(R a) = -R [a]× J_r dε with the right Jacobian J_r of SO(3).
            let square = angles_rad.norm_squared();
            let (_, cosine) = series(square);
            let cross = cross_matrix(angles_rad);
            let right = Matrix3::identity() - cross * cosine + cross * cross * third(square);
            -rotation(form, angles_rad) * cross_matrix(arm) * right
        }
    }
}

/// sin θ/θ and (1 − cos θ)/θ², by series where the quotient would lose digits.
fn series(square: f64) -> (f64, f64) {
    if square < 1e-6 {
        (1.0 - square / 6.0 + square * square / 120.0, 0.5 - square / 24.0 + square * square / 720.0)
    } else {
        let angle = square.sqrt();
        (angle.sin() / angle, (1.0 - angle.cos()) / square)
    }
}

/// (θ − sin θ)/θ³.
fn third(square: f64) -> f64 {
    if square < 1e-4 {
        1.0 / 6.0 - square / 120.0 + square * square / 5040.0
    } else {
        let angle = square.sqrt();
        (angle - angle.sin()) / (square * angle)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_rotation_is_orthogonal_and_matches_nalgebra() {
        for scale in [1e-6, 1e-4, 1e-2, 1.0] {
            let angles = Vector3::new(0.3, -0.7, 0.5) * scale;
            let own = rotation(RotationForm::Exact, &angles);
            let reference = nalgebra::Rotation3::new(angles);
            assert!((own - reference.matrix()).norm() < 1e-14);
            assert!((own.transpose() * own - Matrix3::identity()).norm() < 1e-14);
        }
    }

    #[test]
    fn partials_agree_with_differences_away_from_zero() {
        let arm = Vector3::new(0.4, -0.2, 0.7);
        for (form, scale) in [(RotationForm::Exact, 0.8), (RotationForm::Exact, 0.005), (RotationForm::SmallAngle, 0.8)]
        {
            let angles = Vector3::new(0.3, -0.7, 0.5) * scale;
            let analytic = rotation_partials(form, &angles, &arm);
            for k in 0..3 {
                let step = Vector3::ith(k, 1e-6);
                let difference = (rotation(form, &(angles + step)) - rotation(form, &(angles - step))) * arm / 2e-6;
                assert!((analytic.column(k) - difference).norm() < 1e-9, "{form:?} {scale} {k}");
            }
        }
    }
}
