//! The virtual machine: three linear axes in any chain, 18 error functions and the squareness between them.
//!
//! Place in the flow: [`crate::simulate`] asks it where the reflector really is; tests ask it for the truth.
//! Inputs: axis readings (m), reflector offset (m, ram frame). Output: actual point (m, machine frame, which is
//! the frame of the workpiece side). Error = actual − indicated.
//!
//! Tool-side axis: T = Trans(reading·e + δ)·Rot(ε), the pivot moves with the axis and turns all that is nearer
//! the tool. Workpiece-side axis: p = Rot(ε)·(rest + reading·e) + δ, the pivot is the table's zero; its errors
//! are those of the tool relative to the table. Squareness: δ gains angle·(about × e)·(reading − stroke start). Before all
//! joints the turn of the ram takes the reflector from its offset o to c + Rot(φ)·(o − c).

mod check;
pub(crate) mod curve;
pub(crate) mod matrix;
mod truths;

use std::collections::BTreeMap;

pub use curve::Term;
pub use truths::{Roughness, TruthRecipe};

use crate::error::SimulationError;
use curve::{ErrorCurve, Gauge};
use matrix::{Homogeneous, IDENTITY, apply, product, rotation, translation};

/// A linear axis of the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Axis {
    /// Moves along +X of the machine frame.
    X,
    /// Moves along +Y of the machine frame.
    Y,
    /// Moves along +Z of the machine frame.
    Z,
}

impl Axis {
    /// The three axes in the order in which readings are stored.
    pub const ALL: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

    /// Place of this axis in a reading.
    pub fn index(self) -> usize {
        match self {
            Axis::X => 0,
            Axis::Y => 1,
            Axis::Z => 2,
        }
    }

    fn letter(self) -> char {
        match self {
            Axis::X => 'X',
            Axis::Y => 'Y',
            Axis::Z => 'Z',
        }
    }

    fn unit(self) -> [f64; 3] {
        let mut out = [0.0; 3];
        out[self.index()] = 1.0;
        out
    }
}

/// A constant tilt of one axis' direction about another axis of the machine frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Squareness {
    /// Name such as `C0Y`.
    pub name: String,
    /// The axis whose direction is tilted.
    pub tilts: Axis,
    /// The machine-frame axis about which it is tilted, right-handed.
    pub about: Axis,
    /// Angle (rad).
    pub angle_rad: f64,
}

/// How the ram, with all that it carries, stands in the frame of the axes' motions.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RamTurn {
    /// Rotation vector φ (rad, machine directions).
    pub angles_rad: [f64; 3],
    /// Offset c that stays where it is: the machine frame is fixed by it (m, ram frame).
    pub about_m: [f64; 3],
}

/// Everything that makes one machine, as data.
#[derive(Debug, Clone, PartialEq)]
pub struct MachineTruth {
    /// Name for reports.
    pub name: String,
    /// Lower and upper end of the strokes of X, Y, Z (m).
    pub stroke_m: [[f64; 2]; 3],
    /// Axes that carry the tool, from the bed to the tool.
    pub tool_side: Vec<Axis>,
    /// Axes that carry the workpiece, from the bed to the workpiece.
    pub workpiece_side: Vec<Axis>,
    /// Terms of the error functions by ISO 230-1 name (`EXX` … `ECZ`; m and rad); a name left out is zero.
    pub errors: BTreeMap<String, Vec<Term>>,
    /// Squareness errors, at most one about each machine-frame axis.
    pub squareness: Vec<Squareness>,
    /// Turn of the ram: what is left of the constants of the angular errors when the frame follows the axes' motions.
    pub ram_turn: RamTurn,
}

/// What enters the joints and the tip beyond the machine's own error functions; effects and noise add to it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointErrors {
    /// Extra translation (m) as `[axis][direction]`.
    pub linear_m: [[f64; 3]; 3],
    /// Extra rotation (rad) as `[axis][about]`.
    pub angular_rad: [[f64; 3]; 3],
    /// Extra displacement of the tip (m, machine frame) that belongs to no joint.
    pub tip_m: [f64; 3],
}

/// A machine whose truth passed every check and that can be asked for points.
#[derive(Debug, Clone, PartialEq)]
pub struct VirtualMachine {
    truth: MachineTruth,
    linear: [[ErrorCurve; 3]; 3],
    angular: [[ErrorCurve; 3]; 3],
}

impl VirtualMachine {
    /// Builds the machine.
    ///
    /// # Errors
    /// Names the key of the first setting that makes no sense.
    pub fn new(truth: MachineTruth) -> Result<Self, SimulationError> {
        check::check(&truth).map_err(|e| e.under("machine"))?;
        Ok(Self::unchecked(truth))
    }

    fn unchecked(truth: MachineTruth) -> Self {
        let curve = |direction: char, axis: Axis, gauge: Gauge| {
            let name = format!("E{direction}{}", axis.letter());
            let terms = truth.errors.get(&name).cloned().unwrap_or_default();
            ErrorCurve::new(terms, truth.stroke_m[axis.index()], gauge)
        };
        let linear = Axis::ALL.map(|axis| {
            Axis::ALL.map(|direction| {
                let gauge = if direction == axis { Gauge::ZeroAtStart } else { Gauge::ZeroAtBothEnds };
                curve(direction.letter(), axis, gauge)
            })
        });
        let angular = Axis::ALL.map(|axis| ['A', 'B', 'C'].map(|letter| curve(letter, axis, Gauge::ZeroAtStart)));
        Self { truth, linear, angular }
    }

