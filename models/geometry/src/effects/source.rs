//! What a sample says beside the scales: covariates, and why one cannot be used.
//!
//! Place in the flow: live samples, campaign rows and point files implement [`CovariateSource`]; effects read it.

use thiserror::Error;

/// What a sample says about one covariate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CovariateValue {
    /// A value fresh enough to use, in the unit of the name's suffix.
    Fresh(f64),
    /// A value older than allowed.
    Stale,
    /// Nothing known.
    Missing,
}

/// Name under which effects ask for the time of a reading (s since the campaign began), where there is one.
pub const TIME: &str = "time_s";

/// Where an effect finds its covariates.
pub trait CovariateSource {
    /// The covariate of that name, unit as suffix.
    fn covariate(&self, name: &str) -> CovariateValue;
}

/// A source without any covariate.
#[derive(Debug, Clone, Copy)]
pub struct NoCovariates;

impl CovariateSource for NoCovariates {
    fn covariate(&self, _name: &str) -> CovariateValue {
        CovariateValue::Missing
    }
}

/// Why an effect could not be evaluated for a sample.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum CovariateProblem {
    /// The sample does not carry it.
    #[error("covariate {0} is missing from the sample; log it beside the scales")]
    Missing(String),
    /// The sample carries an old value.
    #[error("covariate {0} is older than allowed; check its sensor")]
    Stale(String),
}

/// A covariate of a sample, or why it cannot be used. A value that is not a number counts as missing.
///
/// # Errors
/// It is missing or stale.
pub fn known_covariate(covariates: &dyn CovariateSource, name: &str) -> Result<f64, CovariateProblem> {
    match covariates.covariate(name) {
        CovariateValue::Fresh(value) if value.is_finite() => Ok(value),
        CovariateValue::Fresh(_) | CovariateValue::Missing => Err(CovariateProblem::Missing(name.to_owned())),
        CovariateValue::Stale => Err(CovariateProblem::Stale(name.to_owned())),
    }
}

/// State of the machine at one sample.
#[derive(Clone, Copy)]
pub struct State<'a> {
    /// Indicated axis positions (m).
    pub reading_m: [f64; 3],
    /// Tip or reflector relative to the ram reference point (m, ram frame).
    pub offset_m: [f64; 3],
    /// Logged quantities.
    pub covariates: &'a dyn CovariateSource,
}

impl State<'_> {
    /// A covariate, or why it cannot be used. A value that is not a number counts as missing.
    pub fn covariate(&self, name: &str) -> Result<f64, CovariateProblem> {
        known_covariate(self.covariates, name)
    }

    /// A quantity of the sample by name: a scale or offset in metres (`x_m`, `offset_z_m`) or a covariate.
    pub fn quantity(&self, name: &str) -> Result<f64, CovariateProblem> {
        match position(name) {
            Some((false, axis)) => Ok(self.reading_m[axis]),
            Some((true, axis)) => Ok(self.offset_m[axis]),
            None => self.covariate(name),
        }
    }
}

/// Whether a quantity of that name is the reading of an axis (`x_m`).
pub fn is_scale(name: &str) -> bool {
    matches!(position(name), Some((false, _)))
}

/// Whether the name is that of a scale (`x_m`) or an offset (`offset_x_m`), and of which axis.
pub(super) fn position(name: &str) -> Option<(bool, usize)> {
    let (is_offset, rest) = match name.strip_prefix("offset_") {
        Some(rest) => (true, rest),
        None => (false, name),
    };
    let axis = ["x_m", "y_m", "z_m"].iter().position(|known| *known == rest)?;
    Some((is_offset, axis))
}
