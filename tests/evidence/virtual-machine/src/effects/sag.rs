//! Sag of a carrying axis under the carriage of another: an angle of one joint that depends on another axis.
//!
//! Equation, with v the stroke fraction of the carriage: the beam gives way by 4·sag·v(1 − v) downward (−Z), and
//! the carrying joint twists by twist·(v − ½v²(3 − 2v)) about the axis of motion. Size: 0.5–5 µm, some µrad.

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite};
use crate::machine::{Axis, JointErrors};

/// Sag of one joint with the position of another axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CarriageSag {
    /// The axis whose joint twists (EAX for X).
    pub carrying: Axis,
    /// The axis whose carriage travels on it.
    pub carriage: Axis,
    /// Drop in mid-stroke of the carriage (m).
    pub sag_m: f64,
    /// Size of the twist about the carrying axis (rad).
    pub twist_rad: f64,
}

impl Effect for CarriageSag {
    fn name(&self) -> &'static str {
        "carriage_sag"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("sag_m, twist_rad", &[self.sag_m, self.twist_rad])?;
        require_two_axes(self.carrying, self.carriage)
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        let carrying = self.carrying.index();
        let v = moment.stroke_fraction(self.carriage.index());
        errors.linear_m[carrying][2] -= 4.0 * self.sag_m * v * (1.0 - v);
        errors.angular_rad[carrying][carrying] += self.twist_rad * (v - 0.5 * v * v * (3.0 - 2.0 * v));
    }
}

/// Refuses an axis that carries itself.
pub(super) fn require_two_axes(carrying: Axis, carriage: Axis) -> Result<(), SimulationError> {
    if carrying != carriage {
        return Ok(());
    }
    Err(SimulationError::new(
        "carrying, carriage",
        format!("{carriage:?} cannot carry itself"),
        "choose two different axes",
    ))
}
