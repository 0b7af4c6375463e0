//! From length measurements to the figures of ISO 10360-2.
//!
//! Place in the flow: measurements (m) in; errors by line and length, R0, departures from the test out. The verdict is
//! a step of its own, with limit and decision rule as arguments, so that observed errors stand without any limit.

use super::summary::LineSummary;
use super::{LEAST_SHARE, LENGTHS, LengthMeasurement, LengthTest, Probing, REPEATS, diagonal};
use crate::decision::{DecisionRule, Verdict};
use crate::departure::Departure;
use crate::error::ConformityError;
use crate::frontier::Frontier;
use crate::limit::MaximumPermissibleError;
use crate::quantity::{ObservedError, PermissibleError};
use std::collections::BTreeMap;

/// An error of length measurement beyond this is a slip: wrong gauge, wrong unit (m).
const PLAUSIBLE_ERROR_M: f64 = 1e-3;
/// Lengths from here to there are believed (m).
const PLAUSIBLE_LENGTH_M: (f64, f64) = (0.5e-3, 100.0);
/// Where the longest length is below this, the lengths are metres (m): as two thirds of its travel it is that of no machine.
const SHORTEST_M: f64 = 5e-3;
/// A tool offset below this is a slip of units (m).
const LEAST_OFFSET_M: f64 = 1e-3;
/// A tool offset below this shows next to nothing of how the ram turns, which the test with an offset is for (m).
const SHORT_OFFSET_M: f64 = 0.05;
/// Nominal lengths of one gauge are the same to this (m).
const SAME_LENGTH_M: f64 = 1e-6;
/// A length may equal its travel, and a travel may be stated in whole millimetres (m).
const TRAVEL_ROUNDING_M: f64 = 1e-3;
/// How R0 is held against its limit: it is a range of measurements of one gauge, in which the gauge's uncertainty takes no part.
pub const REPEATABILITY_RULE: DecisionRule = DecisionRule::SimpleAcceptance;
/// Tolerance of the share of travel: what rounding of lengths to a nanometre can cost.
const SHARE_TOLERANCE: f64 = 1e-8;

/// Repeated measurements of one length on one line.
#[derive(Debug, Clone, PartialEq)]
pub struct LengthSet {
    /// Measuring line.
    pub line: String,
    /// Calibrated length (m).
    pub calibrated_m: f64,
    /// Errors in the order of the repeats.
    pub errors: Vec<ObservedError>,
}

impl LengthSet {
    /// Error with the largest magnitude.
    pub fn largest(&self) -> ObservedError {
        largest(self.errors.iter().copied())
    }

    /// Repeatability range: largest less smallest error; `None` for a single measurement.
    pub fn range(&self) -> Option<ObservedError> {
        (self.errors.len() > 1).then(|| {
            let values = || self.errors.iter().map(|e| e.metres());
            ObservedError::from_metres(
                values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min),
            )
        })
    }
}

/// Observed figures of a length test.
#[derive(Debug, Clone, PartialEq)]
pub struct LengthErrors {
    /// What the test was.
    pub test: LengthTest,
    /// All sets, by line in the order of the data, then by length.
    pub sets: Vec<LengthSet>,
    /// By line in the order of the data.
    pub lines: Vec<LineSummary>,
    /// What a whole test after the standard has and these data lack.
    pub departures: Vec<Departure>,
}

/// A length test held against limits.
#[derive(Debug, Clone, PartialEq)]
pub struct LengthVerdict {
    /// Every error against the limit at its length: the worst of all verdicts.
    pub errors: Verdict,
    /// Sets of repeats with exactly one error that does not conform, and with more.
    pub sets_with_one_beyond: usize,
    /// Sets with two or more errors that do not conform.
    pub sets_with_more_beyond: usize,
    /// R0 against its limit, where one is stated.
    pub repeatability: Option<Verdict>,
    /// True only for a whole test after the standard: without that nothing is verified.
    pub is_whole_test: bool,
}

impl LengthVerdict {
    /// Worst of all.
    pub fn overall(&self) -> Verdict {
        self.errors.max(self.repeatability.unwrap_or(Verdict::Conforms))
    }
}

