//! Diagonal displacement tests after ISO 230-6: the figures of ISO 230-2 along body and face diagonals.
//!
//! Place in the flow: approaches along each diagonal (position D along it, m) in; reversal, repeatability, systematic
//! error and accuracy of each diagonal, and the largest of each kind of diagonal, out (m).
//!
//! A diagonal is named by the signs of its direction along X, Y, Z: `PPP`, `NPP`, `PNP`, `PPN` for body diagonals, with
//! one `0` for face diagonals (`PP0`, `NP0`, `P0P`, …). `NNP` is `PPN` run from the other end.

use crate::departure::Departure;
use crate::error::ConformityError;
use crate::positioning::{AxisFigures, evaluate as evaluate_axis};
use abbe_measurement::positioning::Run;
use std::borrow::Borrow;
use std::collections::BTreeMap;

/// The four body diagonals.
pub const BODY: [&str; 4] = ["PPP", "NPP", "PNP", "PPN"];

/// Body or face.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum DiagonalKind {
    /// From corner to corner of the volume.
    Body,
    /// From corner to corner of a plane of two axes.
    Face,
}

impl DiagonalKind {
    /// The kind that a name means; `None` for what names no diagonal.
    pub fn of(name: &str) -> Option<DiagonalKind> {
        let signs: Vec<char> = name.chars().collect();
        let moving = signs.iter().filter(|c| matches!(c, 'P' | 'N')).count();
        let still = signs.iter().filter(|c| **c == '0').count();
        match (moving, still) {
            (3, 0) => Some(DiagonalKind::Body),
            (2, 1) => Some(DiagonalKind::Face),
            _ => None,
        }
    }
}

/// Largest figures of all diagonals of one kind (m); missing where one of them lacks it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Largest {
    /// Reversal error B.
    pub reversal_m: Option<f64>,
    /// Bidirectional repeatability R.
    pub repeatability_m: Option<f64>,
    /// Bidirectional systematic error E.
    pub systematic_m: Option<f64>,
    /// Mean bidirectional error M.
    pub mean_bidirectional_m: Option<f64>,
    /// Bidirectional accuracy A.
    pub accuracy_m: Option<f64>,
}

/// Figures of a diagonal test.
#[derive(Debug, Clone, PartialEq)]
pub struct DiagonalFigures {
    /// Each diagonal, in alphabetical order of its name.
    pub diagonals: Vec<AxisFigures>,
    /// Largest figures of body and face diagonals.
    pub largest: BTreeMap<DiagonalKind, Largest>,
    /// What a whole test after the standard has and these data lack.
    pub departures: Vec<Departure>,
}

/// Figures of all diagonals.
///
/// # Errors
/// A name that is no diagonal, the same diagonal from both ends, and what [`crate::positioning::evaluate`] refuses.
pub fn evaluate<R: Borrow<Run>>(diagonals: &BTreeMap<String, Vec<R>>) -> Result<DiagonalFigures, ConformityError> {
    if diagonals.is_empty() {
        return Err(ConformityError::new("diagonals", "there is none", "measure along the four body diagonals"));
    }
    let mut figures = Vec::new();
    let mut kinds: BTreeMap<DiagonalKind, Vec<usize>> = BTreeMap::new();
    for (name, approaches) in diagonals {
        let Some(kind) = DiagonalKind::of(name) else {
            let remedy = "name the signs along X, Y, Z: PPP, NPP, PNP, PPN, or with one 0 for a face diagonal";
            return Err(ConformityError::new(format!("diagonal {name:?}"), "this names no diagonal", remedy));
        };
        if let Some(other) = diagonals.keys().find(|other| **other == reversed(name)) {
            let problem = format!("this is {other} from the other end");
            return Err(ConformityError::new(format!("diagonal {name}"), problem, "give each diagonal under one name"));
        }
        kinds.entry(kind).or_default().push(figures.len());
        figures.push(evaluate_axis(name, approaches)?);
    }
    let mut departures: Vec<Departure> = figures.iter().flat_map(|f: &AxisFigures| f.departures.clone()).collect();
    departures.extend(missing(diagonals, &kinds));
    let largest = kinds.iter().map(|(kind, members)| (*kind, largest(&figures, members))).collect();
    Ok(DiagonalFigures { diagonals: figures, largest, departures })
}

/// The same diagonal from the other end.
fn reversed(name: &str) -> String {
    let turn = |c: char| match c {
        'P' => 'N',
        'N' => 'P',
        other => other,
    };
    name.chars().map(turn).collect()
}

