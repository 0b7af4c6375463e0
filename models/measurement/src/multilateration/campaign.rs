//! A whole campaign: readings in, stations, points and what was left out.
//!
//! Place in the flow: [`solve`] takes a [`Campaign`] (SI, machine frame), groups readings by the point they were taken at,
//! calibrates the stations, rejects contradicting pairs and solves every point (Chen 2020 eq. 1-11).

use super::pairs::{self, RejectedPair};
use super::point::{self, LEAST_STATIONS, PointError, Position, Sight};
use super::station::{self, Station, StationError};
use crate::campaign::{Campaign, RangeReading};
use crate::instrument::RangeUncertainty;
use nalgebra::Vector3;
use std::collections::BTreeMap;
use thiserror::Error;

/// How a campaign is solved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Uncertainty of a length.
    pub instrument: RangeUncertainty,
    /// Repeatability of the machine when it comes back to a point (m, k = 1): stations see the point at different times.
    pub repeatability_m: f64,
    /// Readings of one point from one station that differ by more than this (m) are rejected; 5 µm in Chen 2020.
    pub pair_limit_m: f64,
    /// Readings whose indicated reflector positions differ by less than this (m) are of one point.
    pub same_point_m: f64,
}

/// A measured point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// Mean indicated axis positions (m, machine frame).
    pub reading_m: Vector3<f64>,
    /// Reflector relative to the ram reference point (m, ram frame).
    pub offset_m: Vector3<f64>,
}

impl Target {
    /// Indicated position of the reflector (m, machine frame).
    pub fn indicated_m(&self) -> Vector3<f64> {
        self.reading_m + self.offset_m
    }
}

/// A solved point.
#[derive(Debug, Clone, PartialEq)]
pub struct SolvedPoint {
    /// Index into [`MultiStation::targets`].
    pub target: usize,
    /// Indices of the stations that saw it.
    pub stations: Vec<usize>,
    /// What was found.
    pub position: Position,
}

/// A point that could not be solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unsolved {
    /// Index into [`MultiStation::targets`].
    pub target: usize,
    /// Why.
    pub why: PointError,
}

/// A solved campaign.
#[derive(Debug, Clone, PartialEq)]
pub struct MultiStation {
    /// Names of the stations.
    pub names: Vec<String>,
    /// Stations as calibrated, in the order of the names.
    pub stations: Vec<Station>,
    /// Points in the order of their first reading.
    pub targets: Vec<Target>,
    /// Index of the target of each reading.
    pub target_of: Vec<usize>,
    /// Solved points, in the order of the targets.
    pub points: Vec<SolvedPoint>,
    /// Points without solution.
    pub unsolved: Vec<Unsolved>,
    /// Readings that contradict each other.
    pub rejected: Vec<RejectedPair>,
}

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
        why: StationError,
    },
    /// The stations cannot solve any point.
    #[error("the stations: {0}")]
    Stations(PointError),
    /// No point is left.
    #[error(
        "none of {points} points is seen from {LEAST_STATIONS} stations; measure the same points from every station"
    )]
    NoPoint {
        /// Points there are.
        points: usize,
    },
}

/// Stations, dead paths and points of a campaign.
pub fn solve(campaign: &Campaign, options: &Options) -> Result<MultiStation, Problem> {
    check(campaign, options)?;
    let (targets, target_of) = group(&campaign.readings, options.same_point_m);
    let all = vec![true; campaign.readings.len()];
    let first = calibrate(campaign, &all)?;
    let rejected = contradictions(campaign, &target_of, &first, options.pair_limit_m);
    let mut kept = all;
    rejected.iter().flat_map(|pair| &pair.readings).for_each(|reading| kept[*reading] = false);
    let stations = if rejected.is_empty() { first } else { calibrate(campaign, &kept)? };
    let positions: Vec<Vector3<f64>> = stations.iter().map(|s| s.position_m).collect();
    point::check_stations(&positions).map_err(Problem::Stations)?;
    let sights = sights(campaign, &kept, &target_of, &stations, options);
    let (mut points, mut unsolved) = (Vec::new(), Vec::new());
    for (target, seen) in sights_by_target(targets.len(), sights).into_iter().enumerate() {
        let (stations, sights): (Vec<usize>, Vec<Sight>) = seen.into_iter().unzip();
        match point::position(&sights) {
            Ok(position) => points.push(SolvedPoint { target, stations, position }),
            Err(why) => unsolved.push(Unsolved { target, why }),
        }
    }
    if points.is_empty() {
        return Err(Problem::NoPoint { points: targets.len() });
    }
    Ok(MultiStation { names: campaign.stations.clone(), stations, targets, target_of, points, unsolved, rejected })
}

