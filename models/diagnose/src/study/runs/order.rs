//! In which order the runs of an axis were made, and how far apart.
//!
//! Place in the flow: drift and correlation follow the time where every run has one, else the order of the rows. A table
//! that is sorted by target was not measured so: its cycles follow each other.

use super::Run;
use crate::study::series::steps;

/// Rows in the order of measurement, and what a reader must know of it.
pub(super) fn in_order(mut rows: Vec<usize>, runs: &[Run]) -> (Vec<usize>, Option<String>) {
    let times: Option<Vec<f64>> = rows.iter().map(|row| runs[*row].time_s).collect();
    if times.is_some() {
        let time = |row: &usize| runs[*row].time_s.unwrap_or_default();
        rows.sort_by(|a, b| time(a).total_cmp(&time(b)));
        return (rows, None);
    }
    let has_some = rows.iter().any(|row| runs[*row].time_s.is_some());
    let is_sorted = rows.windows(2).all(|pair| runs[pair[0]].cycle <= runs[pair[1]].cycle);
    rows.sort_by_key(|row| runs[*row].cycle);
    let order =
        if is_sorted { "the order of the rows" } else { "the number of the cycle, within it the order of the rows," };
    let lacks = if has_some { "some runs have no time" } else { "no times are written" };
    (rows, Some(format!("{lacks}: {order} was taken as the order of measurement.")))
}

/// Steps between neighbours.
pub(super) fn gaps(rows: &[usize], runs: &[Run]) -> Vec<f64> {
    steps(rows.iter().map(|row| runs[*row].time_s.unwrap_or_default()).collect())
}
