//! The machine file as text sees it: keys with their units, before they mean anything.
//!
//! Place in the flow: [`crate::machine`] turns it into a machine in SI and back; the model file embeds the parts
//! that carry no unit. Every unknown key is refused.

use crate::identity::Identity;
use crate::units::{micrometres_from_m, millimetres_from_m};
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::{Machine, Side, Squareness};
use abbe_geometry::rotation::RotationForm;
use abbe_geometry::{Axis, ErrorId};
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::fmt;

/// A machine file. Tables come last, as TOML wants them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MachineDocument {
    pub(crate) name: String,
    pub(crate) frame_id: String,
    pub(crate) sign_convention: String,
    pub(crate) rotation: RotationText,
    /// Standard uncertainty (k = 1) of repositioning.
    pub(crate) repeatability_um: [f64; 3],
    /// Standard uncertainty (k = 1) of the turn of the ram about X, Y, Z before anything was measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) u_k1_ram_turn_urad: Option<[f64; 3]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) default_offset_mm: Option<[f64; 3]>,
    pub(crate) chain: ChainText,
    pub(crate) stroke_mm: ByAxis<[f64; 2]>,
    pub(crate) error_functions: ErrorFunctionsText,
    pub(crate) instrument: InstrumentDocument,
    pub(crate) squareness: Vec<SquarenessText>,
    /// For the head of reports.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) identity: Option<Identity>,
}

/// The same machine in SI, without the instrument: what the model file embeds. Millimetres cannot hold every metre
/// exactly, and a model must come back bit for bit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MachineRecord {
    pub(crate) name: String,
    pub(crate) frame_id: String,
    pub(crate) sign_convention: String,
    pub(crate) rotation: RotationText,
    /// Standard uncertainty (k = 1) of repositioning.
    pub(crate) repeatability_m: [f64; 3],
    /// Standard uncertainty (k = 1) of the turn of the ram; none in files of earlier software, and where nobody stated it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) u_ram_turn_rad: Option<[f64; 3]>,
    pub(crate) default_offset_m: Option<[f64; 3]>,
    pub(crate) chain: ChainText,
    pub(crate) stroke_m: ByAxis<[f64; 2]>,
    pub(crate) squareness: Vec<SquarenessText>,
    pub(crate) error_functions: ErrorFunctionsText,
}

impl MachineDocument {
    /// What a file says in SI.
    pub(crate) fn into_record(self) -> MachineRecord {
        let metres = |ends: [f64; 2]| ends.map(|mm| mm / 1e3);
        MachineRecord {
            name: self.name,
            frame_id: self.frame_id,
            sign_convention: self.sign_convention,
            rotation: self.rotation,
            repeatability_m: self.repeatability_um.map(|um| um / 1e6),
            u_ram_turn_rad: self.u_k1_ram_turn_urad.map(|turn| turn.map(|urad| urad / 1e6)),
            default_offset_m: self.default_offset_mm.map(|offset| offset.map(|mm| mm / 1e3)),
            chain: self.chain,
            stroke_m: ByAxis::from_array(self.stroke_mm.into_array().map(metres)),
            squareness: self.squareness,
            error_functions: self.error_functions,
        }
    }

    /// A file that says so.
    pub(crate) fn new(record: MachineRecord, instrument: InstrumentDocument) -> MachineDocument {
        let millimetres = |ends: [f64; 2]| ends.map(millimetres_from_m);
        MachineDocument {
            name: record.name,
            frame_id: record.frame_id,
            sign_convention: record.sign_convention,
            rotation: record.rotation,
            repeatability_um: record.repeatability_m.map(micrometres_from_m),
            u_k1_ram_turn_urad: record.u_ram_turn_rad.map(|turn| turn.map(micrometres_from_m)),
            default_offset_mm: record.default_offset_m.map(|offset| offset.map(millimetres_from_m)),
            chain: record.chain,
            stroke_mm: ByAxis::from_array(record.stroke_m.into_array().map(millimetres)),
            squareness: record.squareness,
            error_functions: record.error_functions,
            instrument,
            identity: None,
        }
    }

    pub(crate) fn machine_order(&self) -> OrderChoice {
        self.error_functions.order
    }
}

/// One value for each axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)] // the keys of the file
pub(crate) struct ByAxis<T> {
    pub(crate) X: T,
    pub(crate) Y: T,
    pub(crate) Z: T,
}

impl<T> ByAxis<T> {
    pub(crate) fn from_array([x, y, z]: [T; 3]) -> ByAxis<T> {
        ByAxis { X: x, Y: y, Z: z }
    }

    pub(crate) fn into_array(self) -> [T; 3] {
        [self.X, self.Y, self.Z]
    }
}

/// Form of the rotations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RotationText {
    Exact,
    SmallAngle,
}

/// Axes on either side, each list from the bed outwards.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ChainText {
    pub(crate) workpiece_side: Vec<AxisText>,
    pub(crate) tool_side: Vec<AxisText>,
}

/// Letter of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum AxisText {
    X,
    Y,
    Z,
}

/// One squareness error.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SquarenessText {
    pub(crate) name: String,
    pub(crate) tilts: AxisText,
    pub(crate) about: AxisText,
}

/// Kinds of the error functions: a default, and what differs from it by ISO 230-1 name.
///
/// Unknown keys land in `by_error`, where a name that is no error is refused.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct ErrorFunctionsText {
    pub(crate) order: OrderChoice,
    pub(crate) default: KindText,
    #[serde(flatten)]
    pub(crate) by_error: BTreeMap<String, KindText>,
}

