//! What positioning runs leave open of a model that is made of them: sides of approach and temperatures at which an axis was not measured.
//!
//! Place in the flow: beside the study's problem; shapes are those of [`super::super::model`]. The reversal of an axis that was approached from
//! one side is not known: the model has it as a term that is zero on that side, and may be anything usual on the other. Likewise the expansion
//! of an axis at temperatures that other axes saw and its own runs did not. Of what was logged it is said where axes were measured in different
//! ranges. SI, and the units of logged quantities.

use super::super::model::{self, approached_otherwise, axis_of};
use super::super::shape::{Shape, is_temperature};
use super::{AxisRuns, Runs};
use crate::columns::range;
use crate::study::candidate::{Open, Study, Untold};
use abbe_geometry::unseen_expansion::UnseenExpansion;
use std::collections::BTreeSet;

/// Standard deviation of a reversal that nobody measured (m): what is believed of backlash before a campaign.
const REVERSAL_M: f64 = 50e-6;
/// Share of the range of all axes that one of them may lack and still have seen it.
const SEEN: f64 = 0.25;
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
                is_usual: true,
                term: approached_otherwise(own, &axis.ranges, side),
                u: vec![REVERSAL_M],
                reads: Some(model::sign_of(own)),
            })
        };
        self.axes.iter().filter_map(one).collect()
    }

    /// What an axis does at temperatures that it did not see, and other axes did: it grows by what its own runs leave open of its expansion, from
    /// anywhere on its stroke.
    pub(super) fn untold_expansions(&self, open: &Open) -> Vec<Untold> {
        let one = |(candidate, (of, shape)): (usize, &(usize, Shape))| {
            let (axis, Shape::Expansion(name)) = (&self.axes[*of], shape) else { return None };
            let is_told = |k: &usize| self.shapes[*k].0 == *of && self.shapes[*k].1.reads(name);
            self.untold_expansion(axis, name, open.overlooked_per_k(Some(candidate)))
                .filter(|_| !open.found.iter().any(is_told))
        };
        let varied = self.shapes.iter().enumerate().filter_map(one);
        // What did not vary in the runs of an axis is no candidate of it.
        let held = self.axes.iter().flat_map(|axis| {
            let names: BTreeSet<&String> = axis.rows.iter().flat_map(|row| self.runs[*row].covariates.keys()).collect();
            let is_held = |name: &&String| is_temperature(name) && axis.quantities.iter().all(|(own, ..)| own != *name);
            names
                .into_iter()
                .filter(is_held)
                .filter_map(|name| self.untold_expansion(axis, name, open.overlooked_per_k(None)))
                .collect::<Vec<_>>()
        });
        varied.chain(held).collect()
    }

    fn untold_expansion(&self, axis: &AxisRuns, name: &str, per_k: f64) -> Option<Untold> {
        let own = axis_of(&axis.name)?;
        let ((low_c, high_c), (least_c, most_c)) = (self.range_of(axis, name)?, self.measured_range(name)?);
        if (most_c - least_c) - (high_c - low_c) <= SEEN * (most_c - least_c) {
            return None;
        }
        let (low_m, high_m) = axis.ranges.target_m;
        let half_m = 0.5 * (high_m - low_m);
        Some(Untold {
            what: format!(
                "expansion of {} by {name}: its runs saw {low_c:.1} to {high_c:.1} C, those of others {least_c:.1} to {most_c:.1} C",
                own.letter()
            ),
            is_usual: true,
            term: model::untold_growth(own, &axis.ranges, name, 0.5 * (low_c + high_c)),
            // The place that stays where it is may be anywhere along the axis.
            u: vec![per_k * half_m / 3f64.sqrt(), per_k * half_m],
            reads: Some(name.to_owned()),
        })
    }

    /// What the runs of each axis leave open of its expansion, where no term holds it.
    pub(super) fn unseen(&self, open: &Open) -> Vec<UnseenExpansion> {
        let names: BTreeSet<&String> = self.runs.iter().flat_map(|run| run.covariates.keys()).collect();
        let one = |name: &String| {
            let mut all = UnseenExpansion { sensor: name.clone(), ..UnseenExpansion::default() };
            for (of, axis) in self.axes.iter().enumerate() {
                let Some(own) = axis_of(&axis.name) else { continue };
                let values = axis.rows.iter().filter_map(|row| self.runs[*row].covariates.get(name));
                let (count, sum) = values.fold((0.0, 0.0), |(count, sum), value| (count + 1.0, sum + value));
                // What stretches the axis says what a temperature does to it.
                let stretches = |k: &usize| match &self.shapes[*k] {
                    (axis, Shape::Expansion(name) | Shape::ScaleBy(name)) => *axis == of && is_temperature(name),
                    _ => false,
                };
                if count == 0.0 || open.found.iter().any(stretches) {
                    continue;
                }
                let expansion = Shape::Expansion(name.clone());
                let candidate = self.shapes.iter().position(|(axis, shape)| *axis == of && *shape == expansion);
                let per_k = open.overlooked_per_k(candidate);
                all.at_c[own.index()] = sum / count;
                // Beside the term of an axis whose runs saw less than those of others.
                if self.untold_expansion(axis, name, per_k).is_none() {
                    all.per_kelvin[own.index()] = per_k;
                }
            }
            all
        };
        names.into_iter().filter(|name| is_temperature(name)).map(one).collect()
    }

    /// Temperatures that a candidate reads.
    pub(super) fn covariates_c(&self, candidate: usize) -> impl Iterator<Item = String> {
        self.model_covariates(candidate).into_iter().filter(|name| is_temperature(name))
    }

    /// Errors that are the same at all targets, in words.
    pub(super) fn repeating(&self) -> Vec<String> {
        let one = |axis: &AxisRuns| {
            let step_mm = axis.common_step_m? * 1e3;
            Some(format!(
                "on axis {} an error that repeats at {step_mm:.3} mm, of which all steps of its targets are whole multiples, or at a \
                 whole part of it, as with the lead of a screw",
                axis.name
            ))
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