    /// The data this machine was built from.
    pub fn truth(&self) -> &MachineTruth {
        &self.truth
    }

    /// True error (m for linear, rad for angular) of an ISO 230-1 name at a reading (m) of its own axis.
    ///
    /// # Errors
    /// The name is none of the 18.
    pub fn error_value(&self, name: &str, reading_m: f64) -> Result<f64, SimulationError> {
        let (direction, axis) = parse_error_name(name).ok_or_else(|| check::unknown_error(name))?;
        Ok(match direction {
            Direction::Linear(d) => self.linear[axis.index()][d].value(reading_m),
            Direction::Angular(d) => self.angular[axis.index()][d].value(reading_m),
        })
    }

    /// True squareness (rad) by its name, if the machine declares it.
    pub fn squareness_rad(&self, name: &str) -> Option<f64> {
        let found = self.truth.squareness.iter().find(|s| s.name == name)?;
        Some(found.angle_rad)
    }

    /// Where the reflector is when the axes read `reading_m` (m, machine frame), without effects or noise.
    pub fn actual_point_m(&self, reading_m: [f64; 3], offset_m: [f64; 3]) -> [f64; 3] {
        self.disturbed_point_m(reading_m, offset_m, &JointErrors::default())
    }

    /// Where the machine says the reflector is: reading plus offset (m, machine frame).
    pub fn indicated_point_m(reading_m: [f64; 3], offset_m: [f64; 3]) -> [f64; 3] {
        let mut out = reading_m;
        for i in 0..3 {
            out[i] += offset_m[i];
        }
        out
    }

    /// As [`Self::actual_point_m`], with what effects and noise put on top of the error functions.
    pub fn disturbed_point_m(&self, reading_m: [f64; 3], offset_m: [f64; 3], extra: &JointErrors) -> [f64; 3] {
        let mut ram_in_bed = IDENTITY;
        for axis in &self.truth.tool_side {
            ram_in_bed = product(&ram_in_bed, &self.tool_joint(*axis, reading_m, extra));
        }
        let mut point_m = apply(&ram_in_bed, self.carried_m(offset_m));
        for axis in &self.truth.workpiece_side {
            point_m = apply(&self.table_joint(*axis, reading_m, extra), point_m);
        }
        for i in 0..3 {
            point_m[i] += extra.tip_m[i];
        }
        point_m
    }

    /// Where the turned ram holds a reflector of this offset (m, ram frame).
    fn carried_m(&self, offset_m: [f64; 3]) -> [f64; 3] {
        let RamTurn { angles_rad, about_m } = self.truth.ram_turn;
        let back = about_m.map(|v| -v);
        let about = product(&product(&translation(about_m), &rotation(angles_rad)), &translation(back));
        apply(&about, offset_m)
    }

    fn tool_joint(&self, axis: Axis, reading_m: [f64; 3], extra: &JointErrors) -> Homogeneous {
        let mut shift = self.translation_error_m(axis, reading_m, extra);
        shift[axis.index()] += reading_m[axis.index()];
        product(&translation(shift), &rotation(self.rotation_error_rad(axis, reading_m, extra)))
    }

    fn table_joint(&self, axis: Axis, reading_m: [f64; 3], extra: &JointErrors) -> Homogeneous {
        let mut travel = [0.0; 3];
        travel[axis.index()] = reading_m[axis.index()];
        let turned = product(&rotation(self.rotation_error_rad(axis, reading_m, extra)), &translation(travel));
        product(&translation(self.translation_error_m(axis, reading_m, extra)), &turned)
    }

    /// δ of one joint: error functions, squareness and extras (m, machine directions).
    fn translation_error_m(&self, axis: Axis, reading_m: [f64; 3], extra: &JointErrors) -> [f64; 3] {
        let i = axis.index();
        let mut delta = extra.linear_m[i];
        for d in 0..3 {
            delta[d] += self.linear[i][d].value(reading_m[i]);
        }
        let travelled = reading_m[i] - self.truth.stroke_m[i][0];
        for tilt in self.truth.squareness.iter().filter(|s| s.tilts == axis) {
            let sideways = cross(tilt.about.unit(), axis.unit());
            for d in 0..3 {
                delta[d] += tilt.angle_rad * sideways[d] * travelled;
            }
        }
        delta
    }

    fn rotation_error_rad(&self, axis: Axis, reading_m: [f64; 3], extra: &JointErrors) -> [f64; 3] {
        let i = axis.index();
        let mut epsilon = extra.angular_rad[i];
        for d in 0..3 {
            epsilon[d] += self.angular[i][d].value(reading_m[i]);
        }
        epsilon
    }
}

/// Which of the six errors of an axis a name means.
enum Direction {
    Linear(usize),
    Angular(usize),
}

fn parse_error_name(name: &str) -> Option<(Direction, Axis)> {
    let mut letters = name.chars();
    let (first, direction, axis, rest) = (letters.next()?, letters.next()?, letters.next()?, letters.next());
    if first != 'E' || rest.is_some() {
        return None;
    }
    let axis = *Axis::ALL.iter().find(|a| a.letter() == axis)?;
    let direction = match direction {
        'X' => Direction::Linear(0),
        'Y' => Direction::Linear(1),
        'Z' => Direction::Linear(2),
        'A' => Direction::Angular(0),
        'B' => Direction::Angular(1),
        'C' => Direction::Angular(2),
        _ => return None,
    };
    Some((direction, axis))
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
