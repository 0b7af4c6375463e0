//! Spherical readings of a laser tracker as points with covariance, and back.
//!
//! Place in the flow: readings (range, azimuth, elevation) of targets on a table in, points in the tracker's frame out (m).
//! x = l·cosβ·cosα, y = l·cosβ·sinα, z = l·sinβ (Zhang 2011, eq. 10: lost in print, the usual form), with α the azimuth about
//! z from x and β the elevation above the x-y plane (rad). First-order propagation of the uncertainties (GUM, 5.1).

use nalgebra::{Matrix3, Vector3};
use std::f64::consts::{FRAC_PI_2, TAU};
use thiserror::Error;

/// One reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerReading {
    /// Distance from the tracker's centre (m).
    pub range_m: f64,
    /// α: azimuth about z, from x (rad).
    pub azimuth_rad: f64,
    /// β: elevation above the x-y plane (rad).
    pub elevation_rad: f64,
}

/// Standard uncertainties (k = 1) of a tracker, each a constant and a part proportional to the range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerUncertainty {
    /// Along the beam (m).
    pub range_constant_m: f64,
    /// Along the beam, for each metre of range (m/m).
    pub range_per_metre: f64,
    /// Across the beam, horizontally and vertically (m), as data sheets state angles.
    pub transverse_constant_m: f64,
    /// Across the beam, for each metre of range (m/m, which is rad).
    pub transverse_per_metre: f64,
}

/// A reading or an uncertainty that cannot be.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum TrackerError {
    /// A figure is not finite.
    #[error("a range or angle is not a finite number; correct or remove the reading")]
    NotFinite,
    /// No target is at or behind the tracker's centre.
    #[error("the range {0} m is not above zero; a tracker measures the distance from its own centre")]
    Range(f64),
    /// Elevations lie between straight down and straight up.
    #[error(
        "the elevation {0:.4} rad is beyond straight up or down; angles above the horizontal plane, in the right unit, are needed"
    )]
    Elevation(f64),
    /// Azimuths turn once.
    #[error("the azimuth {0:.4} rad is more than a full turn; check its unit")]
    Azimuth(f64),
    /// A point at the centre has no direction.
    #[error("a point at the tracker's centre has no azimuth and elevation")]
    AtCentre,
    /// Uncertainties are zero or more, and one of them is above zero in each direction.
    #[error("uncertainties must be finite and not below zero, and above zero along and across the beam")]
    Uncertainty,
}

impl TrackerReading {
    /// Refuses what no tracker reads.
    ///
    /// # Errors
    /// Figures that are not finite, a range that is not positive, angles beyond a turn or beyond the vertical.
    pub fn check(&self) -> Result<(), TrackerError> {
        if ![self.range_m, self.azimuth_rad, self.elevation_rad].iter().all(|v| v.is_finite()) {
            return Err(TrackerError::NotFinite);
        }
        if self.range_m <= 0.0 {
            return Err(TrackerError::Range(self.range_m));
        }
        // Rounding of 90° and 360° in a file is no error.
        if self.elevation_rad.abs() > FRAC_PI_2 * (1.0 + 1e-9) {
            return Err(TrackerError::Elevation(self.elevation_rad));
        }
        if self.azimuth_rad.abs() > TAU * (1.0 + 1e-9) {
            return Err(TrackerError::Azimuth(self.azimuth_rad));
        }
        Ok(())
    }

    /// The point (m, tracker frame).
    pub fn point_m(&self) -> Vector3<f64> {
        self.beam() * self.range_m
    }

    /// The reading of a point (m, tracker frame); azimuth in (−π, π], 0 straight above and below.
    ///
    /// # Errors
    /// A point that is not finite, or at the centre.
    pub fn of_point(point_m: &Vector3<f64>) -> Result<TrackerReading, TrackerError> {
        if point_m.iter().any(|v| !v.is_finite()) {
            return Err(TrackerError::NotFinite);
        }
        let range_m = point_m.norm();
        if range_m <= 0.0 {
            return Err(TrackerError::AtCentre);
        }
        // atan2 keeps all digits near the vertical, where the arc sine of z/l loses half of them.
        let elevation_rad = point_m.z.atan2(point_m.x.hypot(point_m.y));
        Ok(TrackerReading { range_m, azimuth_rad: point_m.y.atan2(point_m.x), elevation_rad })
    }

