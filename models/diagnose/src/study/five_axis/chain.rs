//! Exact kinematics of a fork head: where the probed point lies, and how that moves with every flaw.
//!
//! Place in the flow: innermost function of the five-axis study. q = Q + R_C·(o + R_A·(d(1 + s)·R_p + T_p)) + shift, with
//! R_C a rotation by θC about an axis that is Z tilted by a small rotation vector, R_A one by θA about X tilted likewise,
//! and o the offset of the A axis from the C axis, in the frame that C turns (Zhang 2016, eq. 1–3, extended). Metres,
//! radians, machine frame.

use abbe_geometry::rotation::{RotationForm, rotation, rotation_partials};
use abbe_geometry::{Matrix3, Vector3};

/// What a flaw can move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Acts {
    /// θA (rad).
    AngleA,
    /// θC (rad).
    AngleC,
    /// Tilt of the A axis about x, y or z (0, 1, 2) of the frame that C turns (rad).
    TiltA(usize),
    /// Tilt of the C axis about machine x, y or z (rad).
    TiltC(usize),
    /// Offset of the A axis from the C axis along x, y or z of the frame that C turns (m).
    Offset(usize),
    /// Relative error of the probe's reading (1).
    Distance,
    /// Displacement of the probed point along machine x, y or z (m).
    Shift(usize),
}

impl Acts {
    /// Number of different things to move.
    pub(super) const COUNT: usize = 15;

    /// Place in [`Flaws`] and [`Point::by_flaw`].
    pub(super) fn index(self) -> usize {
        match self {
            Acts::AngleA => 0,
            Acts::AngleC => 1,
            Acts::Distance => 2,
            Acts::TiltA(k) => 3 + k,
            Acts::TiltC(k) => 6 + k,
            Acts::Offset(k) => 9 + k,
            Acts::Shift(k) => 12 + k,
        }
    }
}

/// Amounts of all flaws in one pose, in the order of [`Acts::index`].
pub(super) type Flaws = [f64; Acts::COUNT];

/// Indicated pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pose {
    pub(super) a_rad: f64,
    pub(super) c_rad: f64,
    pub(super) distance_m: f64,
    /// Indicated X, Y, Z (m).
    pub(super) reading_m: Vector3<f64>,
}

/// The probed point relative to the indicated X, Y, Z.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    /// Part that probe direction and zero do not enter: offset and shift (m).
    pub(super) constant_m: Vector3<f64>,
    /// R_C·R_A: what T_p is multiplied with.
    pub(super) turn: Matrix3<f64>,
    /// d(1 + s): what the direction is multiplied with beside (m).
    pub(super) distance_m: f64,
    /// Partials by flaw (m per unit).
    pub(super) by_flaw: [Vector3<f64>; Acts::COUNT],
}

/// A rotation by an angle about a tilted axis, applied to a point, with partials by angle and tilt.
struct Turn {
    matrix: Matrix3<f64>,
    axis: Vector3<f64>,
    tilt_rad: Vector3<f64>,
    back: Matrix3<f64>,
    plain: Matrix3<f64>,
}

impl Turn {
    fn new(nominal: Vector3<f64>, angle_rad: f64, tilt_rad: Vector3<f64>) -> Turn {
        let form = RotationForm::Exact;
        let tilt = rotation(form, &tilt_rad);
        let plain = rotation(form, &(nominal * angle_rad));
        let back = tilt.transpose();
        Turn { matrix: tilt * plain * back, axis: tilt * nominal, tilt_rad, back, plain }
    }

    fn by_angle(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.axis.cross(&(self.matrix * point))
    }

    fn by_tilt(&self, point: &Vector3<f64>) -> Matrix3<f64> {
        let form = RotationForm::Exact;
        let outer = rotation_partials(form, &self.tilt_rad, &(self.plain * self.back * point));
        let inner = rotation_partials(form, &-self.tilt_rad, point);
        outer - self.back.transpose() * self.plain * inner
    }
}

