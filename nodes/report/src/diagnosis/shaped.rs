//! Names of effects with their shapes, in words.
//!
//! Place in the flow: titles, tables and sentences of a diagnosis.

use crate::text::{decimals, fixed, significant};
use serde_json::Value;
use std::collections::BTreeMap;

/// The name for readers, where there is one.
pub(super) fn for_readers<'a>(name: &'a str, title: &'a str) -> &'a str {
    if title.is_empty() { name } else { title }
}

/// A name with its shape: `backlash (axis y, over y, terms 1)`.
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

/// The two places in mm between which something lies, by their words, with as many decimals as tell them apart.
pub(super) fn places_mm(shape: &BTreeMap<String, Value>) -> Option<[(&'static str, String); 2]> {
    let mm = |key: &str| shape.get(key).and_then(Value::as_f64).map(|value_m| value_m * 1e3);
    let (from_mm, to_mm) = (mm("from_m")?, mm("to_m")?);
    let decimals = decimals(to_mm - from_mm, 2);
    Some([("from", fixed(from_mm, decimals)), ("to", fixed(to_mm, decimals))])
}
