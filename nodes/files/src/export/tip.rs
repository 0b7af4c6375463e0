//! What tables of the positioning of one axis do to a tip, and the table that does most for one.
//!
//! Place in the flow: beside [`SampledErrors`], for formats that hold each axis by itself ([`super::Writer::Positions`]). E_XX is the error at
//! the pivot of X: all other readings and the offset of the tip zero. A tip works elsewhere, where angular errors move it along the axis as
//! well, and a table of the pivot can make its error larger. So every such table says what it does to the error of a tip along its axis over
//! the volume that was measured (m), free of its mean, which is a matter of zero. One made for a tip is what least squares over that volume
//! give: with errors e(x, y, z) along X, the mean of e over y and z by x, up to a constant. Angular errors act by levers, which are linear in
//! y and z, so that this mean is the error in the middle of them.

use super::volume::{grid_m, seen_m};
use super::{About, fixed, geometric_error_m, of_places};
use abbe_geometry::axis::{Axis, ErrorId};
use abbe_geometry::sampled::{SampledAxis, SampledErrors};

/// Beginning of the line of a head that says what the tables do to the tip.
pub const TIP: &str = "tip: ";
/// Beginning of the line of a head that says that they make it worse.
pub const LARGER: &str = "LARGER: ";
/// Nodes of each axis at which the error is looked at.
const NODES: usize = 9;
/// Parts into which each step is cut where table and function are compared.
const CHECKS_PER_STEP: usize = 8;
/// Changes of an error (m) that are none: a controller resolves no less.
const SAME_M: f64 = 1e-9;

/// The error of the tip along an axis, rms (m).
struct Along {
    axis: Axis,
    before_m: f64,
    after_m: f64,
}

impl About {
    /// For tables that are to be made for a tip at this offset (m, ram frame).
    #[must_use]
    pub fn for_tip(self, offset_m: [f64; 3]) -> About {
        About { tip_m: offset_m, is_for_tip: true, ..self }
    }

    /// These errors, with the positioning of each axis that of the tip where tables are to be made for one.
    #[must_use]
    pub fn at_tip(&self, errors: SampledErrors) -> SampledErrors {
        if !self.is_for_tip {
            return errors;
        }
        SampledErrors { axes: errors.axes.map(|axis| self.moved(axis)), ..errors }
    }

    /// An axis with what its angular errors do to the tip along it.
    fn moved(&self, mut axis: SampledAxis) -> SampledAxis {
        let (own, nodes_m) = (axis.axis.index(), axis.positions_m.clone());
        let first_m = self.by_lever_m(axis.axis, nodes_m[0]);
        let by_lever_m: Vec<f64> =
            nodes_m.iter().map(|position_m| self.by_lever_m(axis.axis, *position_m) - first_m).collect();
        let mut missed_m = 0.0_f64;
        for (ends_m, values_m) in nodes_m.windows(2).zip(by_lever_m.windows(2)) {
            for k in 1..CHECKS_PER_STEP {
                let share = k as f64 / CHECKS_PER_STEP as f64;
                let there_m = self.by_lever_m(axis.axis, ends_m[0] + (ends_m[1] - ends_m[0]) * share) - first_m;
                missed_m = missed_m.max((values_m[0] + (values_m[1] - values_m[0]) * share - there_m).abs());
            }
        }
        axis.errors.iter_mut().zip(by_lever_m).for_each(|(node, moved_m)| node[own] += moved_m);
        // Both together miss no more than both by themselves.
        axis.missed[own] += missed_m;
        axis
    }

    /// What moves the tip along an axis at a reading of it beside its positioning error, the others in the middle of what was measured (m).
    fn by_lever_m(&self, axis: Axis, position_m: f64) -> f64 {
        let reading_m = Axis::ALL.map(|other| {
            let (lower_m, upper_m) = seen_m(self, other);
            if other == axis { position_m } else { 0.5 * (lower_m + upper_m) }
        });
        geometric_error_m(&self.model, &[], reading_m, self.tip_m)[axis.index()]
            - self.model.error(ErrorId::linear(axis, axis), position_m).0
    }

    /// What the values of a table are, in words.
    pub(super) fn positions_words(&self) -> String {
        match self.is_for_tip {
            false => "positioning errors of each axis by itself, nothing else of the model".to_owned(),
            true => format!(
                "errors along each axis of a tip at {} mm (ram frame), with the other axes in the middle of what was measured: positioning and \
                 angular errors times lever, nothing else of the model",
                mm(self.tip_m, " ")
            ),
        }
    }

