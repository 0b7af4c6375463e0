//! Scales and squareness of the axes that positions span: what is named before any smooth form.
//!
//! Place in the flow: candidates of the study of vectors on a plane or in the volume of a machine. Error = actual − indicated, first order:
//! scale of X (the straight part of E_XX) s moves a point by s·x along X; squareness such as C0Y, which tilts the axis
//! t about the axis a, by θ·(a × t)·t. Half of the latter is a turn of the whole, which belongs to the unknown pose;
//! columns are without that half, so that the parameter is the angle and acts on both components alike. SI.

use crate::explanation::Explanation;
use crate::study::candidate::{Candidate, Goes, ModelTerm};
use abbe_geometry::effects::{ParameterSpec, Shape};
use abbe_geometry::machine::{Machine, Squareness};
use abbe_geometry::{Axis, Vector3};
use faer::Mat;

/// Largest scale error and squareness believed: a millimetre a metre.
const PLAUSIBLE: f64 = 1e-3;

/// A named deformation that is the same everywhere.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Named {
    /// Scale of an axis.
    Scale(Axis),
    /// Scale of the first less that of the second: all that is left where the plate's own scale is unknown.
    ScaleDifference(Axis, Axis),
    /// An angle between two axes.
    Square(Squareness),
}

impl Named {
    /// What these axes support.
    pub(super) fn all(axes: &[Axis], machine: Option<&Machine>, is_scale_unknown: bool) -> Vec<Named> {
        let mut all: Vec<Named> = match axes {
            [a, b] if is_scale_unknown => vec![Named::ScaleDifference(*a, *b)],
            _ => axes.iter().map(|axis| Named::Scale(*axis)).collect(),
        };
        let is_seen = |angle: &Squareness| axes.contains(&angle.tilts) && axes.contains(&across(angle));
        all.extend(squareness(machine).into_iter().filter(is_seen).map(Named::Square));
        all
    }

    /// Motion per unit of the parameter of a point with this arm about the middle of its pose (m).
    pub(super) fn motion_m(&self, arm_m: &Vector3<f64>) -> Vector3<f64> {
        let along = |axis: Axis| axis.direction() * arm_m[axis.index()];
        match self {
            Named::Scale(axis) => along(*axis),
            Named::ScaleDifference(a, b) => (along(*a) - along(*b)) * 0.5,
            Named::Square(angle) => {
                let about = angle.about.direction();
                about.cross(&angle.tilts.direction()) * arm_m[angle.tilts.index()] - about.cross(arm_m) * 0.5
            }
        }
    }

    pub(super) fn candidate(&self) -> Candidate {
        let (name, formula, parameter, unit, decided_by) = match self {
            Named::Scale(axis) => (
                format!("scale of {0} (E{0}{0}, straight part)", axis.letter()),
                format!("e_{0} = s {0}", axis.lower()),
                format!("scale_{}", axis.lower()),
                "m/m",
                format!("measure a calibrated length along {}", axis.letter()),
            ),
            Named::ScaleDifference(a, b) => (
                format!("scale of {0} less that of {1} (E{0}{0} and E{1}{1}, straight parts)", a.letter(), b.letter()),
                format!("e_{0} = s/2 {0}, e_{1} = -s/2 {1}", a.lower(), b.lower()),
                format!("scale_{}_less_{}", a.lower(), b.lower()),
                "m/m",
                "turn the plate by 90 degrees in its plane".to_owned(),
            ),
            Named::Square(angle) => (
                format!("squareness {} of {} to {}", angle.name, angle.tilts.letter(), across(angle).letter()),
                format!("e_{} = {}{} {}", across(angle).lower(), sign(angle), angle.name, angle.tilts.lower()),
                angle.name.clone(),
                "rad",
                format!(
                    "measure a square, or a plate also turned by 90 degrees, along {} and {}",
                    across(angle).letter(),
                    angle.tilts.letter()
                ),
            ),
        };
        Candidate {
            family: name.clone(),
            name,
            formula,
            kind: Explanation::Attributed,
            covariates: Vec::new(),
            parameters: vec![ParameterSpec::new(parameter, unit, PLAUSIBLE)],
            decided_by,
            essential: Vec::new(),
            stands_apart: false,
            goes: Goes::First,
        }
    }

