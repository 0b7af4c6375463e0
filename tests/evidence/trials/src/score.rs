//! The verification error of a model: what is left at points of another day after correction and rigid alignment.
//!
//! Place in the flow: scores models before and after diagnosis; nothing that is fitted may see it. Input: model and
//! points (m, machine frame) with their covariates; output: rms length of the residual vectors (m).

use abbe_geometry::Vector3;
use abbe_geometry::correct::{Status, correct};
use abbe_geometry::effects::{CovariateSource, CovariateValue, State};
use abbe_geometry::model::MachineModel;
use abbe_measurement::alignment::aligned_residuals_m;
use abbe_virtual_machine::simulate::covariate_names;
use abbe_virtual_machine::verification::VerificationPoint;

use crate::trial::TrialError;

/// Covariates of one point, the time among them.
struct Logged<'a>(&'a VerificationPoint);

impl CovariateSource for Logged<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        if name == "time_s" {
            return CovariateValue::Fresh(self.0.time_s);
        }
        match covariate_names().position(|known| known == name) {
            Some(place) => CovariateValue::Fresh(self.0.covariates[place]),
            None => CovariateValue::Missing,
        }
    }
}

/// Rms of the 3-D error (m) that the model leaves at the points, after the best rigid alignment.
///
/// # Errors
/// A point could not be corrected in full, or the points cannot be aligned.
pub fn verification_rms_m(model: &MachineModel, points: &[VerificationPoint]) -> Result<f64, TrialError> {
    let mut corrected_m = Vec::with_capacity(points.len());
    for point in points {
        let covariates = Logged(point);
        let state = State { reading_m: point.reading_m, offset_m: point.offset_m, covariates: &covariates };
        let correction = correct(model, &state);
        if !matches!(correction.status, Status::InVolume | Status::Extrapolated) {
            return Err(TrialError::Verification(format!("a point is {:?}", correction.status)));
        }
        corrected_m.push(correction.position_m);
    }
    let actual_m: Vec<Vector3<f64>> = points.iter().map(|p| Vector3::from(p.actual_in_machine_m)).collect();
    let residuals = aligned_residuals_m(&corrected_m, &actual_m)
        .map_err(|problem| TrialError::Verification(problem.to_string()))?;
    let square_m2: f64 = residuals.iter().map(Vector3::norm_squared).sum();
    Ok((square_m2 / residuals.len() as f64).sqrt())
}
