//! Why there is no network, or no point; what can be told before any arithmetic.

use super::{LEAST_STATIONS, NetworkOptions, Sighting, Start};
use thiserror::Error;

/// Why a point has no position; the text says what to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum PointProblem {
    /// Too few stations.
    #[error("seen from {0} stations (at least 3 are needed); measure it from more")]
    TooFew(usize),
    /// A direction is not seen.
    #[error("it and its stations lie nearly in a plane or on a line; measure it from another side")]
    Unseen,
    /// A direction is hardly seen.
    #[error(
        "it lies so nearly in a plane with its stations that it would be known 20 times worse than the others; measure it \
         from another side"
    )]
    Poor,
    /// Its ranges do not agree.
    #[error(
        "its ranges contradict each other, and nothing tells which is wrong; measure it again, and from more stations"
    )]
    Contradicting,
}

/// What the plan lacks that leaves more than the frame open.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum Lack {
    /// Stations in a plane.
    #[error("the stations lie nearly in a plane or on a line: put one at another height")]
    FlatStations,
    /// Points in a plane.
    #[error("the points lie nearly in a plane or on a line: measure points that fill a volume")]
    FlatPoints,
    /// Anything else.
    #[error(
        "too few of the points are common to these and other stations: measure more points from four stations or more, over a larger volume"
    )]
    Common,
}

/// Why there is no network; indices count from 0.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum NetworkError {
    /// Too few stations.
    #[error("{0} stations cannot calibrate each other (at least {LEAST_STATIONS} are needed); measure from more")]
    TooFewStations(usize),
    /// Fewer ranges than unknowns.
    #[error(
        "the stations have {unknowns} unknowns, and only {checks} ranges are left beside the three that fix each point; measure \
         more points from four stations or more"
    )]
    TooFewRanges {
        /// Ranges beyond three a point.
        checks: usize,
        /// Coordinates and dead paths of stations, less the six of the frame.
        unknowns: usize,
    },
    /// Stations in a plane, which leaves no points.
    #[error("the stations lie nearly in a plane or on a line: put one at another height")]
    FlatStations,
    /// A number that is none, or an index that leads nowhere.
    #[error(
        "sighting {0}: a length, uncertainty or start is not a usable number, or its station or point is not listed"
    )]
    Unusable(usize),
    /// An uncertainty that is none.
    #[error("the uncertainty of dead paths that are known beforehand is not above zero")]
    DeadPath,
    /// An uncertainty that is none.
    #[error("the uncertainty of the scale that all lengths have in common is no number of 0 or more")]
    CommonScale,
    /// The same range twice.
    #[error("sighting {0} repeats an earlier one of the same station and point; average them first")]
    Duplicate(usize),
    /// Ranges of another size than the starts.
    #[error(
        "half of the ranges are less than half or more than twice the distance between the starts; the unit is wrong, or \
         points and ranges do not belong together"
    )]
    WrongUnit,
    /// The plan leaves more open than the frame.
    #[error("the ranges leave stations {} free by {:.2} mm (k = 1): {lack}", list(.stations), .free_m * 1e3)]
    Loose {
        /// Stations that move most.
        stations: Vec<usize>,
        /// By how much (m, k = 1).
        free_m: f64,
        /// What is lacking.
        lack: Lack,
    },
    /// No solution.
    #[error(
        "the ranges contradict each other, or the starts are far off; check that points and ranges belong together"
    )]
    NotConverged,
    /// Rounding.
    #[error(
        "the equations of the network cannot be solved in double precision; check coordinates, lengths and uncertainties"
    )]
    Singular,
    /// The caller wanted no more.
    #[error("stopped")]
    Stopped,
}

fn list(stations: &[usize]) -> String {
    let names: Vec<String> = stations.iter().map(ToString::to_string).collect();
    names.join(", ")
}

/// Refuses what no adjustment can use.
pub(super) fn check(start: &Start, sightings: &[Sighting], options: NetworkOptions) -> Result<(), NetworkError> {
    if options.u_dead_path_m.is_some_and(|u_m| !(u_m.is_finite() && u_m > 0.0)) {
        return Err(NetworkError::DeadPath);
    }
    if !(options.u_common_scale.is_finite() && options.u_common_scale >= 0.0) {
        return Err(NetworkError::CommonScale);
    }
    if start.stations.len() < LEAST_STATIONS {
        return Err(NetworkError::TooFewStations(start.stations.len()));
    }
    let mut seen = std::collections::BTreeSet::new();
    for (k, s) in sightings.iter().enumerate() {
        let starts = start.stations.get(s.station).zip(start.points_m.get(s.point));
        let finite = starts.is_some_and(|(a, b)| {
            a.dead_path_m.is_finite()
                && a.position_m.iter().chain(b.iter()).chain(s.shift_m.iter()).all(|v| v.is_finite())
        });
        if !(finite && s.length_m.is_finite() && s.u_m.is_finite() && s.u_m > 0.0) {
            return Err(NetworkError::Unusable(k));
        }
        if !seen.insert((s.station, s.point)) {
            return Err(NetworkError::Duplicate(k));
        }
    }
    // Ranges alone fix the scale: in a wrong unit they would give a network of a wrong size without complaint.
    let is_near = |s: &&Sighting| {
        let station = &start.stations[s.station];
        let ratio = (s.length_m + station.dead_path_m) / (start.points_m[s.point] - station.position_m).norm();
        (0.5..=2.0).contains(&ratio)
    };
    if 2 * sightings.iter().filter(is_near).count() < sightings.len() {
        return Err(NetworkError::WrongUnit);
    }
    Ok(())
}
