//! A station whose readings come one by one: what the next length should be, and how well that is known.
//!
//! Place in the flow: while a campaign is captured each reading is held against all that came before it on its station, from
//! the second on. Unknown are the place of the station, beforehand known to about where it was planned, and the dead path, which lengths that
//! are distances know to be zero, but for [`U_ABSOLUTE_ZERO_M`].
//! Points come with the uncertainty that they have along the beam: that of a machine that is not corrected, or of a model.
//! Predicted length = |p − S| − d with the uncertainty of S and d and that of the point. A jump of the zero that one reading could
//! not tell is told by those after it: from each reading on, a change c of the dead path is estimated beside everything else.
//! Machine frame, m.

use crate::instrument::U_ABSOLUTE_ZERO_M;
use crate::station_start::StationStart;
use nalgebra::{Matrix4, Vector3, Vector4};

/// Steps of a fit at most, and the step (m) that ends it.
const STEPS: usize = 20;
const SETTLED_M: f64 = 1e-9;
/// What is known of the dead path of an interferometer beforehand (m, k = 1): nothing on the scale of a machine.
const U_DEAD_PATH_M: f64 = 1e3;
/// Nearest reflector (m): nothing is told of a line of sight that has no direction.
const NEAREST_M: f64 = 1e-3;

/// A point and the length read there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// The reflector as it is known (m).
    pub position_m: Vector3<f64>,
    /// Standard uncertainty of that along the beam, and of the length (m).
    pub u_m: f64,
    /// Length (m).
    pub length_m: f64,
}

/// A length that should be read, and its standard uncertainty (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Expected {
    /// Length (m).
    pub length_m: f64,
    /// By station and dead path alone (m).
    pub u_m: f64,
}

/// The zero changed from one reading on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jump {
    /// Place of the first reading with the new zero.
    pub from: usize,
    /// By how much lengths are longer since (m).
    pub size_m: f64,
    /// Standard uncertainty of that (m).
    pub u_m: f64,
}

/// The station so far.
#[derive(Debug, Clone)]
pub struct GrowingStation {
    planned_m: Vector3<f64>,
    u_planned_m: f64,
    is_absolute: bool,
    sightings: Vec<Sighting>,
    estimate: Option<(StationStart, Matrix4<f64>)>,
}

impl GrowingStation {
    /// A station that shall stand here (m), within this standard uncertainty (m), of which nothing is read yet.
    pub fn new(planned_m: [f64; 3], u_planned_m: f64, is_absolute: bool) -> GrowingStation {
        let planned_m = Vector3::from(planned_m);
        let sightings = Vec::new();
        let mut station = GrowingStation { planned_m, u_planned_m, is_absolute, sightings, estimate: None };
        station.fit();
        station
    }

    /// How many readings it rests on.
    pub fn len(&self) -> usize {
        self.sightings.len()
    }

    /// Whether it rests on none.
    pub fn is_empty(&self) -> bool {
        self.sightings.is_empty()
    }

    /// Where it stands, as far as is known (m).
    pub fn position_m(&self) -> Vector3<f64> {
        self.estimate.as_ref().map_or(self.planned_m, |(station, _)| station.position_m)
    }

    /// What should be read at this point (m); `None` where nothing is known.
    pub fn expected(&self, position_m: &Vector3<f64>) -> Option<Expected> {
        let (station, covariance) = self.estimate.as_ref()?;
        if self.sightings.is_empty() && !self.is_absolute {
            return None;
        }
        let sight = position_m - station.position_m;
        let row = row(&sight)?;
        let u_m = (covariance * row).dot(&row).max(0.0).sqrt();
        let length_m = sight.norm() - station.dead_path_m;
        (length_m.is_finite() && u_m.is_finite()).then_some(Expected { length_m, u_m })
    }

    /// The likeliest jump of the zero between its readings, with so many of them on either side at least.
    ///
    /// Errors of a machine are correlated, and no number of readings averages them away: the uncertainty of a jump is not less than
    /// half of that of a single point.
    pub fn jump(&self, on_either_side: usize) -> Option<Jump> {
        let (station, covariance) = self.estimate.as_ref()?;
        let (mut pull, mut weights, mut rows) = (0.0, 0.0, Vector4::zeros());
        let mut likeliest: Option<Jump> = None;
        for (from, sighting) in self.sightings.iter().enumerate().rev() {
            let sight = sighting.position_m - station.position_m;
            let Some(row) = row(&sight) else { continue };
            let weight = sighting.u_m.powi(-2);
            pull += weight * (sighting.length_m - (sight.norm() - station.dead_path_m));
            weights += weight;
            rows += row * weight;
            let after = self.sightings.len() - from;
            let told = weights - (covariance * rows).dot(&rows);
            if after < on_either_side || from < on_either_side || told <= 0.0 {
                continue;
            }
            let single_m = (after as f64 / weights).sqrt();
            let jump = Jump { from, size_m: pull / told, u_m: (1.0 / told).sqrt().max(0.5 * single_m) };
            let size = |jump: &Jump| jump.size_m.abs() / jump.u_m;
            if likeliest.is_none_or(|before| size(&jump) > size(&before)) {
                likeliest = Some(jump);
            }
        }
        likeliest
    }