/// The probed point of an indicated pose with these flaws; `direction` and `zero_m` are R_p and T_p.
pub(super) fn point(pose: &Pose, flaws: &Flaws, direction: &Vector3<f64>, zero_m: &Vector3<f64>) -> Point {
    let vector = |first: Acts| Vector3::from_column_slice(&flaws[first.index()..first.index() + 3]);
    let a = Turn::new(Vector3::x(), pose.a_rad + flaws[Acts::AngleA.index()], vector(Acts::TiltA(0)));
    let c = Turn::new(Vector3::z(), pose.c_rad + flaws[Acts::AngleC.index()], vector(Acts::TiltC(0)));
    let distance_m = pose.distance_m * (1.0 + flaws[Acts::Distance.index()]);
    let probe_m = direction * distance_m + zero_m;
    let offset_m = vector(Acts::Offset(0));
    let hung_m = offset_m + a.matrix * probe_m;
    let turn = c.matrix * a.matrix;
    let mut by_flaw = [Vector3::zeros(); Acts::COUNT];
    by_flaw[Acts::AngleA.index()] = c.matrix * a.by_angle(&probe_m);
    by_flaw[Acts::AngleC.index()] = c.by_angle(&hung_m);
    by_flaw[Acts::Distance.index()] = turn * direction * pose.distance_m;
    let (tilt_a, tilt_c) = (c.matrix * a.by_tilt(&probe_m), c.by_tilt(&hung_m));
    for k in 0..3 {
        by_flaw[Acts::TiltA(k).index()] = tilt_a.column(k).into_owned();
        by_flaw[Acts::TiltC(k).index()] = tilt_c.column(k).into_owned();
        by_flaw[Acts::Offset(k).index()] = c.matrix.column(k).into_owned();
        by_flaw[Acts::Shift(k).index()] = Vector3::ith(k, 1.0);
    }
    Point { constant_m: c.matrix * offset_m + vector(Acts::Shift(0)), turn, distance_m, by_flaw }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose() -> Pose {
        Pose { a_rad: 0.9, c_rad: -0.7, distance_m: 0.095, reading_m: Vector3::new(0.1, -0.2, 0.3) }
    }

    fn at(flaws: &Flaws) -> Vector3<f64> {
        let (direction, zero_m) = (Vector3::new(0.01, 0.02, -0.9997), Vector3::new(-0.011, 0.033, -0.453));
        let point = point(&pose(), flaws, &direction, &zero_m);
        point.constant_m + point.turn * (direction * point.distance_m + zero_m)
    }

    /// Away from zero, where a partial that is right for small angles only would be caught.
    #[test]
    fn partials_equal_differences_at_large_flaws() {
        let mut flaws: Flaws = std::array::from_fn(|k| 0.05 * ((k as f64 * 1.7).sin() + 0.3));
        let (direction, zero_m) = (Vector3::new(0.01, 0.02, -0.9997), Vector3::new(-0.011, 0.033, -0.453));
        let by_flaw = point(&pose(), &flaws, &direction, &zero_m).by_flaw;
        for k in 0..Acts::COUNT {
            let (step, middle) = (1e-6, flaws[k]);
            flaws[k] = middle + step;
            let above = at(&flaws);
            flaws[k] = middle - step;
            let below = at(&flaws);
            flaws[k] = middle;
            assert!(((above - below) / (2.0 * step) - by_flaw[k]).norm() < 1e-9, "flaw {k}");
        }
    }

    /// Zhang 2016, eq. 1.
    #[test]
    fn without_flaws_it_is_the_published_matrix() {
        let Pose { a_rad: a, c_rad: c, .. } = pose();
        let expected = Matrix3::new(
            c.cos(),
            -a.cos() * c.sin(),
            a.sin() * c.sin(),
            c.sin(),
            a.cos() * c.cos(),
            -a.sin() * c.cos(),
            0.0,
            a.sin(),
            a.cos(),
        );
        let turn = point(&pose(), &[0.0; Acts::COUNT], &Vector3::z(), &Vector3::zeros()).turn;
        assert!((turn - expected).norm() < 1e-15);
    }
}
