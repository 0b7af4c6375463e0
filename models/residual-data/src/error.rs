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
        "{readings} ranges from {stations} stations tell of no component of the residual, at any point, more than the size of the field \
         ({amplitude_um:.2} µm) itself: beside a field they leave {noise:.1} times the declared noise ({without:.1} without one); {}",
        unseen_words(*stations, *noise)
    )]
    Unseen {
        /// Ranges used.
        readings: usize,
        /// Stations that they come from.
        stations: usize,
        /// Largest size of the field along an axis (µm).
        amplitude_um: f64,
        /// Noise over declared noise beside the field, and without any.
        noise: f64,
        /// The same without any field.
        without: f64,
    },
    /// Fewer known points than fix frame and field.
    #[error("{0} points are too few to tell a field from a misaligned frame; give at least {1}")]
    FewPoints(usize, usize),
    /// Stopped on request.
    #[error("stopped on request")]
    Stopped,
}

/// Noise over declared noise from which the ranges contradict each other.
const CONTRADICTS: f64 = 1.3;
/// Stations from which lines of sight cross in all directions, if they stand around the volume.
const ENOUGH_STATIONS: usize = 4;

/// What hides a field, and what to do.
fn unseen_words(stations: usize, noise: f64) -> &'static str {
    match (noise > CONTRADICTS, stations < ENOUGH_STATIONS) {
        (true, _) => {
            "what they contradict each other by is no field of position: an instrument whose zero or scale wanders, a station that moved, \
             or a noise declared too small; look for it with abbe diagnose --campaign, and measure again"
        }
        (false, true) => "measure from more stations, around the volume",
        (false, false) => {
            "it is too small for so many ranges, or changes faster than they follow; measure more points, closer together"
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_what_hides_a_field_is_the_noise_where_stations_are_many() {
        let said = |stations, noise| {
            ResidualError::Unseen { readings: 700, stations, amplitude_um: 1.4, noise, without: 4.0 }.to_string()
        };
        assert!(
            said(5, 4.0).contains("4.0 times the declared noise") && said(5, 4.0).contains("wanders"),
            "{}",
            said(5, 4.0)
        );
        assert!([said(5, 4.0), said(5, 1.0)].iter().all(|said| !said.contains("more stations")));
        assert!(said(2, 1.0).contains("measure from more stations"));
    }
}
