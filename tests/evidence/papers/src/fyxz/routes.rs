//! Three routes from the same ranges to the machine's errors: the paper's direct one and its two rivals.
//!
//! Place in the flow: the paper's Fig. 10 and Fig. 12. Every route calls the library functions that everybody calls; SI.
//! - direct: errors, stations, all at once in the machine frame ([`abbe_identify::identify`]);
//! - nominal: stations from the points where the machine says it is, then each point from its four ranges (the
//!   self-calibration from theoretical target points that the paper's reference 13 needs);
//! - network: stations and points from the ranges alone, in the frame of the stations (its reference 11).
//!
//! The rivals end in points; their errors come from [`abbe_identify::points`] with the same nodes and constraints.

use super::setup::{Experiment, RANGE, failed};
use crate::figure::PaperError;
use abbe_geometry::Vector3;
use abbe_geometry::model::MachineModel;
use abbe_geometry::volumetric::along_line;
use abbe_identify::points::{Loss, MeasuredPoint, Method, PointOptions, fit_points};
use abbe_identify::{IdentifyOptions, OrderChoice, identify};
use abbe_measurement::alignment::aligned_residuals_m;
use abbe_measurement::multilateration::point::{Sight, position};
use abbe_measurement::multilateration::station::{Station, calibrate};
use abbe_measurement::network::{self, Placed, Sighting};

/// How well its network knows the zero of the tracer (m): the paper holds it, as its eq. 8 does.
const HELD_M: f64 = 1e-9;
/// Points of the volume at which corrected machines are compared: as many along each axis, most of them between nodes.
const CHECKS: usize = 6;

/// A way to the errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Route {
    Direct,
    Nominal,
    Network,
}

impl Route {
    pub(super) const ALL: [Route; 3] = [Route::Direct, Route::Nominal, Route::Network];

    /// What it is called in the table.
    pub(super) fn name(self) -> &'static str {
        match self {
            Route::Direct => "direct",
            Route::Nominal => "stations from nominal points",
            Route::Network => "free network",
        }
    }
}

/// How far a route is off the truth (m).
#[derive(Debug, Clone, Copy)]
pub(super) struct Score {
    /// Largest difference of positioning on the four edges along X, from the true one.
    pub(super) x_m: f64,
    /// The same along Y.
    pub(super) y_m: f64,
    /// The same along Z.
    pub(super) z_m: f64,
    /// Rms length of what is left in the volume after correction, aligned rigidly.
    pub(super) volume_m: f64,
}

/// Follows a route and holds it against the truth.
pub(super) fn follow(route: Route, experiment: &Experiment) -> Result<Score, PaperError> {
    match route {
        Route::Direct => {
            let model = direct(experiment)?;
            let along = |axis| worst_edge_m(experiment, axis, |ends| deviations_of_model(&model, ends));
            Ok(Score { x_m: along(0)?, y_m: along(1)?, z_m: along(2)?, volume_m: left_m(experiment, &model)? })
        }
        Route::Nominal => of_points(experiment, &nominal_points_m(experiment)?),
        Route::Network => of_points(experiment, &network_points_m(experiment)?),
    }
}

/// The paper's solution.
pub(super) fn direct(experiment: &Experiment) -> Result<MachineModel, PaperError> {
    let options = IdentifyOptions {
        order: OrderChoice::Fixed,
        robust: false,
        absolute_range: true,
        ..IdentifyOptions::default()
    };
    identify(&experiment.machine, RANGE, &experiment.campaign, &options, &mut |_| true)
        .map(|found| found.model)
        .map_err(failed)
}

/// Solved points (m) in the order of the targets.
fn nominal_points_m(experiment: &Experiment) -> Result<Vec<Vector3<f64>>, PaperError> {
    let stations = nominal_stations(experiment)?;
    let (targets, of_readings) = experiment.targets();
    let point = |target: usize| {
        let seen = experiment.campaign.readings.iter().zip(&of_readings).filter(|(_, t)| **t == target);
        let indicated_m = Vector3::from(targets[target]);
        // A corner lies on three edges: one sight a station, the mean of its ranges.
        let sights: Vec<Sight> = stations
            .iter()
            .enumerate()
            .filter_map(|(k, station)| {
                let lengths: Vec<f64> =
                    seen.clone().filter(|(r, _)| r.station as usize == k).map(|(r, _)| r.length_m).collect();
                let mean_m = lengths.iter().sum::<f64>() / lengths.len() as f64;
                (!lengths.is_empty()).then(|| Sight {
                    station_m: station.position_m,
                    indicated_m,
                    range_m: mean_m + station.dead_path_m,
                    u_m: RANGE.standard_m(mean_m) / (lengths.len() as f64).sqrt(),
                    station_u_m: 0.0,
                })
            })
            .collect();
        position(&sights).map(|found| indicated_m + found.error_m).map_err(failed)
    };
    (0..targets.len()).map(point).collect()
}

fn nominal_stations(experiment: &Experiment) -> Result<Vec<Station>, PaperError> {
    let of = |k: usize| {
        let own = experiment.campaign.readings.iter().filter(|r| r.station as usize == k);
        let (points_m, lengths_m): (Vec<_>, Vec<_>) = own.map(|r| (Vector3::from(r.reading_m), r.length_m)).unzip();
        calibrate(&points_m, &lengths_m).map_err(failed)
    };
    (0..experiment.campaign.stations.len()).map(of).collect()
}

