//! What came of one trial, and its row in a file.
//!
//! Place in the flow: [`crate::trial::run`] makes it, the runner writes it as soon as it is there, [`crate::summary`]
//! counts rows, read back ones alike. Metres inside, micrometres in the row.

use crate::attribution::Attribution;
use crate::sizing::excess;

/// Columns of a row, in order.
pub const COLUMNS: [&str; 23] = [
    "scenario",
    "family",
    "seed",
    "level",
    "factor",
    "clean_um",
    "before_um",
    "after_um",
    "covered",
    "excess_removed",
    "consistent_with_noise",
    "detected",
    "right",
    "wrong",
    "empirical",
    "chi2_per_dof_before",
    "chi2_per_dof_after",
    "injected",
    "found",
    "not_identifiable",
    "steps",
    "problem",
    "wall_s",
];

/// What is between the entries of a list in one field.
const BETWEEN: &str = " | ";
const MICRO: f64 = 1e-6;

/// One trial with what came of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Name of the scenario.
    pub scenario: String,
    /// Name of its family.
    pub family: String,
    /// Seed.
    pub seed: u64,
    /// Level asked for, `None` without effect.
    pub level: Option<f64>,
    /// What came of it, or why nothing did.
    pub outcome: Result<Outcome, String>,
}

/// The result of a trial that ran through.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Texts of the injected effects.
    pub injected: Vec<String>,
    /// Verification error of the same machine's fit without the effect (m).
    pub clean_m: f64,
    /// Verification error of the best rigid fit with the effect (m).
    pub before_m: f64,
    /// Verification error of the model that diagnosis gave (m).
    pub after_m: f64,
    /// Share of the coordinates of verification points that lie within U (k = 2) of that model.
    pub covered: f64,
    /// Whether diagnosis called the residual consistent with noise.
    pub consistent_with_noise: bool,
    /// What was found against what was there.
    pub attribution: Attribution,
    /// What was found, in words.
    pub found: Vec<String>,
    /// What diagnosis says it cannot tell.
    pub not_identifiable: Vec<String>,
    /// What it decided on the way.
    pub steps: Vec<String>,
    /// χ² per degree of freedom before and after.
    pub chi2_per_dof: [f64; 2],
}

impl Outcome {
    /// Share of the excess error that diagnosis removed: 1 all, 0 none, negative where it did harm. `None` where
    /// there was no excess to speak of.
    pub fn excess_removed(&self) -> Option<f64> {
        let square = |value: f64| value * value;
        let there = square(self.before_m) - square(self.clean_m);
        let is_worth_it = excess(self.before_m, self.clean_m) > 0.1;
        is_worth_it.then(|| (square(self.before_m) - square(self.after_m)) / there)
    }
}

impl Record {
    /// What tells this trial from all others.
    pub fn key(&self) -> (String, u64, Option<String>) {
        (self.scenario.clone(), self.seed, self.level.map(|f| format!("{f}")))
    }

    /// The row of a file, in the order of [`COLUMNS`].
    pub fn to_row(&self, wall_s: f64) -> Vec<String> {
        let number = |value: Option<f64>| value.map_or(String::new(), |v| format!("{v:.4}"));
        let flag = |value: Option<bool>| value.map_or(String::new(), |v| u8::from(v).to_string());
        let done = self.outcome.as_ref().ok();
        let with = |f: fn(&Outcome) -> f64| number(done.map(f));
        let of = |f: fn(&Attribution) -> bool| flag(done.map(|o| f(&o.attribution)));
        let list = |f: fn(&Outcome) -> &Vec<String>| done.map_or(String::new(), |o| f(o).join(BETWEEN));
        vec![
            self.scenario.clone(),
            self.family.clone(),
            self.seed.to_string(),
            self.level.map_or(String::new(), |f| format!("{f}")),
            with(|o| o.before_m / o.clean_m),
            with(|o| o.clean_m / MICRO),
            with(|o| o.before_m / MICRO),
            with(|o| o.after_m / MICRO),
            with(|o| o.covered),
            number(done.and_then(Outcome::excess_removed)),
            flag(done.map(|o| o.consistent_with_noise)),
            of(|a| a.detected),
            of(|a| a.right),
            of(|a| a.wrong),
            of(|a| a.empirical),
            with(|o| o.chi2_per_dof[0]),
            with(|o| o.chi2_per_dof[1]),
            list(|o| &o.injected),
            list(|o| &o.found),
            list(|o| &o.not_identifiable),
            list(|o| &o.steps),
            self.outcome.as_ref().err().cloned().unwrap_or_default(),
            format!("{wall_s:.1}"),
        ]
    }

