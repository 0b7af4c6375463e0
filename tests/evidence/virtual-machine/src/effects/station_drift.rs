//! The tracer's stand creeps while a station is measured.
//!
//! Equation: shift = rate · t · R(station), t since the station's first reading, R a turn about Z by 2 rad a
//! station, so that no two stations creep the same way. Size: 0.5–5 µm/h.

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite};

/// Creep of the stand, in another direction at each station.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StationDrift {
    /// Rate at the first station (m/s, machine frame).
    pub rate_m_s: [f64; 3],
}

impl Effect for StationDrift {
    fn name(&self) -> &'static str {
        "station_drift"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("rate_m_s", &self.rate_m_s)
    }

    fn station_shift_m(&self, _moment: &Moment, station: u32, time_on_station_s: f64) -> [f64; 3] {
        let (sin, cos) = (2.0 * f64::from(station)).sin_cos();
        let [x, y, z] = self.rate_m_s.map(|rate| rate * time_on_station_s);
        [cos * x - sin * y, sin * x + cos * y, z]
    }
}