    /// Unit vectors along the beam, horizontally across it, and across both (tracker frame).
    fn axes(&self) -> Matrix3<f64> {
        let ((sa, ca), (sb, cb)) = (self.azimuth_rad.sin_cos(), self.elevation_rad.sin_cos());
        Matrix3::new(cb * ca, -sa, -sb * ca, cb * sa, ca, -sb * sa, sb, 0.0, cb)
    }

    fn beam(&self) -> Vector3<f64> {
        self.axes().column(0).into_owned()
    }

    /// Partials of the point by range (1), azimuth (m/rad) and elevation (m/rad).
    pub fn partials(&self) -> Matrix3<f64> {
        let scale = Vector3::new(1.0, self.range_m * self.elevation_rad.cos(), self.range_m);
        self.axes() * Matrix3::from_diagonal(&scale)
    }

    /// Covariance of the point (m², tracker frame) from standard uncertainties of range (m), azimuth and elevation (rad).
    pub fn covariance_m2(&self, u_range_m: f64, u_azimuth_rad: f64, u_elevation_rad: f64) -> Matrix3<f64> {
        let variances = Vector3::new(u_range_m, u_azimuth_rad, u_elevation_rad).map(|u| u * u);
        let partials = self.partials();
        partials * Matrix3::from_diagonal(&variances) * partials.transpose()
    }
}

impl TrackerUncertainty {
    /// Refuses what no tracker has.
    ///
    /// # Errors
    /// Parts that are not finite or negative, or nothing along or across the beam.
    pub fn check(&self) -> Result<(), TrackerError> {
        let along = [self.range_constant_m, self.range_per_metre];
        let across = [self.transverse_constant_m, self.transverse_per_metre];
        let is_one =
            |parts: [f64; 2]| parts.iter().all(|p| p.is_finite() && *p >= 0.0) && parts.iter().sum::<f64>() > 0.0;
        if is_one(along) && is_one(across) { Ok(()) } else { Err(TrackerError::Uncertainty) }
    }