/// Figures of a length test.
///
/// # Errors
/// No measurement; a figure that is not finite; the same measurement twice; lengths or errors of a size that only a slip
/// of units explains; a length above the travel along its line. What is merely missing from a whole test is a departure, not an error.
pub fn evaluate(test: LengthTest, measurements: &[LengthMeasurement]) -> Result<LengthErrors, ConformityError> {
    check_test(&test)?;
    let names = names(measurements)?;
    let mut sets: Vec<LengthSet> = Vec::new();
    for name in &names {
        sets.extend(sets_of(name, measurements)?);
    }
    let lines: Vec<LineSummary> = names.iter().map(|name| summary(name, &sets, &test)).collect();
    check_travel(&lines)?;
    let departures = departures(&test, &sets, &lines);
    Ok(LengthErrors { test, sets, lines, departures })
}

impl LengthErrors {
    /// Error with the largest magnitude, with its line and length (m).
    pub fn largest(&self) -> (ObservedError, &str, f64) {
        let mut best = (ObservedError::from_metres(0.0), "", 0.0);
        for set in &self.sets {
            if best.1.is_empty() || set.largest().magnitude_m() > best.0.magnitude_m() {
                best = (set.largest(), &set.line, set.calibrated_m);
            }
        }
        best
    }

    /// R0: largest repeatability range of all sets.
    pub fn repeatability(&self) -> Option<ObservedError> {
        self.lines.iter().filter_map(|line| line.range).max_by(|a, b| a.metres().total_cmp(&b.metres()))
    }

    /// All errors with their lengths (m).
    pub fn errors(&self) -> impl Iterator<Item = (f64, ObservedError)> {
        self.sets.iter().flat_map(|set| set.errors.iter().map(|error| (set.calibrated_m, *error)))
    }

    /// The limits A + L/K that hold all of these errors.
    ///
    /// # Errors
    /// None on data that [`evaluate()`] took.
    pub fn frontier(&self) -> Result<Frontier, ConformityError> {
        Frontier::of(self.errors())
    }

    /// The limits A + L/K to which all of these errors conform by a decision rule.
    ///
    /// # Errors
    /// None on data that [`evaluate()`] took.
    pub fn frontier_to_conform(&self, rule: &DecisionRule) -> Result<Frontier, ConformityError> {
        Frontier::of_limits(self.errors().map(|(length_m, error)| (length_m, rule.least_limit(error, length_m))))
    }

    /// Holds the errors against a limit, and R0 against one of its own.
    pub fn verdict(
        &self,
        limit: &MaximumPermissibleError,
        repeatability_limit: Option<PermissibleError>,
        rule: &DecisionRule,
    ) -> LengthVerdict {
        let (mut worst, mut one, mut more) = (Verdict::Conforms, 0, 0);
        for set in &self.sets {
            let at = limit.at(set.calibrated_m);
            let verdicts = set.errors.iter().map(|error| rule.decide(*error, at, set.calibrated_m));
            let mut beyond = 0;
            for verdict in verdicts {
                worst = worst.max(verdict);
                beyond += usize::from(verdict == Verdict::DoesNotConform);
            }
            one += usize::from(beyond == 1);
            more += usize::from(beyond > 1);
        }
        let against =
            |limit: PermissibleError| self.repeatability().map(|range| REPEATABILITY_RULE.decide(range, limit, 0.0));
        LengthVerdict {
            errors: worst,
            sets_with_one_beyond: one,
            sets_with_more_beyond: more,
            repeatability: repeatability_limit.and_then(against),
            is_whole_test: self.departures.is_empty(),
        }
    }
}

fn largest(errors: impl Iterator<Item = ObservedError>) -> ObservedError {
    errors.fold(ObservedError::from_metres(0.0), |best, e| if e.magnitude_m() > best.magnitude_m() { e } else { best })
}

