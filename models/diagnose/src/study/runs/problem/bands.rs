//! Which waves the targets of an axis can tell, and among how many one is chosen.
//!
//! Place in the flow: part of the study of runs. Equal steps tell none from its aliases; irregular ones do, down to the pitch of a
//! fine screw.

use super::{AxisRuns, FEWEST_FOR_WAVES, OVERSAMPLING, Run, key};
use crate::study::candidate::Band;

/// Slowest periodic error told from a smooth one: cycles over the range of targets.
const SLOWEST: f64 = 2.0;
/// How far beyond the mean sampling limit irregular targets are trusted where there are too many for the whole band.
const BEYOND_LIMIT: f64 = 4.0;
/// Shortest wave looked for (m): the pitch of a fine screw.
const SHORTEST_M: f64 = 1e-3;
/// Most targets for which the whole band is tried.
const MOST_FOR_BAND: usize = 300;

impl AxisRuns {
    /// Periods from the slowest told from a smooth error to the fastest that the targets resolve.
    pub(super) fn periods_m(&self) -> Vec<f64> {
        if self.ranges.targets.len() < FEWEST_FOR_WAVES {
            return Vec::new();
        }
        let span_m = self.ranges.target_m.1 - self.ranges.target_m.0;
        let limit = (self.ranges.targets.len() as f64 - 1.0) / 2.0;
        let fastest = match self.step_m {
            // At the limit itself a sine at equal steps is the sampled zero.
            Some(_) => limit * (1.0 - 1e-9),
            None if self.has_band() => limit,
            None => limit * BEYOND_LIMIT,
        };
        let first = (SLOWEST * OVERSAMPLING).ceil() as usize;
        let last = (fastest * OVERSAMPLING).floor() as usize;
        (first..=last).map(|k| span_m * OVERSAMPLING / k as f64).collect()
    }

    /// Whether the period of a wave is chosen among all: equal steps cannot choose, and what they cannot is known beforehand.
    fn has_band(&self) -> bool {
        self.step_m.is_none() && (FEWEST_FOR_WAVES..=MOST_FOR_BAND).contains(&self.ranges.targets.len())
    }

    /// The band, at some rows.
    pub(super) fn band(&self, rows: &[usize], runs: &[Run]) -> Option<Band> {
        if !self.has_band() {
            return None;
        }
        let resolution = (self.ranges.target_m.1 - self.ranges.target_m.0).recip();
        let place = |row: &usize| self.ranges.targets.binary_search(&key(runs[*row].target_m)).ok();
        let resolved = 0.5 * (self.ranges.targets.len() as f64 - 1.0) * resolution;
        Some(Band {
            low: SLOWEST * resolution,
            high: SHORTEST_M.recip().max(resolved),
            resolved,
            step: resolution / OVERSAMPLING,
            resolution,
            places_m: self.ranges.places_m(),
            place_of: rows.iter().map(place).collect::<Option<_>>()?,
        })
    }

    /// Number of waves tried for each that is a candidate: more where one is faster than the targets resolve.
    pub(super) fn waves(&self, period_m: f64, runs: &[Run]) -> f64 {
        self.band(&[], runs).map_or(1.0, |band| band.choices(period_m.recip()))
    }
}
