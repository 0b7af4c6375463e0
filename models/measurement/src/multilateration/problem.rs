//! Why a campaign gives no points, and what to do.
//!
//! Place in the flow: returned by [`super::solve`].

use super::pairs::LeftOut;
use crate::network::{LEAST_STATIONS, NetworkError};
use crate::station_start::StartError;
use thiserror::Error;

/// Why a campaign has no solution; the text says what to do.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Problem {
    /// Too few stations.
    #[error("{0} stations (at least {LEAST_STATIONS} are needed); measure the points from more")]
    TooFewStations(usize),
    /// An option that is none.
    #[error("{0} is not above zero; give it in metres")]
    Option(&'static str),
    /// A reading that is none.
    #[error("reading {0}: a number is not finite; correct or remove it")]
    NotFinite(usize),
    /// A station failed.
    #[error("station {name}: {why}")]
    Station {
        /// Its name.
        name: String,
        /// Why.
        why: StartError,
    },
    /// Lengths of another size than the ways of the machine.
    #[error(
        "station {0}: lengths change by more than twice the way between the points; they do not share a unit, or do not belong to these points"
    )]
    Unit(String),
    /// Two stations are one.
    #[error("stations {0} and {1} stand at the same place; move one, or merge them to one station")]
    SameStation(String, String),
    /// Stations and points have no common solution.
    #[error("stations {stations}: {why}{}", also(.left_out.as_ref()))]
    Network {
        /// Names of the stations that take part.
        stations: String,
        /// Why.
        why: NetworkError,
        /// Readings that had been left out before, where they are many.
        left_out: Option<LeftOut>,
    },
    /// No point is left.
    #[error(
        "none of {points} points is seen from {LEAST_STATIONS} stations; measure the same points from every station"
    )]
    NoPoint {
        /// Points there are.
        points: usize,
    },
    /// No point is left without the readings that contradict each other.
    #[error(
        "{seen} of {points} points are seen from {LEAST_STATIONS} stations or more, but none is left without the readings that \
         contradict each other: {left_out}"
    )]
    NoPointLeft {
        /// Points there are.
        points: usize,
        /// Points that enough stations saw.
        seen: usize,
        /// What contradicted.
        left_out: LeftOut,
    },
}

/// Share of repeated readings that contradict each other, from which a failure may be their doing.
pub(super) const MANY: f64 = 0.05;

fn also(left_out: Option<&LeftOut>) -> String {
    left_out.map_or_else(String::new, |left_out| format!(". Before that, readings were left out: {left_out}"))
}