fn check_test(test: &LengthTest) -> Result<(), ConformityError> {
    if !(test.tool_offset_m.is_finite() && (0.0..2.0).contains(&test.tool_offset_m)) {
        let problem = format!("{} m is no tool offset", test.tool_offset_m);
        return Err(ConformityError::new("tool offset", problem, "give 0 for E0, 0.15 m for E150"));
    }
    if test.tool_offset_m > 0.0 && test.tool_offset_m < LEAST_OFFSET_M {
        let problem = format!("{} mm is no tool offset", test.tool_offset_m * 1e3);
        return Err(ConformityError::new("tool offset", problem, "give 0 for E0, 150 mm for E150"));
    }
    for (line, travel_m) in &test.travel_m {
        if !(travel_m.is_finite() && *travel_m > 0.0) {
            let problem = format!("a travel of {travel_m} m is none");
            return Err(ConformityError::new(format!("line {line}"), problem, "give the travel along the line"));
        }
    }
    Ok(())
}

/// Names of the lines in the order of the data, every measurement checked.
fn names(measurements: &[LengthMeasurement]) -> Result<Vec<String>, ConformityError> {
    let mut names: Vec<String> = Vec::new();
    for m in measurements {
        let place = || format!("line {}, {} mm, repeat {}", m.line, m.calibrated_m * 1e3, m.repeat);
        let (least_m, most_m) = PLAUSIBLE_LENGTH_M;
        if !(m.calibrated_m.is_finite() && m.error.metres().is_finite()) {
            let problem = "the length or its error is not a finite number";
            return Err(ConformityError::new(place(), problem, "correct or remove the measurement"));
        }
        if !(least_m..=most_m).contains(&m.calibrated_m) {
            let problem = format!("{} m is no calibrated length", m.calibrated_m);
            return Err(ConformityError::new(place(), problem, "give calibrated lengths in millimetres"));
        }
        if m.error.magnitude_m() > PLAUSIBLE_ERROR_M {
            let problem =
                format!("an error of {:.3} mm is that of another gauge or another unit", m.error.metres() * 1e3);
            return Err(ConformityError::new(
                place(),
                problem,
                "check the unit of the column and the calibrated length",
            ));
        }
        if !names.contains(&m.line) {
            names.push(m.line.clone());
        }
    }
    if names.is_empty() {
        return Err(ConformityError::new("length test", "there is no measurement", "give measured lengths"));
    }
    let longest_m = measurements.iter().map(|m| m.calibrated_m).fold(0.0, f64::max);
    if longest_m < SHORTEST_M {
        let problem = format!("the longest length is {:.4} mm, and no machine is so small", longest_m * 1e3);
        return Err(ConformityError::new("length test", problem, "multiply the lengths by 1000 if they are metres"));
    }
    Ok(names)
}

fn sets_of(line: &str, measurements: &[LengthMeasurement]) -> Result<Vec<LengthSet>, ConformityError> {
    let mut own: Vec<&LengthMeasurement> = measurements.iter().filter(|m| m.line == line).collect();
    own.sort_by(|a, b| a.calibrated_m.total_cmp(&b.calibrated_m).then(a.repeat.cmp(&b.repeat)));
    let mut sets: Vec<(LengthSet, Vec<u32>)> = Vec::new();
    for m in own {
        let same = sets.last().is_some_and(|(set, _)| m.calibrated_m - set.calibrated_m <= SAME_LENGTH_M);
        if !same {
            let set = LengthSet { line: line.to_owned(), calibrated_m: m.calibrated_m, errors: Vec::new() };
            sets.push((set, Vec::new()));
        }
        let Some((set, repeats)) = sets.last_mut() else { continue };
        if repeats.contains(&m.repeat) {
            let place = format!("line {line}, {} mm, repeat {}", m.calibrated_m * 1e3, m.repeat);
            let remedy = "number the repeats of a length 1, 2, 3, and give each measurement once";
            return Err(ConformityError::new(place, "the measurement stands twice", remedy));
        }
        repeats.push(m.repeat);
        set.errors.push(m.error);
    }
    Ok(sets.into_iter().map(|(set, _)| set).collect())
}

