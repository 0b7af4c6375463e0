//! What the caller may choose, and how identification tells how far it is.
//!
//! Place in the flow: filled by the command line or a test; nothing here has a hidden default elsewhere.

use crate::range_correlation::RangeCorrelation;
pub use abbe_measurement::instrument::U_ABSOLUTE_ZERO_M;

/// How many coefficients each error function gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OrderChoice {
    /// Decided by the data: restricted marginal likelihood for splines, BIC for polynomials. Nodes stay as the
    /// machine file says.
    Evidence,
    /// Exactly what the machine file says, without penalty.
    Fixed,
}

/// What is believed of how the noise of ranges is correlated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Noise {
    /// The data say: white, unless the likelihood shows a correlation.
    Estimated,
    /// As given; `None` for white.
    Given(Option<RangeCorrelation>),
}

/// Choices of one identification.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IdentifyOptions {
    /// Order of the error functions.
    pub order: OrderChoice,
    /// Down-weight and reject outlying readings (beyond 3.5 and 6 robust deviations); otherwise all weigh as declared.
    pub robust: bool,
    /// The instrument measures absolute distance: dead paths are zero, but for [`U_ABSOLUTE_ZERO_M`].
    pub absolute_range: bool,
    /// How the noise of ranges is correlated. White by default: what a model lacks looks like such noise, so a person has to
    /// say that the model lacks nothing.
    pub noise: Noise,
    /// Passes over the readings after which a fit that still moves is given up.
    pub max_passes: usize,
}

impl Default for IdentifyOptions {
    fn default() -> IdentifyOptions {
        IdentifyOptions {
            order: OrderChoice::Evidence,
            robust: true,
            absolute_range: false,
            noise: Noise::Given(None),
            max_passes: 30,
        }
    }
}

/// One step of progress; the observer returns false to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Pass over the readings, from 1.
    pub pass: usize,
    /// Largest step of this pass in units of the parameter's uncertainty.
    pub largest_step: f64,
    /// χ² per degree of freedom.
    pub chi2_per_dof: f64,
}
