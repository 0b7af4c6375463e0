//! Local wear: a hollow of a guide, narrower than error functions are made to follow.
//!
//! Equation: δ = size·exp(−½·((reading − at)/width)²) across the axis. Size: 0.5–5 µm over 10–100 mm.

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite, require_positive};
use crate::machine::{Axis, JointErrors};

/// A hollow of one guide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wear {
    /// The axis whose guide is worn.
    pub axis: Axis,
    /// Direction in which the carriage falls into it.
    pub across: Axis,
    /// Depth (m).
    pub size_m: f64,
    /// Reading at its deepest place (m).
    pub at_m: f64,
    /// Half its width where 61 % of the depth are left (m).
    pub width_m: f64,
}

impl Effect for Wear {
    fn name(&self) -> &'static str {
        "wear"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("size_m, at_m", &[self.size_m, self.at_m])?;
        require_positive("width_m", self.width_m)
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        let axis = self.axis.index();
        let away = (moment.reading_m[axis] - self.at_m) / self.width_m;
        errors.linear_m[axis][self.across.index()] += self.size_m * (-0.5 * away * away).exp();
    }
}
