//! A jump of the zero: the beam was interrupted, and every length of the station is off from then on.
//!
//! Equation: shift = size on the readings of that station from a time after its first reading on. Size: 1–50 µm.

use super::{Beam, Effect, Moment};
use crate::error::{SimulationError, require_finite};

/// A constant on the later lengths of one station.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ZeroJump {
    /// Index of the station, from 0.
    pub station: u32,
    /// Time on the station from which its lengths are off (s).
    pub after_s: f64,
    /// What they are too long by (m).
    pub shift_m: f64,
}

impl Effect for ZeroJump {
    fn name(&self) -> &'static str {
        "zero_jump"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("after_s, shift_m", &[self.after_s, self.shift_m])
    }

    fn range_shift_m(&self, _moment: &Moment, beam: &Beam) -> f64 {
        if beam.station == self.station && beam.time_on_station_s >= self.after_s { self.shift_m } else { 0.0 }
    }
}