    /// Covariance of the point of a reading (m², tracker frame).
    pub fn covariance_m2(&self, reading: &TrackerReading) -> Matrix3<f64> {
        let along = self.range_constant_m + self.range_per_metre * reading.range_m;
        let across = self.transverse_constant_m + self.transverse_per_metre * reading.range_m;
        let axes = reading.axes();
        axes * Matrix3::from_diagonal(&Vector3::new(along, across, across).map(|u| u * u)) * axes.transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(range_m: f64, azimuth_rad: f64, elevation_rad: f64) -> TrackerReading {
        TrackerReading { range_m, azimuth_rad, elevation_rad }
    }

    #[test]
    fn the_axes_are_where_the_equations_put_them() {
        for (angles, expected) in
            [([0.0, 0.0], [2.0, 0.0, 0.0]), ([FRAC_PI_2, 0.0], [0.0, 2.0, 0.0]), ([0.7, FRAC_PI_2], [0.0, 0.0, 2.0])]
        {
            let point = reading(2.0, angles[0], angles[1]).point_m();
            assert!((point - Vector3::from(expected)).norm() < 1e-15, "{point:?}");
        }
        // l = 3, α = 30°, β = 60°: x = 3·½·√3/2, y = 3·½·½, z = 3·√3/2.
        let point = reading(3.0, 30f64.to_radians(), 60f64.to_radians()).point_m();
        let root = 3f64.sqrt();
        assert!((point - Vector3::new(0.75 * root, 0.75, 1.5 * root)).norm() < 1e-15);
    }

    #[test]
    fn readings_come_back_from_their_points_in_every_direction() {
        for range_m in [1e-3, 0.7, 40.0] {
            for k in -17..18 {
                for j in -9..=9i32 {
                    let one = reading(range_m, f64::from(k) * 0.1818, f64::from(j) * FRAC_PI_2 / 9.0);
                    let back = TrackerReading::of_point(&one.point_m()).unwrap();
                    assert!((back.point_m() - one.point_m()).norm() < 1e-15 * range_m);
                    assert!((back.elevation_rad - one.elevation_rad).abs() < 1e-15);
                    if j.abs() < 9 {
                        assert!((back.azimuth_rad - one.azimuth_rad).abs() < 1e-14, "{one:?} {back:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn partials_equal_differences() {
        let at = [1.7, -2.1, 0.9];
        let point = |v: [f64; 3]| reading(v[0], v[1], v[2]).point_m();
        for k in 0..3 {
            let (mut above, mut below) = (at, at);
            above[k] += 1e-6;
            below[k] -= 1e-6;
            let difference = (point(above) - point(below)) / 2e-6;
            assert!((difference - reading(at[0], at[1], at[2]).partials().column(k)).norm() < 1e-9);
        }
    }

    /// Along the beam u(l), horizontally l·cosβ·u(α), vertically l·u(β); on the x axis these are x, y and z.
    #[test]
    fn covariances_are_those_of_the_hand_case_and_turn_with_the_beam() {
        let variances = |u: [f64; 3]| Matrix3::from_diagonal(&Vector3::from(u).map(|u| u * u));
        let close = |a: Matrix3<f64>, b: Matrix3<f64>| assert!((a - b).norm() < 1e-12 * b.norm(), "{a} {b}");
        close(reading(2.0, 0.0, 0.0).covariance_m2(1e-6, 3e-6, 4e-6), variances([1e-6, 6e-6, 8e-6]));
        let steep = reading(2.0, FRAC_PI_2, 60f64.to_radians()).covariance_m2(1e-6, 3e-6, 4e-6);
        assert!((steep[(0, 0)].sqrt() - 3e-6).abs() < 1e-18, "the horizontal circle is half as large at 60°");
        let tracker = TrackerUncertainty {
            range_constant_m: 1e-6,
            range_per_metre: 0.5e-6,
            transverse_constant_m: 5e-6,
            transverse_per_metre: 2e-6,
        };
        close(tracker.covariance_m2(&reading(2.0, 0.0, 0.0)), variances([2e-6, 9e-6, 9e-6]));
        close(tracker.covariance_m2(&reading(2.0, FRAC_PI_2, 0.0)), variances([9e-6, 2e-6, 9e-6]));
        close(tracker.covariance_m2(&reading(2.0, 0.3, FRAC_PI_2)), variances([9e-6, 9e-6, 2e-6]));
        assert!((tracker.covariance_m2(&reading(2.0, 1.0, 0.5)).trace() - 166e-12).abs() < 1e-22);
    }

    #[test]
    fn what_no_tracker_reads_is_refused() {
        for (one, says) in [
            (reading(f64::NAN, 0.0, 0.0), "finite"),
            (reading(1.0, f64::INFINITY, 0.0), "finite"),
            (reading(0.0, 0.0, 0.0), "above zero"),
            (reading(-2.0, 0.0, 0.0), "above zero"),
            (reading(1.0, 0.0, 40.0), "unit"),
            (reading(1.0, 120.0, 0.0), "unit"),
        ] {
            let message = one.check().unwrap_err().to_string();
            assert!(message.contains(says), "{message}");
        }
        assert!(reading(1.0, TAU, -FRAC_PI_2).check().is_ok());
        assert_eq!(TrackerReading::of_point(&Vector3::zeros()), Err(TrackerError::AtCentre));
        assert_eq!(TrackerReading::of_point(&Vector3::new(0.0, f64::NAN, 1.0)), Err(TrackerError::NotFinite));
        let tracker = |range_constant_m, transverse_constant_m| TrackerUncertainty {
            range_constant_m,
            range_per_metre: 0.0,
            transverse_constant_m,
            transverse_per_metre: 0.0,
        };
        assert!(tracker(1e-6, 1e-6).check().is_ok());
        for bad in [tracker(0.0, 1e-6), tracker(1e-6, 0.0), tracker(-1e-6, 1e-6), tracker(f64::NAN, 1e-6)] {
            assert_eq!(bad.check(), Err(TrackerError::Uncertainty));
        }
    }
}
