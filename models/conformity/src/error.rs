//! The one error of this crate: where, what is wrong, what to do.
//!
//! Place in the flow: readers of files put file and line in front of it.

use thiserror::Error;

/// Data or settings from which no figure of a standard can be computed.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{place}: {problem}; {remedy}")]
pub struct ConformityError {
    /// Where: a measuring line, an axis, a setting.
    pub place: String,
    /// What is wrong.
    pub problem: String,
    /// What to do.
    pub remedy: String,
}

impl ConformityError {
    /// An error at a place.
    pub fn new(place: impl Into<String>, problem: impl Into<String>, remedy: impl Into<String>) -> ConformityError {
        ConformityError { place: place.into(), problem: problem.into(), remedy: remedy.into() }
    }
}
