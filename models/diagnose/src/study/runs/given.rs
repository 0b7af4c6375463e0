//! What is wrong with runs before anything is fitted to them: figures that are none, another unit, the same row twice.
//!
//! Place in the flow: first step of the study of runs.

use super::positions::key;
use super::{Approach, Run};
use crate::error::DiagnoseError;
use crate::logs::mended_rows;
use abbe_geometry::Axis;
use std::collections::{BTreeMap, BTreeSet};

/// Median distance of the errors of an axis from their median (m), from which they are in another unit: poor axes of
/// several metres stay below a tenth of it.
const ANOTHER_UNIT_M: f64 = 1e-3;
/// Rows named in one sentence.
const NAMED: usize = 8;
/// Units in which a column of positions may stand.
const LENGTHS: [&str; 3] = ["mm", "um", "m"];

/// Rows that count, in the order given, and what a reader must know.
pub(super) fn given(runs: &[Run]) -> Result<(Vec<usize>, Vec<String>), DiagnoseError> {
    let data = |problem: String, remedy: &str| Err(DiagnoseError::Data { problem, remedy: remedy.to_owned() });
    if runs.is_empty() {
        return data("there are no runs".to_owned(), "give one row for each approach to a target");
    }
    for (k, run) in runs.iter().enumerate() {
        let logged = run.covariates.values().chain(&run.time_s);
        if !logged.chain([&run.target_m, &run.measured_m]).all(|value| value.is_finite()) {
            return data(format!("run {} holds a figure that is not finite", k + 1), "remove or correct it");
        }
    }
    one_name_an_axis(runs)?;
    no_positions(runs)?;
    let axes: BTreeSet<&str> = runs.iter().map(|run| run.axis.as_str()).collect();
    for axis in axes {
        let own = || runs.iter().filter(|run| run.axis == axis);
        let distinct =
            |position_m: fn(&Run) -> f64| own().map(|run| key(position_m(run))).collect::<BTreeSet<i64>>().len();
        let (targets, measured) = (distinct(|run| run.target_m), distinct(|run| run.measured_m));
        if targets > 2 * measured {
            let problem = format!("axis {axis} has {targets} different targets, and {measured} measured positions");
            return data(
                problem,
                "the columns seem to be exchanged: target_mm is where the axis was sent, each cycle again",
            );
        }
        let errors: Vec<f64> = own().map(Run::error_m).collect();
        let middle = median(errors.clone());
        let spread_m = median(errors.into_iter().map(|error| (error - middle).abs()).collect());
        if spread_m > ANOTHER_UNIT_M {
            let problem = format!("half of the errors of axis {axis} scatter by more than {:.3} mm", spread_m * 1e3);
            return data(problem, "micrometres seem to stand in columns of millimetres: divide them by a thousand");
        }
    }
    let (rows, notes) = once(runs);
    no_approach_twice(runs, &rows)?;
    Ok((rows, [notes, rotary(runs)].concat()))
}

/// What a reader must know of axes that are rotary by their names (ISO 841).
fn rotary(runs: &[Run]) -> Vec<String> {
    let is_rotary = |axis: &&str| ["a", "b", "c"].contains(&axis.trim().to_ascii_lowercase().as_str());
    let axes: BTreeSet<&str> = runs.iter().map(|run| run.axis.as_str()).filter(is_rotary).collect();
    let told = |axis: &str| {
        format!(
            "Axis {axis} is a rotary one by its name, and runs are taken for those of a linear one: where degrees stand in the columns of \
             millimetres, read degrees for mm and thousandths of a degree for µm. No model of it corrects a machine."
        )
    };
    axes.into_iter().map(told).collect()
}

/// Refuses an axis under two names: each would be corrected by itself, and the machine by both.
fn one_name_an_axis(runs: &[Run]) -> Result<(), DiagnoseError> {
    let mut names: BTreeMap<String, &str> = BTreeMap::new();
    for (row, run) in runs.iter().enumerate() {
        let first = *names.entry(run.axis.trim().to_ascii_lowercase()).or_insert(&run.axis);
        if first != run.axis {
            return Err(DiagnoseError::Row {
                row,
                problem: format!("axis {first} is called {} here: these are one axis of a machine", run.axis),
                remedy: format!("write {first} in every row, and go on counting its cycles"),
            });
        }
    }
    Ok(())
}

