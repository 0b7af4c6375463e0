//! A step: the level of an axis or component jumps once, after a push against what holds the instrument or with a restart.
//!
//! Place in the flow: runs and vectors say in which order and when their rows were taken, and what was taken together. A step is
//! likely at few places: in pauses, and between groups of rows. Each of these is a candidate. Any other place is one of many, which
//! share a few candidates: each in turn is set to the place that explains most, and pays for all places that were tried, in its
//! probability as in its evidence. Column: 1 after the step, less its mean, so that its parameter is the level after less the level
//! before. Times in s, or places in the order of measurement.

use faer::Mat;
use std::collections::BTreeSet;

/// Free candidates of a chain: as many steps may be found at places that are not likely.
pub(super) const FREE: usize = 3;
/// Most steps that are sought together, and fewest rows between them.
const TOGETHER: usize = 3;
pub(super) const APART: usize = 4;
/// Median gaps that make a pause.
const PAUSE: f64 = 10.0;
/// Most likely places of a chain, the longest gaps.
const MOST: usize = 16;
/// Fewest rows on either side, and their share: a step at the very end is a few rows that stand apart.
const FEWEST: usize = 4;
const SHARE: f64 = 0.05;
/// Why a model of a machine has no place for it.
pub(super) const NO_PROPERTY: &str =
    "a step in time is no property of the machine: find out what happened then, and measure anew";
/// What tells it from what looks alike.
pub(super) const DECIDED_BY: &str = "log the time of every reading, return to one reference point before and after each pause, and \
                                     measure on: a step stays as it is, a drift goes on";

/// Where the level jumps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct At {
    /// Rows before it.
    pub(super) before: usize,
    /// Time of the first row after it.
    from: f64,
    /// Share of the rows after it.
    after: f64,
}

impl At {
    fn value(&self, time: f64) -> f64 {
        f64::from(u8::from(time >= self.from)) - self.after
    }
}

/// Steps in a record: one; or two or three, which may only be seen together, since a staircase looks like a drift and what jumps
/// there and back like nothing.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Step {
    pub(super) at: Vec<At>,
    /// Whether the data choose its places.
    is_free: bool,
}

impl Step {
    /// Columns at a time.
    pub(super) fn values(&self, time: f64) -> Vec<f64> {
        self.at.iter().map(|at| at.value(time)).collect()
    }

    /// Columns over a unit, at rows of which the time and the unit are given.
    pub(super) fn columns(&self, rows: &[(f64, f64)]) -> Mat<f64> {
        Mat::from_fn(rows.len(), self.at.len(), |i, j| self.at[j].value(rows[i].0) / rows[i].1)
    }

    /// Names of its parameters.
    pub(super) fn parameters(&self) -> Vec<String> {
        match self.at.len() {
            1 => vec!["step".to_owned()],
            count => (1..=count).map(|k| format!("step_{k}")).collect(),
        }
    }

    /// Rows before each of its steps.
    pub(super) fn before(&self) -> Vec<usize> {
        self.at.iter().map(|at| at.before).collect()
    }
}

/// Where the level of a chain may step.
#[derive(Debug, Clone)]
pub(super) struct Places {
    times: Vec<f64>,
    likely: Vec<usize>,
    free: Vec<usize>,
    all: Vec<usize>,
    /// Whether each group was taken at one stretch.
    pub(super) is_grouped: bool,
}

impl Places {
    /// Of rows in order: their times and the groups to which they belong.
    pub(super) fn new<G: Ord>(times: Vec<f64>, groups: &[Option<G>]) -> Places {
        let least = FEWEST.max((SHARE * times.len() as f64).ceil() as usize);
        let is_place = |k: &usize| times[*k] > times[k - 1];
        let all: Vec<usize> = (least..(times.len() + 1).saturating_sub(least)).filter(is_place).collect();
        let is_grouped = is_grouped(groups);
        let gap = |k: usize| times[k] - times[k - 1];
        let mut gaps: Vec<f64> = (1..times.len()).map(gap).collect();
        gaps.sort_by(f64::total_cmp);
        let pause = PAUSE * gaps.get(gaps.len() / 2).copied().unwrap_or(f64::INFINITY);
        let is_likely = |k: &usize| gap(*k) > pause || (is_grouped && groups[*k] != groups[k - 1]);
        let mut likely: Vec<usize> = all.iter().copied().filter(is_likely).collect();
        likely.sort_by(|a, b| gap(*b).total_cmp(&gap(*a)));
        likely.truncate(MOST);
        likely.sort_unstable();
        let free = all.iter().copied().filter(|k| !likely.contains(k)).collect();
        Places { times, likely, free, all, is_grouped }
    }

