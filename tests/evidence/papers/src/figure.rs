//! A published figure beside what comes out when it is computed again.
//!
//! Place in the flow: rows of the table that `abbe papers` prints.

use thiserror::Error;

/// How the computations are run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// First seed of every simulation.
    pub seed: u64,
    /// Share of the full number of simulated runs, above 0 up to 1: 1 for published claims, less for a quick look.
    pub effort: f64,
}

impl Settings {
    /// Number of runs at this effort, `full` at effort 1 and never below `least`.
    pub fn runs(&self, full: usize, least: usize) -> usize {
        ((full as f64 * self.effort).round() as usize).clamp(least.min(full), full)
    }

    /// A figure of random runs: a part of them shows that it works, and judges nothing. Figures of the paper's own data, or of one
    /// computation, are what they are at any effort.
    pub fn of_runs(&self, figure: Figure) -> Figure {
        match self.effort < 1.0 {
            true => Figure { verdict: Verdict::NotJudged, ..figure },
            false => figure,
        }
    }
}

/// What can be said of a published figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The same within what its last digit or its scatter allows.
    Reproduced,
    /// Ours is better under the same conditions.
    Better,
    /// The published data do not give the published figure.
    DoesNotFollow,
    /// The data behind it are not published; the claim was tested on a simulation of the set-up.
    NotPublished,
    /// A figure of random runs, of which only a part was made.
    NotJudged,
}

/// One published figure.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Where it stands: table, equation or figure.
    pub place: &'static str,
    /// What it is, with unit.
    pub what: String,
    /// As published; `None` where the paper has no such figure and ours answers a question it leaves open.
    pub published: Option<String>,
    /// As computed here, with interval or spread where it comes from a simulation.
    pub reproduced: String,
    /// How it was computed.
    pub how: String,
    /// What can be said.
    pub verdict: Verdict,
    /// Why, in a sentence.
    pub reason: String,
}

/// A computation that failed; a figure is never left out in silence.
#[derive(Debug, Error)]
#[error("{paper}, {place}: {problem}")]
pub struct PaperError {
    /// The paper.
    pub paper: &'static str,
    /// The place in it.
    pub place: &'static str,
    /// What went wrong.
    pub problem: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effort_scales_the_runs_but_not_below_the_least() {
        let runs = |effort| Settings { seed: 1, effort }.runs(1000, 20);
        assert_eq!([runs(1.0), runs(0.1), runs(0.001)], [1000, 100, 20]);
    }
}
