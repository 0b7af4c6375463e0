//! Whether a machine is still what a model says.
//!
//! Place in the flow: beside [`crate::diagnose()`], which fits a campaign anew and so never holds the model that it was given against it: a machine
//! that somebody ran into fits as well as one that nobody touched. Here readings of the campaign are corrected by both, the rigid motion between
//! them is taken out, since each has a frame of its own, and what is left is compared with what both say of their uncertainty. SI.

use abbe_geometry::Vector3;
use abbe_geometry::correct::correct;
use abbe_geometry::effects::State;
use abbe_geometry::model::MachineModel;
use abbe_identify::CampaignRow;
use abbe_measurement::alignment::aligned_residuals_m;
use abbe_measurement::campaign::Campaign;

/// Readings that are looked at, over all of the campaign.
const READINGS: usize = 400;
/// Readings that tell a deformation from a motion.
const FEWEST: usize = 10;
/// How often as large as both uncertainties a difference is that chance does not explain: neighbouring readings share their errors, so that few of
/// all these are independent.
const CHANGED: f64 = 1.5;

/// How far a model is from a new fit to a campaign.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Departure {
    /// Distance of corrected positions, but for a rigid motion (rms, m).
    pub rms_m: f64,
    /// What both uncertainties let expect (rms, k = 1, m).
    pub expected_m: f64,
}

impl Departure {
    /// Of readings that both correct; `None` where these are too few.
    pub fn of(given: &MachineModel, fit: &MachineModel, campaign: &Campaign) -> Option<Departure> {
        let every = campaign.readings.len().div_ceil(READINGS).max(1);
        let (mut own_m, mut new_m, mut variance_m2) = (Vec::new(), Vec::new(), 0.0);
        for (reading, row) in campaign.readings.iter().enumerate().step_by(every) {
            let covariates = &CampaignRow { campaign, reading };
            let state = State { reading_m: row.reading_m, offset_m: row.offset_m, covariates };
            let [own, new] = [given, fit].map(|model| (correct(model, &state), model.parts().machine.repeatability_m));
            let without = |repeatability_m: [f64; 3]| Vector3::from(repeatability_m).norm_squared();
            if let (Some(a), Some(b)) = (own.0.covariance_m2, new.0.covariance_m2) {
                own_m.push(own.0.position_m);
                new_m.push(new.0.position_m);
                variance_m2 += (a.trace() - without(own.1)).max(0.0) + (b.trace() - without(new.1)).max(0.0);
            }
        }
        if own_m.len() < FEWEST {
            return None;
        }
        let left = aligned_residuals_m(&own_m, &new_m).ok()?;
        let count = left.len() as f64;
        let square_m2 = left.iter().map(Vector3::norm_squared).sum::<f64>();
        Some(Departure { rms_m: (square_m2 / count).sqrt(), expected_m: (variance_m2 / count).sqrt() })
    }

    /// Whether the machine is another one than the model says.
    pub fn is_another(&self) -> bool {
        self.rms_m > CHANGED * self.expected_m
    }
}