    fn at(&self, before: usize) -> At {
        let count = self.times.len();
        let from = self.times.get(before).copied().unwrap_or(f64::INFINITY);
        At { before, from, after: count.saturating_sub(before) as f64 / count.max(1) as f64 }
    }

    /// Steps before these rows, whose places the data chose.
    pub(super) fn steps(&self, before: &[usize]) -> Step {
        Step { at: before.iter().map(|before| self.at(*before)).collect(), is_free: true }
    }

    /// Candidates: every likely place, and some that wait for the data to choose.
    pub(super) fn candidates(&self) -> Vec<Step> {
        let likely = self.likely.iter().map(|k| Step { at: vec![self.at(*k)], is_free: false });
        let spread = |among: &[usize], k: usize, count: usize| among[k * among.len() / (count + 1)];
        let ones = (1..=FREE.min(self.free.len())).map(|k| self.steps(&[spread(&self.free, k, FREE)]));
        let together = (2..=TOGETHER).filter(|count| self.all.len() >= APART * (count + 1)).map(|count| {
            let before: Vec<usize> = (1..=count).map(|k| spread(&self.all, k, count)).collect();
            self.steps(&before)
        });
        likely.chain(ones).chain(together).collect()
    }

    /// Places that a step may take; none for one whose place is given.
    pub(super) fn of(&self, step: &Step) -> &[usize] {
        match step.at.len() {
            _ if !step.is_free => &[],
            1 => &self.free,
            _ => &self.all,
        }
    }

    /// Number of choices of which steps before these rows are one.
    pub(super) fn tried(&self, before: &[usize]) -> f64 {
        let one =
            |before: &usize| if self.likely.contains(before) { self.likely.len() } else { self.free.len() } as f64;
        let orders: usize = (1..=before.len()).product();
        (before.iter().map(one).product::<f64>() / orders as f64).max(1.0)
    }

    /// Times of the last row before a step and of the first after it, as short as they differ.
    pub(super) fn around(&self, at: &At) -> (String, String) {
        let (last, first) = (self.times[at.before - 1], self.times[at.before]);
        let digits = (-(first - last).log10()).ceil().clamp(0.0, 9.0) as usize;
        (format!("{last:.digits$}"), format!("{first:.digits$}"))
    }
}

/// Whether groups follow each other: each at one stretch.
fn is_grouped<G: Ord>(groups: &[Option<G>]) -> bool {
    let mut seen = BTreeSet::new();
    let starts = (0..groups.len()).filter(|k| *k == 0 || groups[*k] != groups[k - 1]);
    groups.iter().all(Option::is_some) && starts.map(|k| &groups[k]).all(|group| seen.insert(group))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_likely_in_pauses_and_between_groups() {
        let times: Vec<f64> = (0..40).map(|k| 10.0 * f64::from(k) + if k < 25 { 0.0 } else { 3600.0 }).collect();
        let group = |size: usize| (0..40).map(|k| Some(k / size)).collect::<Vec<_>>();
        let of = |groups: &[Option<usize>]| Places::new(times.clone(), groups);
        assert_eq!(of(&vec![None; 40]).likely, [25]);
        assert_eq!(of(&group(10)).likely, [10, 20, 25, 30]);
        // The last group has too few rows; groups that take turns have no boundaries.
        assert_eq!(of(&group(19)).likely, [19, 25]);
        assert_eq!(of(&(0..40).map(|k| Some(k % 4)).collect::<Vec<_>>()).likely, [25]);
        assert!(of(&group(10)).free.iter().all(|k| (4..=36).contains(k) && k % 10 != 0 && *k != 25));
        assert_eq!(of(&group(10)).candidates().len(), 4 + FREE + 2);
    }

    #[test]
    fn the_column_of_a_step_has_no_mean_and_rises_by_one() {
        let places = Places::new((0..20).map(f64::from).collect(), &vec![None::<usize>; 20]);
        let step = places.steps(&[14]);
        let values: Vec<f64> = (0..20).map(|k| step.values(f64::from(k))[0]).collect();
        assert!(values.iter().sum::<f64>().abs() < 1e-12 && (values[14] - values[13] - 1.0).abs() < 1e-12);
        assert_eq!(places.around(&step.at[0]), ("13".to_owned(), "14".to_owned()));
        assert!(places.steps(&[90]).values(30.0)[0].is_finite(), "no such row");
        assert!(Places::new(Vec::new(), &[None::<usize>; 0]).candidates().is_empty());
    }
}
