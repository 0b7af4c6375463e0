//! The residual node's step: adds what a residual field says, or passes the sample through.
//!
//! Place in the flow: after the geometric node, before the users of corrected coordinates. Wraps
//! [`abbe_geometry::correct::add_residual`] between the message types; without a field the sample leaves as it came.

use abbe_geometry::correct::add_residual;
use abbe_geometry::residual_field::ResidualField;
use abbe_geometry::{Matrix3, Vector3};
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, Sha256};
use std::sync::Arc;

/// Adds one residual field.
#[derive(Clone, Default)]
pub struct ResidualStep {
    field: Option<Arc<dyn ResidualField>>,
}

impl ResidualStep {
    /// A step with this field, or none.
    pub fn new(field: Option<Arc<dyn ResidualField>>) -> ResidualStep {
        ResidualStep { field }
    }

    /// The sample with the residual added; what is not valid passes unchanged.
    pub fn correct(&self, sample: &CorrectedCoordinates) -> CorrectedCoordinates {
        let (Some(field), true) = (&self.field, sample.corrected_valid) else { return *sample };
        let mut position_m = Vector3::from(sample.corrected_m);
        let mut covariance_m2 = Matrix3::from_row_slice(&sample.covariance_m2);
        let prediction = add_residual(&mut position_m, &mut covariance_m2, field.as_ref());
        let inside = if prediction.inside { CorrectionStatus::InVolume } else { CorrectionStatus::Extrapolated };
        CorrectedCoordinates {
            residual_correction_m: prediction.residual_m.into(),
            corrected_m: position_m.into(),
            covariance_m2: std::array::from_fn(|k| covariance_m2[(k / 3, k % 3)]),
            residual_model_sha256: Sha256::from_bytes(field.sha256()),
            status: sample.status.max(inside),
            ..*sample
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_geometry::residual_field::ResidualPrediction;

    struct Shift {
        inside: bool,
    }

    impl ResidualField for Shift {
        fn predict(&self, _point_in_machine_m: &Vector3<f64>) -> ResidualPrediction {
            let residual_m = Vector3::new(1e-6, -2e-6, 3e-6);
            ResidualPrediction { residual_m, covariance_m2: Matrix3::identity() * 1e-14, inside: self.inside }
        }

        fn sha256(&self) -> [u8; 32] {
            [7; 32]
        }
    }

    fn sample(corrected_valid: bool, status: CorrectionStatus) -> CorrectedCoordinates {
        let mut sample = crate::step::GeometricStep::new(None, 1.0).correct(&abbe_msgs::ScaleReading::default());
        sample.corrected_valid = corrected_valid;
        sample.status = status;
        sample
    }

    #[test]
    fn without_a_field_a_sample_leaves_as_it_came() {
        let sample = sample(true, CorrectionStatus::InVolume);
        assert_eq!(ResidualStep::default().correct(&sample), sample);
    }

    #[test]
    fn a_field_moves_the_point_widens_the_covariance_and_signs_with_its_hash() {
        let step = ResidualStep::new(Some(Arc::new(Shift { inside: true })));
        let out = step.correct(&sample(true, CorrectionStatus::InVolume));
        assert_eq!(out.corrected_m, [1e-6, -2e-6, 3e-6]);
        assert_eq!(out.covariance_m2[4], 1e-14);
        assert_eq!(out.residual_model_sha256.to_bytes(), [7; 32]);
        assert_eq!(out.status, CorrectionStatus::InVolume);
    }

    #[test]
    fn outside_the_field_is_extrapolated_and_a_worse_status_stays() {
        let step = ResidualStep::new(Some(Arc::new(Shift { inside: false })));
        assert_eq!(step.correct(&sample(true, CorrectionStatus::InVolume)).status, CorrectionStatus::Extrapolated);
        assert_eq!(step.correct(&sample(true, CorrectionStatus::Stale)).status, CorrectionStatus::Stale);
        let rejected = sample(false, CorrectionStatus::Rejected);
        assert_eq!(step.correct(&rejected), rejected);
    }
}
