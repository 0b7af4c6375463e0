//! A table on a linear axis with targets, watched by a laser tracker.
//!
//! Place in the flow: spherical readings for the six errors of an axis, with the truth beside them. Targets are carried by a
//! rigid table that is displaced and turned exactly; the tracker stands anywhere, levelled, and reads range, azimuth and
//! elevation with noise. All SI; targets in the machine frame, readings in the tracker's own.

use crate::error::{SimulationError, require_finite, require_not_negative};
use crate::machine::matrix::{apply, product, rotation, translation};
use crate::random::{Purpose, normal, stream, uniform};
use std::f64::consts::TAU;

/// Standard deviations of a tracker's readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerNoise {
    /// Along the beam (m).
    pub range_constant_m: f64,
    /// Along the beam, for each metre (m/m).
    pub range_per_metre: f64,
    /// Across the beam (m).
    pub transverse_constant_m: f64,
    /// Across the beam, for each metre (m/m).
    pub transverse_per_metre: f64,
}

/// Axis, targets, tracker.
#[derive(Debug, Clone, PartialEq)]
pub struct GuidewayScene {
    /// Axis that moves: 0, 1, 2 for x, y, z.
    pub axis: usize,
    /// Indicated positions (m); the lowest is where the targets stand as given.
    pub positions_m: Vec<f64>,
    /// Targets at the lowest position (m, machine frame); the first is the pivot of the table's rotations.
    pub targets_m: Vec<[f64; 3]>,
    /// Where the tracker stands (m, machine frame).
    pub tracker_m: [f64; 3],
    /// Azimuth of the machine's x axis in the tracker's frame (rad).
    pub azimuth_rad: f64,
    /// Noise of the readings.
    pub noise: TrackerNoise,
    /// Amplitude of the displacements along x, y, z (m).
    pub displacement_m: f64,
    /// Amplitude of the rotations about x, y, z (rad).
    pub rotation_rad: f64,
}

/// A reading of a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetReading {
    /// Index into the positions.
    pub position: usize,
    /// Index into the targets.
    pub target: usize,
    /// Range (m).
    pub range_m: f64,
    /// Azimuth in the tracker's frame (rad).
    pub azimuth_rad: f64,
    /// Elevation (rad).
    pub elevation_rad: f64,
}

/// What the tracker read, and the truth.
#[derive(Debug, Clone, PartialEq)]
pub struct GuidewayReadings {
    /// Position by position, target by target.
    pub readings: Vec<TargetReading>,
    /// Displacement of the first target along x, y, z (m) and rotation vector (rad) at each position, zero at the lowest.
    pub truth: Vec<[f64; 6]>,
}

impl GuidewayScene {
    /// Reads every target at every position.
    ///
    /// # Errors
    /// Settings that are not finite or negative, no such axis, no position or no target.
    pub fn measure(&self, seed: u64) -> Result<GuidewayReadings, SimulationError> {
        self.check()?;
        let lowest_m = self.positions_m.iter().copied().fold(f64::INFINITY, f64::min);
        let highest_m = self.positions_m.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let stroke_m = (highest_m - lowest_m).max(f64::MIN_POSITIVE);
        let mut machine = stream(seed, Purpose::Machine);
        let waves: [(f64, f64); 6] =
            std::array::from_fn(|_| (uniform(&mut machine, 0.5, 1.5), uniform(&mut machine, 0.0, TAU)));
        let mut noise = stream(seed, Purpose::Tracker);
        let mut made = GuidewayReadings { readings: Vec::new(), truth: Vec::new() };
        for (k, position_m) in self.positions_m.iter().enumerate() {
            let share = (position_m - lowest_m) / stroke_m;
            let errors: [f64; 6] = std::array::from_fn(|i| {
                let (cycles, phase) = waves[i];
                let size = if i < 3 { self.displacement_m } else { self.rotation_rad };
                size * ((TAU * cycles * share + phase).sin() - phase.sin())
            });
            for (j, target_m) in self.targets_m.iter().enumerate() {
                let point_m = self.carried(*target_m, position_m - lowest_m, &errors);
                made.readings.push(self.read(k, j, point_m, &mut || normal(&mut noise)));
            }
            made.truth.push(errors);
        }
        Ok(made)
    }

    fn carried(&self, target_m: [f64; 3], moved_m: f64, errors: &[f64; 6]) -> [f64; 3] {
        let pivot_m = self.targets_m[0];
        let mut shift_m = [pivot_m[0] + errors[0], pivot_m[1] + errors[1], pivot_m[2] + errors[2]];
        shift_m[self.axis] += moved_m;
        let turn = rotation([errors[3], errors[4], errors[5]]);
        let motion = product(&product(&translation(shift_m), &turn), &translation(pivot_m.map(|v| -v)));
        apply(&motion, target_m)
    }

