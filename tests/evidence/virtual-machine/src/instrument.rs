//! The tracer's and the machine's noise: range uncertainty, white and correlated, repeatability, resolution and outliers.
//!
//! Place in the flow: [`crate::simulate`] adds it to every range. All values SI, standard deviations (k = 1).

use abbe_measurement::instrument::RangeUncertainty;

use crate::error::{SimulationError, require_finite, require_not_negative, require_positive};

/// Readings spoilt on purpose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outliers {
    /// Chance of each reading but a station's first, in [0, 1].
    pub fraction: f64,
    /// Size of the false length; its sign is drawn (m).
    pub size_m: f64,
}

/// Noise of the range that one reading shares with those before it on its station (air, mounting, beam tracking).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correlated {
    /// Standard deviation (m).
    pub deviation_m: f64,
    /// Correlation of readings that follow one another, in [0, 1): a first-order autoregression in the order of measurement.
    pub neighbours: f64,
    /// Begins anew with each line instead of with each station.
    pub by_line: bool,
}

/// Noise of one measurement set-up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InstrumentConfig {
    /// Standard deviation of the range noise, u(L) = a + b·L.
    pub range: RangeUncertainty,
    /// Range noise beside it, correlated from reading to reading; `None` for none.
    pub correlated: Option<Correlated>,
    /// Standard deviation of where each axis stops for one and the same reading (m).
    pub repeatability_m: [f64; 3],
    /// Smallest step of the displayed length (m); `None` shows it in full.
    pub resolution_m: Option<f64>,
    /// Spoilt readings; `None` for none.
    pub outliers: Option<Outliers>,
}

impl InstrumentConfig {
    /// The recorded campaigns' set-up: U(k = 2) = 0.05 µm + 0.3 µm/m, 0.25 µm repeatability of each axis.
    pub const LASER_TRACER: InstrumentConfig = InstrumentConfig {
        range: RangeUncertainty { constant_m: 0.025e-6, per_metre: 0.15e-6, common_per_metre: 0.0 },
        correlated: None,
        repeatability_m: [0.25e-6; 3],
        resolution_m: None,
        outliers: None,
    };

    /// No noise at all: the length is the distance.
    pub const NOISELESS: InstrumentConfig = InstrumentConfig {
        range: RangeUncertainty { constant_m: 0.0, per_metre: 0.0, common_per_metre: 0.0 },
        correlated: None,
        repeatability_m: [0.0; 3],
        resolution_m: None,
        outliers: None,
    };

    pub(crate) fn check(&self) -> Result<(), SimulationError> {
        require_not_negative("instrument.range.constant_m", self.range.constant_m)?;
        require_not_negative("instrument.range.per_metre", self.range.per_metre)?;
        for value in self.repeatability_m {
            require_not_negative("instrument.repeatability_m", value)?;
        }
        if let Some(step_m) = self.resolution_m {
            require_positive("instrument.resolution_m", step_m)?;
        }
        if let Some(correlated) = self.correlated {
            require_not_negative("instrument.correlated.deviation_m", correlated.deviation_m)?;
            if !(0.0..1.0).contains(&correlated.neighbours) {
                return Err(SimulationError::new(
                    "instrument.correlated.neighbours",
                    format!("{} is not in [0, 1)", correlated.neighbours),
                    "give the correlation of readings that follow one another, such as 0.9",
                ));
            }
        }
        if let Some(outliers) = self.outliers {
            require_finite("instrument.outliers.size_m", &[outliers.size_m])?;
            if !(0.0..=1.0).contains(&outliers.fraction) {
                return Err(SimulationError::new(
                    "instrument.outliers.fraction",
                    format!("{} is not in [0, 1]", outliers.fraction),
                    "give the share of spoilt readings, such as 0.01",
                ));
            }
        }
        Ok(())
    }
}
