//! Steps of the offset of an axis: between two cycles, in a pause, or anywhere in the record.
//!
//! Place in the flow: places from the order and the times of the runs; a shape of each, with the runs before and after it in words.

use super::Run;
use crate::study::step::{At, Places, Step};

/// Steps with their name and formula.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Jump {
    pub(super) step: Step,
    pub(super) name: String,
    pub(super) formula: String,
}

/// All steps that one axis may have.
pub(super) struct Steps {
    pub(super) places: Places,
    /// Runs in order.
    order: Vec<usize>,
    /// Whether no times were written.
    is_order: bool,
}

impl Steps {
    /// Of runs in order, whose times are places in the order where none were written.
    pub(super) fn new(order: &[usize], is_order: bool, runs: &[Run]) -> Steps {
        let times = order.iter().map(|row| runs[*row].time_s.unwrap_or_default()).collect();
        let cycles: Vec<Option<i64>> = order.iter().map(|row| Some(runs[*row].cycle)).collect();
        Steps { places: Places::new(times, &cycles), order: order.to_vec(), is_order }
    }

    /// All candidates; `rows` are the rows of the file.
    pub(super) fn all(&self, runs: &[Run], rows: &[usize]) -> Vec<Jump> {
        self.places.candidates().into_iter().map(|step| self.named(step, runs, rows)).collect()
    }

    /// Steps at places that the data chose.
    pub(super) fn at(&self, places: &[usize], runs: &[Run], rows: &[usize]) -> Jump {
        self.named(self.places.steps(places), runs, rows)
    }

    fn named(&self, step: Step, runs: &[Run], rows: &[usize]) -> Jump {
        let (names, formulas): (Vec<String>, Vec<String>) = step.at.iter().map(|at| self.words(at, runs, rows)).unzip();
        Jump { step, name: names.join(" with "), formula: format!("e = {}", formulas.join("; ")) }
    }

    /// Name and formula of one step.
    fn words(&self, at: &At, runs: &[Run], rows: &[usize]) -> (String, String) {
        let (last, first) = (self.order[at.before - 1], self.order[at.before]);
        let (last_s, first_s) = self.places.around(at);
        let (before, after) = (runs[last].cycle, runs[first].cycle);
        let [last, first] = [last, first].map(|row| format!("run {}", rows[row] + 1));
        let name = match before == after || !self.places.is_grouped {
            false => format!("step between cycles {before} and {after}"),
            true if self.is_order => format!("step in cycle {after} before {first}"),
            true => format!("step in cycle {after} between {last_s} s and {first_s} s"),
        };
        let time = |time: String| if self.is_order { String::new() } else { format!(" ({time} s)") };
        (name, format!("step from {first}{} on; the last before it is {last}{}", time(first_s), time(last_s)))
    }
}
