//! Stations, dead paths and points from nothing but ranges: a free network, adjusted in one go.
//!
//! Place in the flow: lengths (m) of the same points from at least four stations, and starts, in; stations, dead paths and
//! points (m) with their covariance out. No model of the machine takes part, and no nominal point: starts only name the
//! solution that is meant and the frame it is given in.
//!
//! Least squares of ‖pᵢ + shift − Sⱼ‖ − dⱼ = lᵢⱼ by Levenberg-Marquardt. Points are eliminated one by one (Schur complement), so
//! that cost and memory grow with the ranges (`blocks`). Ranges fix shape and scale. They do not change when everything
//! moves together, so six numbers are a convention: the frame is that in which the points fit their starts best (inner
//! constraints; `frame`), and covariances are of that frame. Plans that leave more than the frame open are refused
//! (`rank`). Gross errors are found by residuals over their own standard deviation (`outliers`).
//! Source: Baarda 1968 (data snooping), 1973 (S-transformations); the network itself is that of multilateration.

mod blocks;
mod error;
mod frame;
mod outliers;
mod rank;

pub use error::{NetworkError, PointProblem};

use blocks::{Blocks, Step};
use nalgebra::{Matrix3, Matrix4, Vector3};
use outliers::Verdict;

/// Fewest stations: three give each point exactly, the fourth is what calibrates them.
pub const LEAST_STATIONS: usize = 4;
/// Stations that fix a point.
const LEAST_SIGHTS: usize = 3;
/// Steps at most.
const MAX_STEPS: usize = 100;
/// Gain of a step in χ² that is not worth another: 1e-5 of a standard uncertainty.
const SETTLED_CHI2: f64 = 1e-10;
/// First damping, as a share of each diagonal entry.
const FIRST_DAMPING: f64 = 1e-6;
/// Damping below which a step is that of Gauss and Newton.
const LEAST_DAMPING: f64 = 1e-12;
/// Damping beyond which a step no longer changes anything.
const LARGEST_DAMPING: f64 = 1e9;

/// What a station read at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Index of the station.
    pub station: usize,
    /// Index of the point.
    pub point: usize,
    /// Where the reflector was when it was read, relative to the point (m): a machine comes back only nearly.
    pub shift_m: Vector3<f64>,
    /// Length (m): distance less dead path.
    pub length_m: f64,
    /// Its standard uncertainty (m, k = 1).
    pub u_m: f64,
}

/// Position and dead path of a station.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// Position (m).
    pub position_m: Vector3<f64>,
    /// Distance at length zero (m); nearly zero where lengths are distances.
    pub dead_path_m: f64,
}

/// Where a search begins, and the points whose frame is meant.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Stations, good to a few per cent of the ranges.
    pub stations: Vec<Placed>,
    /// Points (m), such as a machine indicated them.
    pub points_m: Vec<Vector3<f64>>,
}

/// How a network is adjusted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NetworkOptions {
    /// How well dead paths are known to be zero beforehand (m, k = 1), where lengths are distances; `None` where nothing is known of them.
    pub u_dead_path_m: Option<f64>,
    /// Standard uncertainty (m/m) of the scale that all lengths have in common: covariances hold it, and no reading shows it.
    pub u_common_scale: f64,
    /// Gross errors are looked for and left out.
    pub robust: bool,
}

/// A station as it was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Station {
    /// Where.
    pub placed: Placed,
    /// Covariance of position and dead path (m²).
    pub covariance_m2: Matrix4<f64>,
}

/// A point as it was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// Position (m).
    pub position_m: Vector3<f64>,
    /// Its covariance in the frame of this network (m²): ranges, stations, frame.
    pub covariance_m2: Matrix3<f64>,
    /// What its own ranges would leave if stations were known (m²).
    pub of_ranges_m2: Matrix3<f64>,
    /// What the noise of the frame's own points does here (m²): it goes when results of another frame are compared.
    pub of_frame_m2: Matrix3<f64>,
    /// Stations that see it, less the three that fix it: 0 where nothing checks it.
    pub checks: usize,
    /// Sightings of it that were left out as gross errors.
    pub lost: usize,
}