fn check(campaign: &Campaign, options: &Options) -> Result<(), Problem> {
    let above_zero = |value: f64| value.is_finite() && value > 0.0;
    let constant = options.instrument.constant_m;
    let proportional = options.instrument.per_metre;
    if !(constant.is_finite() && constant >= 0.0 && proportional.is_finite() && proportional >= 0.0)
        || constant + proportional <= 0.0
    {
        return Err(Problem::Option("the instrument's uncertainty"));
    }
    if !above_zero(options.pair_limit_m) {
        return Err(Problem::Option("the limit of a pair's difference"));
    }
    if !above_zero(options.same_point_m) {
        return Err(Problem::Option("the distance within which readings are of one point"));
    }
    if !(options.repeatability_m.is_finite() && options.repeatability_m >= 0.0) {
        return Err(Problem::Option("the repeatability, unless it is zero,"));
    }
    if campaign.stations.len() < LEAST_STATIONS {
        return Err(Problem::TooFewStations(campaign.stations.len()));
    }
    let finite = |r: &RangeReading| {
        r.reading_m.iter().chain(&r.offset_m).chain([&r.length_m]).all(|v| v.is_finite())
            && (r.station as usize) < campaign.stations.len()
    };
    match campaign.readings.iter().position(|r| !finite(r)) {
        Some(index) => Err(Problem::NotFinite(index + 1)),
        None => Ok(()),
    }
}

fn indicated_m(reading: &RangeReading) -> Vector3<f64> {
    Vector3::from(reading.reading_m) + Vector3::from(reading.offset_m)
}

/// Readings of one target so far: the first one's place and offset, the sum of all places, and their number.
struct Gathered {
    first_m: Vector3<f64>,
    offset_m: Vector3<f64>,
    sum_m: Vector3<f64>,
    readings: f64,
}

/// Targets in the order of their first reading, and the target of each reading.
///
/// Readings are dealt into boxes as wide as the tolerance, so that only neighbouring boxes need a look. The same point with
/// another reflector offset is another target: the error of a machine depends on the offset.
fn group(readings: &[RangeReading], tolerance_m: f64) -> (Vec<Target>, Vec<usize>) {
    let box_of = |p: &Vector3<f64>| [0, 1, 2].map(|d| (p[d] / tolerance_m).floor() as i64);
    let mut boxes: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
    let mut gathered: Vec<Gathered> = Vec::new();
    let mut target_of = Vec::with_capacity(readings.len());
    for reading in readings {
        let (axes_m, offset_m) = (Vector3::from(reading.reading_m), Vector3::from(reading.offset_m));
        let own = box_of(&axes_m);
        let near = |target: &usize| {
            let Gathered { first_m, offset_m: its_offset_m, .. } = &gathered[*target];
            (first_m - axes_m).norm() <= tolerance_m && (its_offset_m - offset_m).norm() <= tolerance_m
        };
        let beside = |k: i64| [k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1];
        let neighbours = (0..27).map(|k| [0, 1, 2].map(|d| own[d].saturating_add(beside(k)[d])));
        let known = neighbours.flat_map(|key| boxes.get(&key).into_iter().flatten()).copied().find(near);
        let target = known.unwrap_or_else(|| {
            boxes.entry(own).or_default().push(gathered.len());
            gathered.push(Gathered { first_m: axes_m, offset_m, sum_m: Vector3::zeros(), readings: 0.0 });
            gathered.len() - 1
        });
        gathered[target].sum_m += axes_m;
        gathered[target].readings += 1.0;
        target_of.push(target);
    }
    let targets = gathered.iter().map(|g| Target { reading_m: g.sum_m / g.readings, offset_m: g.offset_m });
    (targets.collect(), target_of)
}

