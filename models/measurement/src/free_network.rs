//! Stations and points from ranges alone, in a frame that the stations span.
//!
//! Place in the flow: a rival of the direct identification (the self-calibration that FYXZ paper's reference 11 uses). In:
//! absolute ranges (m) of the same points from at least four stations, and starts; out: stations and points (m) in the frame
//! of the starts up to a rigid motion. Neither a model of the machine nor its readings enter but through the starts.
//!
//! Least squares of ‖Pᵢ − Sⱼ‖ = lᵢⱼ by Levenberg-Marquardt. Ranges do not change when everything moves together, so the
//! network has a rank defect of six. The frame removes it: its origin is the first station, its X axis leads to the second,
//! its XY plane holds the third, so that 3m − 6 station coordinates are unknown. The points are eliminated one by one (Schur
//! complement), and the cost is linear in them.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use thiserror::Error;

/// Fewest stations: three give each point exactly, the fourth is what calibrates them.
pub const LEAST_STATIONS: usize = 4;
/// Steps at most.
const MAX_STEPS: usize = 200;
/// Largest motion of a station (m) that counts as settled: far below what an interferometer resolves.
const SETTLED_M: f64 = 1e-11;
/// First damping, as a share of each diagonal entry.
const FIRST_DAMPING: f64 = 1e-6;
/// Damping beyond which a step no longer changes anything.
const LARGEST_DAMPING: f64 = 1e12;
/// Smallest over largest eigenvalue of the stations' normal matrix, scaled to a unit diagonal, below which some
/// combination of stations is not seen.
const RANK_TOLERANCE: f64 = 1e-10;

/// One range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Index of the station.
    pub station: usize,
    /// Index of the point.
    pub point: usize,
    /// Distance (m).
    pub range_m: f64,
    /// Its standard uncertainty (m, k = 1).
    pub u_m: f64,
}

/// A network as it was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    /// Stations (m).
    pub stations_m: Vec<Vector3<f64>>,
    /// Points (m).
    pub points_m: Vec<Vector3<f64>>,
    /// Measured minus predicted range of each sighting (m).
    pub residuals_m: Vec<f64>,
    /// χ² per degree of freedom.
    pub chi2_per_dof: f64,
    /// Condition number of the stations' normal matrix, scaled to a unit diagonal, with the points eliminated.
    pub condition: f64,
    /// Steps made.
    pub steps: usize,
}

/// Why there is no network; indices count from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum NetworkError {
    /// Too few stations.
    #[error("{0} stations cannot calibrate each other (at least {LEAST_STATIONS} are needed); measure from more")]
    TooFewStations(usize),
    /// Fewer ranges than unknowns.
    #[error("{ranges} ranges cannot determine {unknowns} unknowns; measure more points from all stations")]
    TooFewRanges {
        /// Ranges.
        ranges: usize,
        /// Coordinates of points and stations, less the six of the frame.
        unknowns: usize,
    },
    /// A number that is none, or an index that leads nowhere.
    #[error(
        "sighting {0}: a range, uncertainty or start is not a usable number, or its station or point is not listed"
    )]
    Unusable(usize),
    /// The same range twice.
    #[error("sighting {0} repeats an earlier one of the same station and point; average them first")]
    Duplicate(usize),
    /// Ranges of another size than the starts.
    #[error(
        "half of the ranges are less than half or more than twice the distance between the starts; the unit is wrong, or \
         points and ranges do not belong together"
    )]
    WrongUnit,
    /// A point seen too seldom.
    #[error(
        "point {0} is seen from fewer than three stations, or from nearly one direction; measure it from more sides"
    )]
    Unseen(usize),
    /// Stations that do not span a frame, or do not see each other's place.
    #[error(
        "the ranges do not fix the stations: these lie in a plane or on a line, or the points do; put one station at \
         another height, and measure points that fill a volume"
    )]
    Degenerate,
    /// No solution.
    #[error(
        "the ranges contradict each other, or the starts are far off; check that points and ranges belong together"
    )]
    NotConverged,
}

