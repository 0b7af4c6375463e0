//! Names of the program's own as a page writes them: quantities, parameters, formulas, groups of readings.
//!
//! Place in the flow: a [`Record`] holds the names that `diagnosis.json` and the terminal have; its page is made from a copy in
//! readers' words. Columns of the user's own table keep their names, and so do those that a sentence tells to add.

use super::record::{Detection, Record};
use super::shaped::places_mm;
use crate::sections::Axis;
use crate::text::significant;
use serde_json::Value;
use std::collections::BTreeMap;

/// The program's own names of quantities, in SI, and what they are called.
const QUANTITIES: [(&str, &str); 11] = [
    ("x_m", "X"),
    ("y_m", "Y"),
    ("z_m", "Z"),
    ("offset_x_m", "offset X"),
    ("offset_y_m", "offset Y"),
    ("offset_z_m", "offset Z"),
    ("time_s", "time"),
    ("dir_x", "direction of approach of X"),
    ("dir_y", "direction of approach of Y"),
    ("dir_z", "direction of approach of Z"),
    ("tau_s", "time constant"),
];
/// Indices of formulas and their raised-down signs.
const INDICES: [(char, char); 4] = [('i', 'ᵢ'), ('j', 'ⱼ'), ('k', 'ₖ'), ('n', 'ₙ')];

/// A quantity by its name.
pub(super) fn quantity(name: &str) -> &str {
    QUANTITIES.iter().find(|(own, _)| *own == name).map_or(name, |(_, words)| words)
}

/// A sentence with the program's own names of quantities in words.
pub(super) fn in_words(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut name = String::new();
    for character in text.chars() {
        if character.is_ascii_alphanumeric() || character == '_' {
            name.push(character);
            continue;
        }
        out.push_str(quantity(&name));
        name.clear();
        out.push(character);
    }
    out + quantity(&name)
}

/// A parameter by its name: `twist_x` as twist X, `c_1_0` as c₁₀.
pub fn parameter(name: &str) -> String {
    let words = formula(name).replace('_', " ");
    let word = |word: &str| match word {
        "x" | "y" | "z" => word.to_uppercase(),
        _ => word.to_owned(),
    };
    words.split(' ').map(word).collect::<Vec<_>>().join(" ")
}

/// A formula with its indices below the line: `sum c_ij P_i(p)` as Σ cᵢⱼ Pᵢ(p).
pub(super) fn formula(text: &str) -> String {
    let text = text.replace("sum ", "Σ ");
    let mut out = String::with_capacity(text.len());
    let mut rest = text.as_str();
    while let Some(at) = rest.find('_') {
        out.push_str(&rest[..at]);
        let after = &rest[at + 1..];
        let length = after.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(after.len());
        match lowered(&after[..length]) {
            Some(indices) => out.push_str(&indices),
            None => out.push_str(&rest[at..at + 1 + length]),
        }
        rest = &after[length..];
    }
    out + rest
}

/// Indices as lowered signs; `None` where one of them is none.
fn lowered(indices: &str) -> Option<String> {
    let sign = |c: char| match c.to_digit(10) {
        Some(digit) => char::from_u32('₀' as u32 + digit),
        None => INDICES.iter().find(|(letter, _)| *letter == c).map(|(_, sign)| *sign),
    };
    indices.chars().filter(|c| *c != '_').map(sign).collect()
}

/// Readings of a group: `dir_x +1` as those that X approached in +, `offset 0.0 140.0 -90.0 mm` with true signs.
fn group(name: &str) -> String {
    let of_axis = |axis: &str| match axis.split_once(' ') {
        Some((axis, "+0" | "0")) => format!("{} not moved", axis.to_uppercase()),
        Some((axis, "-1")) => format!("{} approached in −", axis.to_uppercase()),
        Some((axis, _)) => format!("{} approached in +", axis.to_uppercase()),
        None => name.to_owned(),
    };
    name.strip_prefix("dir_").map_or_else(|| name.replace(" -", " −").replace(".0", ""), of_axis)
}

/// A shape in words: axes in capitals, lengths in mm, times in minutes.
pub(super) fn shape(shape: &BTreeMap<String, Value>) -> BTreeMap<String, Value> {
    let scaled = |key: &str, number: f64| match (key.strip_suffix("_m"), key.strip_suffix("_s")) {
        (Some(stem), _) => Some((stem.to_owned(), format!("{} mm", significant(number * 1e3, 3)))),
        (None, Some(_)) if key == "tau_s" => Some((quantity(key).to_owned(), minutes(number))),
        (None, Some(stem)) => Some((stem.to_owned(), minutes(number))),
        _ => None,
    };
    let entry = |(key, value): (&String, &Value)| {
        let of_number = value.as_f64().and_then(|number| scaled(key, number));
        let of_text = value.as_str().map(|text| match text {
            "x" | "y" | "z" => text.to_uppercase(),
            _ => in_words(text),
        });
        let of_list = value.as_array().map(|list| list_words(key, list));
        match (of_number.or(of_list), of_text) {
            (Some((stem, text)), _) => (stem.replace('_', " "), Value::String(text)),
            (None, Some(text)) => (key.replace('_', " "), Value::String(text)),
            _ => (key.replace('_', " "), value.clone()),
        }
    };
    let places = places_mm(shape).into_iter().flatten();
    let places = places.map(|(key, mm)| (key.to_owned(), Value::String(format!("{mm} mm"))));
    shape.iter().map(entry).chain(places).collect()
}