fn summary(line: &str, sets: &[LengthSet], test: &LengthTest) -> LineSummary {
    let own: Vec<&LengthSet> = sets.iter().filter(|set| set.line == line).collect();
    let mut worst = (ObservedError::from_metres(0.0), own.first().map_or(0.0, |set| set.calibrated_m));
    for set in &own {
        if set.largest().magnitude_m() > worst.0.magnitude_m() {
            worst = (set.largest(), set.calibrated_m);
        }
    }
    LineSummary {
        line: line.to_owned(),
        lengths: own.len(),
        longest_m: own.iter().map(|set| set.calibrated_m).fold(0.0, f64::max),
        travel_m: test.travel_m.get(line).copied(),
        largest: worst,
        range: own.iter().filter_map(|set| set.range()).max_by(|a, b| a.metres().total_cmp(&b.metres())),
    }
}

/// Refuses lengths that are longer than the travel along their line.
fn check_travel(lines: &[LineSummary]) -> Result<(), ConformityError> {
    for line in lines {
        let Some(travel_m) = line.travel_m.filter(|travel_m| line.longest_m > travel_m + TRAVEL_ROUNDING_M) else {
            continue;
        };
        let problem = format!(
            "a length of {:.4} mm is longer than the travel of {:.4} mm along the line",
            line.longest_m * 1e3,
            travel_m * 1e3
        );
        let remedy = "correct the travel or the length; multiply the travels by 1000 if they are metres";
        return Err(ConformityError::new(format!("line {}", line.line), problem, remedy));
    }
    Ok(())
}

fn departures(test: &LengthTest, sets: &[LengthSet], lines: &[LineSummary]) -> Vec<Departure> {
    let mut found = Vec::new();
    let asked = test.lines_asked_for();
    let doubles = diagonal::doubles(lines);
    let there = lines.len() - doubles.len();
    if there < asked {
        let twins = doubles.iter().map(|(name, twin)| format!("{name} is {twin} from the other end"));
        let text = format!("{asked} measuring lines are asked for, there are {there}");
        let text = [text].into_iter().chain(twins).collect::<Vec<String>>().join("; ");
        found.push(Departure::new("test", text));
    }
    if test.probing == Probing::Unidirectional {
        let text = "the ends were probed from the same side, so that errors of probe and tip diameter cancel; probe from opposite sides: the \
                    short calibrated length that ISO 10360-2 has probed so beside such data, in the same places, is not among them";
        found.push(Departure::new("test", text));
    }
    if test.tool_offset_m > 0.0 && test.tool_offset_m < SHORT_OFFSET_M {
        let offset_mm = test.tool_offset_m * 1e3;
        let text = format!(
            "a tool offset of {offset_mm} mm is next to none: 150 mm are asked for, or seven lines without one"
        );
        found.push(Departure::new("test", text));
    }
    found.extend(diagonal::departures(test, lines));
    for line in lines {
        let place = || format!("line {}", line.line);
        if line.lengths < LENGTHS {
            found.push(Departure::new(place(), format!("{LENGTHS} lengths are asked for, there are {}", line.lengths)));
        }
        match line.travel_m {
            None => {
                let text = "the travel along it is not given, so that 66 % of it cannot be checked";
                found.push(Departure::new(place(), text));
            }
            Some(travel_m) if line.longest_m < travel_m * (LEAST_SHARE - SHARE_TOLERANCE) => {
                let share = 100.0 * line.longest_m / travel_m;
                let text = format!(
                    "the longest length, {:.1} mm, is {share:.1} % of the travel of {:.1} mm; 66 % are asked for",
                    line.longest_m * 1e3,
                    travel_m * 1e3
                );
                found.push(Departure::new(place(), text));
            }
            Some(_) => {}
        }
    }
    let mut few: BTreeMap<&str, usize> = BTreeMap::new();
    for set in sets.iter().filter(|set| set.errors.len() < REPEATS) {
        *few.entry(&set.line).or_default() += 1;
    }
    for (line, count) in few {
        let text = format!("{count} of its lengths were measured fewer than {REPEATS} times");
        found.push(Departure::new(format!("line {line}"), text));
    }
    found
}

#[cfg(test)]
mod tests;
