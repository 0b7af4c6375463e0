//! Following error: an axis stops the shorter, the faster it came.
//!
//! Equation: δ = −lag · feed · sign(approach), along the axis. Size: 10–100 µs, so 1–10 µm at 100 mm/s.

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite};
use crate::machine::{Axis, JointErrors};

/// Lag of one axis in proportion to the feed of its last move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedLag {
    /// The axis that lags.
    pub axis: Axis,
    /// Way lost per feed (s).
    pub lag_s: f64,
}

impl Effect for SpeedLag {
    fn name(&self) -> &'static str {
        "speed_lag"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("lag_s", &[self.lag_s])
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        let axis = self.axis.index();
        errors.linear_m[axis][axis] -= self.lag_s * moment.feed_m_s * moment.direction[axis];
    }
}
