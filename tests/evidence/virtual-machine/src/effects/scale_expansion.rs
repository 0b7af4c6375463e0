//! Thermal expansion of a scale: the warmer scale is longer than it reads.
//!
//! Equation: δ = α·(T_scale − 20 °C)·(reading − fixed point), along the axis. Size: α, 8–12 µm/(m·K) for steel.

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite};
use crate::machine::{Axis, JointErrors};

/// Expansion of one axis' scale with its own temperature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScaleExpansion {
    /// The axis whose scale expands.
    pub axis: Axis,
    /// Expansion coefficient (1/K).
    pub per_kelvin: f64,
    /// Reading at which the scale is fixed to the machine (m).
    pub fixed_at_m: f64,
}

impl Effect for ScaleExpansion {
    fn name(&self) -> &'static str {
        "scale_expansion"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("per_kelvin, fixed_at_m", &[self.per_kelvin, self.fixed_at_m])
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        let axis = self.axis.index();
        let excess_k = moment.environment.scale_c()[axis] - 20.0;
        let length_m = moment.reading_m[axis] - self.fixed_at_m;
        errors.linear_m[axis][axis] += self.per_kelvin * excess_k * length_m;
    }
}
