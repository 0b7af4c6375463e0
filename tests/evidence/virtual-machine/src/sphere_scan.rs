//! A reference sphere scanned by a distance probe on the fork head of a five-axis machine.
//!
//! Place in the flow: points (not centres) for the sphere fit and the calibration of the probe's pose, with the truth beside
//! them. A point on the sphere lies at Q + C(c)·(o·y + A(a)·(d·R + T)), with the head's true angles and the true Q; what comes
//! out are indicated angles and positions and the probe's reading. All SI, machine frame, right-handed angles. Set-up after
//! Zhang 2016, section 6: points up to 60° from the beam, five poses, two distances for the calibration.

use crate::error::{SimulationError, require_finite, require_not_negative, require_positive};
use crate::random::{Purpose, normal, stream, uniform};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// Sphere, head, probe, and what is wrong with them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphereScan {
    /// Centre of the sphere (m).
    pub centre_m: [f64; 3],
    /// Its radius (m).
    pub radius_m: f64,
    /// Direction of the beam at A = C = 0; of any length, which is the scale of the reading.
    pub direction: [f64; 3],
    /// Zero of the probe at A = C = 0 (m).
    pub zero_m: [f64; 3],
    /// Offset of the A axis from the C axis along y of the frame that C turns (m).
    pub axis_offset_m: f64,
    /// Errors of both angles that belong to a pose and come back with it: standard deviation (rad).
    pub pose_error_rad: f64,
    /// Errors of both angles that change with every visit: standard deviation (rad).
    pub visit_error_rad: f64,
    /// Amplitude of a wave in each linear axis, along and across it (m).
    pub axis_error_m: f64,
    /// Period of those waves (m).
    pub axis_period_m: f64,
    /// Noise of the probe's reading: standard deviation (m).
    pub probe_noise_m: f64,
    /// What the probe reads too much at 60° of incidence; grows with the square of the sine (m).
    pub incidence_error_m: f64,
}

/// Where and how a scan is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanPlan {
    /// Indicated A (rad).
    pub a_rad: f64,
    /// Indicated C (rad).
    pub c_rad: f64,
    /// Lower and upper reading of the probe (m); the same for a scan at one distance.
    pub distance_m: (f64, f64),
    /// Points.
    pub points: usize,
    /// Number of the visit to this pose: every visit has its own errors of the angles.
    pub visit: u64,
}

/// A point as the machine sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScannedPoint {
    /// Indicated X, Y, Z (m).
    pub reading_m: [f64; 3],
    /// Reading of the probe (m).
    pub distance_m: f64,
}

impl SphereScan {
    /// Scans a cap of 60° about the beam.
    ///
    /// # Errors
    /// Settings that are not finite, negative sizes, no radius, no direction, an empty range of distances.
    pub fn scan(&self, plan: &ScanPlan, seed: u64) -> Result<Vec<ScannedPoint>, SimulationError> {
        self.check()?;
        require_finite("plan", &[plan.a_rad, plan.c_rad, plan.distance_m.0, plan.distance_m.1])?;
        if plan.distance_m.0 > plan.distance_m.1 {
            let remedy = "give the lower distance first";
            return Err(SimulationError::new("plan.distance_m", "the range is empty", remedy));
        }
        let head = self.head(plan, seed);
        let phases = self.phases(seed);
        let tag = visit_tag(plan);
        let mut generator = stream(seed ^ tag, Purpose::SphereScan);
        Ok((0..plan.points).map(|_| self.point(plan, &head, &phases, &mut generator)).collect())
    }

    fn check(&self) -> Result<(), SimulationError> {
        let vectors = [self.centre_m, self.direction, self.zero_m].concat();
        require_finite("sphere_scan", &vectors)?;
        require_finite("sphere_scan", &[self.axis_offset_m, self.incidence_error_m])?;
        require_positive("sphere_scan.radius_m", self.radius_m)?;
        require_positive("sphere_scan.direction", length(self.direction))?;
        require_positive("sphere_scan.axis_period_m", self.axis_period_m)?;
        for (key, value) in [
            ("sphere_scan.pose_error_rad", self.pose_error_rad),
            ("sphere_scan.visit_error_rad", self.visit_error_rad),
            ("sphere_scan.axis_error_m", self.axis_error_m),
            ("sphere_scan.probe_noise_m", self.probe_noise_m),
        ] {
            require_not_negative(key, value)?;
        }
        Ok(())
    }