fn network_points_m(experiment: &Experiment) -> Result<Vec<Vector3<f64>>, PaperError> {
    let placed = |station: &Station| Placed { position_m: station.position_m, dead_path_m: 0.0 };
    let stations: Vec<Placed> = nominal_stations(experiment)?.iter().map(placed).collect();
    let (targets, of_readings) = experiment.targets();
    let points_m: Vec<Vector3<f64>> = targets.iter().copied().map(Vector3::from).collect();
    let mut sums: std::collections::BTreeMap<(usize, usize), (f64, f64)> = std::collections::BTreeMap::new();
    for (reading, target) in experiment.campaign.readings.iter().zip(&of_readings) {
        let entry = sums.entry((reading.station as usize, *target)).or_default();
        *entry = (entry.0 + reading.length_m, entry.1 + 1.0);
    }
    let sighting = |((station, point), (sum_m, count)): (&(usize, usize), &(f64, f64))| {
        let length_m = sum_m / count;
        let u_m = RANGE.standard_m(length_m) / count.sqrt();
        Sighting { station: *station, point: *point, shift_m: Vector3::zeros(), length_m, u_m }
    };
    let sightings: Vec<Sighting> = sums.iter().map(sighting).collect();
    let options = network::NetworkOptions { u_dead_path_m: Some(HELD_M), u_common_scale: 0.0, robust: false };
    let start = network::Start { stations, points_m };
    let found = network::solve(&start, &sightings, options, &mut |_| true).map_err(failed)?;
    found.points.into_iter().map(|point| point.map(|point| point.position_m).map_err(failed)).collect()
}

/// Score of a route that ends in points.
fn of_points(experiment: &Experiment, points_m: &[Vector3<f64>]) -> Result<Score, PaperError> {
    let (targets, _) = experiment.targets();
    let at = |reading_m: &[f64; 3]| targets.iter().position(|t| t == reading_m).map(|k| points_m[k]);
    let along = |axis| {
        worst_edge_m(experiment, axis, |edge| {
            let solved: Option<Vec<Vector3<f64>>> = edge.iter().map(at).collect();
            let solved = solved.ok_or_else(|| failed("an edge's target was not measured"))?;
            Ok(deviations(edge, &solved))
        })
    };
    let measured: Vec<MeasuredPoint> = targets
        .iter()
        .zip(points_m)
        .map(|(reading_m, actual_m)| MeasuredPoint {
            reading_m: *reading_m,
            offset_m: [0.0; 3],
            actual_m: *actual_m,
            u_m: RANGE.constant_m + RANGE.per_metre,
        })
        .collect();
    let options = PointOptions { method: Method::LevenbergMarquardt, loss: Loss::Squares };
    let fitted = fit_points(&experiment.machine, &measured, &options, &mut |_| true).map_err(failed)?;
    Ok(Score { x_m: along(0)?, y_m: along(1)?, z_m: along(2)?, volume_m: left_m(experiment, &fitted.model)? })
}

/// Positioning deviations (m) of points from the first of a line.
fn deviations(edge: &[[f64; 3]], points_m: &[Vector3<f64>]) -> Vec<f64> {
    let nominal_m = |k: usize| (Vector3::from(edge[k]) - Vector3::from(edge[0])).norm();
    (0..edge.len()).map(|k| (points_m[k] - points_m[0]).norm() - nominal_m(k)).collect()
}

fn deviations_of_model(model: &MachineModel, edge: &[[f64; 3]]) -> Result<Vec<f64>, PaperError> {
    let (Some(first), Some(last)) = (edge.first(), edge.last()) else { return Err(failed("an edge has no target")) };
    let line = along_line(model, [*first, *last], edge.len(), [0.0; 3]).map_err(failed)?;
    Ok(line.iter().map(|point| point.deviation_m).collect())
}

/// Largest difference from the true positioning over the four edges along an axis (m).
fn worst_edge_m(
    experiment: &Experiment,
    axis: usize,
    found: impl Fn(&[[f64; 3]]) -> Result<Vec<f64>, PaperError>,
) -> Result<f64, PaperError> {
    let stroke_m = experiment.machine.stroke_m;
    let (targets, _) = experiment.targets();
    let mut worst_m: f64 = 0.0;
    for corner in 0..4 {
        let side = |d: usize, bit: usize| if corner >> bit & 1 == 0 { stroke_m[d].0 } else { stroke_m[d].1 };
        let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
        let on_edge = |t: &&[f64; 3]| t[a] == side(a, 0) && t[b] == side(b, 1);
        let mut edge: Vec<[f64; 3]> = targets.iter().filter(on_edge).copied().collect();
        edge.sort_by(|p, q| p[axis].total_cmp(&q[axis]));
        let actual_m: Vec<Vector3<f64>> = edge.iter().map(|t| experiment.actual_m(*t)).collect();
        let truth = deviations(&edge, &actual_m);
        let differences = found(&edge)?.into_iter().zip(truth).map(|(found, truth)| (found - truth).abs());
        worst_m = differences.fold(worst_m, f64::max);
    }
    Ok(worst_m)
}

/// Rms length (m) of true minus corrected position over the volume, aligned rigidly.
fn left_m(experiment: &Experiment, model: &MachineModel) -> Result<f64, PaperError> {
    let steps = [CHECKS; 3];
    let map = abbe_geometry::volumetric::error_map(model, &experiment.machine.stroke_m, steps, [0.0; 3]);
    let map = map.map_err(failed)?;
    let corrected: Vec<Vector3<f64>> = map.iter().map(|p| Vector3::from(p.reading_m) + p.error_m).collect();
    let actual: Vec<Vector3<f64>> = map.iter().map(|p| experiment.actual_m(p.reading_m)).collect();
    let left = aligned_residuals_m(&corrected, &actual).map_err(failed)?;
    Ok((left.iter().map(Vector3::norm_squared).sum::<f64>() / left.len() as f64).sqrt())
}
