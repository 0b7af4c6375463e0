//! Whether a plan fixes all but the frame.
//!
//! Place in the flow: before each least squares, at the places where stations and points stand. What is free by so much that
//! the bend of the sphere about a station shows before its slope does is not known to first order, so that no covariance of it
//! would be true: it is refused, with what would help.

use super::blocks::{Blocks, of_station};
use super::error::Lack;
use super::{LEAST_SIGHTS, NetworkError, PointProblem, Search};
use crate::robust::median;
use nalgebra::{Matrix3, Vector3};

/// Smallest over largest extent below which places are called flat.
const FLAT: f64 = 0.03;
/// Smallest over largest eigenvalue from which rounding decides.
const ROUNDING: f64 = 1e-13;
/// Points known this many times worse than most are left out: the frame is that of all, and one such would shake it.
const POOR: f64 = 20.0;
/// Share of the largest motion from which a station counts as moving.
const MOVING: f64 = 0.5;

/// Whether a motion of `free_m` (k = 1) across a line of sight changes the range by less than its uncertainty.
fn is_linear(free_m: f64, range_m: f64, u_m: f64) -> bool {
    free_m * free_m / (2.0 * range_m) < u_m
}

/// Points that take part and are not fixed by their stations, with the reason.
pub(super) fn loose(search: &Search) -> Vec<(usize, PointProblem)> {
    let free: Vec<(usize, Result<f64, PointProblem>)> = search.solvable().map(|k| (k, free_m(search, k))).collect();
    let known = free.iter().filter_map(|(_, free_m)| free_m.as_ref().ok().copied()).collect();
    let limit_m = POOR * median(known).unwrap_or(0.0);
    let problem = |free: &Result<f64, PointProblem>| match free {
        Ok(free_m) if *free_m > limit_m => Some(PointProblem::Poor),
        Ok(_) => None,
        Err(why) => Some(*why),
    };
    free.iter().filter_map(|(point, free)| Some((*point, problem(free)?))).collect()
}

/// Standard deviation of a point along the direction that its stations see least (m).
fn free_m(search: &Search, point: usize) -> Result<f64, PointProblem> {
    let sights: Vec<usize> = search.sights(point).collect();
    if sights.len() < LEAST_SIGHTS {
        return Err(PointProblem::TooFew(sights.len()));
    }
    let mut normal = Matrix3::zeros();
    let (mut range_m, mut u_m) = (f64::INFINITY, f64::INFINITY);
    for k in &sights {
        let s = &search.sightings[*k];
        let (_, ray) = search.row(*k);
        normal += ray * ray.transpose() / (s.u_m * s.u_m);
        range_m = range_m.min((search.points_m[point] - search.stations[s.station].position_m).norm());
        u_m = u_m.min(s.u_m);
    }
    let values = normal.symmetric_eigenvalues();
    let free_m = 1.0 / values.min().max(0.0).sqrt();
    let is_fixed = values.min() > ROUNDING * values.max() && is_linear(free_m, range_m, u_m);
    if is_fixed { Ok(free_m) } else { Err(PointProblem::Unseen) }
}

/// Refuses plans that leave more open than the frame.
pub(super) fn check(search: &Search) -> Result<(), NetworkError> {
    let points: Vec<usize> = search.solvable().collect();
    let checks = points.iter().map(|point| search.sights(*point).count() - LEAST_SIGHTS).sum();
    let unknowns = search.unknowns_of_stations();
    if checks <= unknowns {
        return Err(match lack(search, &points) {
            Lack::FlatStations => NetworkError::FlatStations,
            _ => NetworkError::TooFewRanges { checks, unknowns },
        });
    }
    let blocks = Blocks::new(search);
    let mut reduced = blocks.reduced(0.0)?;
    if search.u_dead_path_m.is_some() {
        // What is known of them bounds what they leave open, whether the plan tells them or not; U says how far.
        reduced.hold_dead_paths();
    }
    let eigen = blocks.filled(&reduced).symmetric_eigen();
    let weakest = eigen.eigenvalues.imin();
    let least = eigen.eigenvalues[weakest];
    let (range_m, u_m) = typical(search);
    let direction = eigen.eigenvectors.column(weakest).into_owned();
    let size = |station: usize| of_station(&direction, station).norm();
    let largest = (0..search.stations.len()).map(size).fold(0.0, f64::max);
    let free_m = largest / least.max(0.0).sqrt();
    if least > ROUNDING * eigen.eigenvalues.max() && is_linear(free_m, range_m, u_m) {
        return Ok(());
    }
    let stations = (0..search.stations.len()).filter(|k| size(*k) > MOVING * largest).collect();
    Err(NetworkError::Loose { stations, free_m, lack: lack(search, &points) })
}

/// Median range and uncertainty of a length (m).
fn typical(search: &Search) -> (f64, f64) {
    let used = || (0..search.sightings.len()).filter(|k| search.used[*k]);
    let range = |k: usize| {
        let s = &search.sightings[k];
        (search.points_m[s.point] - search.stations[s.station].position_m).norm()
    };
    let of = |values| median(values).unwrap_or(0.0);
    (of(used().map(range).collect()), of(used().map(|k| search.sightings[k].u_m).collect()))
}

/// Whether the stations lie nearly in a plane or on a line.
pub(super) fn stations_are_flat(search: &Search) -> bool {
    let stations: Vec<Vector3<f64>> = search.stations.iter().map(|s| s.position_m).collect();
    is_flat(&stations)
}

fn lack(search: &Search, points: &[usize]) -> Lack {
    let points: Vec<Vector3<f64>> = points.iter().map(|k| search.points_m[*k]).collect();
    match (stations_are_flat(search), is_flat(&points)) {
        (true, _) => Lack::FlatStations,
        (_, true) => Lack::FlatPoints,
        _ => Lack::Common,
    }
}

fn is_flat(places_m: &[Vector3<f64>]) -> bool {
    let mean = places_m.iter().sum::<Vector3<f64>>() / places_m.len() as f64;
    let spread: Matrix3<f64> = places_m.iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
    let values = spread.symmetric_eigenvalues();
    values.min() <= FLAT * FLAT * values.max()
}
