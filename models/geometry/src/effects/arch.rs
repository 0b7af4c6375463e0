//! The arch of a guideway that bends upwards, and what rides on it: no effect by itself, but what those have in common that bend one.
//!
//! Formula, for reading r on the stroke r₀ … r₁ with middle m, all times what bends it: the guideway runs at
//! height −½κ(r − r₀)(r − r₁) + ramp·(r − m) + heave; the carriage pitches by −slope·(r − m) + tilt; it moves along the
//! axis by shift + stretch·(r − m) + lean·(z − z₀). On one bent beam (form `beam`) slope = κ, tilt = ramp (bending
//! theory) and nothing moves along; in form `free` they are separate, since columns and carriage may ride on other parts
//! than the one that bends: shift and stretch say at which height the carriage pivots, as no drawing tells, and lean is a
//! column that leans without turning what it guides.
//! Of a workpiece-side axis the table follows the guideway: the tool sinks relative to it where the guideway rises.

use super::shape::{EffectError, Reader, Shape};
use super::{Acts, Motion, ParameterSpec, State};
use crate::axis::{Axis, ErrorId};
use crate::machine::{Machine, Side};

#[derive(Debug)]
pub(super) struct Arch {
    height: ErrorId,
    turn: ErrorId,
    axis: Axis,
    stroke_m: (f64, f64),
    /// Lower end of the vertical stroke.
    foot_m: f64,
    /// Motion of the tip per rise of the guideway: −1 where the table follows it.
    rise: f64,
    /// Angle of the carriage per slope of the guideway: a climb along x turns about −y, along y about +x.
    turn_sign: f64,
    /// One bent beam carries everything: slope = curvature, tilt = ramp, and nothing moves along the axis.
    beam: bool,
}

impl Arch {
    /// Of a shape with `axis` and `form`.
    pub(super) fn of(reader: &mut Reader, machine: &Machine) -> Result<Arch, EffectError> {
        let axis = reader.axis("axis")?;
        let (about, turn_sign) = match axis {
            Axis::X => (Axis::Y, -1.0),
            Axis::Y => (Axis::X, 1.0),
            Axis::Z => return Err(reader.wrong("axis", "must be x or y: a vertical guideway does not arch upwards")),
        };
        let on_table = machine.joints.iter().any(|joint| joint.axis == axis && joint.side == Side::Workpiece);
        Ok(Arch {
            height: ErrorId::linear(Axis::Z, axis),
            turn: ErrorId::angular(about, axis),
            axis,
            stroke_m: machine.stroke_m[axis.index()],
            foot_m: machine.stroke_m[Axis::Z.index()].0,
            rise: if on_table { -1.0 } else { 1.0 },
            turn_sign,
            beam: reader.is_beam()?,
        })
    }

    /// Both forms of both level axes, each shape completed by what bends it.
    pub(super) fn shapes(completed: impl Fn(Shape) -> Shape) -> Vec<Shape> {
        let forms =
            |axis: Axis| ["beam", "free"].map(|form| Shape::new().text("axis", axis.lower()).text("form", form));
        [Axis::X, Axis::Y].into_iter().flat_map(forms).map(completed).collect()
    }

    /// Its parameters, in units of a curvature, an angle, a length and a stretch per unit of what bends it; `unit` is how much of that does what a
    /// kelvin may do.
    pub(super) fn parameters(&self, units: [&'static str; 4], unit: f64) -> Vec<ParameterSpec> {
        let [curvature, angle, length, stretch] = units;
        let mut specs = vec![
            ParameterSpec::new("curvature", curvature, 200e-6 / unit),
            ParameterSpec::new("ramp", angle, 100e-6 / unit),
            ParameterSpec::new("heave", length, 50e-6 / unit),
            ParameterSpec::new("slope", curvature, 200e-6 / unit),
            ParameterSpec::new("tilt", angle, 100e-6 / unit),
            ParameterSpec::new("shift", length, 50e-6 / unit),
            ParameterSpec::new("stretch", stretch, 50e-6 / unit),
            ParameterSpec::new("lean", stretch, 50e-6 / unit),
        ];
        specs.truncate(if self.beam { 3 } else { 8 });
        specs
    }

    /// The curvature, and where the carriage rides on another part, the slope that comes of it: without them it is a height or an angle that
    /// changes, which follows whatever goes along with the time.
    pub(super) fn essential(&self) -> &'static [usize] {
        if self.beam { &[0] } else { &[0, 3] }
    }

    /// What a unit of each parameter does, times what bends it.
    pub(super) fn motion(&self, state: &State, bent: f64, part: &mut Motion) {
        let (lower_m, upper_m) = self.stroke_m;
        let r_m = state.reading_m[self.axis.index()];
        let from_middle_m = r_m - 0.5 * (lower_m + upper_m);
        let arch = -0.5 * (r_m - lower_m) * (r_m - upper_m);
        let (height, turn) = (Acts::Error(self.height), Acts::Error(self.turn));
        let along = Acts::Error(ErrorId::linear(self.axis, self.axis));
        let (rise, turned) = (bent * self.rise, bent * self.turn_sign);
        part(0, height, rise * arch);
        part(1, height, rise * from_middle_m);
        part(2, height, rise);
        let (slope, tilt) = if self.beam { (0, 1) } else { (3, 4) };
        part(slope, turn, -turned * from_middle_m);
        part(tilt, turn, turned);
        if !self.beam {
            part(5, along, bent);
            part(6, along, bent * from_middle_m);
            part(7, Acts::Tip(self.axis), bent * (state.reading_m[Axis::Z.index()] - self.foot_m));
        }
    }
}