fn missing<R>(diagonals: &BTreeMap<String, Vec<R>>, kinds: &BTreeMap<DiagonalKind, Vec<usize>>) -> Vec<Departure> {
    if !kinds.contains_key(&DiagonalKind::Body) {
        return Vec::new();
    }
    let absent = BODY.iter().filter(|name| !diagonals.contains_key(**name) && !diagonals.contains_key(&reversed(name)));
    absent.map(|name| Departure::new("diagonals", format!("body diagonal {name} is missing"))).collect()
}

fn largest(figures: &[AxisFigures], members: &[usize]) -> Largest {
    let over = |pick: fn(&AxisFigures) -> Option<f64>| {
        let values: Option<Vec<f64>> = members.iter().map(|k| pick(&figures[*k])).collect();
        values.map(|v| v.into_iter().fold(f64::NEG_INFINITY, f64::max))
    };
    Largest {
        reversal_m: over(|f| f.reversal_m),
        repeatability_m: over(|f| f.repeatability_m),
        systematic_m: over(|f| f.systematic_m),
        mean_bidirectional_m: over(|f| f.mean_bidirectional_m),
        accuracy_m: over(|f| f.accuracy_m),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::positioning::tests::run;
    use abbe_measurement::positioning::Approach;

    /// Five targets up to `length_m`, five cycles; deviation = slope·D ± reversal/2 (m).
    fn diagonal(length_m: f64, slope: f64, reversal_m: f64) -> Vec<Run> {
        let mut list = Vec::new();
        for share in [0.0, 0.21, 0.39, 0.63, 0.78, 1.0] {
            let target_m = length_m * share;
            for cycle in 1..=5 {
                for (approach, sign) in [(Approach::Positive, 0.5), (Approach::Negative, -0.5)] {
                    let deviation_m = slope * target_m + sign * reversal_m;
                    list.push(run(target_m, approach, cycle, deviation_m));
                }
            }
        }
        list
    }

    fn all(names: &[&str]) -> BTreeMap<String, Vec<Run>> {
        let slopes = (1..).map(|k| 1e-6 * f64::from(k));
        names.iter().zip(slopes).map(|(name, slope)| ((*name).to_owned(), diagonal(1.0, slope, 2e-6))).collect()
    }

    #[test]
    fn figures_of_the_volume_are_the_largest_of_its_diagonals() {
        let found = evaluate(&all(&BODY)).unwrap();
        assert!(found.departures.is_empty(), "{:?}", found.departures);
        let largest = found.largest[&DiagonalKind::Body];
        // The steepest, 4 µm/m on 1 m, with ± 1 µm of reversal: E = 4 + 2, M = 4, B = 2, no scatter.
        let close = |value: Option<f64>, um: f64| assert!((value.unwrap() - um * 1e-6).abs() < 1e-15, "{value:?} {um}");
        close(largest.systematic_m, 6.0);
        close(largest.accuracy_m, 6.0);
        close(largest.mean_bidirectional_m, 4.0);
        close(largest.reversal_m, 2.0);
        close(largest.repeatability_m, 2.0);
    }

    #[test]
    fn body_and_face_diagonals_are_kept_apart() {
        let found = evaluate(&all(&["PPP", "NPP", "PNP", "NNP", "PP0", "0NP"])).unwrap();
        assert_eq!(found.largest.len(), 2);
        assert!(found.departures.is_empty(), "NNP stands for PPN: {:?}", found.departures);
        assert_ne!(found.largest[&DiagonalKind::Body], found.largest[&DiagonalKind::Face]);
    }

    #[test]
    fn missing_body_diagonals_are_named() {
        let told: Vec<String> =
            evaluate(&all(&["PPP", "NPP"])).unwrap().departures.iter().map(ToString::to_string).collect();
        assert!(told.iter().any(|d| d.contains("PNP")) && told.iter().any(|d| d.contains("PPN")), "{told:?}");
        assert!(
            evaluate(&all(&["PP0"])).unwrap().departures.is_empty(),
            "face diagonals alone are a test of their own"
        );
    }

    #[test]
    fn what_is_no_diagonal_is_refused() {
        for name in ["X", "PP", "P00", "QPP", "PPPP", ""] {
            assert!(evaluate(&all(&[name])).unwrap_err().to_string().contains("names no diagonal"), "{name}");
        }
        assert!(evaluate(&all(&["PPP", "NNN"])).unwrap_err().to_string().contains("from the other end"));
        assert!(evaluate::<Run>(&BTreeMap::new()).is_err());
    }
}
