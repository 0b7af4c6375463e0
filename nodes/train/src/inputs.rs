//! Inputs by their names: what a residual is said to depend on.
//!
//! Place in the flow: `--inputs` of `train` and `compare`, and rows of residual vectors, in; samples of the training crate out.
//! `position` stands for x, y and z (m, machine frame) and always comes first; any other name is that of a column, in its unit.

use abbe_diagnose::study::vectors::ResidualVector;
use abbe_field::{POSITION, Samples};
use abbe_geometry::Vector3;
use anyhow::{Context, bail, ensure};

/// The word for x, y and z.
const WORD: &str = "position";
/// The column of the time, which rows know by itself.
const TIME: &str = "time_s";

/// Named inputs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Inputs {
    has_position: bool,
    further: Vec<String>,
}

impl Inputs {
    /// The position alone.
    pub(crate) fn position() -> Inputs {
        Inputs { has_position: true, further: Vec::new() }
    }

    /// From the words of the command line.
    pub(crate) fn of(words: &[String]) -> anyhow::Result<Inputs> {
        let mut inputs = Inputs { has_position: false, further: Vec::new() };
        for word in words.iter().map(|word| word.trim()) {
            let is_axis = ["x", "y", "z"].iter().any(|axis| word.strip_prefix(axis).is_some_and(is_length));
            ensure!(!is_axis, "--inputs {word}: write {WORD}, which is x, y and z together");
            ensure!(!word.is_empty(), "--inputs: an empty name; write names with one comma between them");
            let is_known = word == WORD && inputs.has_position || inputs.further.iter().any(|known| known == word);
            ensure!(!is_known, "--inputs: {word} is named twice");
            match word {
                WORD => inputs.has_position = true,
                _ => inputs.further.push(word.to_owned()),
            }
        }
        Ok(inputs)
    }

    /// Whether nothing but the position was named.
    pub(crate) fn is_position_alone(&self) -> bool {
        self.has_position && self.further.is_empty()
    }

    /// Whether this column was named beside the position.
    pub(crate) fn is_further(&self, column: &str) -> bool {
        self.further.iter().any(|known| known == column)
    }

    /// The words of the command line, to be written into another.
    pub(crate) fn words(&self) -> String {
        let position = self.has_position.then_some(WORD);
        position.into_iter().chain(self.further.iter().map(String::as_str)).collect::<Vec<_>>().join(",")
    }
}

fn is_length(unit: &str) -> bool {
    ["", "_m", "_mm", "_um"].contains(&unit)
}

/// Rows as samples of these inputs. Every row must know all of them: nothing stands in for what was not logged.
pub(crate) fn samples(rows: &[ResidualVector], inputs: &Inputs, has_position: bool) -> anyhow::Result<Samples> {
    if inputs.has_position && !has_position {
        bail!("--inputs names {WORD}, and the file has no columns x_mm, y_mm, z_mm; name columns that it has");
    }
    let mut at = Vec::new();
    for (number, row) in rows.iter().enumerate() {
        if inputs.has_position {
            at.extend(row.position_m);
        }
        for name in &inputs.further {
            let logged = row.covariates.get(name).copied().or(row.time_s.filter(|_| name == TIME));
            at.push(logged.with_context(|| lacks(rows, number, name))?);
        }
    }
    let names = POSITION.into_iter().filter(|_| inputs.has_position).map(str::to_owned);
    let residual_m = rows.iter().map(|row| Vector3::from(row.residual_m)).collect();
    let u_m: Option<Vec<Vector3<f64>>> = rows.iter().map(|row| row.u_m.map(Vector3::from)).collect();
    let samples = Samples::new(names.chain(inputs.further.iter().cloned()).collect(), at, residual_m, u_m);
    samples.context("points are rows of the file, from 0")
}

/// What to say of an input that a row lacks.
fn lacks(rows: &[ResidualVector], number: usize, name: &str) -> String {
    let mut known: Vec<&str> = rows.iter().flat_map(|row| row.covariates.keys()).map(String::as_str).collect();
    known.extend(rows.iter().any(|row| row.time_s.is_some()).then_some(TIME));
    known.sort_unstable();
    known.dedup();
    if !known.contains(&name) {
        let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
        return format!("--inputs names {name}, and the file has no such column; columns that can be inputs: {known}");
    }
    format!("row {} has no {name}; write it, remove the row, or leave {name} out of --inputs", number + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(words: &[&str]) -> anyhow::Result<Inputs> {
        Inputs::of(&words.iter().map(|word| (*word).to_owned()).collect::<Vec<_>>())
    }

    fn rows() -> Vec<ResidualVector> {
        let row = |k: usize| ResidualVector {
            position_m: [k as f64, (k * k) as f64, (k % 3) as f64],
            residual_m: [1e-6; 3],
            time_s: Some(k as f64),
            covariates: [("q1_deg".to_owned(), (k * 2) as f64)].into(),
            ..ResidualVector::default()
        };
        (0..10).map(row).collect()
    }

    #[test]
    fn the_position_comes_first_and_the_others_as_they_were_named() {
        let inputs = of(&["q1_deg", "position", "time_s"]).unwrap();
        assert_eq!(inputs.words(), "position,q1_deg,time_s");
        let found = samples(&rows(), &inputs, true).unwrap();
        assert_eq!(found.names(), ["x_m", "y_m", "z_m", "q1_deg", "time_s"]);
        assert_eq!(found.point(4), [4.0, 16.0, 1.0, 8.0, 4.0]);
        assert!(of(&["position"]).unwrap().is_position_alone() && !of(&["q1_deg"]).unwrap().is_position_alone());
    }

    #[test]
    fn names_that_are_none_and_rows_that_lack_one_are_refused() {
        let refused = |words: &[&str]| of(words).unwrap_err().to_string();
        assert!(refused(&["x_mm"]).contains("write position"));
        assert!(refused(&["q1_deg", "q1_deg"]).contains("twice") && refused(&[""]).contains("empty"));
        let lacks = |rows: &[ResidualVector], words: &[&str], has_position| {
            format!("{:#}", samples(rows, &of(words).unwrap(), has_position).unwrap_err())
        };
        let unknown = lacks(&rows(), &["position", "q2_deg"], true);
        assert!(unknown.contains("q2_deg") && unknown.contains("q1_deg, time_s"), "{unknown}");
        assert!(lacks(&rows(), &["position", "q1_deg"], false).contains("no columns x_mm"));
        let mut gap = rows();
        gap[6].covariates.clear();
        assert!(lacks(&gap, &["q1_deg"], true).contains("row 7 has no q1_deg"));
    }
}
