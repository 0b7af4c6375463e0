//! Actual position of one point from several stations.
//!
//! Place in the flow: second solution of multilateration. What each station saw of the point in (m, machine frame); actual
//! position with covariance and residuals out. Source: Chen 2020 eq. 2-11, Levenberg-Marquardt with μ = ‖F‖ and Armijo's step.

use super::descent::{self, NotSolved};
use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

/// Fewest stations: three fix a point, the fourth checks it.
pub const LEAST_STATIONS: usize = 4;
/// Smallest extent of the stations over their largest below which they lie in a plane.
const FLAT: f64 = 1e-3;
/// Smallest share of the best seen direction's information below which a direction counts as not seen.
const SEEN: f64 = 1e-6;

/// What one station saw of a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// Position of the station (m, machine frame).
    pub station_m: Vector3<f64>,
    /// Where the machine indicated the point when it was measured from here (m, machine frame).
    pub indicated_m: Vector3<f64>,
    /// Measured distance d + l (m).
    pub range_m: f64,
    /// Standard uncertainty of the length (m, k = 1).
    pub u_m: f64,
    /// Standard uncertainty of the distance that comes from the station's own position and dead path (m, k = 1).
    pub station_u_m: f64,
}

/// A point as it was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Position {
    /// Volumetric error: actual − indicated (m, machine frame; eq. 11).
    pub error_m: Vector3<f64>,
    /// Its covariance (m²): ranges and stations.
    pub covariance_m2: Matrix3<f64>,
    /// Part of it that comes from the ranges alone (m²).
    pub range_covariance_m2: Matrix3<f64>,
    /// Predicted minus measured distance for each station (m).
    pub residuals_m: Vec<f64>,
    /// Σ (residual / u)² with u of range and station together.
    pub chi2: f64,
    /// Steps of the descent.
    pub steps: usize,
}

/// Why a point has no position; the text says what to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum PointError {
    /// Too few stations.
    #[error("seen from {0} stations (at least {LEAST_STATIONS} are needed); measure it from more")]
    TooFew(usize),
    /// A number that is none.
    #[error("station {0}: a coordinate, range or uncertainty is not a number that can be used; correct it")]
    NotFinite(usize),
    /// The same station twice.
    #[error("stations {first} and {second} stand at the same place; move one, or merge them to one station")]
    SameStation {
        /// One.
        first: usize,
        /// The other.
        second: usize,
    },
    /// No volume.
    #[error("its stations lie in a plane or on a line; put one station at another height")]
    FlatStations,
    /// A direction is not seen.
    #[error("its stations all see it from nearly the same direction; measure it from other sides")]
    Unseen,
    /// No solution.
    #[error("no position is consistent with its ranges; check stations and lengths")]
    Inconsistent,
}

/// Position of a point that several stations saw.
pub fn position(sights: &[Sight]) -> Result<Position, PointError> {
    check(sights)?;
    // Relative weights, so that residuals stay lengths: the best range has weight one.
    let best_u_m = sights.iter().map(|s| s.u_m.hypot(s.station_u_m)).fold(f64::INFINITY, f64::min);
    let weights: Vec<f64> = sights.iter().map(|s| best_u_m / s.u_m.hypot(s.station_u_m)).collect();
    let rows = |error_m: &Vector3<f64>| -> descent::Rows<3> {
        let weighted = |(sight, weight): (&Sight, &f64)| {
            let (ray, residual_m) = row(sight, error_m);
            (ray * *weight, residual_m * weight)
        };
        sights.iter().zip(&weights).map(weighted).collect()
    };
    let solved = descent::descend(Vector3::zeros(), rows).map_err(|why| match why {
        NotSolved::Singular => PointError::Unseen,
        NotSolved::NotConverged => PointError::Inconsistent,
    })?;
    let eigen = solved.normal.symmetric_eigenvalues();
    if eigen.min() <= SEEN * eigen.max() {
        return Err(PointError::Unseen);
    }
    let inverse = solved.normal.cholesky().ok_or(PointError::Unseen)?.inverse();
    let error_m = solved.unknowns;
    let residuals_m: Vec<f64> = sights.iter().map(|sight| row(sight, &error_m).1).collect();
    // How a length passes into the position: inverse · weighted ray.
    let (mut range_covariance_m2, mut covariance_m2, mut chi2) = (Matrix3::zeros(), Matrix3::zeros(), 0.0);
    for ((sight, weight), residual_m) in sights.iter().zip(&weights).zip(&residuals_m) {
        let gain = inverse * row(sight, &error_m).0 * (weight * weight);
        let outer = gain * gain.transpose();
        let variance = sight.u_m * sight.u_m + sight.station_u_m * sight.station_u_m;
        range_covariance_m2 += outer * (sight.u_m * sight.u_m);
        covariance_m2 += outer * variance;
        chi2 += residual_m * residual_m / variance;
    }
    Ok(Position { error_m, covariance_m2, range_covariance_m2, residuals_m, chi2, steps: solved.steps })
}

/// Line of sight and residual F = ‖A − P‖ − (d + l) for an assumed error of the point.
fn row(sight: &Sight, error_m: &Vector3<f64>) -> (Vector3<f64>, f64) {
    let line = sight.indicated_m + error_m - sight.station_m;
    let range_m = line.norm();
    (line / range_m, range_m - sight.range_m)
}

fn check(sights: &[Sight]) -> Result<(), PointError> {
    if sights.len() < LEAST_STATIONS {
        return Err(PointError::TooFew(sights.len()));
    }
    let usable = |s: &Sight| {
        let numbers = s.station_m.iter().chain(s.indicated_m.iter()).chain([&s.range_m, &s.u_m, &s.station_u_m]);
        numbers.copied().all(f64::is_finite) && s.u_m > 0.0 && s.station_u_m >= 0.0
    };
    if let Some(index) = sights.iter().position(|s| !usable(s)) {
        return Err(PointError::NotFinite(index));
    }
    let stations: Vec<Vector3<f64>> = sights.iter().map(|s| s.station_m).collect();
    check_stations(&stations)
}

/// Refuses stations that are the same or lie in a plane.
pub(crate) fn check_stations(stations_m: &[Vector3<f64>]) -> Result<(), PointError> {
    /// Stations nearer than this (m) are one: no two instruments fit there.
    const SAME_M: f64 = 1e-3;
    for second in 1..stations_m.len() {
        for first in 0..second {
            if (stations_m[first] - stations_m[second]).norm() < SAME_M {
                return Err(PointError::SameStation { first, second });
            }
        }
    }
    let mean = stations_m.iter().sum::<Vector3<f64>>() / stations_m.len() as f64;
    let spread: Matrix3<f64> = stations_m.iter().map(|s| (s - mean) * (s - mean).transpose()).sum();
    let eigen = spread.symmetric_eigenvalues();
    if eigen.min() <= FLAT * FLAT * eigen.max() { Err(PointError::FlatStations) } else { Ok(()) }
}
