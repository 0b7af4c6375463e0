//! The kinematic chain: where tip or reflector really is, and how that moves with each error.
//!
//! Place in the flow: the innermost function of everything; identification takes its partials as Jacobian,
//! correction as sensitivities. Inputs: axis readings (m), offset (m, ram frame), error values (m, rad).
//! Output: position in the machine frame (m). Source: Liang 2025, eq. 1-7, with exact rotations as an option.
//!
//! Going from the tool towards the workpiece, a tool-side axis takes a point p to R(ε)·p + r·e + δ, a
//! workpiece-side axis to R(ε)·(p + r·e) + δ, where r is the reading, e the axis direction, δ the linear and ε
//! the angular errors. Squareness adds c·(r − r₀)·(about × e) to δ.

use crate::axis::Axis;
use crate::machine::{Machine, Side};
use crate::rotation::{rotation, rotation_partials};
use nalgebra::{Matrix3, Vector3};

/// Values of all errors at one position of the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorValues {
    /// In the order of [`crate::ErrorId::index`] (m, rad).
    pub errors: [f64; 18],
    /// In the order of [`Machine::squareness`] (rad).
    pub squareness: [f64; 3],
}

impl ErrorValues {
    /// A perfect machine.
    pub const ZERO: ErrorValues = ErrorValues { errors: [0.0; 18], squareness: [0.0; 3] };
}

/// Position of tip or reflector and its partial derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChainPoint {
    /// Actual position in the machine frame (m).
    pub position_m: Vector3<f64>,
    /// ∂position/∂error, in the order of [`crate::ErrorId::index`] (m/m, m/rad).
    pub by_error: [Vector3<f64>; 18],
    /// ∂position/∂squareness, in the order of [`Machine::squareness`] (m/rad).
    pub by_squareness: [Vector3<f64>; 3],
    /// ∂position/∂offset: what all joints together turn the offset by.
    pub by_offset: Matrix3<f64>,
}

/// Where an ideal machine would be: readings plus offset (m, machine frame).
pub fn nominal_point_m(reading_m: [f64; 3], offset_m: [f64; 3]) -> Vector3<f64> {
    Vector3::from(reading_m) + Vector3::from(offset_m)
}

/// Actual position of tip or reflector with these errors, and its partials.
pub fn chain_point(machine: &Machine, reading_m: [f64; 3], offset_m: [f64; 3], values: &ErrorValues) -> ChainPoint {
    let joints = joints(machine, reading_m, values);
    let (point, arms) = outward(&joints, offset_m);
    let mut result = ChainPoint {
        position_m: point,
        by_error: [Vector3::zeros(); 18],
        by_squareness: [Vector3::zeros(); 3],
        by_offset: Matrix3::identity(),
    };
    let mut before = Matrix3::identity();
    for (joint, arm) in joints.iter().zip(&arms) {
        let turned = before * rotation_partials(machine.rotation, &joint.angles_rad, arm);
        for d in 0..3 {
            result.by_error[joint.axis.index() * 6 + d] = before.column(d).into_owned();
            result.by_error[joint.axis.index() * 6 + 3 + d] = turned.column(d).into_owned();
        }
        for (entry, column) in machine.squareness.iter().zip(&mut result.by_squareness) {
            if entry.tilts == joint.axis {
                *column = before * tilt_m(machine, entry.tilts, entry.about, reading_m);
            }
        }
        before *= joint.turn;
    }
    result.by_offset = before;
    result
}

/// The same position without its partials.
pub(crate) fn actual_point_m(
    machine: &Machine,
    reading_m: [f64; 3],
    offset_m: [f64; 3],
    values: &ErrorValues,
) -> Vector3<f64> {
    outward(&joints(machine, reading_m, values), offset_m).0
}

fn joints(machine: &Machine, reading_m: [f64; 3], values: &ErrorValues) -> [JointState; 3] {
    // Written out: mapping the array copies the states, which took a tenth of an identification.
    let state = |k: usize| JointState::new(machine, machine.joints[k].axis, machine.joints[k].side, reading_m, values);
    [state(0), state(1), state(2)]
}

/// From the tool to the workpiece: the position, and what each joint turned.
fn outward(joints: &[JointState; 3], offset_m: [f64; 3]) -> (Vector3<f64>, [Vector3<f64>; 3]) {
    let mut point = Vector3::from(offset_m);
    let mut arms = [Vector3::zeros(); 3];
    for k in (0..3).rev() {
        arms[k] = joints[k].arm(&point);
        point = joints[k].place(&point, &arms[k]);
    }
    (point, arms)
}

/// Motion per radian of squareness: (about × axis) · travelled distance (m/rad).
fn tilt_m(machine: &Machine, tilts: Axis, about: Axis, reading_m: [f64; 3]) -> Vector3<f64> {
    let travelled_m = reading_m[tilts.index()] - machine.stroke_m[tilts.index()].0;
    about.direction().cross(&tilts.direction()) * travelled_m
}

/// One axis at one reading.
struct JointState {
    axis: Axis,
    side: Side,
    travel_m: Vector3<f64>,
    shift_m: Vector3<f64>,
    angles_rad: Vector3<f64>,
    turn: Matrix3<f64>,
}

impl JointState {
    fn new(machine: &Machine, axis: Axis, side: Side, reading_m: [f64; 3], values: &ErrorValues) -> JointState {
        let first = axis.index() * 6;
        let errors = &values.errors;
        let mut shift_m = Vector3::new(errors[first], errors[first + 1], errors[first + 2]);
        for (entry, angle_rad) in machine.squareness.iter().zip(values.squareness) {
            if entry.tilts == axis {
                shift_m += tilt_m(machine, axis, entry.about, reading_m) * angle_rad;
            }
        }
        let angles_rad = Vector3::new(errors[first + 3], errors[first + 4], errors[first + 5]);
        let travel_m = axis.direction() * reading_m[axis.index()];
        JointState { axis, side, travel_m, shift_m, angles_rad, turn: rotation(machine.rotation, &angles_rad) }
    }

    /// What the rotation of this joint turns.
    fn arm(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        match self.side {
            Side::Tool => *point_m,
            Side::Workpiece => point_m + self.travel_m,
        }
    }

    /// The point after this joint, towards the workpiece. The tiny part R·a − a is added last, so that it is not
    /// rounded to the size of the coordinates.
    fn place(&self, point_m: &Vector3<f64>, arm_m: &Vector3<f64>) -> Vector3<f64> {
        let turned_by_m = (self.turn - Matrix3::identity()) * arm_m;
        (point_m + self.travel_m) + (turned_by_m + self.shift_m)
    }
}
