//! Tables of many trials: how often effects are detected, rightly or wrongly named, and how much error goes away.
//!
//! Place in the flow: last step of the bench; records in, text and rows out. Shares come with Wilson's 95 % intervals;
//! trials without a result are counted beside them, never among them.

use std::collections::BTreeMap;
use std::fmt::Write;

use crate::record::{Outcome, Record};
use crate::statistics::{Count, mean_and_least, median_and_largest};

/// Trials of one scenario at one level.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Family of the scenario.
    pub family: String,
    /// Name of the scenario.
    pub scenario: String,
    /// Level asked for.
    pub level: Option<f64>,
    /// Something was found.
    pub detected: Count,
    /// Everything injected was named.
    pub right: Count,
    /// A cause was claimed that was not there.
    pub wrong: Count,
    /// The error after is within 15 % of that without the effect.
    pub within_15_percent: Count,
    /// Median and largest error after, in units of that without the effect.
    pub after_over_clean: Option<[f64; 2]>,
    /// Mean and least share of coordinates within U (k = 2) after.
    pub covered: Option<[f64; 2]>,
    /// Median share of the excess that was removed.
    pub excess_removed: Option<f64>,
    /// Trials without a result.
    pub failed: usize,
    /// Seeds of the trials.
    pub seeds: [u64; 2],
}

/// One line for each scenario and level, and one for each family over all its scenarios.
pub fn lines(records: &[Record]) -> Vec<Line> {
    let mut groups: BTreeMap<(String, String, u64), Vec<&Record>> = BTreeMap::new();
    for record in records {
        // Levels are positive, so the bits of the number sort as the number does.
        let level = record.level.map_or(0, f64::to_bits);
        for scenario in [record.scenario.clone(), format!("all {}", record.family)] {
            groups.entry((record.family.clone(), scenario, level)).or_default().push(record);
        }
    }
    groups.into_iter().map(|((family, scenario, _), group)| line(family, scenario, &group)).collect()
}

fn line(family: String, scenario: String, group: &[&Record]) -> Line {
    let done: Vec<&Outcome> = group.iter().filter_map(|record| record.outcome.as_ref().ok()).collect();
    let count = |test: fn(&Outcome) -> bool| Count::among(done.iter().map(|outcome| test(outcome)));
    let seeds = group.iter().map(|record| record.seed);
    Line {
        family,
        scenario,
        level: group.first().and_then(|record| record.level),
        detected: count(|o| o.attribution.detected),
        right: count(|o| o.attribution.right),
        wrong: count(|o| o.attribution.wrong),
        within_15_percent: count(|o| o.after_m <= 1.15 * o.clean_m),
        after_over_clean: median_and_largest(done.iter().map(|o| o.after_m / o.clean_m)),
        covered: mean_and_least(done.iter().map(|o| o.covered)),
        excess_removed: median_and_largest(done.iter().filter_map(|o| o.excess_removed())).map(|[median, _]| median),
        failed: group.len() - done.len(),
        seeds: [seeds.clone().min().unwrap_or(0), seeds.max().unwrap_or(0)],
    }
}

/// The table as text.
pub fn text(lines: &[Line]) -> String {
    let mut out = String::new();
    let _ = writeln!(
        out,
        "{:<12} {:<34} {:>6} {:>4} {:>6}  {:<17} {:<17} {:<17} {:<17} {:>12} {:>10} {:>8}  seeds",
        "family",
        "scenario",
        "level",
        "n",
        "failed",
        "detected",
        "right",
        "wrong",
        "within 15 %",
        "after/clean",
        "covered",
        "removed"
    );
    for line in lines {
        let _ = writeln!(
            out,
            "{:<12} {:<34} {:>6} {:>4} {:>6}  {:<17} {:<17} {:<17} {:<17} {:>12} {:>10} {:>8}  {}-{}",
            line.family,
            line.scenario,
            line.level.map_or("-".to_owned(), |level| level.to_string()),
            line.detected.of,
            line.failed,
            share(line.detected),
            share(line.right),
            share(line.wrong),
            share(line.within_15_percent),
            line.after_over_clean.map_or("-".to_owned(), |[median, largest]| format!("{median:.2}/{largest:.2}")),
            line.covered.map_or("-".to_owned(), |[mean, least]| format!("{:.0}/{:.0} %", mean * 100.0, least * 100.0)),
            line.excess_removed.map_or("-".to_owned(), |share| format!("{:.0} %", share * 100.0)),
            line.seeds[0],
            line.seeds[1],
        );
    }
    out
}

/// Columns of [`power_row`].
pub const POWER_COLUMNS: [&str; 20] = [
    "family",
    "scenario",
    "level",
    "trials",
    "failed",
    "detected",
    "detected_low",
    "detected_high",
    "right",
    "right_low",
    "right_high",
    "wrong",
    "wrong_low",
    "wrong_high",
    "within_15_percent",
    "after_over_clean_median",
    "after_over_clean_largest",
    "covered_mean",
    "covered_least",
    "excess_removed_median",
];

