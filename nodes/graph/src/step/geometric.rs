//! The geometric node's step: scale reading in, corrected coordinates out.
//!
//! Place in the flow: wraps [`abbe_geometry::correct::correct`], the one correcting function, between the message
//! types. Every reading gives exactly one output with the same stamp and sequence; what could not be corrected
//! says so in its status. A reading in another frame than the model's machine is of another machine, and one that names
//! no frame may be: neither is corrected.

use abbe_geometry::correct::{Status, correct};
use abbe_geometry::effects::{CovariateSource, CovariateValue, State};
use abbe_geometry::model::{IdentifiedVolume, MachineModel};
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, Covariates, ScaleReading, Sha256};
use std::sync::Arc;

/// How far a covariate may be from after the instant of latching (s): clocks that are kept together agree to that.
pub(super) const CLOCK_TOLERANCE_S: f64 = 1e-3;

/// Whether a covariate of this age may be used. One from the future has an age that nobody knows.
pub(crate) fn is_fresh(age_s: f64, max_age_s: f64) -> bool {
    (-CLOCK_TOLERANCE_S..=max_age_s).contains(&age_s)
}

/// The axis on whose other side every identified offset lies: a sign error moves every lever arm.
pub fn opposite_offset(identified: &IdentifiedVolume, offset_m: [f64; 3]) -> Option<usize> {
    let bounds = identified.offset_m.iter().zip(offset_m);
    bounds
        .map(|(bounds, offset)| (*bounds, offset))
        .position(|((lower, upper), offset)| (upper < 0.0 && offset > 0.0) || (lower > 0.0 && offset < 0.0))
}

/// Covariates of a sample, with the age from which they are stale.
pub struct SampleCovariates<'a> {
    /// Those of the sample.
    pub table: &'a Covariates,
    /// Age from which one is stale (s).
    pub max_age_s: f64,
}

impl CovariateSource for SampleCovariates<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        match self.table.get(name) {
            None => CovariateValue::Missing,
            Some(entry) if is_fresh(entry.age_s, self.max_age_s) => CovariateValue::Fresh(entry.value),
            Some(_) => CovariateValue::Stale,
        }
    }
}

/// Corrects with one model, or says that there is none.
#[derive(Debug, Clone)]
pub struct GeometricStep {
    model: Option<(Arc<MachineModel>, Sha256)>,
    max_covariate_age_s: f64,
}

impl GeometricStep {
    /// A step with this model, and the age (s) beyond which a covariate is stale.
    pub fn new(model: Option<(Arc<MachineModel>, Sha256)>, max_covariate_age_s: f64) -> GeometricStep {
        GeometricStep { model, max_covariate_age_s }
    }

    /// Corrects with this model from the next reading on.
    pub fn put_in_use(&mut self, model: Arc<MachineModel>, sha256: Sha256) {
        self.model = Some((model, sha256));
    }

    /// From the next reading on, a covariate of more than this age (s) is stale.
    pub fn set_max_covariate_age_s(&mut self, max_covariate_age_s: f64) {
        self.max_covariate_age_s = max_covariate_age_s;
    }

    /// Hash of the model in use; [`Sha256::NONE`] without one.
    pub fn model_sha256(&self) -> Sha256 {
        self.model.as_ref().map_or(Sha256::NONE, |(_, sha256)| *sha256)
    }

    /// The corrected coordinates of one reading.
    pub fn correct(&self, reading: &ScaleReading) -> CorrectedCoordinates {
        let Some((model, sha256)) = &self.model else {
            return uncorrected(reading, CorrectionStatus::NoModel, Sha256::NONE);
        };
        if reading.frame_id.as_str() != model.parts().machine.frame_id {
            return uncorrected(reading, CorrectionStatus::OtherFrame, *sha256);
        }
        let covariates = SampleCovariates { table: &reading.covariates, max_age_s: self.max_covariate_age_s };
        let state = State { reading_m: reading.reading_m, offset_m: reading.offset_m, covariates: &covariates };
        let correction = correct(model, &state);
        match correction.covariance_m2 {
            None => uncorrected(reading, CorrectionStatus::Rejected, *sha256),
            Some(covariance_m2) => CorrectedCoordinates {
                geometric_correction_m: correction.geometric_m.into(),
                effect_correction_m: correction.effects_m.into(),
                corrected_valid: true,
                corrected_m: correction.position_m.into(),
                covariance_m2: std::array::from_fn(|k| covariance_m2[(k / 3, k % 3)]),
                ..uncorrected(reading, wire_status(correction.status), *sha256)
            },
        }
    }
}

/// The status as it goes over the wire.
pub(super) fn wire_status(status: Status) -> CorrectionStatus {
    match status {
        Status::InVolume => CorrectionStatus::InVolume,
        Status::Extrapolated => CorrectionStatus::Extrapolated,
        Status::CovariateMissing => CorrectionStatus::CovariateMissing,
        Status::Stale => CorrectionStatus::Stale,
        Status::Rejected => CorrectionStatus::Rejected,
    }
}

/// A sample that repeats the indicated position; its status says that nothing was corrected. A reading that is no
/// number is repeated as such, so that no sequence number vanishes and nothing is made up.
fn uncorrected(reading: &ScaleReading, status: CorrectionStatus, model_sha256: Sha256) -> CorrectedCoordinates {
    CorrectedCoordinates {
        stamp: reading.stamp,
        sequence: reading.sequence,
        reading_m: reading.reading_m,
        offset_m: reading.offset_m,
        geometric_correction_m: [0.0; 3],
        effect_correction_m: [0.0; 3],
        residual_correction_m: [0.0; 3],
        corrected_m: std::array::from_fn(|d| reading.reading_m[d] + reading.offset_m[d]),
        covariance_m2: [0.0; 9],
        model_sha256,
        residual_model_sha256: Sha256::NONE,
        frame_id: reading.frame_id,
        corrected_valid: false,
        status,
    }
}
