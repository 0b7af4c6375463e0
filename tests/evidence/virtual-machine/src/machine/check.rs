//! Checks of a machine's data before it is built: every refusal names its key.
//!
//! Place in the flow: [`super::VirtualMachine::new`] calls it; nothing else may skip it.

use super::{Axis, MachineTruth, parse_error_name};
use crate::error::{SimulationError, require_finite};

/// Refuses a machine that cannot exist.
pub(super) fn check(truth: &MachineTruth) -> Result<(), SimulationError> {
    for (axis, stroke) in Axis::ALL.iter().zip(truth.stroke_m) {
        let key = format!("stroke_m.{axis:?}");
        require_finite(&key, &stroke)?;
        if stroke[0] >= stroke[1] {
            return Err(SimulationError::new(
                key,
                format!("the lower end {} is not below {}", stroke[0], stroke[1]),
                "give [lower, upper] in metres",
            ));
        }
    }
    check_chain(truth)?;
    for (name, terms) in &truth.errors {
        if parse_error_name(name).is_none() {
            return Err(unknown_error(name));
        }
        for (place, term) in terms.iter().enumerate() {
            term.check().map_err(|e| e.under(&format!("errors.{name}[{place}]")))?;
        }
    }
    require_finite("ram_turn.angles_rad", &truth.ram_turn.angles_rad)?;
    require_finite("ram_turn.about_m", &truth.ram_turn.about_m)?;
    check_squareness(truth)
}

pub(super) fn unknown_error(name: &str) -> SimulationError {
    SimulationError::new(
        format!("errors.{name}"),
        "no such error function",
        "use E, then one of X Y Z A B C, then the axis X Y Z, as in EYX",
    )
}

fn check_chain(truth: &MachineTruth) -> Result<(), SimulationError> {
    for axis in Axis::ALL {
        let times = truth.tool_side.iter().chain(&truth.workpiece_side).filter(|a| **a == axis).count();
        if times != 1 {
            return Err(SimulationError::new(
                "tool_side, workpiece_side",
                format!("axis {axis:?} stands in the chain {times} times"),
                "list each of X, Y, Z exactly once on one of the two sides",
            ));
        }
    }
    Ok(())
}

fn check_squareness(truth: &MachineTruth) -> Result<(), SimulationError> {
    for (place, tilt) in truth.squareness.iter().enumerate() {
        let key = format!("squareness[{place}]");
        require_finite(&format!("{key}.angle_rad"), &[tilt.angle_rad])?;
        if tilt.name.is_empty() {
            return Err(SimulationError::new(format!("{key}.name"), "empty", "name it, for example C0Y"));
        }
        if tilt.tilts == tilt.about {
            return Err(SimulationError::new(
                key,
                format!("{} tilts {:?} about itself", tilt.name, tilt.tilts),
                "choose two different axes",
            ));
        }
        let before = &truth.squareness[..place];
        if before.iter().any(|s| s.about == tilt.about || s.name == tilt.name) {
            return Err(SimulationError::new(
                key,
                format!("{} repeats a name or an axis it is about", tilt.name),
                "give at most one squareness about each of X, Y, Z",
            ));
        }
    }
    Ok(())
}
