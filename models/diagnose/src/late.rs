//! What was off in the last lines of a campaign, of which nothing says that it ended.
//!
//! Place in the flow: near the end of [`crate::diagnose()`], on the model that is adopted. A scale that slips when nearly all is measured leaves
//! a few lines off. They are found as lines that stand out, or as a jump of the instrument in the end, and fit well so; too few are left to
//! tell a motion of the machine. Lines that stand out in the middle are followed by others that do not: what it was is over. After the last
//! ones nobody looked. What they are off by may hold from then on, so that it stands in the uncertainty. Ranges in m.

use crate::candidates::Round;
use crate::error::DiagnoseError;
use crate::tomorrow::DIRECTIONS;
use abbe_geometry::model::{FittedEffect, MachineModel, ModelError};
use abbe_measurement::campaign::Campaign;

/// Share of the readings that the last lines are at most: more of them tell by themselves what moved.
const LAST: f64 = 0.1;
/// Share of the last lines that are off: one across the motion does not show it.
const OFF: f64 = 0.5;

/// The last lines, as far as they are off.
#[derive(Debug, Clone, PartialEq)]
pub struct Late {
    lines: Vec<String>,
    /// Standard deviation that it may have along each axis from then on (m).
    deviation_m: f64,
}

/// A line as it was driven.
struct Driven {
    line: usize,
    start_s: f64,
    readings: usize,
    /// Sum of the squares of what was found on its readings alone (m²).
    square_m2: f64,
}

impl Late {
    /// Of what a diagnosis found; `None` where the last lines are as the others.
    pub(crate) fn of<'a>(
        found: impl Iterator<Item = &'a FittedEffect>,
        round: &Round,
        campaign: &Campaign,
    ) -> Result<Option<Late>, DiagnoseError> {
        let mut on_reading_m = vec![0.0; campaign.readings.len()];
        for fitted in found.filter(|fitted| stands_out(fitted)) {
            round.on_ranges_m(fitted)?.into_iter().for_each(|(k, value_m)| on_reading_m[k] += value_m);
        }
        let of_line = |line| Driven { line, start_s: f64::INFINITY, readings: 0, square_m2: 0.0 };
        let mut driven: Vec<Driven> = (0..campaign.lines.len()).map(of_line).collect();
        for (reading, value_m) in campaign.readings.iter().zip(on_reading_m) {
            let own = &mut driven[reading.line as usize];
            own.start_s = own.start_s.min(reading.time_s);
            own.square_m2 += value_m * value_m;
            own.readings += 1;
        }
        driven.retain(|own| own.readings > 0);
        driven.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
        let last = last(&driven, (LAST * campaign.readings.len() as f64) as usize);
        let off: Vec<&Driven> = last.iter().filter(|own| own.square_m2 > 0.0).collect();
        let readings: usize = off.iter().map(|own| own.readings).sum();
        let square_m2 = off.iter().map(|own| own.square_m2).sum::<f64>() / readings.max(1) as f64;
        let lines = off.iter().map(|own| campaign.lines[own.line].clone()).collect();
        Ok((!off.is_empty()).then(|| Late { lines, deviation_m: (DIRECTIONS * square_m2).sqrt() }))
    }

    /// The model with it in its uncertainty.
    pub(crate) fn told(&self, model: MachineModel) -> Result<MachineModel, ModelError> {
        let own_m = model.parts().quality.unexplained_m;
        model.with_unexplained(own_m.map(|own_m| own_m.hypot(self.deviation_m)))
    }

    /// What it is, for readers.
    #[must_use]
    pub fn words(&self) -> String {
        format!(
            "The last lines are off ({}), and nothing was measured after them: what moved them may be the machine, which is as it was then from \
             there on; U holds it (k = 1: {:.2} µm along each axis).",
            self.lines.join(", "),
            self.deviation_m * 1e6
        )
    }

    /// What tells.
    pub(crate) fn next(&self) -> String {
        format!(
            "drive {} again, and some lines from the middle of the campaign: if they are off now, the machine is not what it was",
            self.lines.join(", ")
        )
    }
}

/// Whether an effect holds one line, or begins at an instant that a search found.
fn stands_out(fitted: &FittedEffect) -> bool {
    fitted.shape.0.contains_key("line") || fitted.effect.happens_once()
}

/// The most of the last lines, of so many readings together, that begin with one that is off and of which half are; none where there are none.
fn last(driven: &[Driven], most: usize) -> &[Driven] {
    let is_off = |own: &Driven| own.square_m2 > 0.0;
    let from = |first: usize| &driven[first..];
    let is_late = |first: &usize| {
        let own = from(*first);
        let off = own.iter().filter(|own| is_off(own)).count();
        own.iter().map(|own| own.readings).sum::<usize>() <= most
            && is_off(&own[0])
            && off as f64 >= OFF * own.len() as f64
    };
    (0..driven.len()).find(is_late).map_or(&[], from)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn driven(off: &[bool]) -> Vec<Driven> {
        let one = |(line, off): (usize, &bool)| Driven {
            line,
            start_s: line as f64,
            readings: 10,
            square_m2: if *off { 1e-12 } else { 0.0 },
        };
        off.iter().enumerate().map(one).collect()
    }

    fn count(off: &[bool]) -> usize {
        last(&driven(off), 40).len()
    }

    #[test]
    fn the_last_lines_are_late_where_most_of_them_are_off() {
        let (on, off) = (false, true);
        assert_eq!(count(&[on, on, on, on, off, off, on, off]), 4);
        assert_eq!(count(&[on, on, on, on, on, on, off]), 1);
        assert_eq!(count(&[on, on, on, on, on, off, on]), 2, "the last one may lie across the motion");
        assert_eq!(count(&[on, on, on, off, off, on, on]), 4, "so may two");
        assert_eq!(count(&[on, on, on, on, off, on, on]), 0, "two lines say that it is over");
        assert_eq!(count(&[off, on, on, on, on, on, on]), 0);
        assert_eq!(count(&[on, off, off, off, off, off]), 4, "more would tell by themselves");
        assert_eq!(count(&[]), 0);
    }
}
