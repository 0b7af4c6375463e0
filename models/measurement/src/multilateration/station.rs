//! Station self-calibration: position and dead path from nominal points and lengths.
//!
//! Place in the flow: first step of multilateration. Nominal points (m, machine frame) and interferometric lengths (m) in;
//! P and d of ‖A − P‖ = d + l with their covariance out. Source: Chen 2020 eq. 1 and section 2.1.2. Squaring the range
//! equation gives one that is linear in P, d and ‖P‖² − d²: no start is asked of the user.

use super::descent::{self, NotSolved};
use nalgebra::{DMatrix, DVector, Matrix4, Vector3, Vector4};
use thiserror::Error;

/// Unknowns of a station.
const UNKNOWNS: usize = 4;
/// Fewest points: the linear start has five unknowns, and without more than that nothing checks the result.
pub const LEAST_POINTS: usize = 6;
/// Relative size of the smallest singular value below which the points do not fix the station.
const RANK_TOLERANCE: f64 = 1e-7;

/// A station as it was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Station {
    /// Position P (m, machine frame).
    pub position_m: Vector3<f64>,
    /// Dead path d: distance at length zero (m).
    pub dead_path_m: f64,
    /// Covariance of position and dead path (m²), from the scatter of the residuals.
    pub covariance_m2: Matrix4<f64>,
    /// Predicted minus measured length at each point (m).
    pub residuals_m: Vec<f64>,
    /// Standard deviation of the residuals (m): machine error along the line of sight, and noise.
    pub deviation_m: f64,
    /// Steps of the descent.
    pub steps: usize,
}

/// Why there is no station; the text says what to do. Indices count from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum StationError {
    /// Too few points.
    #[error("{0} points cannot place a station (at least {LEAST_POINTS} are needed); measure more points from it")]
    TooFew(usize),
    /// Not one length a point.
    #[error("{lengths} lengths for {points} points; give one for each")]
    Lengths {
        /// Points.
        points: usize,
        /// Lengths.
        lengths: usize,
    },
    /// A number that is none.
    #[error("point {0}: a coordinate or the length is not a finite number; correct or remove it")]
    NotFinite(usize),
    /// No volume.
    #[error(
        "the points lie in a plane or on a line, so that the station cannot be found; measure points that fill a volume"
    )]
    Flat,
    /// No solution.
    #[error(
        "no position is consistent with the lengths; check that points and lengths belong together and share a unit"
    )]
    Inconsistent,
}

/// Position and dead path of a station from nominal points and the lengths read there (m).
pub fn calibrate(nominal_m: &[Vector3<f64>], lengths_m: &[f64]) -> Result<Station, StationError> {
    check(nominal_m, lengths_m)?;
    let start = linear(nominal_m, lengths_m)?;
    let rows = |unknowns: &Vector4<f64>| -> descent::Rows<UNKNOWNS> {
        nominal_m.iter().zip(lengths_m).map(|(point, length)| row(unknowns, point, *length)).collect()
    };
    let solved = descent::descend(start, rows).map_err(|why| match why {
        NotSolved::Singular => StationError::Flat,
        NotSolved::NotConverged => StationError::Inconsistent,
    })?;
    let residuals_m: Vec<f64> = rows(&solved.unknowns).into_iter().map(|(_, residual)| residual).collect();
    let square: f64 = residuals_m.iter().map(|r| r * r).sum();
    let variance = square / (nominal_m.len() - UNKNOWNS) as f64;
    let inverse = solved.normal.cholesky().ok_or(StationError::Flat)?.inverse();
    Ok(Station {
        position_m: solved.unknowns.xyz(),
        dead_path_m: solved.unknowns.w,
        covariance_m2: inverse * variance,
        residuals_m,
        deviation_m: variance.sqrt(),
        steps: solved.steps,
    })
}

/// Derivative and residual F = ‖A − P‖ − d − l of one reading.
fn row(unknowns: &Vector4<f64>, point_m: &Vector3<f64>, length_m: f64) -> (Vector4<f64>, f64) {
    let sight = point_m - unknowns.xyz();
    let range_m = sight.norm();
    let ray = sight / range_m;
    (Vector4::new(-ray.x, -ray.y, -ray.z, -1.0), range_m - unknowns.w - length_m)
}

/// JᵀJ of position and dead path for unit noise at these points: its inverse times a variance is the Cramér-Rao bound.
pub fn information(position_m: &Vector3<f64>, nominal_m: &[Vector3<f64>]) -> Matrix4<f64> {
    let unknowns = position_m.push(0.0);
    let rows = nominal_m.iter().map(|point| row(&unknowns, point, 0.0).0);
    rows.map(|row| row * row.transpose()).sum()
}

fn check(nominal_m: &[Vector3<f64>], lengths_m: &[f64]) -> Result<(), StationError> {
    if nominal_m.len() != lengths_m.len() {
        return Err(StationError::Lengths { points: nominal_m.len(), lengths: lengths_m.len() });
    }
    if nominal_m.len() < LEAST_POINTS {
        return Err(StationError::TooFew(nominal_m.len()));
    }
    let finite = |(point, length): (&Vector3<f64>, &f64)| point.iter().chain([length]).all(|v| v.is_finite());
    match nominal_m.iter().zip(lengths_m).position(|pair| !finite(pair)) {
        Some(index) => Err(StationError::NotFinite(index)),
        None => Ok(()),
    }
}

/// Least squares of ‖A‖² − l² = 2 A·P + 2 l d − (‖P‖² − d²), about the centroid of the points.
fn linear(nominal_m: &[Vector3<f64>], lengths_m: &[f64]) -> Result<Vector4<f64>, StationError> {
    let centre = nominal_m.iter().sum::<Vector3<f64>>() / nominal_m.len() as f64;
    let mut matrix = DMatrix::zeros(nominal_m.len(), UNKNOWNS + 1);
    let mut right = DVector::zeros(nominal_m.len());
    for (k, (point, length)) in nominal_m.iter().zip(lengths_m).enumerate() {
        let a = point - centre;
        matrix.row_mut(k).copy_from_slice(&[2.0 * a.x, 2.0 * a.y, 2.0 * a.z, 2.0 * length, -1.0]);
        right[k] = a.norm_squared() - length * length;
    }
    let svd = matrix.svd(true, true);
    let (smallest, largest) = (svd.singular_values.min(), svd.singular_values.max());
    if smallest.is_nan() || smallest <= RANK_TOLERANCE * largest {
        return Err(StationError::Flat);
    }
    let solution = svd.solve(&right, 0.0).map_err(|_| StationError::Flat)?;
    let start = Vector4::new(centre.x + solution[0], centre.y + solution[1], centre.z + solution[2], solution[3]);
    if start.iter().all(|v| v.is_finite()) { Ok(start) } else { Err(StationError::Inconsistent) }
}