/// Stations and points from ranges alone, from these starts (m, any one frame).
///
/// # Errors
/// Too few ranges, stations in a plane, a number that is none.
pub fn solve(
    stations_m: &[Vector3<f64>],
    points_m: &[Vector3<f64>],
    sightings: &[Sighting],
) -> Result<Network, NetworkError> {
    check(stations_m, points_m, sightings)?;
    let frame = Frame::of(stations_m)?;
    let mut state = State {
        stations_m: stations_m.iter().map(|s| frame.inward(s)).collect(),
        points_m: points_m.iter().map(|p| frame.inward(p)).collect(),
    };
    let mut damping = FIRST_DAMPING;
    let mut square = state.square(sightings);
    for step in 1..=MAX_STEPS {
        let normal = Normal::new(&state, sightings);
        let (tried, moved_m) = normal.step(&state, damping)?;
        let value = tried.square(sightings);
        if value <= square {
            (state, square) = (tried, value);
            damping = (damping / 10.0).max(1e-15);
        } else {
            damping *= 10.0;
        }
        if moved_m < SETTLED_M {
            return finish(&frame, &state, sightings, step);
        }
        if damping > LARGEST_DAMPING {
            break;
        }
    }
    Err(NetworkError::NotConverged)
}

fn finish(frame: &Frame, state: &State, sightings: &[Sighting], steps: usize) -> Result<Network, NetworkError> {
    let condition = Normal::new(state, sightings).condition()?;
    let unknowns = 3 * (state.stations_m.len() + state.points_m.len()) - 6;
    let degrees = (sightings.len() - unknowns).max(1) as f64;
    Ok(Network {
        residuals_m: sightings.iter().map(|s| state.residual_m(s)).collect(),
        chi2_per_dof: state.square(sightings) / degrees,
        condition,
        steps,
        stations_m: state.stations_m.iter().map(|s| frame.outward(s)).collect(),
        points_m: state.points_m.iter().map(|p| frame.outward(p)).collect(),
    })
}

fn check(stations_m: &[Vector3<f64>], points_m: &[Vector3<f64>], sightings: &[Sighting]) -> Result<(), NetworkError> {
    if stations_m.len() < LEAST_STATIONS {
        return Err(NetworkError::TooFewStations(stations_m.len()));
    }
    let mut seen = std::collections::BTreeSet::new();
    for (k, s) in sightings.iter().enumerate() {
        let starts = stations_m.get(s.station).zip(points_m.get(s.point));
        let finite = starts.is_some_and(|(a, b)| a.iter().chain(b.iter()).all(|v| v.is_finite()));
        if !(finite && s.range_m.is_finite() && s.range_m > 0.0 && s.u_m.is_finite() && s.u_m > 0.0) {
            return Err(NetworkError::Unusable(k));
        }
        if !seen.insert((s.station, s.point)) {
            return Err(NetworkError::Duplicate(k));
        }
    }
    for point in 0..points_m.len() {
        if sightings.iter().filter(|s| s.point == point).count() < 3 {
            return Err(NetworkError::Unseen(point));
        }
    }
    // Ranges alone fix the scale: in a wrong unit they would give a network of a wrong size without complaint.
    let is_near = |s: &&Sighting| {
        let ratio = s.range_m / (points_m[s.point] - stations_m[s.station]).norm();
        (0.5..=2.0).contains(&ratio)
    };
    if 2 * sightings.iter().filter(is_near).count() < sightings.len() {
        return Err(NetworkError::WrongUnit);
    }
    let unknowns = 3 * (stations_m.len() + points_m.len()) - 6;
    if sightings.len() <= unknowns {
        return Err(NetworkError::TooFewRanges { ranges: sightings.len(), unknowns });
    }
    Ok(())
}

/// Origin and axes that the first three stations span.
struct Frame {
    origin_m: Vector3<f64>,
    axes: Matrix3<f64>,
}

impl Frame {
    fn of(stations_m: &[Vector3<f64>]) -> Result<Frame, NetworkError> {
        let (first, second, third) = (stations_m[0], stations_m[1], stations_m[2]);
        let x = (second - first).try_normalize(1e-3).ok_or(NetworkError::Degenerate)?;
        let z = x.cross(&(third - first)).try_normalize(1e-3).ok_or(NetworkError::Degenerate)?;
        Ok(Frame { origin_m: first, axes: Matrix3::from_columns(&[x, z.cross(&x), z]) })
    }

    fn inward(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        self.axes.transpose() * (point_m - self.origin_m)
    }

    fn outward(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        self.axes * point_m + self.origin_m
    }
}

/// Whether the frame leaves a coordinate of a station free.
fn is_free(station: usize, coordinate: usize) -> bool {
    match station {
        0 => false,
        1 => coordinate < 1,
        2 => coordinate < 2,
        _ => true,
    }
}

#[derive(Clone)]
struct State {
    stations_m: Vec<Vector3<f64>>,
    points_m: Vec<Vector3<f64>>,
}