/// One point of the power curve: shares with their 95 % intervals against the level.
pub fn power_row(line: &Line) -> Vec<String> {
    let number = |value: Option<f64>| value.map_or(String::new(), |v| format!("{v:.4}"));
    let mut row = vec![
        line.family.clone(),
        line.scenario.clone(),
        line.level.map_or(String::new(), |level| level.to_string()),
        line.detected.of.to_string(),
        line.failed.to_string(),
    ];
    for count in [line.detected, line.right, line.wrong] {
        let interval = count.interval();
        row.push(number(count.share()));
        row.push(number(interval.map(|[low, _]| low)));
        row.push(number(interval.map(|[_, high]| high)));
    }
    row.push(number(line.within_15_percent.share()));
    row.push(number(line.after_over_clean.map(|[median, _]| median)));
    row.push(number(line.after_over_clean.map(|[_, largest]| largest)));
    row.push(number(line.covered.map(|[mean, _]| mean)));
    row.push(number(line.covered.map(|[_, least]| least)));
    row.push(number(line.excess_removed));
    row
}

/// A count with its interval, such as `95 % (76-99)`.
fn share(count: Count) -> String {
    match (count.share(), count.interval()) {
        (Some(share), Some([low, high])) => {
            format!("{:.0} % ({:.0}-{:.0})", share * 100.0, low * 100.0, high * 100.0)
        }
        _ => "-".to_owned(),
    }
}

/// Trials that did not come out as wanted, one text each: the list from which a diagnosis is improved.
pub fn failures(records: &[Record]) -> Vec<String> {
    records.iter().filter_map(failure).collect()
}

fn failure(record: &Record) -> Option<String> {
    let level = record.level.map_or(String::new(), |level| format!(" x{level}"));
    let place = format!("{} {}{level} seed {}", record.family, record.scenario, record.seed);
    let outcome = match &record.outcome {
        Ok(outcome) => outcome,
        Err(problem) => return Some(format!("{place}: {problem}")),
    };
    let found = if outcome.found.is_empty() { "nothing".to_owned() } else { outcome.found.join(" + ") };
    let is_free = matches!(record.family.as_str(), "clean" | "adverse");
    let what = match outcome.attribution {
        a if is_free && a.detected => "false alarm",
        _ if is_free => return None,
        a if a.wrong => "wrong name",
        _ if outcome.after_m > 1.1 * outcome.before_m => "harm done",
        // What the plan hides may be left alone, as long as nothing else is claimed in its place.
        _ if record.family == "aliased" => return None,
        a if !a.detected => "missed",
        a if !a.right && record.family != "undescribed" => "not named",
        _ if outcome.after_m > 1.15 * outcome.clean_m && record.family != "undescribed" => "error left",
        _ if outcome.excess_removed().is_some_and(|share| share < 0.7) => "excess left",
        _ => return None,
    };
    Some(format!(
        "{place}: {what}; injected {}; found {found}; clean {:.3} before {:.3} after {:.3} um; chi2 {:.3} to {:.3}",
        outcome.injected.join(" + "),
        outcome.clean_m * 1e6,
        outcome.before_m * 1e6,
        outcome.after_m * 1e6,
        outcome.chi2_per_dof[0],
        outcome.chi2_per_dof[1]
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribution::Attribution;

    /// A trial of an effect of factor 2: named rightly or not, with an error left in units of the clean one.
    fn record(seed: u64, right: bool, left: f64) -> Record {
        let attribution = Attribution { detected: true, right, wrong: !right, empirical: false };
        let outcome = Outcome {
            injected: vec!["play axis=x".to_owned()],
            clean_m: 3e-7,
            before_m: 6e-7,
            after_m: 3e-7 * left,
            covered: 0.9 + 0.05 * f64::from(u8::from(right)),
            consistent_with_noise: false,
            attribution,
            found: vec!["reverse x".to_owned()],
            not_identifiable: Vec::new(),
            steps: Vec::new(),
            chi2_per_dof: [2.0, 1.0],
        };
        let (scenario, family) = ("play".to_owned(), "single".to_owned());
        Record { scenario, family, seed, level: Some(2.0), outcome: Ok(outcome) }
    }

    #[test]
    fn trials_without_a_result_are_counted_apart() {
        let failed = Record { outcome: Err("no size".to_owned()), ..record(3, true, 1.0) };
        let all = [record(1, true, 1.0), record(2, false, 1.5), failed];
        let lines = lines(&all);
        assert_eq!(lines.len(), 2, "the scenario and its family");
        for line in &lines {
            assert_eq!((line.right, line.failed, line.seeds), (Count { hits: 1, of: 2 }, 1, [1, 3]));
            assert_eq!(line.within_15_percent, Count { hits: 1, of: 2 });
            let [median, largest] = line.after_over_clean.unwrap();
            assert!((median - 1.25).abs() < 1e-12 && (largest - 1.5).abs() < 1e-12);
            let [mean, least] = line.covered.unwrap();
            assert!((mean - 0.925).abs() < 1e-12 && least == 0.9);
            assert_eq!(power_row(line).len(), POWER_COLUMNS.len());
        }
        assert_eq!(failures(&all).len(), 2);
        assert!(failures(&all)[0].contains("wrong name"));
    }

    #[test]
    fn an_error_that_stays_is_a_failure_even_under_the_right_name() {
        assert!(failures(&[record(1, true, 1.1)]).is_empty());
        assert!(failures(&[record(1, true, 1.2)])[0].contains("error left"));
    }
}