fn calibrate(campaign: &Campaign, kept: &[bool]) -> Result<Vec<Station>, Problem> {
    let one = |(index, name): (usize, &String)| {
        let own = campaign.readings.iter().zip(kept).filter(|(r, kept)| **kept && r.station as usize == index);
        let (points, lengths): (Vec<_>, Vec<_>) = own.map(|(r, _)| (indicated_m(r), r.length_m)).unzip();
        station::calibrate(&points, &lengths).map_err(|why| Problem::Station { name: name.clone(), why })
    };
    campaign.stations.iter().enumerate().map(one).collect()
}

/// Readings of each station and target, in order.
fn by_station_and_target(campaign: &Campaign, target_of: &[usize]) -> BTreeMap<(usize, usize), Vec<usize>> {
    let mut groups: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for (index, (reading, target)) in campaign.readings.iter().zip(target_of).enumerate() {
        groups.entry((reading.station as usize, *target)).or_default().push(index);
    }
    groups
}

/// Measured length less that to the indicated position (m).
fn deviation_m(reading: &RangeReading, station: &Station) -> f64 {
    reading.length_m - ((indicated_m(reading) - station.position_m).norm() - station.dead_path_m)
}

fn contradictions(campaign: &Campaign, target_of: &[usize], stations: &[Station], limit_m: f64) -> Vec<RejectedPair> {
    let mut rejected = Vec::new();
    for ((station, point), readings) in by_station_and_target(campaign, target_of) {
        let deviation = |k: &usize| deviation_m(&campaign.readings[*k], &stations[station]);
        let deviations: Vec<f64> = readings.iter().map(deviation).collect();
        if let Some(difference_m) = pairs::contradiction(&deviations, limit_m) {
            rejected.push(RejectedPair { station, point, readings, difference_m });
        }
    }
    rejected
}

/// What each station saw of each target: the mean of its readings.
fn sights(
    campaign: &Campaign,
    kept: &[bool],
    target_of: &[usize],
    stations: &[Station],
    options: &Options,
) -> Vec<(usize, usize, Sight)> {
    let mut sights = Vec::new();
    for ((index, target), mut readings) in by_station_and_target(campaign, target_of) {
        readings.retain(|k| kept[*k]);
        if readings.is_empty() {
            continue;
        }
        let count = readings.len() as f64;
        let station = &stations[index];
        let indicated = readings.iter().map(|k| indicated_m(&campaign.readings[*k])).sum::<Vector3<f64>>() / count;
        let deviation = readings.iter().map(|k| deviation_m(&campaign.readings[*k], station)).sum::<f64>() / count;
        let line = indicated - station.position_m;
        let range_m = line.norm() + deviation;
        let ray = line / line.norm();
        let column = ray.push(1.0);
        let single_u_m = options.instrument.standard_m(range_m).hypot(options.repeatability_m);
        let sight = Sight {
            station_m: station.position_m,
            indicated_m: indicated,
            range_m,
            u_m: single_u_m / count.sqrt(),
            station_u_m: (column.transpose() * station.covariance_m2 * column).x.max(0.0).sqrt(),
        };
        sights.push((target, index, sight));
    }
    sights
}

fn sights_by_target(targets: usize, sights: Vec<(usize, usize, Sight)>) -> Vec<Vec<(usize, Sight)>> {
    let mut lists = vec![Vec::new(); targets];
    sights.into_iter().for_each(|(target, station, sight)| lists[target].push((station, sight)));
    lists
}
