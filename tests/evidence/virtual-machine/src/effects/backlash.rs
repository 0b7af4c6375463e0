//! Backlash: the axis stops short by half the play, on the side it comes from.
//!
//! Equation: δ = −½·(size + growth·sin²(πu))·sign(approach), along the axis, u the stroke fraction;
//! growth 0 is the constant form. Size: 0.1–2 µm.

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite};
use crate::machine::{Axis, JointErrors};

/// Play of one axis, constant or largest in mid-stroke.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Backlash {
    /// The axis with play.
    pub axis: Axis,
    /// Play at the ends of the stroke, from one side to the other (m).
    pub size_m: f64,
    /// Further play in mid-stroke (m).
    pub growth_m: f64,
}

impl Effect for Backlash {
    fn name(&self) -> &'static str {
        "backlash"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("size_m, growth_m", &[self.size_m, self.growth_m])
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        let axis = self.axis.index();
        let wave = (std::f64::consts::PI * moment.stroke_fraction(axis)).sin();
        let play_m = self.size_m + self.growth_m * wave * wave;
        errors.linear_m[axis][axis] -= 0.5 * play_m * moment.direction[axis];
    }
}
