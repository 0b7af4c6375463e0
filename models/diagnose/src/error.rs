//! What can go wrong in a diagnosis, with what to do about it.
//!
//! Place in the flow: returned by every entry point of this crate; the command line prints it once.

use abbe_geometry::effects::{CovariateProblem, EffectError};
use abbe_identify::IdentifyError;
use abbe_measurement::probe_pose::ProbePoseError;
use thiserror::Error;

/// Why a diagnosis could not be made.
#[derive(Debug, Error)]
pub enum DiagnoseError {
    /// The campaign cannot be identified at all.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// An effect of the model does not fit the machine.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// The campaign lacks a covariate that the model's effects need.
    #[error("the campaign cannot be judged with the model's effects: {0}")]
    Covariate(#[from] CovariateProblem),
    /// Sphere centres that do not give the probe's pose.
    #[error(transparent)]
    ProbePose(#[from] ProbePoseError),
    /// Columns that depend on each other, or a covariance that is none.
    #[error("the fit's own columns depend on each other, so nothing can be projected off them; measure a richer plan")]
    Singular,
    /// The observer said stop.
    #[error("stopped before the end; nothing was changed")]
    Stopped,
    /// A row that a study without a chain cannot use.
    #[error("row {}: {problem}; {remedy}", row + 1)]
    Row {
        /// Its place among the rows given, from 0.
        row: usize,
        /// What is wrong.
        problem: String,
        /// What to do.
        remedy: String,
    },
    /// Data that a study without a chain cannot use.
    #[error("{problem}; {remedy}")]
    Data {
        /// What is wrong, with row or key.
        problem: String,
        /// What to do.
        remedy: String,
    },
}
