//! Why a training gives no model.
//!
//! Place in the flow: every step of [`crate::train()`] returns it; the texts say what to do.

use crate::config::{ConfigRange, Split, SplitKind};
use crate::optimise::OptimiseError;
use crate::views::ViewError;
use abbe_field::kriging::KrigingError;
use abbe_residual_net::ModelError;
use abbe_residual_net::network::ParametersError;
use thiserror::Error;

/// Points below which no held-out share tells 95 % from all.
pub(crate) const LEAST_POINTS: usize = 20;

/// Why there is no model.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum TrainingError {
    /// Configuration out of range.
    #[error("configuration: {0}")]
    Config(#[from] ConfigRange),
    /// Fewer points than can show what 95 % is.
    #[error(
        "{0} points; at least {LEAST_POINTS} are needed, so that held-out ones can show what their 95 % interval is: measure more"
    )]
    Few(usize),
    /// A fold without points.
    #[error(
        "{points} points, {occupied} parts of space with points in them, dealt to {folds} folds: what is held out leaves {learnt} points to \
         learn from at the least, and {least} are needed in each, with no fold empty; {}{}",
        remedy_words(remedy.as_ref()),
        more_words(*points, *enough, *folds)
    )]
    Folds {
        /// All points.
        points: usize,
        /// Blocks with points.
        occupied: usize,
        /// Folds.
        folds: usize,
        /// Points left to learn from where fewest are.
        learnt: usize,
        /// As many are needed.
        least: usize,
        /// A split that works with these points.
        remedy: Option<Split>,
        /// Points that are enough for these folds where they are of even size.
        enough: usize,
    },
    /// Kriging has no fit.
    #[error("kriging: {0}")]
    Kriging(#[from] KrigingError),
    /// Covariance without an inverse.
    #[error("kriging: the covariance of the points is not positive definite")]
    NotPositiveDefinite,
    /// A fold leaves too little.
    #[error("{0}")]
    View(#[from] ViewError),
    /// A member cannot be trained.
    #[error("{kind}, member {member}: {source}")]
    Member {
        /// Kind.
        kind: &'static str,
        /// Member.
        member: usize,
        /// Why.
        source: OptimiseError,
    },
    /// Parameters that are none.
    #[error("trained parameters: {0}")]
    Parameters(#[from] ParametersError),
    /// The parts make no model.
    #[error("{0}")]
    Model(#[from] ModelError),
    /// A state of something else.
    #[error("the state to go on from was made with another {0}; start the training anew")]
    State(&'static str),
    /// Nothing held out, or errors of exactly zero.
    #[error("{0}: held-out predictions give no scale for the uncertainty; are all residuals equal?")]
    NoCalibration(&'static str),
}

/// What to write in the configuration.
fn remedy_words(remedy: Option<&Split>) -> String {
    let Some(Split { kind, folds, blocks_per_axis }) = remedy else { return String::new() };
    let (keys, but) = match kind {
        SplitKind::Blocks => (format!("folds = {folds} and blocks_per_axis = {blocks_per_axis}"), ""),
        SplitKind::Random => (format!("folds = {folds} and kind = \"random\""), ", whose figures flatter"),
    };
    format!("these points train with {keys} in [split] of the configuration (--config){but}; or ")
}

/// What to measure.
fn more_words(points: usize, enough: usize, folds: usize) -> String {
    if points < enough {
        format!("measure more: {enough} points or more, evenly spread, are enough for {folds} folds")
    } else {
        format!("measure in more parts of space, as many points in each: {folds} folds want {folds} parts or more")
    }
}