    /// Takes a reading that was found good.
    pub fn add(&mut self, sighting: Sighting) {
        self.sightings.push(sighting);
        self.fit();
    }

    /// Takes all readings anew, as where a better model of the machine tells the points.
    pub fn replace(&mut self, sightings: Vec<Sighting>) {
        self.sightings = sightings;
        self.fit();
    }

    /// Gauss-Newton from the planned place; what is known of that beforehand keeps the matrix regular.
    fn fit(&mut self) {
        let mut station = StationStart { position_m: self.planned_m, dead_path_m: 0.0 };
        if let (Some(first), false) = (self.sightings.first(), self.is_absolute) {
            station.dead_path_m = (first.position_m - station.position_m).norm() - first.length_m;
        }
        let known = self.u_planned_m.powi(-2);
        let of_path = if self.is_absolute { U_ABSOLUTE_ZERO_M } else { U_DEAD_PATH_M }.powi(-2);
        self.estimate = None;
        for _ in 0..STEPS {
            let mut normal = Matrix4::from_diagonal(&Vector4::new(known, known, known, of_path));
            let away_m = self.planned_m - station.position_m;
            // Nothing pulls the dead path of an interferometer anywhere.
            let to_zero_m = if self.is_absolute { -station.dead_path_m } else { 0.0 };
            let mut gradient = (away_m * known).push(to_zero_m * of_path);
            for sighting in &self.sightings {
                let sight = sighting.position_m - station.position_m;
                let Some(row) = row(&sight) else { continue };
                let left_m = sighting.length_m - (sight.norm() - station.dead_path_m);
                let weight = sighting.u_m.powi(-2);
                normal += row * row.transpose() * weight;
                gradient += row * (left_m * weight);
            }
            let Some(factor) = normal.cholesky() else { return };
            let step = factor.solve(&gradient);
            station.position_m += step.xyz();
            station.dead_path_m += step.w;
            if !step.iter().all(|value| value.is_finite()) {
                return;
            }
            if step.norm() < SETTLED_M {
                self.estimate = Some((station, factor.inverse()));
                return;
            }
        }
    }
}

