//! A ball screw that warms up: between its fixed bearing and the nut it grows, fast at the nut and slowly as a whole.
//!
//! Equation: δ = growth·(reading − fixed point)·(0.7·(1 − e^(−t/τ)) + 0.3·(1 − e^(−t/(4τ)))), along the axis. Size: 20–100 µm/m.

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite, require_positive};
use crate::machine::{Axis, JointErrors};

/// Growth of the screw of one axis, whose position the encoder of its motor tells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Screw {
    /// The axis.
    pub axis: Axis,
    /// Final growth (m/m).
    pub growth: f64,
    /// Reading at the fixed bearing (m).
    pub fixed_at_m: f64,
    /// Time constant of the fast part (s).
    pub time_constant_s: f64,
}

impl Effect for Screw {
    fn name(&self) -> &'static str {
        "screw"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("growth, fixed_at_m", &[self.growth, self.fixed_at_m])?;
        require_positive("time_constant_s", self.time_constant_s)
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        let (axis, ratio) = (self.axis.index(), moment.time_s / self.time_constant_s);
        let warmed = 1.0 - 0.7 * (-ratio).exp() - 0.3 * (-ratio / 4.0).exp();
        errors.linear_m[axis][axis] += self.growth * (moment.reading_m[axis] - self.fixed_at_m) * warmed;
    }
}