/// By hand, because a derived flattened map forgets on which line a value stands.
impl<'de> Deserialize<'de> for ErrorFunctionsText {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<ErrorFunctionsText, D::Error> {
        deserializer.deserialize_map(ErrorFunctionsVisitor)
    }
}

struct ErrorFunctionsVisitor;

impl<'de> Visitor<'de> for ErrorFunctionsVisitor {
    type Value = ErrorFunctionsText;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a table with order, default and error names")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<ErrorFunctionsText, A::Error> {
        let (mut order, mut default, mut by_error) = (None, None, BTreeMap::new());
        while let Some(key) = map.next_key::<String>()? {
            match key.as_str() {
                "order" => order = Some(map.next_value()?),
                "default" => default = Some(map.next_value()?),
                _ => {
                    let kind = map.next_value()?;
                    by_error.insert(key, kind);
                }
            }
        }
        let missing = |field: &'static str| match by_error.keys().find(|key| ErrorId::from_name(key).is_none()) {
            // Likelier misspelt than missing.
            Some(other) => {
                A::Error::custom(format!("missing field `{field}`; `{other}` is neither that nor the name of an error"))
            }
            None => A::Error::missing_field(field),
        };
        Ok(ErrorFunctionsText {
            order: order.ok_or_else(|| missing("order"))?,
            default: default.ok_or_else(|| missing("default"))?,
            by_error,
        })
    }
}

/// Whether the kinds of error functions are a starting point or the last word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OrderChoice {
    /// The data decide how much of each kind is used.
    Evidence,
    /// As declared.
    Fixed,
}

/// Kind of one error function.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub(crate) enum KindText {
    Polynomial { degree: usize },
    Nodes { count: usize },
    Bspline { intervals: usize },
    Zero {},
}

/// What is declared of the tracer: U(L) with k = 2, as its maker states it, and the part of it that all lengths have in common.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct InstrumentDocument {
    pub(crate) u_k2_constant_um: f64,
    pub(crate) u_k2_proportional_um_per_m: f64,
    /// Of a scale that all lengths have in common; absent where nothing is known of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) u_k2_common_um_per_m: Option<f64>,
    /// True where the length reading is the distance itself, false where the dead path is unknown.
    pub(crate) absolute: bool,
}

impl From<&Machine> for ChainText {
    fn from(machine: &Machine) -> ChainText {
        let on = |wanted| {
            let joints = machine.joints.iter().filter(move |joint| joint.side == wanted);
            joints.map(|joint| AxisText::from(joint.axis))
        };
        ChainText { workpiece_side: on(Side::Workpiece).rev().collect(), tool_side: on(Side::Tool).collect() }
    }
}

impl ErrorFunctionsText {
    /// The commonest kind becomes the default, so that the text stays short; ties go to the first in error order.
    pub(crate) fn new(machine: &Machine, order: OrderChoice) -> ErrorFunctionsText {
        let kinds = machine.kinds.map(KindText::from);
        let count = |kind: &KindText| kinds.iter().filter(|other| *other == kind).count();
        let default = kinds.iter().rev().max_by_key(|kind| count(kind)).copied().unwrap_or(KindText::Zero {});
        let named = ErrorId::all().map(|id| (id.name(), kinds[id.index()]));
        ErrorFunctionsText { order, default, by_error: named.filter(|(_, kind)| *kind != default).collect() }
    }
}

impl From<AxisText> for Axis {
    fn from(text: AxisText) -> Axis {
        match text {
            AxisText::X => Axis::X,
            AxisText::Y => Axis::Y,
            AxisText::Z => Axis::Z,
        }
    }
}

impl From<Axis> for AxisText {
    fn from(axis: Axis) -> AxisText {
        match axis {
            Axis::X => AxisText::X,
            Axis::Y => AxisText::Y,
            Axis::Z => AxisText::Z,
        }
    }
}

impl From<&SquarenessText> for Squareness {
    fn from(text: &SquarenessText) -> Squareness {
        Squareness { name: text.name.clone(), tilts: text.tilts.into(), about: text.about.into() }
    }
}

impl From<&Squareness> for SquarenessText {
    fn from(entry: &Squareness) -> SquarenessText {
        SquarenessText { name: entry.name.clone(), tilts: entry.tilts.into(), about: entry.about.into() }
    }
}

impl From<RotationText> for RotationForm {
    fn from(text: RotationText) -> RotationForm {
        match text {
            RotationText::Exact => RotationForm::Exact,
            RotationText::SmallAngle => RotationForm::SmallAngle,
        }
    }
}

impl From<RotationForm> for RotationText {
    fn from(form: RotationForm) -> RotationText {
        match form {
            RotationForm::Exact => RotationText::Exact,
            RotationForm::SmallAngle => RotationText::SmallAngle,
        }
    }
}

impl From<KindText> for Option<FunctionKind> {
    fn from(text: KindText) -> Option<FunctionKind> {
        match text {
            KindText::Polynomial { degree } => Some(FunctionKind::Polynomial { degree }),
            KindText::Nodes { count } => Some(FunctionKind::Nodes { count }),
            KindText::Bspline { intervals } => Some(FunctionKind::BSpline { intervals }),
            KindText::Zero {} => None,
        }
    }
}

impl From<Option<FunctionKind>> for KindText {
    fn from(kind: Option<FunctionKind>) -> KindText {
        match kind {
            Some(FunctionKind::Polynomial { degree }) => KindText::Polynomial { degree },
            Some(FunctionKind::Nodes { count }) => KindText::Nodes { count },
            Some(FunctionKind::BSpline { intervals }) => KindText::Bspline { intervals },
            None => KindText::Zero {},
        }
    }
}