    fn read(&self, position: usize, target: usize, point_m: [f64; 3], draw: &mut dyn FnMut() -> f64) -> TargetReading {
        let [x, y, z] = [0, 1, 2].map(|d| point_m[d] - self.tracker_m[d]);
        let flat_m = x.hypot(y);
        let range_m = flat_m.hypot(z);
        let along_m = self.noise.range_constant_m + self.noise.range_per_metre * range_m;
        let across_m = self.noise.transverse_constant_m + self.noise.transverse_per_metre * range_m;
        TargetReading {
            position,
            target,
            range_m: range_m + along_m * draw(),
            // Across the beam by so much, on a horizontal circle of this radius.
            azimuth_rad: y.atan2(x) + self.azimuth_rad + across_m / flat_m.max(f64::MIN_POSITIVE) * draw(),
            elevation_rad: z.atan2(flat_m) + across_m / range_m.max(f64::MIN_POSITIVE) * draw(),
        }
    }

    fn check(&self) -> Result<(), SimulationError> {
        let empty = self.positions_m.is_empty() || self.targets_m.is_empty();
        if self.axis > 2 || empty {
            let problem = "an axis 0, 1 or 2, a position and a target are needed";
            return Err(SimulationError::new("guideway", problem, "name the axis, add positions and targets"));
        }
        require_finite("guideway.positions_m", &self.positions_m)?;
        require_finite("guideway.targets_m", &self.targets_m.concat())?;
        require_finite("guideway.tracker_m", &self.tracker_m)?;
        require_finite("guideway", &[self.azimuth_rad, self.displacement_m, self.rotation_rad])?;
        let TrackerNoise { range_constant_m, range_per_metre, transverse_constant_m, transverse_per_metre } =
            self.noise;
        for value in [range_constant_m, range_per_metre, transverse_constant_m, transverse_per_metre] {
            require_not_negative("guideway.noise", value)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene() -> GuidewayScene {
        GuidewayScene {
            axis: 0,
            positions_m: vec![0.1, 0.3, 0.5],
            targets_m: vec![[1.0, 2.0, 0.5], [1.2, 2.0, 0.5], [1.0, 2.3, 0.6]],
            tracker_m: [0.0; 3],
            azimuth_rad: 0.0,
            noise: TrackerNoise {
                range_constant_m: 0.0,
                range_per_metre: 0.0,
                transverse_constant_m: 0.0,
                transverse_per_metre: 0.0,
            },
            displacement_m: 0.0,
            rotation_rad: 0.0,
        }
    }

    fn points(scene: &GuidewayScene) -> Vec<[f64; 3]> {
        let made = scene.measure(4).unwrap();
        let point = |r: &TargetReading| {
            let flat = r.range_m * r.elevation_rad.cos();
            [flat * r.azimuth_rad.cos(), flat * r.azimuth_rad.sin(), r.range_m * r.elevation_rad.sin()]
        };
        made.readings.iter().map(point).collect()
    }

    #[test]
    fn without_errors_the_targets_ride_along_the_axis() {
        for (k, point) in points(&scene()).iter().enumerate() {
            let start = scene().targets_m[k % 3];
            let expected = [start[0] + 0.2 * (k / 3) as f64, start[1], start[2]];
            assert!((0..3).all(|d| (point[d] - expected[d]).abs() < 1e-14), "{point:?} {expected:?}");
        }
    }

    #[test]
    fn the_first_target_moves_by_the_displacements_and_distances_stay() {
        let flawed = GuidewayScene { displacement_m: 1e-4, rotation_rad: 1e-3, ..scene() };
        let (points, truth) = (points(&flawed), flawed.measure(4).unwrap().truth);
        assert_eq!(truth[0], [0.0; 6]);
        assert!(truth[2].iter().all(|error| *error != 0.0));
        let distance = |a: [f64; 3], b: [f64; 3]| (0..3).map(|d| (a[d] - b[d]).powi(2)).sum::<f64>().sqrt();
        for k in 1..3 {
            for d in 0..3 {
                let moved = points[3 * k][d] - points[0][d] - if d == 0 { 0.2 * k as f64 } else { 0.0 };
                assert!((moved - truth[k][d]).abs() < 1e-14);
            }
            let change = distance(points[3 * k], points[3 * k + 1]) - distance(points[0], points[1]);
            assert!(change.abs() < 1e-14);
        }
    }

    #[test]
    fn settings_that_make_no_sense_are_named() {
        assert!(GuidewayScene { axis: 3, ..scene() }.measure(1).is_err());
        assert!(GuidewayScene { positions_m: Vec::new(), ..scene() }.measure(1).is_err());
        assert!(GuidewayScene { tracker_m: [f64::NAN; 3], ..scene() }.measure(1).is_err());
        let mut noisy = scene();
        noisy.noise.range_constant_m = -1.0;
        assert!(noisy.measure(1).unwrap_err().to_string().contains("noise"));
    }
}
