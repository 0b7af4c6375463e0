//! A whole campaign: readings in, stations, points and what was left out.
//!
//! Place in the flow: [`solve`] takes a [`Campaign`] (SI, machine frame), groups readings by the point they were taken at,
//! rejects contradicting pairs, starts from stations that fit the indicated points (Chen 2020 eq. 1) and adjusts stations,
//! dead paths and points together ([`crate::network`]).

use super::pairs::{self, LeftOut, RejectedPair};
use super::problem::{MANY, Problem};
use super::targets::{Target, group, indicated_m};
use crate::campaign::{Campaign, RangeReading};
use crate::instrument::{RangeUncertainty, U_ABSOLUTE_ZERO_M};
use crate::network::{self, LEAST_STATIONS, Network, NetworkError, Placed, PointProblem, Progress, Sighting};
use crate::robust;
use crate::station_start::{self, PointAndLength};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;

/// How a campaign is solved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MultilaterationOptions {
    /// Uncertainty of a length.
    pub instrument: RangeUncertainty,
    /// Repeatability of each axis when the machine comes back to a point (m, k = 1): stations see the point at different times.
    pub repeatability_m: [f64; 3],
    /// Readings of one point from one station that differ by more than this (m) contradict each other; `None` for what
    /// instrument and repeatability explain, at least the 5 µm of Chen 2020.
    pub pair_limit_m: Option<f64>,
    /// Readings whose indicated reflector positions differ by less than this (m) are of one point.
    pub same_point_m: f64,
    /// Lengths are distances: dead paths are zero, but for [`U_ABSOLUTE_ZERO_M`].
    pub absolute_range: bool,
}

/// A solved point.
#[derive(Debug, Clone, PartialEq)]
pub struct SolvedPoint {
    /// Index into [`MultiStation::targets`].
    pub target: usize,
    /// Indices of the stations that saw it and were used.
    pub stations: Vec<usize>,
    /// Stations whose mean reading of it was left out, since it contradicts the others.
    pub lost: usize,
    /// Volumetric error: actual − indicated (m, machine frame), but for a motion common to all points.
    pub error_m: Vector3<f64>,
    /// Its covariance in that frame (m²).
    pub covariance_m2: Matrix3<f64>,
    /// Part of it that is the point's own: its ranges (m²). The rest it shares with other points: stations and frame.
    pub own_m2: Matrix3<f64>,
    /// What the noise of the frame does here (m²).
    pub frame_m2: Matrix3<f64>,
}

/// A point that could not be solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unsolved {
    /// Index into [`MultiStation::targets`].
    pub target: usize,
    /// Why.
    pub why: PointProblem,
}

/// The mean reading of a point from a station that contradicts all others.
#[derive(Debug, Clone, PartialEq)]
pub struct RejectedSight {
    /// Index of the station.
    pub station: usize,
    /// Index of the point.
    pub point: usize,
    /// Indices of the readings that were left out.
    pub readings: Vec<usize>,
    /// Measured less predicted length (m); `None` where the point was not solved either.
    pub residual_m: Option<f64>,
}

/// A solved campaign.
#[derive(Debug, Clone, PartialEq)]
pub struct MultiStation {
    /// Names of the stations.
    pub names: Vec<String>,
    /// Stations, in the order of the names.
    pub stations: Vec<network::Station>,
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
    /// What they cost; `None` where there are none.
    pub left_out: Option<LeftOut>,
    /// Readings that contradict other stations.
    pub contradicted: Vec<RejectedSight>,
    /// Measured minus predicted lengths of the sights used (m).
    pub residuals_m: Vec<f64>,
    /// χ² per degree of freedom, and these.
    pub chi2_per_dof: f64,
    /// Sights less unknowns.
    pub degrees: usize,
}

