//! Residual vectors at points that four stations or more saw: a free network about the model.
//!
//! Place in the flow: model and campaign in, by way of [`crate::shared`]; for each pose, actual − corrected (m) with its
//! covariance out. Stations and dead paths are found together with the points, from ranges alone, since those of a model that
//! lacks a field have taken up a part of it. What effects do to a range stays taken out. The residuals hold no common shift and
//! turn: ranges do not tell these, and the frame of a model is a convention.

use crate::PointResidual;
use crate::problem::Problem;
use abbe_geometry::Vector3;
use abbe_measurement::instrument::U_ABSOLUTE_ZERO_M;
use abbe_measurement::network::{self, Network, NetworkError, NetworkOptions, Placed, Sighting, Start};
use std::collections::BTreeMap;

/// Residuals of a network.
pub(crate) struct OfNetwork {
    pub(crate) points: Vec<PointResidual>,
    /// Readings that belong to these points.
    pub(crate) used: usize,
    /// χ² per degree of freedom, and these degrees.
    pub(crate) chi2_per_dof: (f64, usize),
}

/// Residuals of poses (rows of each); an error where the plan does not fix stations and points together.
pub(crate) fn of_poses(problem: &Problem, poses: &[Vec<usize>]) -> Result<OfNetwork, NetworkError> {
    let centres: Vec<Vector3<f64>> = poses.iter().map(|rows| mean_m(problem, rows)).collect();
    let sightings: Vec<Sighting> =
        poses.iter().enumerate().flat_map(|(point, rows)| sightings(problem, point, rows, &centres[point])).collect();
    let placed = |s: &abbe_geometry::model::Station| Placed { position_m: s.position_m, dead_path_m: s.dead_path_m };
    let stations: Vec<Placed> = problem.placed.iter().map(placed).collect();
    // Models of earlier software hold the dead paths of an instrument that knows its distance at zero.
    let is_held = stations.iter().all(|s| s.dead_path_m == 0.0);
    let u_dead_path_m = is_held.then_some(U_ABSOLUTE_ZERO_M);
    let options = NetworkOptions { u_dead_path_m, u_common_scale: problem.u_common_scale, robust: true };
    let start = Start { stations, points_m: centres };
    let Network { points, chi2, degrees, .. } = network::solve(&start, &sightings, options, &mut |_| true)?;
    let mut used = 0;
    let mut residuals = Vec::new();
    for ((point, rows), centre_m) in points.into_iter().zip(poses).zip(&start.points_m) {
        let Ok(point) = point else { continue };
        used += rows.len();
        residuals.push(PointResidual {
            row: problem.readings[rows[0]],
            point_m: *centre_m,
            residual_m: point.position_m - centre_m,
            covariance_m2: Some(point.covariance_m2),
        });
    }
    Ok(OfNetwork { points: residuals, used, chi2_per_dof: (chi2 / degrees.max(1) as f64, degrees) })
}

fn mean_m(problem: &Problem, rows: &[usize]) -> Vector3<f64> {
    rows.iter().map(|row| problem.points_m[*row]).sum::<Vector3<f64>>() / rows.len() as f64
}

/// What each station saw of a pose: weighted means of its rows.
fn sightings(problem: &Problem, point: usize, rows: &[usize], centre_m: &Vector3<f64>) -> Vec<Sighting> {
    let mut of_station: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    rows.iter().for_each(|row| of_station.entry(problem.stations[*row]).or_default().push(*row));
    let one = |(station, rows): (u32, Vec<usize>)| {
        let placed = &problem.placed[station as usize];
        let information: f64 = rows.iter().map(|row| problem.whitening[*row].powi(2)).sum();
        let weighted = |value: &dyn Fn(usize) -> f64| {
            rows.iter().map(|row| problem.whitening[*row].powi(2) * value(*row)).sum::<f64>() / information
        };
        let at_m = Vector3::from_fn(|d, _| weighted(&|row| problem.points_m[row][d]));
        let residual_m = weighted(&|row| problem.residuals[row] / problem.whitening[row]);
        Sighting {
            station: station as usize,
            point,
            shift_m: at_m - centre_m,
            length_m: (at_m - placed.position_m).norm() - placed.dead_path_m + residual_m,
            u_m: information.sqrt().recip(),
        }
    };
    of_station.into_iter().map(one).collect()
}
