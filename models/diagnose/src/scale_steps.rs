//! Steps of the scales: a place along an axis beyond which all readings are off by the same.
//!
//! Place in the flow: proposes shapes of the step in a scale to [`crate::search`]. Every pair of neighbouring readings of an axis is a place;
//! some are tried, then all beside the best. Between which readings the place lies is told by the readings themselves: for a step in noise
//! twice the log likelihood of the true place falls short of the best by less than x with probability (1 − e^(−x/2))² (D. Siegmund, Confidence
//! sets in change-point problems, International Statistical Review 56, 1988), so that all places within [`UNSURE`] stay open. What a slope
//! explains as well is no step: rails have joints and guideways waves, and finer error functions follow those. Readings in m.

use crate::candidates::{Candidate, Round, score_all};
use crate::error::DiagnoseError;
use crate::score::Score;
use abbe_geometry::Axis;
use abbe_geometry::effects::{Known, Shape, known};
use abbe_geometry::machine::Machine;
use abbe_identify::EffectTerm;
use abbe_measurement::campaign::Campaign;
use faer::Mat;
use std::collections::{BTreeMap, BTreeSet};

/// Readings this close are at one place (m): no scale comes back to the last bit.
const AT_PLACE_M: f64 = 1e-6;
/// Lines before and beyond: one alone may be an outlying run.
const LEAST_LINES: usize = 2;
/// Places tried first, and those of each closer look.
const COARSE: usize = 64;
const CLOSER: usize = 16;
/// Reduction of χ², in units of the noise, by which a place may fall short of the best: (1 − e^(−x/2))² is 99 %.
const UNSURE: f64 = 10.6;
/// Widths of the slopes that a step is held against, as shares of the stroke: the finest error functions have forty intervals.
const SLOPES: [f64; 2] = [1.0 / 40.0, 1.0 / 20.0];
/// Reduction of χ², in units of the noise, by which a step must explain more than each of these: twenty times as likely.
const SHARPER: f64 = 6.0;

/// The step that stands out most, of each axis along which one does.
pub(crate) fn candidates(
    round: &Round,
    machine: &Machine,
    campaign: &Campaign,
) -> Result<Vec<Candidate>, DiagnoseError> {
    let Some(known) = known("scale_step") else { return Ok(Vec::new()) };
    let mut all = Vec::new();
    for axis in Axis::ALL {
        if let Some(mut places) = Places::of(round, (known, machine), campaign, axis)? {
            all.extend(places.best(round, (known, machine))?);
        }
    }
    Ok(all)
}

/// Places of a step along one axis: place `k` lies between the groups of readings `k` and `k + 1`.
struct Places {
    axis: Axis,
    /// Lowest and highest reading of each group of readings at one place (m), ascending.
    groups_m: Vec<(f64, f64)>,
    /// Group of each row used, and what a unit of step does to its range.
    rows: Vec<Option<(usize, f64)>>,
    /// Places with lines enough before and beyond.
    open: std::ops::Range<usize>,
    /// What has been scored.
    reductions: BTreeMap<usize, f64>,
}