/// Stations, dead paths and points of a campaign; `observe` returns false to stop.
///
/// # Errors
/// Plans that cannot tell stations, points and dead paths apart, readings that do not fit.
pub fn solve(
    campaign: &Campaign,
    options: &MultilaterationOptions,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<MultiStation, Problem> {
    check(campaign, options)?;
    let (targets, target_of) = group(&campaign.readings, options.same_point_m);
    let stations = starts(campaign, options.absolute_range)?;
    let groups = by_station_and_target(campaign, &target_of);
    let rejected = contradictions(campaign, &groups, &stations, options);
    let left_out = left_out(&groups, &rejected);
    let mut kept = vec![true; campaign.readings.len()];
    rejected.iter().flat_map(|pair| &pair.readings).for_each(|reading| kept[*reading] = false);
    let sights = sights(campaign, &kept, (&targets, &groups), &stations, options);
    let enough = |points: &mut dyn Iterator<Item = usize>| {
        let mut seen = vec![0; targets.len()];
        points.for_each(|point| seen[point] += 1);
        seen.iter().filter(|count| **count >= LEAST_STATIONS).count()
    };
    if enough(&mut sights.iter().map(|sight| sight.sighting.point)) == 0 {
        let (points, seen) = (targets.len(), enough(&mut groups.keys().map(|(_, point)| *point)));
        return Err(match left_out.filter(|_| seen > 0) {
            Some(left_out) => Problem::NoPointLeft { points, seen, left_out },
            None => Problem::NoPoint { points },
        });
    }
    let start = network::Start { stations, points_m: targets.iter().map(Target::indicated_m).collect() };
    let sightings: Vec<Sighting> = sights.iter().map(|sight| sight.sighting).collect();
    let u_dead_path_m = options.absolute_range.then_some(U_ABSOLUTE_ZERO_M);
    let u_common_scale = options.instrument.common_per_metre;
    let network_options = network::NetworkOptions { u_dead_path_m, u_common_scale, robust: true };
    let found = network::solve(&start, &sightings, network_options, observe)
        .map_err(|why| of_network(&campaign.stations, why, left_out))?;
    Ok(told(campaign, (targets, target_of), (rejected, left_out), &sights, found))
}

/// A network in the words of its campaign.
fn told(
    campaign: &Campaign,
    (targets, target_of): (Vec<Target>, Vec<usize>),
    (rejected, left_out): (Vec<RejectedPair>, Option<LeftOut>),
    sights: &[MeanReading],
    found: Network,
) -> MultiStation {
    let is_used = |k: usize| found.residuals_m[k].is_some() && found.rejected.binary_search(&k).is_err();
    let mut stations_of = vec![Vec::new(); targets.len()];
    for (_, MeanReading { sighting, .. }) in sights.iter().enumerate().filter(|(k, _)| is_used(*k)) {
        stations_of[sighting.point].push(sighting.station);
    }
    let (mut points, mut unsolved) = (Vec::new(), Vec::new());
    for ((target, point), stations) in found.points.into_iter().enumerate().zip(stations_of) {
        match point {
            Ok(point) => points.push(SolvedPoint {
                target,
                stations,
                lost: point.lost,
                error_m: point.position_m - targets[target].indicated_m(),
                covariance_m2: point.covariance_m2,
                own_m2: point.of_ranges_m2,
                frame_m2: point.of_frame_m2,
            }),
            Err(why) => unsolved.push(Unsolved { target, why }),
        }
    }
    let contradicted = found.rejected.iter().map(|k| RejectedSight {
        station: sights[*k].sighting.station,
        point: sights[*k].sighting.point,
        readings: sights[*k].readings.clone(),
        residual_m: found.residuals_m[*k],
    });
    MultiStation {
        names: campaign.stations.clone(),
        stations: found.stations,
        targets,
        target_of,
        points,
        unsolved,
        rejected,
        left_out,
        contradicted: contradicted.collect(),
        residuals_m: (0..sights.len()).filter(|k| is_used(*k)).filter_map(|k| found.residuals_m[k]).collect(),
        chi2_per_dof: found.chi2 / found.degrees.max(1) as f64,
        degrees: found.degrees,
    }
}

fn of_network(names: &[String], why: NetworkError, left_out: Option<LeftOut>) -> Problem {
    let part: Vec<&str> = match &why {
        NetworkError::Loose { stations, .. } => {
            stations.iter().filter_map(|k| names.get(*k)).map(String::as_str).collect()
        }
        _ => names.iter().map(String::as_str).collect(),
    };
    let is_many = |left_out: &LeftOut| left_out.pairs as f64 > MANY * left_out.repeated as f64;
    Problem::Network { stations: part.join(", "), why, left_out: left_out.filter(is_many) }
}

fn check(campaign: &Campaign, options: &MultilaterationOptions) -> Result<(), Problem> {
    let above_zero = |value: f64| value.is_finite() && value > 0.0;
    let RangeUncertainty { constant_m, per_metre, common_per_metre } = options.instrument;
    let is_size = |value: f64| value.is_finite() && value >= 0.0;
    if ![constant_m, per_metre, common_per_metre].into_iter().all(is_size) || constant_m + per_metre <= 0.0 {
        return Err(Problem::Option("the instrument's uncertainty"));
    }
    if options.pair_limit_m.is_some_and(|limit_m| !above_zero(limit_m)) {
        return Err(Problem::Option("the limit of a pair's difference"));
    }
    if !above_zero(options.same_point_m) {
        return Err(Problem::Option("the distance within which readings are of one point"));
    }
    if !options.repeatability_m.iter().all(|r| r.is_finite() && *r >= 0.0) {
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

/// Stations that fit the indicated points, with gross errors left out; refused where two stand at one place.
fn starts(campaign: &Campaign, absolute: bool) -> Result<Vec<Placed>, Problem> {
    /// Stations nearer than this (m) are one: no two instruments fit there.
    const SAME_M: f64 = 1e-3;
    /// Lengths of a point that is read again differ by less (m).
    const REPEATED_M: f64 = 1e-3;
    let one = |(index, name): (usize, &String)| {
        let own = campaign.readings.iter().filter(|r| r.station as usize == index);
        let points: Vec<_> = own.map(|r| (indicated_m(r), r.length_m)).collect();
        // No length changes faster than its point moves, wherever the station stands.
        let is_fast = |pair: &&[PointAndLength]| {
            (pair[1].1 - pair[0].1).abs() > 2.0 * (pair[1].0 - pair[0].0).norm() + REPEATED_M
        };
        if 2 * points.windows(2).filter(is_fast).count() > points.len() {
            return Err(Problem::Unit(name.clone()));
        }
        let station = station_start::start(&points, absolute);
        let station = station.map_err(|why| Problem::Station { name: name.clone(), why })?;
        Ok(Placed { position_m: station.position_m, dead_path_m: station.dead_path_m })
    };
    let stations: Vec<Placed> = campaign.stations.iter().enumerate().map(one).collect::<Result<_, Problem>>()?;
    for second in 1..stations.len() {
        for first in 0..second {
            if (stations[first].position_m - stations[second].position_m).norm() < SAME_M {
                return Err(Problem::SameStation(campaign.stations[first].clone(), campaign.stations[second].clone()));
            }
        }
    }
    Ok(stations)
}

/// Readings of each station and target, in order.
type Groups = BTreeMap<(usize, usize), Vec<usize>>;

fn by_station_and_target(campaign: &Campaign, target_of: &[usize]) -> Groups {
    let mut groups = Groups::new();
    for (index, (reading, target)) in campaign.readings.iter().zip(target_of).enumerate() {
        groups.entry((reading.station as usize, *target)).or_default().push(index);
    }
    groups
}

/// Measured length less that to the indicated position (m).
fn deviation_m(reading: &RangeReading, station: &Placed) -> f64 {
    reading.length_m - ((indicated_m(reading) - station.position_m).norm() - station.dead_path_m)
}

/// Standard uncertainty of one reading (m) along this line of sight, with what the machine adds in its direction: lᵀ Σ l.
fn single_u_m(line_m: &Vector3<f64>, options: &MultilaterationOptions) -> f64 {
    let range_m = line_m.norm();
    let sight = line_m / range_m.max(f64::MIN_POSITIVE);
    options.instrument.with_repeatability_m(range_m, &sight, options.repeatability_m)
}

fn contradictions(
    campaign: &Campaign,
    groups: &Groups,
    stations: &[Placed],
    options: &MultilaterationOptions,
) -> Vec<RejectedPair> {
    let of = |(&(station, point), readings): (&(usize, usize), &Vec<usize>)| {
        let deviation = |k: &usize| deviation_m(&campaign.readings[*k], &stations[station]);
        let deviations: Vec<f64> = readings.iter().map(deviation).collect();
        let u_m =
            |k: &usize| single_u_m(&(indicated_m(&campaign.readings[*k]) - stations[station].position_m), options);
        let largest_m = readings.iter().map(u_m).fold(0.0, f64::max);
        let limit_m = options.pair_limit_m.unwrap_or_else(|| pairs::limit_m(largest_m));
        let found = pairs::contradiction(&deviations, limit_m)?;
        let readings = found.left_out.iter().map(|place| readings[*place]).collect();
        let (gross, difference_m) = (found.gross, found.difference_m);
        Some(RejectedPair { station, point, readings, gross, difference_m, limit_m })
    };
    groups.iter().filter_map(of).collect()
}

/// What contradicting readings cost; `None` where there are none.
fn left_out(groups: &Groups, rejected: &[RejectedPair]) -> Option<LeftOut> {
    let median = |of: fn(&RejectedPair) -> f64| robust::median(rejected.iter().map(of).collect());
    Some(LeftOut {
        pairs: rejected.len(),
        repeated: groups.values().filter(|readings| readings.len() > 1).count(),
        difference_m: median(|pair| pair.difference_m)?,
        limit_m: median(|pair| pair.limit_m)?,
    })
}

/// The mean of what a station read at a point.
struct MeanReading {
    sighting: Sighting,
    readings: Vec<usize>,
}

fn sights(
    campaign: &Campaign,
    kept: &[bool],
    (targets, groups): (&[Target], &Groups),
    stations: &[Placed],
    options: &MultilaterationOptions,
) -> Vec<MeanReading> {
    let mut sights = Vec::new();
    for (&(index, point), readings) in groups {
        let readings: Vec<usize> = readings.iter().copied().filter(|k| kept[*k]).collect();
        if readings.is_empty() {
            continue;
        }
        let count = readings.len() as f64;
        let station = &stations[index];
        let indicated = readings.iter().map(|k| indicated_m(&campaign.readings[*k])).sum::<Vector3<f64>>() / count;
        let deviation = readings.iter().map(|k| deviation_m(&campaign.readings[*k], station)).sum::<f64>() / count;
        let range_m = (indicated - station.position_m).norm() + deviation;
        let sighting = Sighting {
            station: index,
            point,
            shift_m: indicated - targets[point].indicated_m(),
            length_m: range_m - station.dead_path_m,
            u_m: single_u_m(&(indicated - station.position_m), options) / count.sqrt(),
        };
        sights.push(MeanReading { sighting, readings });
    }
    sights
}
