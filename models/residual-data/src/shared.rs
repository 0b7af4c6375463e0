//! Residual vectors at points that several stations saw: multilateration about the model.
//!
//! Place in the flow: model and campaign in; for each pose of the machine (reading and offset) that at least three
//! stations measured, actual − corrected (m, machine frame) with its covariance out. Where the plan fixes stations and
//! points together they are found so ([`crate::network`]). Where it does not, the stations come from the model with their
//! covariance, which is part of that of the residual; their common part does not average out. That is linear, since a
//! residual is a millionth of a range: l_k = u_k·ρ + station terms + noise, solved by weighted least squares.
//! Source: Chen 2020 eq. 1, linearised at the corrected point.

use crate::network::{self, OfNetwork};
use crate::problem::Problem;
use crate::{PointResidual, ResidualError};
use abbe_geometry::model::MachineModel;
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use abbe_measurement::network::NetworkError;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use std::collections::BTreeMap;

/// Poses closer than this are the same (m): scales are read finer, and no field changes over it.
const SAME_POSE_M: f64 = 20e-6;
/// Stations that see three components.
const LEAST_STATIONS: usize = 3;
/// Smallest over largest eigenvalue of the information below which the stations stand too much in a plane with the point.
const LEAST_CONDITION: f64 = 1e-3;

/// Residuals of points that several stations saw.
#[derive(Debug, Clone)]
pub struct SharedPoints {
    /// One a pose, in the order of measurement.
    pub points: Vec<PointResidual>,
    /// Readings that belong to these points, and readings used in all.
    pub readings: (usize, usize),
    /// Readings that contradict the model by far more than noise, and are not used.
    pub rejected: usize,
    /// χ² per degree of freedom of the points seen by four stations or more, and these degrees; `None` without such a point.
    pub chi2_per_dof: Option<(f64, usize)>,
    /// Where the stations come from.
    pub frame: Frame,
}

/// Where the stations come from that points are seen from.
#[derive(Debug, Clone, PartialEq)]
pub enum Frame {
    /// Found together with the points, from ranges alone: what the model lacks has no part in them.
    Network,
    /// Those of the model, with their covariance: they may have taken up a part of what it lacks.
    Model {
        /// Why not a network.
        why: NetworkError,
    },
}

/// Residuals at poses that at least three stations measured; `own` says that the model was identified from the campaign.
/// Poses with fewer stations, or stations in a plane with the point, are not in it: see the counts.
///
/// # Errors
/// Stations or covariates that do not fit, too few readings.
pub fn shared_points(
    model: &MachineModel,
    instrument: RangeUncertainty,
    campaign: &Campaign,
    own: bool,
) -> Result<SharedPoints, ResidualError> {
    let problem = Problem::new(model, instrument, campaign, own)?;
    let poses = poses(&problem, campaign);
    match network::of_poses(&problem, &poses) {
        Ok(OfNetwork { points, used, chi2_per_dof }) => Ok(SharedPoints {
            points,
            readings: (used, problem.len()),
            rejected: problem.rejected,
            chi2_per_dof: Some(chi2_per_dof),
            frame: Frame::Network,
        }),
        Err(why) => Ok(about_stations(&problem, &poses, why)),
    }
}

/// Each pose by itself, seen from the stations of the model.
fn about_stations(problem: &Problem, poses: &[Vec<usize>], why: NetworkError) -> SharedPoints {
    let (mut solved, mut used, mut chi2, mut degrees) = (Vec::new(), 0, 0.0, 0_usize);
    for rows in poses {
        let Some(one) = solve(problem, rows) else { continue };
        used += rows.len();
        chi2 += one.chi2;
        degrees += rows.len() - 3;
        solved.push(one);
    }
    // What the stations disagree by is noise; what the model leaves of them all alike is the residual itself.
    let chi2_per_dof = (degrees > 0).then(|| (chi2 / degrees as f64, degrees));
    let noise = chi2_per_dof.map_or(1.0, |(chi2, _)| chi2.max(1.0));
    let point = |Solved { row, point_m, residual_m, of_noise_m2, of_stations_m2, .. }: Solved| PointResidual {
        row,
        point_m,
        residual_m,
        covariance_m2: Some(of_noise_m2 * noise + of_stations_m2),
    };
    SharedPoints {
        points: solved.into_iter().map(point).collect(),
        readings: (used, problem.len()),
        rejected: problem.rejected,
        chi2_per_dof,
        frame: Frame::Model { why },
    }
}

/// Rows of each pose, in the order of its first row.
fn poses(problem: &Problem, campaign: &Campaign) -> Vec<Vec<usize>> {
    let mut place: BTreeMap<[i64; 6], usize> = BTreeMap::new();
    let mut poses: Vec<Vec<usize>> = Vec::new();
    for (row, reading) in problem.readings.iter().enumerate() {
        let at = &campaign.readings[*reading];
        let cell = |d: usize| (if d < 3 { at.reading_m[d] } else { at.offset_m[d - 3] } / SAME_POSE_M).round() as i64;
        let next = poses.len();
        let pose = *place.entry(std::array::from_fn(cell)).or_insert(next);
        if pose == next {
            poses.push(Vec::new());
        }
        poses[pose].push(row);
    }
    poses
}

/// One pose: its residual, and covariances for the declared noise and for the stations.
struct Solved {
    row: usize,
    point_m: Vector3<f64>,
    residual_m: Vector3<f64>,
    of_noise_m2: Matrix3<f64>,
    of_stations_m2: Matrix3<f64>,
    chi2: f64,
}

/// Weighted least squares over the rows of one pose; `None` where they do not fix a point.
fn solve(problem: &Problem, rows: &[usize]) -> Option<Solved> {
    let mut stations: Vec<u32> = rows.iter().map(|row| problem.stations[*row]).collect();
    stations.sort_unstable();
    stations.dedup();
    if stations.len() < LEAST_STATIONS {
        return None;
    }
    let whitened = DMatrix::from_fn(rows.len(), 3, |i, d| problem.directions[rows[i]][d] * problem.whitening[rows[i]]);
    let information = three_by_three(&(whitened.transpose() * &whitened));
    let values = information.symmetric_eigenvalues();
    if values.min() < LEAST_CONDITION * values.max() {
        return None;
    }
    let inverse = information.try_inverse()?;
    let observed = DVector::from_fn(rows.len(), |i, _| problem.residuals[rows[i]]);
    let solution = inverse * Vector3::from_iterator((whitened.transpose() * &observed).iter().copied());
    let left = &observed - &whitened * DVector::from_iterator(3, solution.iter().copied());
    // Station terms of each row: its coordinates against the sight, its dead path.
    let size = problem.station_covariance.nrows();
    let terms = DMatrix::from_fn(rows.len(), size, |i, k| {
        let row = rows[i];
        let first = 4 * problem.stations[row] as usize;
        let value = match k.checked_sub(first) {
            Some(d @ 0..3) => -problem.directions[row][d],
            Some(3) => -1.0,
            _ => 0.0,
        };
        value * problem.whitening[row]
    });
    let covariance = DMatrix::from_fn(size, size, |i, j| problem.station_covariance[(i, j)]);
    let of_stations = whitened.transpose() * terms;
    let common = inverse * three_by_three(&(&of_stations * covariance * of_stations.transpose())) * inverse;
    Some(Solved {
        row: problem.readings[rows[0]],
        point_m: problem.points_m[rows[0]],
        residual_m: solution,
        of_noise_m2: inverse,
        of_stations_m2: common,
        chi2: left.norm_squared(),
    })
}

fn three_by_three(matrix: &DMatrix<f64>) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| matrix[(i, j)])
}