/// A network as it was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    /// Stations in the order of the start.
    pub stations: Vec<Station>,
    /// Points in the order of the start, or why there is none.
    pub points: Vec<Result<Point, PointProblem>>,
    /// Measured minus predicted length of each sighting (m); `None` where its point was not solved.
    pub residuals_m: Vec<Option<f64>>,
    /// Sightings left out as gross errors, in order.
    pub rejected: Vec<usize>,
    /// χ² of the sightings used.
    pub chi2: f64,
    /// Sightings used, less unknowns.
    pub degrees: usize,
    /// Factor that covariances were multiplied with: χ² per degree of freedom where that is above one.
    pub noise: f64,
}

/// How far an adjustment is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Search for gross errors, from 1.
    pub round: usize,
    /// Step in this round, from 1.
    pub step: usize,
    /// Sightings left out so far.
    pub rejected: usize,
}

/// Stations and points from ranges alone; `observe` returns false to stop.
///
/// # Errors
/// Too few stations or ranges, plans that leave more than the frame open, a number that is none.
pub fn solve(
    start: &Start,
    sightings: &[Sighting],
    options: NetworkOptions,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Network, NetworkError> {
    error::check(start, sightings, options)?;
    let mut search = Search::new(start, sightings, options);
    for round in 1.. {
        match search.round(round, observe) {
            Ok(()) if options.robust && search.leave_out_outliers()? => {}
            Ok(()) => break,
            // Such equations have no solution because of where the stations stand.
            Err(NetworkError::Singular | NetworkError::NotConverged) if rank::stations_are_flat(&search) => {
                return Err(NetworkError::FlatStations);
            }
            Err(why) => return Err(why),
        }
    }
    frame::finish(search, start)
}

/// A network in work.
struct Search<'a> {
    sightings: &'a [Sighting],
    u_dead_path_m: Option<f64>,
    u_common_scale: f64,
    stations: Vec<Placed>,
    points_m: Vec<Vector3<f64>>,
    /// Sightings of each point.
    of_point: Vec<Vec<usize>>,
    /// Why a point takes no part.
    problems: Vec<Option<PointProblem>>,
    used: Vec<bool>,
    rejected: Vec<usize>,
}

impl<'a> Search<'a> {
    fn new(start: &Start, sightings: &'a [Sighting], options: NetworkOptions) -> Search<'a> {
        let mut of_point = vec![Vec::new(); start.points_m.len()];
        sightings.iter().enumerate().for_each(|(k, s)| of_point[s.point].push(k));
        Search {
            sightings,
            u_dead_path_m: options.u_dead_path_m,
            u_common_scale: options.u_common_scale,
            stations: start.stations.clone(),
            points_m: start.points_m.clone(),
            problems: vec![None; of_point.len()],
            of_point,
            used: vec![true; sightings.len()],
            rejected: Vec::new(),
        }
    }

    /// Sightings of a point that take part.
    fn sights(&self, point: usize) -> impl Iterator<Item = usize> + '_ {
        self.of_point[point].iter().copied().filter(|k| self.used[*k])
    }

    /// Sightings of a point that take part, less the three that fix it.
    fn checks(&self, point: usize) -> usize {
        self.sights(point).count().saturating_sub(LEAST_SIGHTS)
    }

    /// Sightings of a point that were left out as gross errors while it stayed.
    fn lost(&self, point: usize) -> usize {
        self.rejected.iter().filter(|k| self.sightings[**k].point == point).count()
    }