impl State {
    fn residual_m(&self, s: &Sighting) -> f64 {
        s.range_m - (self.points_m[s.point] - self.stations_m[s.station]).norm()
    }

    fn square(&self, sightings: &[Sighting]) -> f64 {
        sightings.iter().map(|s| (self.residual_m(s) / s.u_m).powi(2)).sum()
    }
}

/// Matrix and right-hand side of the stations with the points eliminated, and the inverse block of each point.
type Reduced = (DMatrix<f64>, DVector<f64>, Vec<Matrix3<f64>>);

/// Normal equations in blocks.
struct Normal {
    /// Places of the stations' free coordinates.
    free: Vec<usize>,
    stations: DMatrix<f64>,
    stations_right: DVector<f64>,
    points: Vec<(Matrix3<f64>, Vector3<f64>)>,
    /// Coupling of all station coordinates with each point.
    coupling: Vec<DMatrix<f64>>,
}

impl Normal {
    fn new(state: &State, sightings: &[Sighting]) -> Normal {
        let size = 3 * state.stations_m.len();
        let count = state.points_m.len();
        let mut normal = Normal {
            free: (0..size).filter(|k| is_free(k / 3, k % 3)).collect(),
            stations: DMatrix::zeros(size, size),
            stations_right: DVector::zeros(size),
            points: vec![(Matrix3::zeros(), Vector3::zeros()); count],
            coupling: vec![DMatrix::zeros(size, 3); count],
        };
        for s in sightings {
            let line = state.points_m[s.point] - state.stations_m[s.station];
            let (ray, information) = (line / line.norm(), 1.0 / (s.u_m * s.u_m));
            let (outer, right) = (ray * ray.transpose() * information, ray * (state.residual_m(s) * information));
            let first = 3 * s.station;
            let (matrix, vector) = &mut normal.points[s.point];
            *matrix += outer;
            *vector += right;
            for i in 0..3 {
                normal.stations_right[first + i] -= right[i];
                for j in 0..3 {
                    normal.stations[(first + i, first + j)] += outer[(i, j)];
                    normal.coupling[s.point][(first + i, j)] -= outer[(i, j)];
                }
            }
        }
        normal
    }

    /// The stations' equations with the points eliminated.
    fn reduced(&self, damping: f64) -> Result<Reduced, NetworkError> {
        let (mut matrix, mut right) = (self.stations.clone(), self.stations_right.clone());
        (0..matrix.nrows()).for_each(|k| matrix[(k, k)] *= 1.0 + damping);
        let mut inverses = Vec::with_capacity(self.points.len());
        for (point, ((block, vector), coupling)) in self.points.iter().zip(&self.coupling).enumerate() {
            let mut damped = *block;
            (0..3).for_each(|k| damped[(k, k)] *= 1.0 + damping);
            let inverse = damped.cholesky().ok_or(NetworkError::Unseen(point))?.inverse();
            let weighted = coupling * inverse;
            matrix -= &weighted * coupling.transpose();
            right -= &weighted * vector;
            inverses.push(inverse);
        }
        let size = self.free.len();
        let matrix = DMatrix::from_fn(size, size, |i, j| matrix[(self.free[i], self.free[j])]);
        let right = DVector::from_fn(size, |i, _| right[self.free[i]]);
        Ok((matrix, right, inverses))
    }

    /// The state after a damped step, and the largest motion of a station (m).
    fn step(&self, state: &State, damping: f64) -> Result<(State, f64), NetworkError> {
        let (matrix, right, inverses) = self.reduced(damping)?;
        let change = matrix.cholesky().ok_or(NetworkError::Degenerate)?.solve(&right);
        let mut full = DVector::zeros(self.stations.nrows());
        self.free.iter().zip(change.iter()).for_each(|(place, value)| full[*place] = *value);
        let mut next = state.clone();
        for (k, station) in next.stations_m.iter_mut().enumerate() {
            *station += full.fixed_rows::<3>(3 * k);
        }
        for (k, point) in next.points_m.iter_mut().enumerate() {
            let coupled = self.coupling[k].transpose() * &full;
            *point += inverses[k] * (self.points[k].1 - coupled.fixed_rows::<3>(0));
        }
        Ok((next, change.amax()))
    }

