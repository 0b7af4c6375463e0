//! The reflector's centre error depends on the angle at which the beam comes in.
//!
//! Equation: shift = size · (1 − cos θ)² · 4, θ between the incoming beam and the reflector's axis in the ram
//! frame (the ram's turns of some µrad do not matter here); size is the shift at θ = 60°. Size: 0.1–5 µm.

use super::{Beam, Effect, Moment};
use crate::error::{SimulationError, require_finite};

/// Shift of the apparent centre with the angle of incidence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReflectorIncidence {
    /// Shift at 60° of incidence (m).
    pub size_m: f64,
    /// Direction in which the reflector looks (ram frame, any length but zero).
    pub looks_along: [f64; 3],
}

impl Effect for ReflectorIncidence {
    fn name(&self) -> &'static str {
        "reflector_incidence"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("size_m", &[self.size_m])?;
        require_finite("looks_along", &self.looks_along)?;
        if self.looks_along == [0.0; 3] {
            return Err(SimulationError::new("looks_along", "has no direction", "give a vector such as [0, 0, -1]"));
        }
        Ok(())
    }

    fn range_shift_m(&self, _moment: &Moment, beam: &Beam) -> f64 {
        let length = self.looks_along.iter().map(|v| v * v).sum::<f64>().sqrt();
        let towards: f64 = (0..3).map(|d| -beam.toward_reflector[d] * self.looks_along[d] / length).sum();
        let opening = 1.0 - towards;
        4.0 * self.size_m * opening * opening
    }
}
