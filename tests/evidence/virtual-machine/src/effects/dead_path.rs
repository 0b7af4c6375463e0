//! Dead path drift: air in a path that the counter neither measures nor compensates.
//!
//! Equation: shift = unseen path · δn(T, p, h), δn as in [`super::Refraction`]. What of it is there at the station's
//! first reading goes into the zero of length; the drift afterwards stays. Size: 0.1–2 m, so 0.2–2 µm.

use super::refraction::excess_index;
use super::{Beam, Effect, Moment};
use crate::error::{SimulationError, require_finite};

/// A path on which only the air acts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeadPath {
    /// Length of that path (m).
    pub unseen_m: f64,
}

impl Effect for DeadPath {
    fn name(&self) -> &'static str {
        "dead_path"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("unseen_m", &[self.unseen_m])
    }

    fn range_shift_m(&self, moment: &Moment, _beam: &Beam) -> f64 {
        self.unseen_m * excess_index(&moment.environment)
    }
}