    /// As an effect of a machine model; `readings_m` are the smallest and largest reading of each axis.
    pub(super) fn term(&self, readings_m: impl Fn(Axis) -> (f64, f64)) -> Result<ModelTerm, String> {
        let (effect, shape, values) = match self {
            Named::Scale(axis) => {
                let (low_m, high_m) = readings_m(*axis);
                let shape = Shape::new().text("axis", axis.lower()).number("terms", 2.0);
                let shape = shape.number("low_m", low_m).number("high_m", high_m);
                ("axis_term", shape, vec![0.0, 0.5 * (high_m - low_m)])
            }
            Named::Square(angle) => {
                let (low, high) = readings_m(angle.tilts);
                let shape = Shape::new().text("acts", across(angle).lower()).text("p", position(angle.tilts));
                let shape = shape.number("p_low", low).number("p_high", high).number("degree", 1.0);
                let half_m = 0.5 * (high - low) * if sign(angle).is_empty() { 1.0 } else { -1.0 };
                ("empirical", shape.number("whole", 1.0), vec![half_m])
            }
            Named::ScaleDifference(..) => {
                return Err("the plate's own scale is unknown, so that neither axis can be corrected".to_owned());
            }
        };
        let map = Mat::from_fn(values.len(), 1, |i, _| values[i]);
        Ok(ModelTerm { effect, shape, map, table: None })
    }
}

/// What positions along these axes do not tell, with what would.
pub(super) fn unseen(axes: &[Axis], machine: Option<&Machine>) -> Vec<(String, String)> {
    let letters: String = axes.iter().map(|axis| axis.letter()).collect();
    let mut all: Vec<(String, String)> = Vec::new();
    for axis in Axis::ALL.into_iter().filter(|axis| !axes.contains(axis)) {
        let name = format!("scale of {0} (E{0}{0}, straight part)", axis.letter());
        all.push((name, format!("positions that differ in {}: all lie along {letters}", axis.letter())));
    }
    for angle in squareness(machine) {
        let pair = [angle.tilts, across(&angle)];
        if pair.iter().any(|axis| !axes.contains(axis)) {
            let name = format!("squareness {} of {} to {}", angle.name, pair[0].letter(), pair[1].letter());
            all.push((name, format!("a plate along {} and {}", pair[1].letter(), pair[0].letter())));
        }
    }
    all
}

/// The axis towards which a squareness moves the tip.
fn across(angle: &Squareness) -> Axis {
    let is_third = |axis: &Axis| *axis != angle.tilts && *axis != angle.about;
    Axis::ALL.into_iter().find(is_third).unwrap_or(angle.about)
}

/// Sign of that motion, in words.
fn sign(angle: &Squareness) -> &'static str {
    let along = angle.about.direction().cross(&angle.tilts.direction());
    if along[across(angle).index()] < 0.0 { "-" } else { "" }
}

fn position(axis: Axis) -> String {
    format!("{}_m", axis.lower())
}

/// The squareness angles of the machine, or of a usual one.
fn squareness(machine: Option<&Machine>) -> Vec<Squareness> {
    let usual = |(name, tilts, about): (&str, Axis, Axis)| Squareness { name: name.to_owned(), tilts, about };
    let all = [("C0Y", Axis::Y, Axis::Z), ("B0Z", Axis::Z, Axis::Y), ("A0Z", Axis::Z, Axis::X)];
    machine.map_or_else(|| all.map(usual).to_vec(), |machine| machine.squareness.to_vec())
}