/// Refuses positions of the machine as a quantity logged: no sample could say them beside its own readings.
fn no_positions(runs: &[Run]) -> Result<(), DiagnoseError> {
    let is_position = |name: &&String| {
        let name = name.to_ascii_lowercase();
        let of_axis = |axis: Axis| name.strip_prefix(axis.lower()).and_then(|rest| rest.strip_prefix('_'));
        Axis::ALL.into_iter().filter_map(of_axis).any(|unit| LENGTHS.contains(&unit))
    };
    match runs.iter().flat_map(|run| run.covariates.keys()).find(is_position) {
        None => Ok(()),
        Some(name) => Err(DiagnoseError::Data {
            problem: format!("the column {name} holds positions: runs are told along one line, and no model of them reads where it lies"),
            remedy: "write the runs of each line to a file of their own, without that column; to see how an error depends on the \
                     positions of other axes, give residual vectors"
                .to_owned(),
        }),
    }
}

/// Refuses a cycle in which an approach stands twice with another result: sessions that were each counted from 1 would be taken for one,
/// and what differs between them for scatter.
fn no_approach_twice(runs: &[Run], rows: &[usize]) -> Result<(), DiagnoseError> {
    let mut seen = BTreeSet::new();
    for row in rows.iter().copied() {
        let run = &runs[row];
        if !seen.insert((run.axis.as_str(), key(run.target_m), run.approach, run.cycle)) {
            let sign = if run.approach == Approach::Positive { '+' } else { '-' };
            return Err(DiagnoseError::Row {
                row,
                problem: format!(
                    "axis {}, target {:.4} mm, cycle {}: the approach from this direction ({sign}) stands twice",
                    run.axis,
                    run.target_m * 1e3,
                    run.cycle
                ),
                remedy: "number the cycles 1, 2, 3 on through all sessions, and give each approach once".to_owned(),
            });
        }
    }
    Ok(())
}

/// The runs with what was logged beside them mended, as that of a campaign is, and what was done.
pub(super) fn mended(mut runs: Vec<Run>) -> (Vec<Run>, Vec<String>) {
    let times_s: Vec<Option<f64>> = runs.iter().map(|run| run.time_s).collect();
    let (logged, said) = mended_rows(&times_s, &runs.iter().map(|run| &run.covariates).collect::<Vec<_>>());
    runs.iter_mut().zip(logged).for_each(|(run, covariates)| run.covariates = covariates);
    (runs, said)
}

/// Rows without copies.
fn once(runs: &[Run]) -> (Vec<usize>, Vec<String>) {
    let mut seen = BTreeSet::new();
    let (mut rows, mut copies) = (Vec::new(), Vec::new());
    for (k, run) in runs.iter().enumerate() {
        let logged: Vec<(&str, u64)> = run.covariates.iter().map(|(name, v)| (name.as_str(), v.to_bits())).collect();
        let own = (
            run.axis.as_str(),
            key(run.target_m),
            run.approach,
            run.cycle,
            run.measured_m.to_bits(),
            run.time_s.map(f64::to_bits),
            logged,
        );
        if seen.insert(own) { rows.push(k) } else { copies.push(k + 1) }
    }
    if copies.is_empty() {
        return (rows, Vec::new());
    }
    let named: Vec<String> = copies.iter().take(NAMED).map(usize::to_string).collect();
    let more = if copies.len() > NAMED { ", …" } else { "" };
    let note = format!("{} rows are copies of others and were counted once: {}{more}.", copies.len(), named.join(", "));
    (rows, vec![note])
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Periods of degrees came out as "0.4486 mm, axis B", without a word.
    #[test]
    fn regress_a_rotary_axis_is_told_that_it_is_taken_for_a_linear_one() {
        let of = |axis: &str| {
            let run = |k: i64| Run {
                axis: axis.to_owned(),
                target_m: 1e-3 * k as f64,
                approach: Approach::Positive,
                cycle: 1,
                measured_m: 1e-3 * k as f64 + 1e-7 * (k % 3) as f64,
                time_s: None,
                covariates: BTreeMap::new(),
            };
            given(&(0..6).map(run).collect::<Vec<Run>>()).map(|(_, notes)| notes.concat())
        };
        assert!(of("B").is_ok_and(|notes| notes.contains("thousandths of a degree")));
        assert!(of("X").is_ok_and(|notes| notes.is_empty()));
    }
}