    /// A row back from a file; `None` if it is none of [`Self::to_row`]'s.
    pub fn from_row(row: &[&str]) -> Option<Record> {
        if row.len() != COLUMNS.len() {
            return None;
        }
        let at = |name: &str| COLUMNS.iter().position(|column| *column == name).map(|k| row[k]);
        let problem = at("problem")?;
        let level = at("level")?;
        Some(Record {
            scenario: at("scenario")?.to_owned(),
            family: at("family")?.to_owned(),
            seed: at("seed")?.parse().ok()?,
            level: if level.is_empty() { None } else { Some(level.parse().ok()?) },
            outcome: if problem.is_empty() { Ok(outcome(&at)?) } else { Err(problem.to_owned()) },
        })
    }
}

fn outcome<'a>(at: &dyn Fn(&str) -> Option<&'a str>) -> Option<Outcome> {
    let number = |name: &str| at(name)?.parse::<f64>().ok();
    let flag = |name: &str| match at(name)? {
        "0" => Some(false),
        "1" => Some(true),
        _ => None,
    };
    let list = |name: &str| {
        let text = at(name)?;
        Some(text.split(BETWEEN).filter(|part| !part.is_empty()).map(str::to_owned).collect::<Vec<_>>())
    };
    Some(Outcome {
        injected: list("injected")?,
        clean_m: number("clean_um")? * MICRO,
        before_m: number("before_um")? * MICRO,
        after_m: number("after_um")? * MICRO,
        covered: number("covered")?,
        consistent_with_noise: flag("consistent_with_noise")?,
        attribution: Attribution {
            detected: flag("detected")?,
            right: flag("right")?,
            wrong: flag("wrong")?,
            empirical: flag("empirical")?,
        },
        found: list("found")?,
        not_identifiable: list("not_identifiable")?,
        steps: list("steps")?,
        chi2_per_dof: [number("chi2_per_dof_before")?, number("chi2_per_dof_after")?],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record() -> Record {
        Record {
            scenario: "play".to_owned(),
            family: "single".to_owned(),
            seed: 4,
            level: Some(1.5),
            outcome: Ok(Outcome {
                injected: vec!["play axis=x".to_owned(), "heat".to_owned()],
                clean_m: 3e-7,
                before_m: 5e-7,
                after_m: 3e-7,
                covered: 0.95,
                consistent_with_noise: false,
                attribution: Attribution { detected: true, right: true, wrong: false, empirical: false },
                found: Vec::new(),
                not_identifiable: vec!["a".to_owned()],
                steps: Vec::new(),
                chi2_per_dof: [2.5, 1.0],
            }),
        }
    }

    fn back(record: &Record) -> Record {
        let row = record.to_row(1.0);
        Record::from_row(&row.iter().map(String::as_str).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn a_row_comes_back_as_it_went() {
        let went = record();
        let came = back(&went);
        assert_eq!(came.key(), went.key());
        assert_eq!(back(&came), came);
        assert_eq!(came.outcome.unwrap().injected, went.outcome.unwrap().injected);
        let failed = Record { outcome: Err("no size".to_owned()), level: None, ..record() };
        assert_eq!(back(&failed), failed);
        assert_eq!(Record::from_row(&["play", "single"]), None);
    }

    #[test]
    fn the_excess_removed_is_all_none_or_a_loss() {
        let mut outcome = record().outcome.unwrap();
        assert!((outcome.excess_removed().unwrap() - 1.0).abs() < 1e-12);
        outcome.after_m = outcome.before_m;
        assert_eq!(outcome.excess_removed(), Some(0.0));
        outcome.after_m = 7e-7;
        assert!(outcome.excess_removed().unwrap() < 0.0);
        outcome.before_m = outcome.clean_m;
        assert_eq!(outcome.excess_removed(), None);
    }
}
