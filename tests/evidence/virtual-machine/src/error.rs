//! The one error of this crate: a setting that cannot be simulated, named by its key.
//!
//! Place in the flow: every `check` and constructor returns it; nothing is clamped or defaulted instead.

use thiserror::Error;

/// A setting of the simulation that makes no sense, with the key it stands under and what to do.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{key}: {problem}; {remedy}")]
pub struct SimulationError {
    /// Path of the setting, such as `machine.errors.EXX` or `plan.stations[2].lines[0].points`.
    pub key: String,
    /// What was found.
    pub problem: String,
    /// What to write instead.
    pub remedy: String,
}

impl SimulationError {
    pub(crate) fn new(key: impl Into<String>, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { key: key.into(), problem: problem.into(), remedy: remedy.into() }
    }

    /// The same error seen from one level up: `range` under `instrument` becomes `instrument.range`.
    pub(crate) fn under(mut self, parent: &str) -> Self {
        self.key = if self.key.is_empty() { parent.to_owned() } else { format!("{parent}.{}", self.key) };
        self
    }
}

/// Refuses NaN and infinities.
pub(crate) fn require_finite(key: &str, values: &[f64]) -> Result<(), SimulationError> {
    match values.iter().find(|v| !v.is_finite()) {
        Some(bad) => Err(SimulationError::new(key, format!("{bad} is not a finite number"), "give a finite number")),
        None => Ok(()),
    }
}

/// Refuses anything but a finite number that is zero or more.
pub(crate) fn require_not_negative(key: &str, value: f64) -> Result<(), SimulationError> {
    require_finite(key, &[value])?;
    if value < 0.0 {
        return Err(SimulationError::new(key, format!("{value} is negative"), "give zero or more"));
    }
    Ok(())
}

/// Refuses anything but a finite number above zero.
pub(crate) fn require_positive(key: &str, value: f64) -> Result<(), SimulationError> {
    require_finite(key, &[value])?;
    if value <= 0.0 {
        return Err(SimulationError::new(key, format!("{value} is not positive"), "give a number above zero"));
    }
    Ok(())
}
