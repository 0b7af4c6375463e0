//! Names of effects with their shapes, in words.
//!
//! Place in the flow: titles, tables and sentences of a diagnosis.

use crate::text::significant;
use serde_json::Value;
use std::collections::BTreeMap;

/// A name with its shape: `reversal (axis y, over y, terms 1)`.
pub(super) fn shaped(name: &str, shape: &BTreeMap<String, Value>) -> String {
    if shape.is_empty() { name.to_owned() } else { format!("{name} ({})", entries(shape)) }
}

pub(super) fn entries(shape: &BTreeMap<String, Value>) -> String {
    let entry = |(key, value): (&String, &Value)| match value {
        Value::String(text) => format!("{key} {text}"),
        Value::Number(number) => match number.as_f64() {
            Some(number) if number.fract() == 0.0 => format!("{key} {number:.0}"),
            Some(number) => format!("{key} {}", significant(number, 4)),
            None => format!("{key} {number}"),
        },
        other => format!("{key} {other}"),
    };
    shape.iter().map(entry).collect::<Vec<_>>().join(", ")
}
