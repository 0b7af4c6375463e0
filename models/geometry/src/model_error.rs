//! Why the parts of a model make none.
//!
//! Place in the flow: [`crate::model`] and what it checks with return it; readers of model files tell it to the user.

use crate::effects::EffectError;
use crate::machine::MachineError;
use thiserror::Error;

/// A model whose parts do not fit together.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ModelError {
    /// The machine description is wrong.
    #[error(transparent)]
    Machine(#[from] MachineError),
    /// An effect is unknown.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// A list has the wrong length.
    #[error(
        "{what} holds {found} numbers, but {expected} are needed for this machine; the model is damaged or of another version"
    )]
    Length {
        /// Which list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length it must have.
        expected: usize,
    },
    /// A range of a covariate that is none.
    #[error("covariate {name} is said to go from {low} to {high}, which is no range; the model is damaged")]
    Covariate {
        /// Its name.
        name: String,
        /// Lower end.
        low: f64,
        /// Upper end.
        high: f64,
    },
    /// A variance is below zero.
    #[error("the covariance holds a variance of {variance} for parameter {parameter}; the model is damaged")]
    Variance {
        /// Number of the parameter, from 1.
        parameter: usize,
        /// Its variance.
        variance: f64,
    },
    /// What a machine does by place is no variance.
    #[error("the variance by place of quality.wanders is none: {what}; the model is damaged")]
    ByPlace {
        /// Why.
        what: &'static str,
    },
    /// An expansion that is none.
    #[error("the expansion by {sensor} of quality.unseen_expansions is none: {what}; the model is damaged")]
    UnseenExpansion {
        /// Its sensor.
        sensor: String,
        /// Why.
        what: &'static str,
    },
    /// Models that have no mean.
    #[error("these models have no mean: their {what} do not fit together")]
    Mixture {
        /// What differs, or is none.
        what: &'static str,
    },
    /// A number is not finite.
    #[error("{what} holds a number that is not finite; the model is damaged")]
    NotFinite {
        /// Which list.
        what: &'static str,
    },
}
