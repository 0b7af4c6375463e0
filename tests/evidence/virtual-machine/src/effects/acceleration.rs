//! Dynamic bending: the last acceleration of an axis twists its carriage, the lever does the rest.
//!
//! Equation: ε = c · a, about one machine axis, in the joint of the accelerated axis.
//! Size: c a few µrad for 1 m/s², so 1–20 µm at half a metre of lever when fast.

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite};
use crate::machine::{Axis, JointErrors};

/// Twist of one carriage with its own acceleration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Acceleration {
    /// The accelerated axis.
    pub axis: Axis,
    /// The machine-frame axis about which its carriage twists.
    pub about: Axis,
    /// Twist per acceleration (rad/(m/s²)).
    pub rad_per_m_s2: f64,
}

impl Effect for Acceleration {
    fn name(&self) -> &'static str {
        "acceleration"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("rad_per_m_s2", &[self.rad_per_m_s2])
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        let axis = self.axis.index();
        errors.angular_rad[axis][self.about.index()] += self.rad_per_m_s2 * moment.acceleration_m_s2[axis];
    }
}