    /// Lines of the head: what the tables of these axes do to the tip, and that they make it worse.
    pub(super) fn tip_lines(&self, errors: &SampledErrors, without: &[Axis]) -> Vec<String> {
        let tables = errors.axes.iter().filter(|axis| !without.contains(&axis.axis));
        let along: Vec<Along> = tables.filter_map(|axis| self.along(axis)).collect();
        if along.is_empty() {
            return Vec::new();
        }
        let volume_m = Axis::ALL.map(|axis| seen_m(self, axis));
        let figures: Vec<String> = along.iter().map(Along::words).collect();
        let words = format!(
            "{TIP}error of a tip at {} mm (ram frame) along each axis over readings X Y Z from {} to {} mm, free of its mean and without \
             reversal, um rms without and with this table: {}",
            mm(self.tip_m, " "),
            mm(volume_m.map(|(lower_m, _)| lower_m), " "),
            mm(volume_m.map(|(_, upper_m)| upper_m), " "),
            figures.join(", ")
        );
        let larger: Vec<&Along> = along.iter().filter(|own| own.after_m > own.before_m + SAME_M).collect();
        let worse = (!larger.is_empty()).then(|| self.larger_words(&larger));
        std::iter::once(words).chain(worse).collect()
    }

    fn larger_words(&self, larger: &[&Along]) -> String {
        let figures: Vec<String> = larger.iter().map(|own| own.words()).collect();
        let why = match self.is_for_tip {
            false => format!(
                "it holds the errors at the pivots, and angular errors move a tip elsewhere; make it for the tip with --offset-mm {}, or correct \
                 with abbe correct",
                mm(self.tip_m, ",")
            ),
            true => "correct with abbe correct".to_owned(),
        };
        format!("{LARGER}this table makes the error of the tip larger (um rms: {}): {why}", figures.join(", "))
    }

    /// What a table does to the tip along its axis; `None` where the axis was measured at one place, or nowhere in its stroke.
    fn along(&self, table: &SampledAxis) -> Option<Along> {
        let own = table.axis.index();
        let identified_m = self.model.parts().identified.reading_m[own];
        let volume_m = Axis::ALL.map(|axis| seen_m(self, axis));
        let is_measured = identified_m.0 < volume_m[own].1 && identified_m.1 > volume_m[own].0;
        if !is_measured || volume_m[own].0 >= volume_m[own].1 {
            return None;
        }
        let (places_m, effects) = (grid_m(&volume_m, NODES), of_places(&self.model));
        let error_m = |place_m: [f64; 3]| geometric_error_m(&self.model, &effects, place_m, self.tip_m)[own];
        let before_m: Vec<f64> = places_m.iter().map(|place_m| error_m((*place_m).into())).collect();
        let after_m = places_m.iter().zip(&before_m).map(|(place_m, error_m)| error_m - value_m(table, place_m[own]));
        Some(Along { axis: table.axis, before_m: rms_m(&before_m), after_m: rms_m(&after_m.collect::<Vec<_>>()) })
    }
}

impl Along {
    fn words(&self) -> String {
        format!("{} {} -> {}", self.axis.letter(), fixed(self.before_m * 1e6, 3), fixed(self.after_m * 1e6, 3))
    }
}

fn mm(values_m: [f64; 3], between: &str) -> String {
    values_m.map(|m| fixed(m * 1e3, 4)).join(between)
}

/// What a table says at a reading, linear between its nodes (m).
fn value_m(table: &SampledAxis, position_m: f64) -> f64 {
    let (nodes_m, own) = (&table.positions_m, table.axis.index());
    let after = nodes_m.partition_point(|node_m| *node_m <= position_m).clamp(1, nodes_m.len() - 1);
    let share = (position_m - nodes_m[after - 1]) / (nodes_m[after] - nodes_m[after - 1]);
    let [left_m, right_m] = [after - 1, after].map(|k| table.errors[k][own]);
    left_m + (right_m - left_m) * share
}

/// Root mean square of what is left beside the mean.
fn rms_m(errors_m: &[f64]) -> f64 {
    let mean_m = errors_m.iter().sum::<f64>() / errors_m.len() as f64;
    (errors_m.iter().map(|error_m| (error_m - mean_m).powi(2)).sum::<f64>() / errors_m.len() as f64).sqrt()
}
