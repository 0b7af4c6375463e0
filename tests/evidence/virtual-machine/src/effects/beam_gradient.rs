//! Air that is warmer the further it is from the tracer, while the tracer takes all of it to be as at its own sensor.
//!
//! Equation: the beam passes air that is on average half of range · gradient warmer than at its start, so the counter shows
//! range · (−0.96e-6/K · ½ range · gradient) more. Size: a gradient of 0.5 K/m, −2 µm over 3 m.

use super::refraction::INDEX_PER_KELVIN;
use super::{Beam, Effect, Moment};
use crate::error::{SimulationError, require_finite};

/// How much warmer the air gets along every beam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BeamGradient {
    /// Gradient away from the tracer (K/m).
    pub kelvin_per_m: f64,
}

impl Effect for BeamGradient {
    fn name(&self) -> &'static str {
        "beam_gradient"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("kelvin_per_m", &[self.kelvin_per_m])
    }

    fn range_shift_m(&self, _moment: &Moment, beam: &Beam) -> f64 {
        let warmer_k = 0.5 * beam.range_m * self.kelvin_per_m;
        beam.range_m * INDEX_PER_KELVIN * warmer_k
    }
}
