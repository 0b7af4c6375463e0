//! The machine description that goes with a simulated machine: what its maker would write into the machine file.
//!
//! Place in the flow: [`crate::trial`] gives it to identification and diagnosis beside the campaign. It holds the
//! chain, the strokes and the kind of error functions, and nothing of the truth's errors. SI.

use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::{Joint, Machine, Side, Squareness};
use abbe_geometry::rotation::RotationForm;
use abbe_geometry::{Axis, ErrorId};
use abbe_virtual_machine::MachineTruth;

use crate::error::TrialError;

/// Describes a simulated machine; errors named in `held_zero` are not fitted.
///
/// # Errors
/// The truth has no three axes and squareness, or a name is no error.
pub fn describe(
    truth: &MachineTruth,
    kind: FunctionKind,
    held_zero: &[&str],
    repeatability_m: [f64; 3],
) -> Result<Machine, TrialError> {
    let joint = |side| move |axis: &abbe_virtual_machine::Axis| Joint { axis: Axis::ALL[axis.index()], side };
    // The truth lists both sides from the bed outwards, the description from the workpiece through the bed to the tool.
    let table = truth.workpiece_side.iter().rev().map(joint(Side::Workpiece));
    let joints: Vec<Joint> = table.chain(truth.tool_side.iter().map(joint(Side::Tool))).collect();
    let squareness: Vec<Squareness> = truth
        .squareness
        .iter()
        .map(|s| Squareness {
            name: s.name.clone(),
            tilts: Axis::ALL[s.tilts.index()],
            about: Axis::ALL[s.about.index()],
        })
        .collect();
    let wrong = |what: &str| TrialError::Description(format!("{} has no three {what}", truth.name));
    let mut kinds = [Some(kind); ErrorId::COUNT];
    for name in held_zero {
        let id = ErrorId::from_name(name).ok_or_else(|| TrialError::Description(format!("{name} is no error")))?;
        kinds[id.index()] = None;
    }
    Ok(Machine {
        name: truth.name.clone(),
        frame_id: "machine".to_owned(),
        joints: joints.try_into().map_err(|_| wrong("axes"))?,
        stroke_m: truth.stroke_m.map(|[lower, upper]| (lower, upper)),
        squareness: squareness.try_into().map_err(|_| wrong("squareness errors"))?,
        rotation: RotationForm::Exact,
        kinds,
        repeatability_m,
        u_ram_turn_rad: [abbe_geometry::machine::USUAL_RAM_TURN_RAD; 3],
        default_offset_m: None,
    })
}
