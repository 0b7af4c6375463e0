//! Thermal expansion of a scale that warms more slowly than its sensor: the heat has to come through the guide.
//!
//! Equation: δ = α·(T_behind − 20 °C)·(reading − fixed point), along the axis; T_behind follows the scale's sensor with a first-order
//! lag. Size: α, 8–12 µm/(m·K) for steel; lag 300–5000 s.

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite, require_positive};
use crate::machine::{Axis, JointErrors};

/// Expansion of one axis' scale behind its own temperature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaggedExpansion {
    /// The axis whose scale expands.
    pub axis: Axis,
    /// Expansion coefficient (1/K).
    pub per_kelvin: f64,
    /// Reading at which the scale is fixed to the machine (m).
    pub fixed_at_m: f64,
    /// Time constant behind the sensor (s).
    pub lag_s: f64,
}

impl Effect for LaggedExpansion {
    fn name(&self) -> &'static str {
        "lagged_expansion"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("per_kelvin, fixed_at_m", &[self.per_kelvin, self.fixed_at_m])?;
        require_positive("lag_s", self.lag_s)
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        let axis = self.axis.index();
        let excess_k = moment.room.behind(moment.time_s, self.lag_s).scale_c()[axis] - 20.0;
        errors.linear_m[axis][axis] += self.per_kelvin * excess_k * (moment.reading_m[axis] - self.fixed_at_m);
    }
}
