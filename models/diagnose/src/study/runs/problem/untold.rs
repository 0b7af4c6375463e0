//! What positioning runs leave open of a model that is made of them: sides of approach and temperatures at which an axis was not measured.
//!
//! Place in the flow: beside the study's problem; shapes are those of [`super::super::model`]. The reversal of an axis that was approached from
//! one side is not known: the model has it as a term that is zero on that side, and may be anything usual on the other. Of temperatures it
//! is said where axes were measured in different ranges. SI, and the units of logged quantities.

use super::super::model::{self, approached_otherwise, axis_of};
use super::{AxisRuns, Runs};
use crate::context::range;
use crate::study::candidate::Untold;
use std::collections::BTreeSet;

/// Standard deviation of a reversal that nobody measured (m): what is believed of backlash before a campaign.
const REVERSAL_M: f64 = 50e-6;
/// Share of the widest range of an axis that all axes share, below which they were measured apart.
const SHARED: f64 = 0.5;

impl Runs {
    /// The one side from which an axis was approached; `None` where both were.
    pub(super) fn only_side(&self, axis: &AxisRuns) -> Option<f64> {
        let mut sides = axis.rows.iter().map(|row| self.runs[*row].approach.sign());
        let first = sides.next()?;
        sides.all(|side| side == first).then_some(first)
    }

    /// Range of a quantity that a model reads: times since the first run.
    pub(super) fn measured_range(&self, name: &str) -> Option<(f64, f64)> {
        match name {
            model::CYCLE => Some(range(self.runs.iter().map(|run| run.cycle as f64))),
            model::TIME => {
                let timed = self.axes.iter().filter(|axis| !axis.ranges.is_order);
                let last_s = timed.filter_map(|axis| axis.ranges.time_s).map(|(_, last)| last).reduce(f64::max)?;
                Some((0.0, last_s - self.start_s))
            }
            // Where nobody says from which side, it may be either.
            sign if sign.starts_with("dir_") => Some((-1.0, 1.0)),
            name => {
                let all = || self.axes.iter().filter_map(|axis| self.range_of(axis, name));
                all().reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
            }
        }
    }

    /// Reversals that nobody measured.
    pub(super) fn untold_reversals(&self) -> Vec<Untold> {
        let one = |axis: &AxisRuns| {
            let (own, side) = (axis_of(&axis.name)?, self.only_side(axis)?);
            let [from, other] = if side > 0.0 { ["+", "-"] } else { ["-", "+"] };
            Some(Untold {
                what: format!(
                    "{} in approaches in {other}: it was measured in approaches in {from} only",
                    own.letter()
                ),
                term: approached_otherwise(own, &axis.ranges, side),
                u: REVERSAL_M,
                reads: model::sign_of(own),
            })
        };
        self.axes.iter().filter_map(one).collect()
    }

    /// Logged quantities at which axes were measured in different ranges, in words with these.
    pub(super) fn ranges_apart(&self) -> Vec<String> {
        let names: BTreeSet<&String> = self.runs.iter().flat_map(|run| run.covariates.keys()).collect();
        let one = |name: &&String| {
            let each: Vec<(&str, (f64, f64))> =
                self.axes.iter().filter_map(|axis| Some((axis.name.as_str(), self.range_of(axis, name)?))).collect();
            let widest = each.iter().map(|(_, (low, high))| high - low).fold(0.0, f64::max);
            let (low, high) = each.iter().map(|(_, range)| *range).reduce(|a, b| (a.0.max(b.0), a.1.min(b.1)))?;
            let words = each.iter().map(|(axis, (low, high))| format!("{axis} {low:.2} to {high:.2}"));
            (high < low || high - low < SHARED * widest)
                .then(|| format!("{name} ({})", words.collect::<Vec<_>>().join(", ")))
        };
        names.iter().filter_map(one).collect()
    }

    fn range_of(&self, axis: &AxisRuns, name: &str) -> Option<(f64, f64)> {
        let values = axis.rows.iter().filter_map(|row| self.runs[*row].covariates.get(name).copied());
        let (low, high) = range(values);
        (low <= high).then_some((low, high))
    }
}
