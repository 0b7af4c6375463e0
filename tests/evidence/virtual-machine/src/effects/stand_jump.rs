//! Somebody bumps the tracer's stand, and the station measures from another place from then on.
//!
//! Equation: shift of the station = (x, y, z) from a time after its first reading on. Size: 2–100 µm.

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite};

/// Another place of one station from some time on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StandJump {
    /// Index of the station, from 0.
    pub station: u32,
    /// Time on the station from which it stands elsewhere (s).
    pub after_s: f64,
    /// By how much (m, machine frame).
    pub shift_m: [f64; 3],
}

impl Effect for StandJump {
    fn name(&self) -> &'static str {
        "stand_jump"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("after_s", &[self.after_s])?;
        require_finite("shift_m", &self.shift_m)
    }

    fn station_shift_m(&self, _moment: &Moment, station: u32, time_on_station_s: f64) -> [f64; 3] {
        if station == self.station && time_on_station_s >= self.after_s { self.shift_m } else { [0.0; 3] }
    }
}
