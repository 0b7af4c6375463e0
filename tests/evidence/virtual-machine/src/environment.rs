//! The room and the machine's temperatures: smooth drift, and what noisy sensors log of it.
//!
//! Place in the flow: [`crate::simulate`] asks for the true state at a time (s since the campaign began), effects
//! act on it, and the logged covariates are that state plus sensor noise. Temperatures in °C, pressure in hPa,
//! humidity in %: the units of the covariate columns.
//! Equation: q(t) = mean + settling·exp(−t/τ) + drift·Σ aₖ sin(2πt/pₖ + φₖ), Σ aₖ² = 2.

use std::f64::consts::TAU;

use rand_chacha::ChaCha8Rng;

use crate::error::{SimulationError, require_finite, require_not_negative, require_positive};
use crate::random::{Purpose, normal, stream, uniform};

/// Names of the sensors' covariates, in the order of [`EnvironmentConfig::channels`].
pub const SENSOR_NAMES: [&str; 9] = [
    "temp_air_c",
    "temp_scale_x_c",
    "temp_scale_y_c",
    "temp_scale_z_c",
    "temp_bridge_top_c",
    "temp_bridge_bottom_c",
    "temp_granite_c",
    "pressure_hpa",
    "humidity_pct",
];

/// Sine waves each channel's drift is made of.
const WAVES: usize = 3;

/// One sensor and what it sees, in the unit of its name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Channel {
    /// Long-term mean.
    pub mean: f64,
    /// Rms of the slow drift.
    pub drift: f64,
    /// Shortest and longest period of the drift (s).
    pub periods_s: [f64; 2],
    /// Excess over the mean when the campaign begins.
    pub settling: f64,
    /// Time constant with which that excess dies away (s).
    pub settling_time_s: f64,
    /// Standard deviation of the sensor's noise.
    pub noise: f64,
}

/// The environment of a campaign.
#[derive(Debug, Clone, PartialEq)]
pub struct EnvironmentConfig {
    /// One channel for each of [`SENSOR_NAMES`].
    pub channels: [Channel; 9],
}

impl EnvironmentConfig {
    /// A room held within some tenths of a kelvin, a bridge that is warmer on top, weather outside.
    pub fn workshop() -> Self {
        let channel = |mean, drift, settling, settling_time_s, noise| Channel {
            mean,
            drift,
            periods_s: [5400.0, 21_600.0],
            settling,
            settling_time_s,
            noise,
        };
        let mut air = channel(20.2, 0.25, 0.0, 3600.0, 0.015);
        air.periods_s = [1800.0, 9000.0];
        Self {
            channels: [
                air,
                channel(20.2, 0.2, -0.3, 4000.0, 0.01),
                channel(20.15, 0.2, -0.2, 5000.0, 0.01),
                channel(20.2, 0.25, 0.1, 3000.0, 0.01),
                channel(20.6, 0.35, 0.5, 6000.0, 0.018),
                channel(20.15, 0.15, 0.0, 6000.0, 0.008),
                channel(20.2, 0.04, -0.15, 12_000.0, 0.005),
                channel(1009.0, 2.5, 0.0, 3600.0, 0.04),
                channel(46.0, 3.0, 0.0, 3600.0, 0.2),
            ],
        }
    }

    /// 20 °C, 1013.25 hPa and 50 % for ever, with perfect sensors.
    pub fn constant() -> Self {
        let channel = |mean| Channel {
            mean,
            drift: 0.0,
            periods_s: [3600.0, 3600.0],
            settling: 0.0,
            settling_time_s: 3600.0,
            noise: 0.0,
        };
        let mut channels = [channel(20.0); 9];
        channels[7] = channel(1013.25);
        channels[8] = channel(50.0);
        Self { channels }
    }

    pub(crate) fn check(&self) -> Result<(), SimulationError> {
        for (channel, name) in self.channels.iter().zip(SENSOR_NAMES) {
            let key = |field: &str| format!("environment.{name}.{field}");
            require_finite(&key("mean"), &[channel.mean])?;
            require_finite(&key("settling"), &[channel.settling])?;
            require_not_negative(&key("drift"), channel.drift)?;
            require_not_negative(&key("noise"), channel.noise)?;
            require_positive(&key("settling_time_s"), channel.settling_time_s)?;
            require_positive(&key("periods_s[0]"), channel.periods_s[0])?;
            require_finite(&key("periods_s[1]"), &[channel.periods_s[1]])?;
            if channel.periods_s[1] < channel.periods_s[0] {
                return Err(SimulationError::new(
                    key("periods_s"),
                    format!("{:?} falls", channel.periods_s),
                    "give [shortest, longest]",
                ));
            }
        }
        Ok(())
    }
}

/// The state of the environment at one instant, in the units of [`SENSOR_NAMES`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnvironmentState {
    /// One value for each of [`SENSOR_NAMES`].
    pub values: [f64; 9],
}

impl EnvironmentState {
    /// Air temperature (°C).
    pub fn air_c(&self) -> f64 {
        self.values[0]
    }

    /// Temperatures of the scales of X, Y, Z (°C).
    pub fn scale_c(&self) -> [f64; 3] {
        [self.values[1], self.values[2], self.values[3]]
    }

    /// Temperature at the top of the bridge minus that at its bottom (K).
    pub fn bridge_gradient_k(&self) -> f64 {
        self.values[4] - self.values[5]
    }

    /// Air pressure (hPa).
    pub fn pressure_hpa(&self) -> f64 {
        self.values[7]
    }

