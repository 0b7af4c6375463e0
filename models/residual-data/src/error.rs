//! Why no residual vectors can be given.
//!
//! Place in the flow: everything in this crate returns it; the text says what to do.

use abbe_identify::IdentifyError;
use abbe_identify::station_start::StartError;
use abbe_measurement::alignment::AlignmentError;
use thiserror::Error;

/// Why no residual vectors can be given.
#[derive(Debug, Error)]
pub enum ResidualError {
    /// A covariate or station is missing.
    #[error(transparent)]
    Campaign(#[from] IdentifyError),
    /// A station of a new campaign cannot be placed.
    #[error("station {station}: {problem}")]
    Station {
        /// Its name.
        station: String,
        /// Why.
        problem: StartError,
    },
    /// Known points that fix no frame.
    #[error(transparent)]
    Alignment(#[from] AlignmentError),
    /// A reading that the model cannot correct.
    #[error(
        "reading {reading}: the model does not correct it ({status:?}); remove it, or give the covariates that the model's effects need"
    )]
    Uncorrected {
        /// Number of the reading, counted from 1.
        reading: usize,
        /// Why not.
        status: abbe_geometry::correct::Status,
    },
    /// Too little to estimate a field from.
    #[error("{0} readings are left after outliers; a vector field needs at least {1}")]
    TooFew(usize, usize),
    /// Matrices that cannot be factored.
    #[error("the covariance of the ranges is not positive definite; a reading or an uncertainty is not sane")]
    Singular,
    /// The ranges hold nothing that a field of position would explain.
    #[error(
        "the range residuals show no field beyond the model and noise (evidence {evidence:.1}, at least {least:.0} is asked \
         for): there is nothing to train on; the residual stands at {noise:.2} of the declared noise"
    )]
    NothingThere {
        /// Gain of twice the log likelihood less what its parameters cost.
        evidence: f64,
        /// What is asked for.
        least: f64,
        /// Noise over declared noise.
        noise: f64,
    },
    /// No component of any point is seen.
    #[error(
        "no station sees any component of the residual at any point; measure from more stations, around the volume"
    )]
    Unseen,
    /// Fewer known points than fix frame and field.
    #[error("{0} points are too few to tell a field from a misaligned frame; give at least {1}")]
    FewPoints(usize, usize),
    /// Stopped on request.
    #[error("stopped on request")]
    Stopped,
}