    fn condition(&self) -> Result<f64, NetworkError> {
        let (matrix, _, _) = self.reduced(0.0)?;
        let size = matrix.nrows();
        let scaled = DMatrix::from_fn(size, size, |i, j| matrix[(i, j)] / (matrix[(i, i)] * matrix[(j, j)]).sqrt());
        let values = scaled.symmetric_eigenvalues();
        let (least, most) = (values.min(), values.max());
        if least > RANK_TOLERANCE * most { Ok((most / least).sqrt()) } else { Err(NetworkError::Degenerate) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::alignment::aligned_residuals_m;

    fn stations() -> Vec<Vector3<f64>> {
        [[-0.15, -0.2, -0.1], [0.85, -0.2, 0.05], [0.8, 1.3, 0.1], [-0.1, 1.2, 0.6]].map(Vector3::from).to_vec()
    }

    /// A grid of 3 × 3 × 3 points.
    fn points() -> Vec<Vector3<f64>> {
        (0..27)
            .map(|k| Vector3::new(0.35 * f64::from(k % 3), 0.5 * f64::from(k / 3 % 3), 0.3 * f64::from(k / 9)))
            .collect()
    }

    /// Exact ranges to points that are off by up to 50 µm from where the starts say.
    fn case(stations_m: &[Vector3<f64>]) -> (Vec<Vector3<f64>>, Vec<Sighting>) {
        let bent = |(k, p): (usize, &Vector3<f64>)| {
            let k = k as f64;
            p + Vector3::new((1.7 * k).sin(), (2.3 * k).cos(), (0.9 * k).sin()) * 50e-6
        };
        let actual: Vec<_> = points().iter().enumerate().map(bent).collect();
        let sightings = (0..stations_m.len()).flat_map(|station| (0..27).map(move |point| (station, point)));
        let sighting = |(station, point): (usize, usize)| {
            let range_m = (actual[point] - stations_m[station]).norm();
            Sighting { station, point, range_m, u_m: 0.3e-6 }
        };
        let sightings = sightings.map(sighting).collect();
        (actual, sightings)
    }

    #[test]
    fn exact_ranges_give_the_network_back_whatever_the_starts_are_off() {
        let (actual, sightings) = case(&stations());
        let starts: Vec<_> = stations().iter().map(|s| s * 1.001).collect();
        let found = solve(&starts, &points(), &sightings).unwrap();
        let both = |a: &[Vector3<f64>], b: &[Vector3<f64>]| [a, b].concat();
        let left = aligned_residuals_m(&both(&found.points_m, &found.stations_m), &both(&actual, &stations()));
        let worst = left.unwrap().iter().map(|r| r.norm()).fold(0.0, f64::max);
        // Rounding of 1e-16 m by the condition of the network.
        assert!(worst < 1e-10, "{worst:e}, condition {}", found.condition);
        assert!(found.residuals_m.iter().all(|r| r.abs() < 1e-11));
    }

    #[test]
    fn stations_in_a_plane_or_too_few_are_refused() {
        let flat: Vec<_> = stations().iter().map(|s| Vector3::new(s.x, s.y, 0.1)).collect();
        let (_, sightings) = case(&flat);
        assert_eq!(solve(&flat, &points(), &sightings), Err(NetworkError::Degenerate));
        let line: Vec<_> = (0..4).map(|k| Vector3::new(f64::from(k), -0.3, 0.1)).collect();
        let (_, sightings) = case(&line);
        assert_eq!(solve(&line, &points(), &sightings), Err(NetworkError::Degenerate));
        let three = stations()[..3].to_vec();
        let (_, sightings) = case(&three);
        assert_eq!(solve(&three, &points(), &sightings), Err(NetworkError::TooFewStations(3)));
    }

    #[test]
    fn bad_sightings_are_refused_by_their_place() {
        let with = |change: fn(&mut Vec<Sighting>)| {
            let (_, mut sightings) = case(&stations());
            change(&mut sightings);
            solve(&stations(), &points(), &sightings).unwrap_err()
        };
        assert_eq!(with(|s| s[5].range_m = f64::NAN), NetworkError::Unusable(5));
        assert_eq!(with(|s| s[5].u_m = 0.0), NetworkError::Unusable(5));
        assert_eq!(with(|s| s[5].point = 99), NetworkError::Unusable(5));
        assert_eq!(with(|s| s.push(s[3])), NetworkError::Duplicate(108));
        assert_eq!(with(|s| s.retain(|s| s.point != 4 || s.station < 2)), NetworkError::Unseen(4));
        assert!(matches!(with(|s| s.retain(|s| s.station < 3 || s.point < 3)), NetworkError::TooFewRanges { .. }));
        // Ranges in millimetres.
        assert_eq!(with(|s| s.iter_mut().for_each(|s| s.range_m *= 1e3)), NetworkError::WrongUnit);
    }
}
