//! A machine as data: which axes hang where, strokes, squareness, kinds of error functions.
//!
//! Place in the flow: read from a file of `launch-config/machines` (by `nodes/files`), used by identification and
//! stored inside every model. SI; error = actual − indicated, of the tool relative to the workpiece.

use crate::axis::{Axis, ErrorId};
use crate::error_function::{Basis, BasisError, Closure, FunctionKind};
use crate::rotation::RotationForm;
use thiserror::Error;

/// Smallest and largest uncertainty of the turn of the ram that is believed (rad): a nanoradian is nothing, and beyond a
/// twentieth of a radian, three degrees, small angles end.
const RAM_TURN_RAD: (f64, f64) = (1e-9, 0.05);

/// Where an axis stands in the chain from the workpiece through the bed to the tool.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Carries the tool: what hangs on it turns about a pivot that travels with the axis.
    Tool,
    /// Carries the workpiece (moving table): the tool, seen from the table, turns about the table's zero.
    Workpiece,
}

/// One axis in the chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Joint {
    /// Which axis.
    pub axis: Axis,
    /// What it carries.
    pub side: Side,
}

/// Squareness error: the motion of `tilts` is turned by a constant angle about `about`.
#[derive(Debug, Clone, PartialEq)]
pub struct Squareness {
    /// ISO 230-1 name, such as `C0Y`.
    pub name: String,
    /// Axis whose direction of motion is turned.
    pub tilts: Axis,
    /// Axis about which it is turned, right-handed.
    pub about: Axis,
}

impl Squareness {
    /// Axis along which the turn moves the tip: that which is neither.
    pub fn moves(&self) -> Axis {
        let is_third = |axis: &Axis| *axis != self.tilts && *axis != self.about;
        Axis::ALL.into_iter().find(is_third).unwrap_or(self.tilts)
    }
}

/// Standard uncertainty (rad, k = 1) with which the turn of the ram is known where nothing was measured and nobody says
/// better: 0.06 mm in 300 mm, three times what acceptance tests of machine tools allow between a spindle's axis and the
/// motion that carries it (ISO 10791-1, 0.02 mm in 300 mm), since nobody squares the roll of a ram, or an adapter on it, as
/// carefully as a spindle. It matters only for offsets that the campaign does not tell of: three offsets determine the turn
/// a hundred times better.
pub const USUAL_RAM_TURN_RAD: f64 = 200e-6;

/// The machine as its maker describes it: everything about it that is not measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Machine {
    /// Name; a model of another machine is refused by it.
    pub name: String,
    /// Name of the machine frame on the wire (REP-103).
    pub frame_id: String,
    /// Axes in order from the workpiece through the bed to the tool.
    pub joints: [Joint; 3],
    /// Lower and upper end of travel of X, Y, Z (m).
    pub stroke_m: [(f64, f64); 3],
    /// The three squareness errors.
    pub squareness: [Squareness; 3],
    /// Exact rotations or the small-angle form.
    pub rotation: RotationForm,
    /// Kind of each error function in the order of [`ErrorId::index`]; `None` holds the error at zero.
    pub kinds: [Option<FunctionKind>; ErrorId::COUNT],
    /// Standard uncertainty (k = 1) of repositioning, X, Y, Z (m).
    pub repeatability_m: [f64; 3],
    /// Standard uncertainty (k = 1) of the turn of the ram about X, Y, Z before anything was measured (rad).
    pub u_ram_turn_rad: [f64; 3],
    /// Offset of tip or reflector where a file has no offset columns (m, ram frame).
    pub default_offset_m: Option<[f64; 3]>,
}

/// What is wrong with a machine description.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum MachineError {
    /// An axis is listed twice or not at all.
    #[error("the chain must hold each of X, Y and Z once, but lists {0}; correct workpiece_side and tool_side")]
    Chain(String),
    /// A squareness makes no sense.
    #[error("squareness {name}: {problem}")]
    Squareness {
        /// Name of the entry.
        name: String,
        /// What is wrong and what to do.
        problem: String,
    },
    /// An error function or stroke makes no sense.
    #[error("error {name}: {source}")]
    Basis {
        /// ISO 230-1 name.
        name: String,
        /// What is wrong.
        source: BasisError,
    },
    /// A figure is not a positive number.
    #[error("{key} must be a finite number of 0 or more, but is {value}")]
    Figure {
        /// Name of the figure.
        key: &'static str,
        /// Its value, SI.
        value: f64,
    },
    /// The turn of the ram is declared to be known in a way that nothing is.
    #[error(
        "the uncertainty of the turn of the ram is {} µrad, but must lie between {} and {} µrad; 200 µrad suits a ram that \
         nobody aligned, 1 µrad one whose orientation was calibrated", .value_rad * 1e6, RAM_TURN_RAD.0 * 1e6, RAM_TURN_RAD.1 * 1e6
    )]
    RamTurn {
        /// The figure (rad).
        value_rad: f64,
    },
}

impl Machine {
    /// Checks that the chain, squareness and strokes describe a machine.
    pub fn validate(&self) -> Result<(), MachineError> {
        let listed: String = self.joints.iter().map(|joint| joint.axis.letter()).collect();
        if Axis::ALL.iter().any(|axis| !listed.contains(axis.letter())) {
            return Err(MachineError::Chain(listed));
        }
        let first_tool = self.joints.iter().position(|j| j.side == Side::Tool).unwrap_or(3);
        if self.joints[first_tool..].iter().any(|j| j.side == Side::Workpiece) {
            return Err(MachineError::Chain(format!("{listed} with a workpiece axis beyond a tool axis")));
        }
        self.validate_squareness()?;
        for value in self.repeatability_m {
            if !(value.is_finite() && value >= 0.0) {
                return Err(MachineError::Figure { key: "repeatability", value });
            }
        }
        for value_rad in self.u_ram_turn_rad {
            if !(RAM_TURN_RAD.0..=RAM_TURN_RAD.1).contains(&value_rad) {
                return Err(MachineError::RamTurn { value_rad });
            }
        }
        ErrorId::all().try_for_each(|id| self.basis(id).map(|_| ()))
    }

    /// Basis of an error function, `None` where the error is held at zero.
    pub fn basis(&self, id: ErrorId) -> Result<Option<Basis>, MachineError> {
        let closure = if id.is_straightness() { Closure::BothEnds } else { Closure::Origin };
        let (lower_m, upper_m) = self.stroke_m[id.axis().index()];
        let build = |kind| Basis::new(kind, closure, lower_m, upper_m);
        self.kinds[id.index()].map(build).transpose().map_err(|source| MachineError::Basis { name: id.name(), source })
    }

    /// Edge lengths of the working volume (m).
    pub fn travel_m(&self) -> [f64; 3] {
        self.stroke_m.map(|(lower, upper)| upper - lower)
    }

    fn validate_squareness(&self) -> Result<(), MachineError> {
        for (k, entry) in self.squareness.iter().enumerate() {
            let wrong = |problem: String| Err(MachineError::Squareness { name: entry.name.clone(), problem });
            if entry.tilts == entry.about {
                return wrong("an axis cannot be tilted about itself; name another axis in about".to_owned());
            }
            for other in &self.squareness[..k] {
                if other.about == entry.about {
                    let letter = entry.about.letter();
                    return wrong(format!(
                        "{} already turns about {letter}; the three must turn about X, Y and Z",
                        other.name
                    ));
                }
            }
        }
        Ok(())
    }
}