    /// True angles of the head on this visit.
    fn head(&self, plan: &ScanPlan, seed: u64) -> Head {
        let mut of_pose = stream(seed ^ pose_tag(plan), Purpose::Head);
        let mut of_visit = stream(seed ^ visit_tag(plan), Purpose::Head);
        let mut angle = |indicated_rad: f64| {
            let error = self.pose_error_rad * normal(&mut of_pose) + self.visit_error_rad * normal(&mut of_visit);
            indicated_rad + error
        };
        Head { a_rad: angle(plan.a_rad), c_rad: angle(plan.c_rad), offset_m: self.axis_offset_m }
    }

    fn phases(&self, seed: u64) -> [[f64; 3]; 3] {
        let mut generator = stream(seed, Purpose::Machine);
        [[(); 3]; 3].map(|row| row.map(|()| uniform(&mut generator, 0.0, TAU)))
    }

    fn point(&self, plan: &ScanPlan, head: &Head, phases: &[[f64; 3]; 3], generator: &mut ChaCha8Rng) -> ScannedPoint {
        let unit = scaled(self.direction, length(self.direction).recip());
        let towards_probe = scaled(head.turn(unit), -1.0);
        let normal_out = near(towards_probe, generator);
        let sine_squared = 1.0 - dot(normal_out, towards_probe).powi(2);
        let reading_m = if plan.distance_m.0 < plan.distance_m.1 {
            uniform(generator, plan.distance_m.0, plan.distance_m.1)
        } else {
            plan.distance_m.0
        };
        // The reading is the distance plus noise and what the slope of the surface adds: at 60° the sine squared is 3/4.
        let distance_m =
            reading_m - self.probe_noise_m * normal(generator) - self.incidence_error_m * sine_squared / 0.75;
        let on_sphere = sum(self.centre_m, scaled(normal_out, self.radius_m));
        let probe = head.turn(sum(scaled(self.direction, distance_m), self.zero_m));
        let true_m = difference(on_sphere, sum(probe, head.offset()));
        // Error = actual − indicated, a wave of the indicated position; the actual one is near enough to take it at.
        let error = |d: usize| -> f64 {
            let wave = |j: usize| (TAU * true_m[j] / self.axis_period_m + phases[d][j]).sin();
            self.axis_error_m * (0..3).map(wave).sum::<f64>() / 3f64.sqrt()
        };
        ScannedPoint { reading_m: std::array::from_fn(|d| true_m[d] - error(d)), distance_m: reading_m }
    }
}

/// True state of the head.
struct Head {
    a_rad: f64,
    c_rad: f64,
    offset_m: f64,
}

impl Head {
    /// First about x by A, then about z by C.
    fn turn(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let (y, z) = (y * self.a_rad.cos() - z * self.a_rad.sin(), y * self.a_rad.sin() + z * self.a_rad.cos());
        [x * self.c_rad.cos() - y * self.c_rad.sin(), x * self.c_rad.sin() + y * self.c_rad.cos(), z]
    }

    fn offset(&self) -> [f64; 3] {
        [-self.offset_m * self.c_rad.sin(), self.offset_m * self.c_rad.cos(), 0.0]
    }
}

/// A direction drawn evenly from the cap of 60° about another.
fn near(axis: [f64; 3], generator: &mut ChaCha8Rng) -> [f64; 3] {
    let up = uniform(generator, 0.5, 1.0);
    let (across, around) = ((1.0 - up * up).sqrt(), uniform(generator, 0.0, TAU));
    let helper = if axis[0].abs() < 0.8 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let first = cross(axis, helper);
    let first = scaled(first, length(first).recip());
    let second = cross(axis, first);
    sum(scaled(axis, up), sum(scaled(first, across * around.cos()), scaled(second, across * around.sin())))
}

