//! Periodic error of a scale: interpolation or mounting screws.
//!
//! Equation: δ = size · cos(2π·reading/pitch − φ), along the axis. Size: 0.05–0.5 µm at 20 µm pitch.

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite, require_positive};
use crate::machine::{Axis, JointErrors};

/// One harmonic of a scale's pitch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PeriodicScale {
    /// The axis whose scale is periodic.
    pub axis: Axis,
    /// Amplitude (m).
    pub size_m: f64,
    /// Pitch (m).
    pub pitch_m: f64,
    /// Phase φ (rad).
    pub phase_rad: f64,
}

impl Effect for PeriodicScale {
    fn name(&self) -> &'static str {
        "periodic_scale"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("size_m, phase_rad", &[self.size_m, self.phase_rad])?;
        require_positive("pitch_m", self.pitch_m)
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        let axis = self.axis.index();
        let turn = std::f64::consts::TAU * moment.reading_m[axis] / self.pitch_m;
        errors.linear_m[axis][axis] += self.size_m * (turn - self.phase_rad).cos();
    }
}
