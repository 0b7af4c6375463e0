//! Harmonics of the tracer's gimbal: its centre is not quite where its axes cross.
//!
//! Equation: shift = s₁·sin(az) + s₂·sin(2az) + s₃·sin(2el), az and el of the beam in the machine frame,
//! computed from the beam's components without any arc function. Size: 0.1–0.3 µm.

use super::{Beam, Effect, Moment};
use crate::error::{SimulationError, require_finite};

/// Three harmonics of the beam's direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gimbal {
    /// Sizes of sin az, sin 2az and sin 2el (m).
    pub sizes_m: [f64; 3],
}

impl Effect for Gimbal {
    fn name(&self) -> &'static str {
        "gimbal"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("sizes_m", &self.sizes_m)
    }

    fn range_shift_m(&self, _moment: &Moment, beam: &Beam) -> f64 {
        let [x, y, z] = beam.toward_reflector;
        let level = x.hypot(y);
        // Straight up the azimuth does not exist; the gimbal then shows none of its azimuth harmonics.
        let (sin, cos) = if level > 0.0 { (y / level, x / level) } else { (0.0, 0.0) };
        self.sizes_m[0] * sin + self.sizes_m[1] * 2.0 * sin * cos + self.sizes_m[2] * 2.0 * z * level
    }
}
