//! How much of each stroke was driven.
//!
//! Place in the flow: from readings and machine alone, so that it can be asked before a fit and where a fit fails.

use super::{Cause, Finding, Grade, Subject};
use abbe_geometry::machine::Machine;

/// Shares of a stroke below which a reader is told, warned and refused.
const TOLD: f64 = 0.8;
const WARNED: f64 = 0.5;
const REFUSED: f64 = 0.1;
/// How much a share may exceed that of a whole stroke in another unit and still be explained by the unit: overtravel.
const OVERTRAVEL: f64 = 1.04;
/// Millimetres in an inch, a metre and a centimetre, and their names.
const UNITS: [(f64, &str); 3] = [(1e3, "metres"), (25.4, "inches"), (10.0, "centimetres")];

/// Grades the part of the machine's stroke that readings (m) span; nothing where it is nearly all.
pub fn stroke(machine: &Machine, readings_m: impl Iterator<Item = [f64; 3]>) -> Option<Finding> {
    stroke_along(machine, [true; 3], readings_m)
}

/// The same of these axes alone: a plate stands still along the others.
pub fn stroke_along(machine: &Machine, axes: [bool; 3], readings_m: impl Iterator<Item = [f64; 3]>) -> Option<Finding> {
    let mut spans = [(f64::INFINITY, f64::NEG_INFINITY); 3];
    for reading_m in readings_m {
        for (span, value) in spans.iter_mut().zip(reading_m) {
            *span = (span.0.min(value), span.1.max(value));
        }
    }
    let share = |d: usize| {
        let ((low, high), (lower, upper)) = (spans[d], machine.stroke_m[d]);
        (['X', 'Y', 'Z'][d], (high - low).max(0.0) / (upper - lower))
    };
    let shares: Vec<(char, f64)> = (0..3).filter(|d| axes[*d]).map(share).collect();
    let least = shares.iter().map(|(_, share)| *share).fold(f64::INFINITY, f64::min);
    let most = shares.iter().map(|(_, share)| *share).fold(0.0, f64::max);
    let grade = match least {
        little if little <= REFUSED => Grade::Refusal,
        half if half < WARNED => Grade::Warning,
        part if part < TOLD => Grade::Message,
        _ => return None,
    };
    let mut causes = Vec::new();
    // The largest unit that explains all axes is the likeliest: smaller ones would leave the machine nearly unused.
    if grade == Grade::Refusal
        && let Some((_, unit)) = UNITS.iter().find(|(mm, _)| most <= OVERTRAVEL / mm)
    {
        causes.push(Cause::Unit { unit });
    }
    if grade >= Grade::Warning {
        causes.push(Cause::OtherMachine { machine: machine.name.clone() });
    }
    causes.push(Cause::PartOfStroke);
    let shares = shares.into_iter().filter(|(_, share)| *share < TOLD).collect();
    Some(Finding { grade, subject: Subject::Stroke { shares }, causes })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::points::tests_machine;

    /// Corners of a part of the bridge's stroke of 0.8, 0.6 and 0.6 m.
    fn of(shares: [f64; 3]) -> Option<Finding> {
        let machine = tests_machine();
        let corner = [0.8 * shares[0], 0.6 * shares[1], 0.6 * shares[2]];
        stroke(&machine, [[0.0; 3], corner].into_iter())
    }

    #[test]
    fn a_part_of_the_stroke_is_graded_by_the_axis_that_moved_least() {
        assert_eq!(of([0.9, 0.95, 1.0]), None);
        let grades = [0.7, 0.4, 0.05].map(|least| of([1.0, least, 1.0]).map(|finding| finding.grade));
        assert_eq!(grades, [Grade::Message, Grade::Warning, Grade::Refusal].map(Some));
        let Some(Finding { subject: Subject::Stroke { shares }, .. }) = of([1.0, 0.4, 0.6]) else { panic!() };
        assert_eq!(shares.iter().map(|(letter, _)| *letter).collect::<String>(), "YZ");
    }

    #[test]
    fn a_unit_is_named_where_it_explains_all_axes() {
        let unit = |shares: [f64; 3]| match of(shares).unwrap().causes.first() {
            Some(Cause::Unit { unit }) => Some(*unit),
            _ => None,
        };
        assert_eq!(unit([1.0 / 25.4, 0.9 / 25.4, 0.95 / 25.4]), Some("inches"));
        assert_eq!(unit([1e-3, 0.9e-3, 0.95e-3]), Some("metres"));
        assert_eq!(unit([0.1, 0.09, 0.1]), Some("centimetres"));
        assert_eq!(unit([0.9, 0.01, 0.9]), None);
    }
}
