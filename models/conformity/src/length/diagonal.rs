//! Whether the lines of a length test are the diagonals that the standard asks for.
//!
//! Place in the flow: part of the departures of [`super::evaluate()`]. ISO 10360-2:2009 asks for four space diagonals among the seven
//! lines of E0; the other three are parallel to the axes unless user and manufacturer agree on others, so nothing is asked of them.
//! With a tool offset it asks for the two diagonals of one plane. A line that is measured from both its ends is one line. A diagonal is told by its name, the signs of its direction along
//! X, Y and Z as in [`super::e0_lines`], or by its travel, which is the root sum of squares of the travels of lines X, Y and Z.

use super::LengthTest;
use super::summary::LineSummary;
use crate::departure::Departure;
use std::collections::{BTreeMap, BTreeSet};

/// Space diagonals of E0.
const BODY: usize = 4;
/// Share by which the travel of a diagonal may differ from that of the axes: alignment by hand, a stylus.
const TRAVEL: f64 = 0.02;

/// What the lines lack.
pub(super) fn departures(test: &LengthTest, lines: &[LineSummary]) -> Vec<Departure> {
    match test.tool_offset_m == 0.0 {
        true => of_body(test, lines),
        false => of_plane(lines),
    }
}

/// Lines that are an earlier one from the other end, each with that one.
pub(super) fn doubles(lines: &[LineSummary]) -> Vec<(&str, &str)> {
    let mut known: BTreeMap<String, &str> = BTreeMap::new();
    let mut found = Vec::new();
    for line in lines {
        let Some(signs) = signs(&line.line) else { continue };
        match known.get(&signs) {
            Some(twin) => found.push((line.line.as_str(), *twin)),
            None => drop(known.insert(signs, &line.line)),
        }
    }
    found
}

fn of_body(test: &LengthTest, lines: &[LineSummary]) -> Vec<Departure> {
    let diagonal_m = body_travel_m(test);
    let mut found = Vec::new();
    let mut diagonals = BTreeSet::new();
    for line in lines {
        let is_near = line.travel_m.zip(diagonal_m).map(|(own_m, whole_m)| (own_m / whole_m - 1.0).abs() <= TRAVEL);
        match (signs(&line.line).filter(|signs| !signs.contains('0')), is_near) {
            (Some(_), Some(false)) => {
                let (own_mm, whole_mm) = (line.travel_m.unwrap_or(0.0) * 1e3, diagonal_m.unwrap_or(0.0) * 1e3);
                let text = format!(
                    "it is named a space diagonal, but its travel of {own_mm:.1} mm is not the {whole_mm:.1} mm of the travels of X, Y and Z"
                );
                found.push(Departure::new(format!("line {}", line.line), text));
            }
            (Some(signs), _) => {
                diagonals.insert(signs);
            }
            (None, Some(true)) => {
                diagonals.insert(line.line.clone());
            }
            (None, _) => {}
        }
    }
    if diagonals.len() < BODY {
        let text = format!(
            "four of the lines must be the space diagonals, {} can be told: name them by the signs of their direction (PPP, NPP, PNP, \
             PPN), or give the travels of lines X, Y and Z",
            diagonals.len()
        );
        found.push(Departure::new("test", text));
    }
    found
}

fn of_plane(lines: &[LineSummary]) -> Vec<Departure> {
    let named: BTreeSet<String> = lines.iter().filter_map(|line| signs(&line.line)).collect();
    let has = |pair: [&str; 2]| pair.iter().all(|name| named.contains(*name));
    if has(["0PP", "0PN"]) || has(["P0P", "P0N"]) {
        return Vec::new();
    }
    let text = "the two lines must be the diagonals of one plane; name them by the signs of their direction: 0PP and 0PN for YZ, P0P and \
                P0N for XZ";
    vec![Departure::new("test", text)]
}

/// Travel along a space diagonal (m), where that of the axes is known.
fn body_travel_m(test: &LengthTest) -> Option<f64> {
    let squares: Option<Vec<f64>> =
        ["X", "Y", "Z"].iter().map(|axis| test.travel_m.get(*axis).map(|travel_m| travel_m * travel_m)).collect();
    Some(squares?.iter().sum::<f64>().sqrt())
}

/// A name of three signs, in capitals or not, from the end at which the first sign is P; `None` for any other name.
fn signs(name: &str) -> Option<String> {
    let name = name.to_ascii_uppercase();
    let is_signs = name.chars().count() == 3 && name.chars().all(|c| ['P', 'N', '0'].contains(&c));
    let first = name.chars().find(|c| *c != '0').filter(|_| is_signs)?;
    let turned = |c: char| match c {
        'P' => 'N',
        'N' => 'P',
        other => other,
    };
    Some(if first == 'N' { name.chars().map(turned).collect() } else { name })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_diagonal_is_the_same_from_either_end() {
        let of = |name| signs(name);
        assert_eq!((of("NNN"), of("PPP")), (Some("PPP".to_owned()), Some("PPP".to_owned())));
        assert_eq!((of("NPP"), of("0NP")), (Some("PNN".to_owned()), Some("0PN".to_owned())));
        assert_eq!(of("nnp"), of("PPN"));
        assert_eq!([of("PPQ"), of("X"), of("000"), of("PPPP"), of("")], [const { None }; 5]);
    }
}
