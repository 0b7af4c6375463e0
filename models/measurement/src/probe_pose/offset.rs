//! Whether an offset of the A axis, which was not fitted, explains what the centres have in common.
//!
//! Place in the flow: after a fit without it. Left out, an offset goes into T_p, S0 and what a pose adds in common; with it the
//! fit has one unknown more. It is told where it exceeds what chance makes of none: Student's t of the degrees that its own
//! uncertainty rests on.

use super::{ProbePose, ProbePoseModel, SphereCentre};

/// Probability that an offset of zero is told, and that it is refused to go without it.
const TOLD: f64 = 1e-2;
const CERTAIN: f64 = 1e-4;
/// Share of the mean square of the residuals that it must leave at most, to be what the poses have in common.
const EXPLAINED: f64 = 0.5;
/// An offset below this (m) is rounding.
const RESOLVED_M: f64 = 1e-9;

/// An offset that a fit left out.
#[derive(Debug, Clone, PartialEq)]
pub struct ToldOffset {
    /// The fit with it.
    pub with: ProbePose,
    /// The offset (m).
    pub offset_m: f64,
    /// Its standard uncertainty (m).
    pub u_m: f64,
    /// Whether chance is out of the question, and it explains most of the residuals.
    pub is_certain: bool,
}

impl ProbePose {
    /// The offset of the A axis that these centres, its own, tell although it was not fitted; `None` where it is no more than chance, or
    /// they do not determine it.
    pub fn untold_offset(&self, centres: &[SphereCentre]) -> Option<ToldOffset> {
        if self.model.axis_offset {
            return None;
        }
        let with = ProbePose::fit(centres, ProbePoseModel { axis_offset: true, ..self.model }).ok()?;
        let (offset_m, claim) = (with.axis_offset_m?, with.claim?);
        let u_m = *with.u()?.last()?;
        let differs = |chance| offset_m.abs() > (claim.beyond(chance) * u_m).max(RESOLVED_M);
        let mean_square = |pose: &ProbePose| pose.rms_m().powi(2) / pose.degrees_of_freedom.max(1) as f64;
        let explains = mean_square(&with) < EXPLAINED * mean_square(self);
        differs(TOLD).then(|| ToldOffset { is_certain: differs(CERTAIN) && explains, offset_m, u_m, with })
    }

    /// The same pose with an uncertainty that holds what the other fit finds for the same unknowns.
    #[must_use]
    pub fn widened_to(mut self, other: &ProbePose) -> ProbePose {
        let three = [(self.centre_m, other.centre_m), (self.direction, other.direction), (self.zero_m, other.zero_m)];
        let differences: Vec<f64> =
            three.iter().flat_map(|(own, others)| (others - own).iter().copied().collect::<Vec<_>>()).collect();
        if let Some(covariance) = &mut self.covariance {
            for (i, first) in differences.iter().enumerate() {
                for (j, second) in differences.iter().enumerate() {
                    covariance[(i, j)] += first * second;
                }
            }
        }
        self
    }
}