/// A list of names, or of lengths in mm.
fn list_words(key: &str, list: &[Value]) -> (String, String) {
    let word = |value: &Value| match (value.as_f64(), key.ends_with("_m")) {
        (Some(length_m), true) => significant(length_m * 1e3, 3),
        (Some(number), false) => significant(number, 3),
        (None, _) => value.as_str().map_or_else(|| value.to_string(), str::to_owned),
    };
    let words = list.iter().map(word).collect::<Vec<_>>().join(", ");
    match key.strip_suffix("_m") {
        Some(stem) => (stem.to_owned(), format!("{words} mm")),
        None => (key.to_owned(), words),
    }
}

fn minutes(seconds: f64) -> String {
    format!("{} min", significant(seconds / 60.0, 3))
}

/// Name and shape of another explanation in words.
fn named(name: &mut String, title: &str, own: &mut BTreeMap<String, Value>) {
    *name = in_words(if title.is_empty() { name } else { title });
    *own = shape(own);
}

/// An axis of a plot.
pub(super) fn axis(axis: &Axis) -> Axis {
    Axis { label: in_words(&axis.label), unit: axis.unit.clone() }
}

fn detection(detection: &mut Detection) {
    detection.words = in_words(&detection.words);
    for own in &mut detection.groups {
        own.name = group(&own.name);
    }
}

/// The record as its page shows it.
pub(super) fn for_readers(record: &Record) -> Record {
    let mut record = record.clone();
    let change = |text: &mut String| *text = in_words(text);
    change(&mut record.verdict);
    record.not_adopted.iter_mut().for_each(change);
    for effect in &mut record.effects {
        effect.formula = formula(&effect.formula);
        effect.parameters.iter_mut().for_each(|own| own.name = parameter(&own.name));
        effect.cannot_be_told_from.iter_mut().for_each(|own| named(&mut own.name, &own.title, &mut own.shape));
        effect.averaged_with.iter_mut().for_each(|own| named(&mut own.name, &own.title, &mut own.shape));
        effect.predicts.left_out.iter_mut().for_each(|left_out| change(&mut left_out.by));
    }
    for aside in &mut record.set_aside {
        aside.title = in_words(&aside.title);
        aside.shape = shape(&aside.shape);
    }
    record.steps.iter_mut().chain(&mut record.notes).for_each(change);
    record.ladder.iter_mut().filter_map(|rung| rung.added.as_mut()).for_each(change);
    record.considered.iter_mut().for_each(|candidate| change(&mut candidate.name));
    record.alternatives.iter_mut().flat_map(|set| &mut set.effects).for_each(change);
    record.not_identifiable.iter_mut().for_each(|own| named(&mut own.name, &own.title, &mut own.shape));
    for own in record.untestable.iter_mut().filter(|own| !own.title.is_empty()) {
        own.name = in_words(&own.title);
    }
    detection(&mut record.detection.before);
    detection(&mut record.detection.after);
    record
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A page spoke of `smooth in y_m and q2_deg` and of `c_1_0`.
    #[test]
    fn regress_names_of_the_program_are_words_and_columns_of_the_user_keep_theirs() {
        assert_eq!(in_words("smooth in y_m and q2_deg, by time_s"), "smooth in Y and q2_deg, by time");
        assert_eq!(["c_1_0", "twist_x", "sine", "height_2_1"].map(parameter), ["c₁₀", "twist X", "sine", "height₂₁"]);
        assert_eq!(formula("e = sum c_ij P_i(p) P_j(q), b_x"), "e = Σ cᵢⱼ Pᵢ(p) Pⱼ(q), b_x");
        let own = serde_json::from_str(
            r#"{"axis": "x", "tau_s": 1984.0, "period_m": 0.02, "terms": 2, "at_m": [0.12, 0.0], "of": ["a", "b"]}"#,
        )
        .unwrap();
        let words =
            r#"{"at":"120, 0 mm","axis":"X","of":"a, b","period":"20.0 mm","terms":2,"time constant":"33.1 min"}"#;
        assert_eq!(serde_json::to_string(&shape(&own)).unwrap(), words);
        let step = serde_json::from_str(r#"{"axis": "y", "from_m": 0.31241, "to_m": 0.31313}"#).unwrap();
        assert_eq!(
            serde_json::to_string(&shape(&step)).unwrap(),
            r#"{"axis":"Y","from":"312.41 mm","to":"313.13 mm"}"#
        );
        assert_eq!(
            ["dir_x +1", "dir_y -1", "dir_z +0", "offset 0.0 140.0 -90.0 mm"].map(group),
            ["X approached in +", "Y approached in −", "Z not moved", "offset 0 140 −90 mm"]
        );
    }
}
