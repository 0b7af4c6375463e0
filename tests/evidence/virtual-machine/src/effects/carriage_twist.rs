//! Twist of a carrying joint that depends on its own position and on that of its carriage: EAX(x, y).
//!
//! Equation: ε = twist · u · v about the axis of motion, u and v the stroke fractions of the carrying axis and of
//! the carriage. Unlike a twist by the carriage alone, no function of one axis has this form.
//! Size: 2–20 µrad, so 1–10 µm at half a metre of lever.

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite};
use crate::machine::{Axis, JointErrors};

/// Twist of one joint with the product of two positions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CarriageTwist {
    /// The axis whose joint twists (EAX for X).
    pub carrying: Axis,
    /// The axis whose carriage travels on it.
    pub carriage: Axis,
    /// Twist with both axes at the end of their strokes (rad).
    pub twist_rad: f64,
}

impl Effect for CarriageTwist {
    fn name(&self) -> &'static str {
        "carriage_twist"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("twist_rad", &[self.twist_rad])?;
        super::sag::require_two_axes(self.carrying, self.carriage)
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        let carrying = self.carrying.index();
        let product = moment.stroke_fraction(carrying) * moment.stroke_fraction(self.carriage.index());
        errors.angular_rad[carrying][carrying] += self.twist_rad * product;
    }
}