impl Places {
    fn of(
        round: &Round,
        (known, machine): (&'static Known, &Machine),
        campaign: &Campaign,
        axis: Axis,
    ) -> Result<Option<Places>, DiagnoseError> {
        let reading_m = |k: &usize| campaign.readings[*k].reading_m[axis.index()];
        let mut used: Vec<usize> = (0..round.rows.len()).filter(|k| round.rows.whitening[*k] > 0.0).collect();
        used.sort_by(|a, b| reading_m(a).total_cmp(&reading_m(b)));
        let Some(lowest_m) = used.first().map(reading_m) else { return Ok(None) };
        // Beyond a step before all readings is every one.
        let before_all = shape(axis, (lowest_m - 2.0, lowest_m - 1.0));
        let partials = round.rows.partials(EffectTerm::new(known.name, before_all, machine)?.effect.as_ref())?;
        let mut groups_m: Vec<(f64, f64)> = Vec::new();
        let mut rows = vec![None; round.rows.len()];
        let mut lines = Vec::new();
        for k in &used {
            match groups_m.last_mut() {
                Some((_, highest_m)) if reading_m(k) - *highest_m <= AT_PLACE_M => *highest_m = reading_m(k),
                _ => groups_m.push((reading_m(k), reading_m(k))),
            }
            rows[*k] = Some((groups_m.len() - 1, partials[(*k, 0)]));
            lines.push((groups_m.len() - 1, campaign.readings[*k].line));
        }
        let last = groups_m.len() - 1;
        let first_open = enough(lines.iter().copied());
        let last_open = enough(lines.iter().rev().copied());
        let open = match (first_open, last_open) {
            (Some(low), Some(high)) if low < high => low..high.min(last),
            _ => return Ok(None),
        };
        Ok(Some(Places { axis, groups_m, rows, open, reductions: BTreeMap::new() }))
    }

    /// The step between the readings that leave its place open; `None` where a slope explains as much.
    fn best(
        &mut self,
        round: &Round,
        (known, machine): (&'static Known, &Machine),
    ) -> Result<Option<Candidate>, DiagnoseError> {
        let mut stride = self.open.len().div_ceil(COARSE).max(1);
        self.score(round, self.open.clone().step_by(stride));
        while stride > 1 {
            let Some((best, _)) = self.highest() else { return Ok(None) };
            let closer = (2 * stride).div_ceil(CLOSER);
            self.score(round, (self.within(best, stride)).step_by(closer));
            stride = closer;
        }
        let Some((best, highest)) = self.highest() else { return Ok(None) };
        let noise = round.free.noise_factor();
        let least = highest - UNSURE * noise;
        let (low, high) = (self.outermost(round, best, least, false), self.outermost(round, best, least, true));
        let between_m = (self.groups_m[low].1, self.groups_m[high + 1].0);
        let middle_m = 0.5 * (self.groups_m[best].1 + self.groups_m[best + 1].0);
        let (lower_m, upper_m) = machine.stroke_m[self.axis.index()];
        let gap_m = self.groups_m[best + 1].0 - self.groups_m[best].1;
        let slope = |share: f64| {
            let half_m = 0.5 * (gap_m + share * (upper_m - lower_m));
            (middle_m - half_m, middle_m + half_m)
        };
        let shapes = std::iter::once(between_m).chain(SLOPES.map(slope));
        let terms = shapes.map(|between_m| {
            Ok((known, EffectTerm::new(known.name, shape(self.axis, between_m), machine)?, self.open.len()))
        });
        let mut scored = score_all(round, terms.collect::<Result<_, DiagnoseError>>()?)?;
        let slopes = scored.split_off(1);
        let as_well = |slope: &Candidate| slope.score.reduction > highest - SHARPER * noise;
        Ok(scored.pop().filter(|_| !slopes.iter().any(as_well)))
    }

    /// Places at most so far from one.
    fn within(&self, place: usize, distance: usize) -> std::ops::Range<usize> {
        place.saturating_sub(distance).max(self.open.start)..(place + distance + 1).min(self.open.end)
    }

    fn highest(&self) -> Option<(usize, f64)> {
        self.reductions.iter().map(|(place, value)| (*place, *value)).max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The outermost place above or below one that explains at least so much.
    fn outermost(&mut self, round: &Round, from: usize, least: f64, above: bool) -> usize {
        let open = self.open.clone();
        outermost(&open, from, above, |places| {
            self.score(round, places.iter().copied());
            let explains = |place: &usize| self.reductions.get(place).is_some_and(|value| *value >= least);
            places.iter().map(explains).collect()
        })
    }

    /// Scores steps at these places, all together.
    fn score(&mut self, round: &Round, places: impl Iterator<Item = usize>) {
        let places: Vec<usize> = places.filter(|place| !self.reductions.contains_key(place)).collect();
        let column = |place: &usize| {
            let beyond =
                |row: &Option<(usize, f64)>| row.filter(|(group, _)| group > place).map_or(0.0, |(_, unit)| unit);
            let mut column = Mat::from_fn(self.rows.len(), 1, |k, _| beyond(&self.rows[k]));
            round.rows.whiten(column.col_as_slice_mut(0));
            column
        };
        let columns: Vec<Mat<f64>> = places.iter().map(column).collect();
        let scores = round.free.project_all(&columns).into_iter().map(|group| round.score(&group));
        self.reductions.extend(places.into_iter().zip(scores.map(|score: Score| score.reduction)));
    }
}

/// The outermost of these places, above or below one that is open, that is open as well, as `are_open` says of some; with growing
/// strides, so that what lies between two that were tried counts as open.
fn outermost(
    places: &std::ops::Range<usize>,
    from: usize,
    above: bool,
    mut are_open: impl FnMut(&[usize]) -> Vec<bool>,
) -> usize {
    let (mut outermost, mut tried, mut is_open, mut stride) = (from, from, true, 1);
    loop {
        // Up to the next one that would be tried.
        let up_to_next = |place: usize| match above {
            true => (place + stride - 1).min(places.end - 1),
            false => place.saturating_sub(stride - 1).max(places.start),
        };
        let beyond = |k: usize| if above { tried.checked_add(k * stride) } else { tried.checked_sub(k * stride) };
        let batch: Vec<usize> = (1..=CLOSER).map_while(beyond).filter(|k| places.contains(k)).collect();
        let open = are_open(&batch);
        let found = batch.iter().zip(open).rev().find(|(_, is_open)| *is_open);
        let (Some((found, _)), Some(last)) = (found, batch.last()) else {
            return if is_open { up_to_next(tried) } else { outermost };
        };
        outermost = up_to_next(*found);
        (tried, is_open, stride) = (*last, found == last, 2 * stride);
    }
}

fn shape(axis: Axis, (from_m, to_m): (f64, f64)) -> Shape {
    Shape::new().text("axis", axis.lower()).number("from_m", from_m).number("to_m", to_m)
}

/// Group at which lines enough were met.
fn enough(readings: impl Iterator<Item = (usize, u32)>) -> Option<usize> {
    let mut met = BTreeSet::new();
    readings.into_iter().find(|(_, line)| met.insert(*line) && met.len() >= LEAST_LINES).map(|(group, _)| group)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ends of the places at which a step explains enough.
    fn ends(open: &[bool], from: usize) -> (usize, usize) {
        let of = |places: &[usize]| places.iter().map(|place| open[*place]).collect();
        (outermost(&(0..open.len()), from, false, of), outermost(&(0..open.len()), from, true, of))
    }

    /// With few places all of them were tried, and one open beside the best made the interval run to the end of the axis.
    #[test]
    fn regress_an_interval_ends_at_the_last_open_place() {
        for count in 3..200 {
            for from in 0..count {
                let alone: Vec<bool> = (0..count).map(|place| place == from).collect();
                assert_eq!(ends(&alone, from), (from, from), "{count}");
                let beside: Vec<bool> = (0..count).map(|place| place.abs_diff(from) <= 1).collect();
                assert_eq!(ends(&beside, from), (from.saturating_sub(1), (from + 1).min(count - 1)), "{count}");
            }
            let all = vec![true; count];
            assert_eq!(ends(&all, count / 2), (0, count - 1), "{count}");
        }
    }

    #[test]
    fn what_lies_between_two_that_were_tried_counts_as_open_and_no_more() {
        for wide in 1..150_usize {
            let open: Vec<bool> = (0..400_usize).map(|place| place.abs_diff(200) <= wide).collect();
            let (low, high) = ends(&open, 200);
            assert!(low <= 200 - wide && high >= 200 + wide, "{wide}: {low} {high}");
            // A stride is at most an eighth of what was open by then.
            assert!(200 - low <= wide + wide / 8 + 1 && high - 200 <= wide + wide / 8 + 1, "{wide}: {low} {high}");
        }
    }
}
