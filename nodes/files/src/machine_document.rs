//! The machine file as text sees it: keys with their units, before they mean anything.
//!
//! Place in the flow: [`crate::machine`] turns it into a machine in SI and back; the model file embeds the parts
//! that carry no unit. Every unknown key is refused.

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
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) default_offset_mm: Option<[f64; 3]>,
    pub(crate) chain: ChainText,
    pub(crate) stroke_mm: ByAxis<[f64; 2]>,
    pub(crate) error_functions: ErrorFunctionsText,
    pub(crate) instrument: InstrumentDocument,
    pub(crate) squareness: Vec<SquarenessText>,
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
    pub(crate) order: OrderText,
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
        Ok(ErrorFunctionsText {
            order: order.ok_or_else(|| A::Error::missing_field("order"))?,
            default: default.ok_or_else(|| A::Error::missing_field("default"))?,
            by_error,
        })
    }
}

/// Whether the kinds are a starting point or the last word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum OrderText {
    Evidence,
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

/// What is declared of the tracer: U(L) with k = 2, as its maker states it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct InstrumentDocument {
    pub(crate) u_k2_constant_um: f64,
    pub(crate) u_k2_proportional_um_per_m: f64,
    /// True where the length reading is the distance itself, false where the dead path is unknown.
    pub(crate) absolute: bool,
}
