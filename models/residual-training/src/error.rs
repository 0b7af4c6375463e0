//! Why a training gives no model.
//!
//! Place in the flow: every step of [`crate::train()`] returns it; the texts say what to do.

use crate::config::ConfigRange;
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
        "the points lie in {occupied} of {blocks} blocks of space, which cannot be dealt to {folds} folds with enough points each; in \
         [split] of the configuration give fewer folds or more blocks_per_axis, or kind = \"random\", whose figures flatter"
    )]
    Folds {
        /// Blocks with points.
        occupied: usize,
        /// All blocks.
        blocks: usize,
        /// Folds.
        folds: usize,
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
