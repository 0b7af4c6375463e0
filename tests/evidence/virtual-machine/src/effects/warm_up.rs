//! Warm-up growth of the head: the tip creeps away as the machine comes to temperature.
//!
//! Equation: tip = size · (0.7·(1 − e^(−t/τ)) + 0.3·(1 − e^(−t/(5τ)))). Size: 1–10 µm.

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite, require_positive};
use crate::machine::JointErrors;

/// Growth of the head since the campaign began.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WarmUp {
    /// Final displacement of the tip (m, machine frame).
    pub final_m: [f64; 3],
    /// Time constant of the fast part (s).
    pub time_constant_s: f64,
}

impl Effect for WarmUp {
    fn name(&self) -> &'static str {
        "warm_up"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("final_m", &self.final_m)?;
        require_positive("time_constant_s", self.time_constant_s)
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        let ratio = moment.time_s / self.time_constant_s;
        // −expm1(−x) is 1 − e^(−x) without cancellation right after the start.
        let grown = -0.7 * (-ratio).exp_m1() - 0.3 * (-0.2 * ratio).exp_m1();
        for d in 0..3 {
            errors.tip_m[d] += self.final_m[d] * grown;
        }
    }
}