/// Partials of a length by station and dead path.
fn row(sight: &Vector3<f64>) -> Option<Vector4<f64>> {
    let range_m = sight.norm();
    let along = sight / range_m;
    (range_m > NEAREST_M).then(|| Vector4::new(-along.x, -along.y, -along.z, -1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const U_M: f64 = 20e-6;

    /// Lines along X at several heights, then along Y.
    fn points() -> Vec<Vector3<f64>> {
        let along_x =
            (0..40).map(|k| Vector3::new(0.05 * f64::from(k % 10), 0.2 * f64::from(k / 10), 0.1 * f64::from(k / 20)));
        let along_y = (0..20).map(|k| Vector3::new(0.3, 0.05 * f64::from(k % 10), 0.3 * f64::from(k / 10)));
        along_x.chain(along_y).collect()
    }

    #[test]
    fn the_next_length_is_within_what_is_stated_from_the_second_reading_on() {
        let (mut squares, mut count, mut largest) = (0.0_f64, 0.0_f64, 0.0_f64);
        for seed in 0..100 {
            let mut generator = ChaCha8Rng::seed_from_u64(seed);
            let mut normal = || -> f64 { StandardNormal.sample(&mut generator) };
            let truth = Vector3::new(-0.5 + 0.02 * normal(), -0.4 + 0.02 * normal(), 0.1 + 0.02 * normal());
            let mut station = GrowingStation::new([-0.5, -0.4, 0.1], 0.02, false);
            assert!(station.is_empty() && station.expected(&points()[0]).is_none());
            for position_m in points() {
                let length_m = (position_m - truth).norm() - 0.713 + U_M * normal();
                if let Some(expected) = station.expected(&position_m) {
                    let off = (length_m - expected.length_m) / expected.u_m.hypot(U_M);
                    (squares, count, largest) = (squares + off * off, count + 1.0, largest.max(off.abs()));
                }
                station.add(Sighting { position_m, u_m: U_M, length_m });
            }
            assert!((station.position_m() - truth).norm() < 5e-3 && station.len() == 60);
        }
        // Normal numbers: 5900 of them, so that the largest is near 3.8.
        let rms = (squares / count).sqrt();
        assert!((0.9..1.1).contains(&rms) && largest < 6.0, "{rms} {largest}");
    }

    #[test]
    fn a_jump_of_the_zero_is_seen_at_the_first_reading_after_it() {
        let truth = Vector3::new(-0.5, -0.4, 0.1);
        let mut station = GrowingStation::new([-0.52, -0.38, 0.1], 0.05, false);
        for position_m in points().into_iter().take(30) {
            station.add(Sighting { position_m, u_m: U_M, length_m: (position_m - truth).norm() });
        }
        let next = points()[30];
        let expected = station.expected(&next).unwrap();
        let off_m = (next - truth).norm() + 300e-6 - expected.length_m;
        assert!(off_m / expected.u_m.hypot(U_M) > 6.0);
    }

    #[test]
    fn a_jump_that_slipped_in_is_found_by_the_readings_after_it_and_none_where_there_is_none() {
        let jumps = |at: usize, size_m: f64| {
            let mut found = Vec::new();
            for seed in 0..50 {
                let mut generator = ChaCha8Rng::seed_from_u64(seed);
                let mut normal = || -> f64 { StandardNormal.sample(&mut generator) };
                let truth = Vector3::new(-0.5 + 0.02 * normal(), -0.4 + 0.02 * normal(), 0.1 + 0.02 * normal());
                let mut station = GrowingStation::new([-0.5, -0.4, 0.1], 0.02, false);
                for (k, position_m) in points().into_iter().enumerate() {
                    // What a machine does: an error that bends slowly, of as much as is said of a point.
                    let bend_m = U_M * (3.0 * position_m.x + 5.0 * position_m.y + 2.0 * position_m.z).sin();
                    let jump_m = if k >= at { size_m } else { 0.0 };
                    let length_m = (position_m - truth).norm() - 0.7 + bend_m + 0.2 * U_M * normal() + jump_m;
                    station.add(Sighting { position_m, u_m: U_M, length_m });
                    if let Some(jump) = station.jump(3).filter(|jump| jump.size_m.abs() > 6.0 * jump.u_m) {
                        found.push((k, jump));
                        break;
                    }
                }
            }
            found
        };
        assert_eq!(jumps(usize::MAX, 0.0), vec![]);
        let found = jumps(44, 8.0 * U_M);
        assert!(found.len() >= 48, "{}", found.len());
        assert!(
            found
                .iter()
                .all(|(k, jump)| *k < 60 && jump.from.abs_diff(44) <= 2 && (jump.size_m / U_M - 8.0).abs() < 3.0)
        );
    }

    /// Held at zero, a constant of 0.3 mm put a reading 13 standard uncertainties off.
    #[test]
    fn a_constant_of_an_absolute_instrument_is_found_and_no_reading_is_in_doubt() {
        for constant_m in [0.0, 20e-6, 0.3e-3] {
            let (mut squares, mut count, mut largest) = (0.0_f64, 0.0_f64, 0.0_f64);
            for seed in 0..40 {
                let mut generator = ChaCha8Rng::seed_from_u64(seed);
                let mut normal = || -> f64 { StandardNormal.sample(&mut generator) };
                let truth = Vector3::new(-0.5 + 0.02 * normal(), -0.4 + 0.02 * normal(), 0.1 + 0.02 * normal());
                let mut station = GrowingStation::new([-0.5, -0.4, 0.1], 0.02, true);
                for position_m in points() {
                    let length_m = (position_m - truth).norm() + constant_m + 0.1 * U_M * normal();
                    let expected = station.expected(&position_m).unwrap();
                    let off = (length_m - expected.length_m) / expected.u_m.hypot(0.1 * U_M);
                    (squares, count, largest) = (squares + off * off, count + 1.0, largest.max(off.abs()));
                    station.add(Sighting { position_m, u_m: 0.1 * U_M, length_m });
                }
            }
            let rms = (squares / count).sqrt();
            assert!((0.85..1.15).contains(&rms) && largest < 6.0, "{constant_m}: {rms} {largest}");
        }
    }

    #[test]
    fn an_absolute_instrument_is_known_before_the_first_reading_and_a_reflector_at_the_station_is_not() {
        let station = GrowingStation::new([0.0; 3], 0.01, true);
        let expected = station.expected(&Vector3::new(1.0, 0.0, 0.0)).unwrap();
        assert!(
            (expected.length_m - 1.0).abs() < 1e-12 && (expected.u_m - 0.01_f64.hypot(U_ABSOLUTE_ZERO_M)).abs() < 1e-12
        );
        assert_eq!(station.expected(&Vector3::zeros()), None);
    }
}