/// Same angles, same number: a pose keeps its errors.
fn pose_tag(plan: &ScanPlan) -> u64 {
    (plan.a_rad + 0.0).to_bits().rotate_left(17) ^ (plan.c_rad + 0.0).to_bits().wrapping_mul(0x9E37_79B9_7F4A_7C15)
}

fn visit_tag(plan: &ScanPlan) -> u64 {
    pose_tag(plan) ^ (plan.visit + 1).wrapping_mul(0xD1B5_4A32_D192_ED03)
}

fn sum(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn scaled(a: [f64; 3], by: f64) -> [f64; 3] {
    [a[0] * by, a[1] * by, a[2] * by]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn length(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Beam straight down from half a metre, no errors.
    const PLAIN: SphereScan = SphereScan {
        centre_m: [0.1, 0.2, 0.3],
        radius_m: 0.01,
        direction: [0.0, 0.0, -1.0],
        zero_m: [0.0, 0.0, -0.4],
        axis_offset_m: 0.0,
        pose_error_rad: 0.0,
        visit_error_rad: 0.0,
        axis_error_m: 0.0,
        axis_period_m: 1.0,
        probe_noise_m: 0.0,
        incidence_error_m: 0.0,
    };

    fn plan(a_deg: f64, c_deg: f64) -> ScanPlan {
        ScanPlan {
            a_rad: a_deg.to_radians(),
            c_rad: c_deg.to_radians(),
            distance_m: (0.09, 0.1),
            points: 200,
            visit: 0,
        }
    }

    /// Straight down, the probed point lies d + 0.4 m below; turned by A = 90°, as far along +y; by C = 90° on top, along −x.
    #[test]
    fn without_errors_every_point_lies_on_the_upper_cap() {
        for (angles, away) in
            [([0.0, 0.0], [0.0, 0.0, -1.0]), ([90.0, 0.0], [0.0, 1.0, 0.0]), ([90.0, 90.0], [-1.0, 0.0, 0.0])]
        {
            for point in PLAIN.scan(&plan(angles[0], angles[1]), 3).unwrap() {
                assert!((0.09..0.1).contains(&point.distance_m));
                let probed = sum(point.reading_m, scaled(away, point.distance_m + 0.4));
                let arm = difference(probed, PLAIN.centre_m);
                assert!((length(arm) - 0.01).abs() < 1e-15, "{angles:?} {arm:?}");
                assert!(dot(arm, away) < -0.005 + 1e-12, "points face the probe, up to 60°");
            }
        }
    }

    #[test]
    fn errors_of_a_pose_come_back_with_it_and_those_of_a_visit_do_not() {
        let flawed = SphereScan { pose_error_rad: 1e-3, visit_error_rad: 0.0, ..PLAIN };
        let angles = |scan: &SphereScan, visit| {
            let head = scan.head(&ScanPlan { visit, ..plan(60.0, 45.0) }, 5);
            [head.a_rad, head.c_rad]
        };
        assert_eq!(angles(&flawed, 0), angles(&flawed, 1));
        assert_ne!(angles(&flawed, 0), angles(&PLAIN, 0));
        let restless = SphereScan { visit_error_rad: 1e-3, ..PLAIN };
        assert_ne!(angles(&restless, 0), angles(&restless, 1));
        assert_eq!(flawed.scan(&plan(60.0, 45.0), 5), flawed.scan(&plan(60.0, 45.0), 5));
    }

    #[test]
    fn settings_that_make_no_sense_are_named() {
        let refused = |scan: SphereScan, says: &str| {
            let message = scan.scan(&plan(0.0, 0.0), 1).unwrap_err().to_string();
            assert!(message.contains(says), "{message}");
        };
        refused(SphereScan { radius_m: 0.0, ..PLAIN }, "radius_m");
        refused(SphereScan { direction: [0.0; 3], ..PLAIN }, "direction");
        refused(SphereScan { probe_noise_m: -1.0, ..PLAIN }, "probe_noise_m");
        refused(SphereScan { centre_m: [f64::NAN, 0.0, 0.0], ..PLAIN }, "finite");
        let backwards = ScanPlan { distance_m: (0.1, 0.09), ..plan(0.0, 0.0) };
        assert!(PLAIN.scan(&backwards, 1).unwrap_err().to_string().contains("distance_m"));
    }
}