    /// Points that take part.
    fn solvable(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.problems.len()).filter(|point| self.problems[*point].is_none())
    }

    /// Measured minus predicted length (m), and the unit vector from station to point.
    ///
    /// The direction leaves the shift out: with it a turn of the whole network would seem to be measured.
    fn row(&self, sighting: usize) -> (f64, Vector3<f64>) {
        let s = &self.sightings[sighting];
        let station = &self.stations[s.station];
        let line = self.points_m[s.point] - station.position_m;
        (s.length_m - ((line + s.shift_m).norm() - station.dead_path_m), line.normalize())
    }

    fn chi2(&self) -> f64 {
        let of = |k: usize| (self.row(k).0 / self.sightings[k].u_m).powi(2);
        let of_sightings: f64 = (0..self.sightings.len()).filter(|k| self.used[*k]).map(of).sum();
        of_sightings + self.chi2_of_dead_paths()
    }

    /// What dead paths add that are known beforehand.
    fn chi2_of_dead_paths(&self) -> f64 {
        let Some(u_m) = self.u_dead_path_m else { return 0.0 };
        self.stations.iter().map(|station| (station.dead_path_m / u_m).powi(2)).sum()
    }

    /// Unknowns beside points that no plan may leave open: without the six of the frame, and without dead paths that are known beforehand.
    fn unknowns_of_stations(&self) -> usize {
        let each = if self.u_dead_path_m.is_some() { 3 } else { 4 };
        each * self.stations.len() - 6
    }

    fn leave_out(&mut self, point: usize, why: PointProblem) {
        self.problems[point] = Some(why);
        for k in 0..self.of_point[point].len() {
            self.used[self.of_point[point][k]] = false;
        }
    }

    /// Leaves out points that too few stations see, or that lie nearly in a plane with them.
    fn leave_out_loose_points(&mut self) {
        rank::loose(self).into_iter().for_each(|(point, why)| self.leave_out(point, why));
    }

    /// Least squares of what takes part.
    fn round(&mut self, round: usize, observe: &mut dyn FnMut(Progress) -> bool) -> Result<(), NetworkError> {
        self.leave_out_loose_points();
        rank::check(self)?;
        self.settle(round, observe)?;
        // Starts may hide that stations lie in a plane; what is found does not.
        rank::check(self)
    }

    /// Descent from where the search stands.
    fn settle(&mut self, round: usize, observe: &mut dyn FnMut(Progress) -> bool) -> Result<(), NetworkError> {
        let mut damping = FIRST_DAMPING;
        let mut chi2 = self.chi2();
        for step in 1..=MAX_STEPS {
            if !observe(Progress { round, step, rejected: self.rejected.len() }) {
                return Err(NetworkError::Stopped);
            }
            let blocks = Blocks::new(self);
            loop {
                let Step { stations, points_m, gain } = blocks.step(self, damping)?;
                let before =
                    (std::mem::replace(&mut self.stations, stations), std::mem::replace(&mut self.points_m, points_m));
                let next = self.chi2();
                // A step too small for its gain to show in the sum is taken: its length is that of rounding.
                if next <= chi2 || gain < SETTLED_CHI2 {
                    chi2 = next;
                    if gain < SETTLED_CHI2 {
                        return Ok(());
                    }
                    damping = (damping / 100.0).max(LEAST_DAMPING);
                    break;
                }
                (self.stations, self.points_m) = before;
                damping *= 10.0;
                if damping > LARGEST_DAMPING {
                    return Err(NetworkError::NotConverged);
                }
            }
        }
        Err(NetworkError::NotConverged)
    }

    /// Leaves out what contradicts the rest; false where nothing does.
    fn leave_out_outliers(&mut self) -> Result<bool, NetworkError> {
        let found = outliers::find(self)?;
        for verdict in &found {
            match *verdict {
                Verdict::Sighting(k) => {
                    self.used[k] = false;
                    self.rejected.push(k);
                }
                Verdict::Point(point) => self.leave_out(point, PointProblem::Contradicting),
            }
        }
        Ok(!found.is_empty())
    }
}

#[cfg(test)]
mod tests;
