//! Why a trial has no result.
//!
//! Place in the flow: returned by every step of a trial, told beside its name.

use abbe_geometry::effects::EffectError;
use abbe_identify::IdentifyError;
use abbe_virtual_machine::SimulationError;
use thiserror::Error;

/// Why a trial has no result.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum TrialError {
    /// The simulator refuses a setting.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// Identification refuses the campaign.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// An effect of a model is wrong.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// The machine cannot be described.
    #[error("description: {0}")]
    Description(String),
    /// A template of an effect is wrong.
    #[error("template {0}")]
    Template(String),
    /// A model cannot be scored.
    #[error("verification: {0}")]
    Verification(String),
    /// No size of the effect leads to the factor asked for.
    #[error("no size up to {size} times the template's raises the verification error that far")]
    Unreachable {
        /// Size where the search ended.
        size: f64,
    },
    /// The diagnosis failed.
    #[error("diagnosis: {0}")]
    Diagnosis(String),
}