    /// Relative humidity (%).
    pub fn humidity_pct(&self) -> f64 {
        self.values[8]
    }
}

/// One sine of a drift.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Wave {
    amplitude: f64,
    per_second: f64,
    phase_rad: f64,
}

/// The drift drawn for one seed, a closed function of time, and the noise of its sensors.
#[derive(Debug, Clone, PartialEq)]
pub struct Environment {
    channels: [Channel; 9],
    waves: [[Wave; WAVES]; 9],
    noise: ChaCha8Rng,
}

impl Environment {
    /// The room of one seed.
    pub fn new(config: &EnvironmentConfig, seed: u64) -> Self {
        let mut generator = stream(seed, Purpose::EnvironmentDrift);
        let waves = config.channels.map(|channel| {
            let weights: [f64; WAVES] = std::array::from_fn(|_| uniform(&mut generator, 0.3, 1.0));
            let norm = (weights.iter().map(|w| w * w).sum::<f64>() / 2.0).sqrt();
            weights.map(|weight| Wave {
                amplitude: channel.drift * weight / norm,
                per_second: TAU / uniform(&mut generator, channel.periods_s[0], channel.periods_s[1]),
                phase_rad: uniform(&mut generator, 0.0, TAU),
            })
        });
        Self { channels: config.channels, waves, noise: stream(seed, Purpose::SensorNoise) }
    }

    /// True state at a time (s since the campaign began).
    pub fn state(&self, time_s: f64) -> EnvironmentState {
        let mut values = [0.0; 9];
        for ((value, channel), waves) in values.iter_mut().zip(&self.channels).zip(&self.waves) {
            let drift: f64 = waves.iter().map(|w| w.amplitude * (w.per_second * time_s + w.phase_rad).sin()).sum();
            let settling = channel.settling * (-time_s / channel.settling_time_s).exp();
            *value = channel.mean + settling + drift;
        }
        EnvironmentState { values }
    }

    /// What follows the true state with a time constant (s, above zero), and has followed it for ever: each wave is smaller by
    /// 1/√(1 + (ωτ)²) and late by atan(ωτ). The settling is met in balance as the campaign begins.
    pub fn behind(&self, time_s: f64, lag_s: f64) -> EnvironmentState {
        let mut values = [0.0; 9];
        for ((value, channel), waves) in values.iter_mut().zip(&self.channels).zip(&self.waves) {
            let wave = |w: &Wave| {
                let late_rad = (w.per_second * lag_s).atan();
                w.amplitude * late_rad.cos() * (w.per_second * time_s + w.phase_rad - late_rad).sin()
            };
            let drift: f64 = waves.iter().map(wave).sum();
            *value = channel.mean + channel.settling * settling_behind(time_s, channel.settling_time_s, lag_s) + drift;
        }
        EnvironmentState { values }
    }

    /// What the sensors show of a state; draws one noise value a sensor.
    pub(crate) fn logged(&mut self, state: &EnvironmentState) -> [f64; 9] {
        let mut out = state.values;
        for (value, channel) in out.iter_mut().zip(&self.channels) {
            *value += channel.noise * normal(&mut self.noise);
        }
        out
    }
}

/// τ dy/dt = exp(−t/T) − y from y(0) = 1: (T·exp(−t/T) − τ·exp(−t/τ))/(T − τ), and its limit for equal constants.
fn settling_behind(time_s: f64, settling_s: f64, lag_s: f64) -> f64 {
    let apart_s = settling_s - lag_s;
    if apart_s.abs() < 1e-6 * settling_s {
        return (1.0 + time_s / settling_s) * (-time_s / settling_s).exp();
    }
    (settling_s * (-time_s / settling_s).exp() - lag_s * (-time_s / lag_s).exp()) / apart_s
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against small steps of the equation itself.
    #[test]
    fn what_lags_behind_obeys_its_equation() {
        let room = Environment::new(&EnvironmentConfig::workshop(), 5);
        for lag_s in [300.0, 4000.0] {
            let step_s = 0.5;
            for k in 1..200_u32 {
                let time_s = 37.0 * f64::from(k);
                let [before, now, after] = [-step_s, 0.0, step_s].map(|d| room.behind(time_s + d, lag_s).values);
                let input = room.state(time_s).values;
                for d in 0..9 {
                    let slope = (after[d] - before[d]) / (2.0 * step_s);
                    // Central differences over 1 s of curves that change over hours.
                    assert!((lag_s * slope - (input[d] - now[d])).abs() < 1e-5, "{lag_s} {time_s} {d}");
                }
            }
        }
    }

    #[test]
    fn drift_has_the_rms_asked_for_over_a_long_time() {
        let environment = Environment::new(&EnvironmentConfig::workshop(), 3);
        let drift = environment.channels[7].drift;
        let mut total = 0.0;
        let steps = 20_000_u32;
        for step in 0..steps {
            let state = environment.state(300.0 * f64::from(step));
            total += (state.pressure_hpa() - environment.channels[7].mean).powi(2);
        }
        // 280 longest periods: the mean square of sines not commensurate with the steps settles to a few %.
        let rms = (total / f64::from(steps)).sqrt();
        assert!((rms / drift - 1.0).abs() < 0.1, "{rms} for {drift}");
    }

    #[test]
    fn a_constant_room_logs_exactly_its_means() {
        let mut environment = Environment::new(&EnvironmentConfig::constant(), 3);
        let state = environment.state(12_345.0);
        assert_eq!(environment.logged(&state), state.values);
        assert_eq!(state.air_c(), 20.0);
        assert_eq!(state.humidity_pct(), 50.0);
    }
}
