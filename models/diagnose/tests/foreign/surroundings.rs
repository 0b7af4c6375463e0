//! What surrounds a foreign machine: air, structure, load, and the sensors that log them.
//!
//! Air follows a drift, a slow and a fast cycle; parts of the machine follow the air as lags of first order, each with a time
//! of its own. Sensors add noise and may have holes. Times in s, temperatures in °C.

use super::random::Random;
use std::f64::consts::TAU;

/// Logged columns, in order; units stand in the names.
pub(crate) const COLUMNS: [&str; 16] = [
    "dir_x",
    "dir_y",
    "dir_z",
    "speed_mm_s",
    "acc_x_mm_s2",
    "acc_y_mm_s2",
    "acc_z_mm_s2",
    "load_kg",
    "temp_air_c",
    "temp_scale_x_c",
    "temp_scale_y_c",
    "temp_scale_z_c",
    "temp_bridge_top_c",
    "temp_bridge_bottom_c",
    "pressure_hpa",
    "humidity_pct",
];
/// Lags of scales X, Y, Z, top and bottom of the bridge (s), and how far each follows the air.
const LAGS: [(f64, f64); 5] = [(2400.0, 0.9), (3300.0, 0.8), (1500.0, 1.0), (700.0, 1.2), (5200.0, 0.7)];

/// The air over time.
pub(crate) struct Air {
    mean: f64,
    /// Size (K), period (s), phase.
    cycles: [(f64, f64, f64); 3],
    noise: f64,
}

impl Air {
    pub(crate) fn new(noise: f64, random: &mut Random) -> Air {
        let mut cycle = |size: f64, period: f64| {
            (size * random.between(0.8, 1.2), period * random.between(0.8, 1.25), random.between(0.0, TAU))
        };
        let cycles = [cycle(0.5, 24e3), cycle(0.35, 5.2e3), cycle(0.15, 1.7e3)];
        Air { mean: 20.4, cycles, noise }
    }

    /// Air, and what follows it with this lag (s), warmer by `more` than usual.
    pub(crate) fn lagged(&self, time_s: f64, lag_s: f64, more: f64) -> f64 {
        let cycle = |(size, period, phase): &(f64, f64, f64)| {
            let (speed, along) = (TAU / period, TAU * time_s / period + phase);
            // The settled answer of a first-order lag to a sine.
            size * (along.sin() - lag_s * speed * along.cos()) / (1.0 + (lag_s * speed).powi(2))
        };
        self.mean + more + self.cycles.iter().map(cycle).sum::<f64>()
    }

    /// Scales X, Y, Z, top and bottom of the bridge.
    pub(crate) fn parts(&self, time_s: f64, more: f64) -> [f64; 5] {
        LAGS.map(|(lag_s, follows)| 20.0 + follows * (self.lagged(time_s, lag_s, more) - 20.0))
    }

    /// What the sensors say of air and parts.
    pub(crate) fn logged(&self, time_s: f64, more: f64, random: &mut Random) -> [f64; 6] {
        let parts = self.parts(time_s, more);
        let all = [self.lagged(time_s, 0.0, more), parts[0], parts[1], parts[2], parts[3], parts[4]];
        all.map(|value| value + self.noise * random.normal())
    }
}
