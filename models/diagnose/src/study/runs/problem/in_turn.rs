//! Runs in which one target was measured after the other, as in the step cycle of ISO 230-2: what goes with the time goes with the place.
//!
//! Place in the flow: beside the study's problem. A drift of the laser or of the machine is then an error of position, and is said. A temperature
//! that rose meanwhile goes with the place, too: what of it is an expansion, what a shift of all targets and what an
//! error of position, nothing tells, so that a model of such runs holds each in its uncertainty. SI.

use super::super::Run;
use super::super::model::{axis_of, untold_bow, untold_growth};
use super::super::shape::Shape;
use super::{AxisRuns, Runs};
use crate::columns::{correlation, range};
use crate::study::candidate::{Open, Untold};
use std::collections::BTreeSet;

/// Correlation with the place from which a quantity goes with it. There and back in each cycle leaves none; a single way there, or each target in its
/// turn, nearly all.
const ALONG: f64 = 0.9;

impl Runs {
    /// What nobody can tell of axes that were measured so, in words.
    pub(super) fn one_after_the_other(&self) -> Vec<String> {
        let one = |axis: &AxisRuns| {
            if !self.goes_along(axis, &|run| run.time_s) {
                return None;
            }
            let names: BTreeSet<&String> = axis.rows.iter().flat_map(|row| self.runs[*row].covariates.keys()).collect();
            let goes_along = |name: &&&String| self.goes_along(axis, &|run| run.covariates.get(**name).copied());
            let names: Vec<&str> = names.iter().filter(goes_along).map(|name| name.as_str()).collect();
            // Without times nobody says so.
            let order = if axis.ranges.is_order { ", if the rows stand in the order of measurement" } else { "" };
            let quantities = match names.as_slice() {
                [] => String::new(),
                names => format!(", with {} as well", names.join(", ")),
            };
            Some(format!(
                "on axis {} a drift of the laser or of the machine: one target was measured after the other{order}, so that what goes with the time is an \
                 error of position{quantities}; go to all targets and back in each cycle, or end at the targets that you began with",
                axis.name
            ))
        };
        self.axes.iter().filter_map(one).collect()
    }

    /// Of each axis the errors and the reversal of all its targets, which are tried as one: where one target was measured after the other, each of
    /// them alone leaves steps in time, as slow noise does.
    pub(super) fn tables(&self) -> Vec<Vec<usize>> {
        let is_table = |shape: &Shape| matches!(shape, Shape::PositionTable | Shape::LostTable);
        let of = |axis: usize| {
            let own = |k: &usize| self.shapes[*k].0 == axis && is_table(&self.shapes[*k].1);
            (0..self.shapes.len()).filter(own).collect()
        };
        (0..self.axes.len()).map(of).collect()
    }

    /// What a dependence on a temperature that rose along with the targets leaves open: an expansion about any place of the axis in its stead, or a
    /// shift, and the slope and the bow of the position that are there then.
    pub(super) fn untold_in_turn(&self, open: &Open) -> Vec<Untold> {
        let one = |candidate: &usize| {
            let (of, shape) = &self.shapes[*candidate];
            let axis = &self.axes[*of];
            let name = self.covariates_c(*candidate).next()?;
            let (own, value) = (axis_of(&axis.name)?, |run: &Run| run.covariates.get(&name).copied());
            if !self.goes_along(axis, &value) {
                return None;
            }
            let (low_c, high_c) = range(axis.rows.iter().filter_map(|row| value(&self.runs[*row])));
            let (low_m, high_m) = axis.ranges.target_m;
            let (half_c, half_m) = (0.5 * (high_c - low_c), 0.5 * (high_m - low_m));
            let values = (open.values)(*candidate);
            let found = match shape {
                Shape::Expansion(_) => values.get(1)?.abs(),
                _ => values.iter().map(|value| value.abs()).sum::<f64>() / half_c,
            };
            let grows = open.overlooked_per_k(None) * half_m;
            let shifts = found.hypot(grows / 3f64.sqrt());
            let what = format!("the slope and the bow of {}: {name} rose along with its targets", own.letter());
            let untold = |term, u, reads| Untold { what: what.clone(), is_usual: false, term, u, reads };
            let growth = untold_growth(own, &axis.ranges, &name, 0.5 * (low_c + high_c));
            Some([
                untold(untold_bow(own, &axis.ranges), vec![0.0, shifts * half_c, grows * half_c], None),
                untold(growth, vec![shifts, grows], Some(name.clone())),
            ])
        };
        open.found.iter().filter_map(one).flatten().collect()
    }

    /// Whether what runs have goes along with their targets.
    fn goes_along(&self, axis: &AxisRuns, of: &dyn Fn(&Run) -> Option<f64>) -> bool {
        let both = axis.rows.iter().filter_map(|row| Some((of(&self.runs[*row])?, self.runs[*row].target_m)));
        let (values, targets): (Vec<f64>, Vec<f64>) = both.unzip();
        correlation(&values, &targets).abs() > ALONG
    }
}
