//! Waves whose period the places that were read do not tell.
//!
//! Place in the flow: a wave that [`crate::search`] proposes is held here against all others that equal steps take for it, before it is
//! fitted. Lines at steps h read frequency f as f + k/h alike, but for where they begin (Nyquist, Shannon); a peak of the periodogram may be
//! any of these. Where one explains more than all others, it is that one. Where others explain as much, none corrects anything: between the
//! places that were read each says something else, and the uncertainty holds the wave. Positions and periods in m.

use crate::candidates::{Candidate, Round, refined, score_all};
use crate::error::DiagnoseError;
use crate::periodic::{AS_GOOD, SHORTEST_M, period_m};
use abbe_geometry::Axis;
use abbe_geometry::effects::{Shape, ShapeValue};
use abbe_geometry::machine::Machine;
use abbe_geometry::model::{MachineModel, ModelError};
use abbe_identify::EffectTerm;
use abbe_measurement::campaign::{Campaign, RangeReading};

/// Figure of a wave.
const PERIOD: &str = "period_m";
/// Others that are tried, those of the longest periods: screws and scales have them.
const TRIED: usize = 1500;
/// Columns that are scored in one go: some megabytes.
const AT_ONCE: usize = 64;
/// The best of them that are moved to their peaks.
const REFINED: usize = 10;
/// Readings of a line that show its step, departure from it, and difference of two lines' steps, as shares of a step.
const READINGS: usize = 4;
const UNEVEN: f64 = 0.1;
const SAME_STEP: f64 = 1e-3;
/// Steps that are tried, the most common ones.
const STEPS: usize = 3;
/// Shortest step (m): below it a machine stands.
const SHORTEST_STEP_M: f64 = 0.2e-3;
/// Periods named in a message.
const NAMED: usize = 4;

/// A wave, after all that looks like it was tried.
pub(crate) enum Period {
    /// No other explains as much.
    Told(Candidate),
    /// Others do.
    Open(OpenWave),
}

/// A wave whose period is open.
#[derive(Debug, Clone)]
pub(crate) struct OpenWave {
    axis: Axis,
    stroke_m: f64,
    /// What each of them would do at most (m).
    amplitude_m: f64,
    /// Periods that explain as much, the longest first (m).
    periods_m: Vec<f64>,
    /// The one that was proposed.
    pub(crate) term: EffectTerm,
}

/// What the places that were read tell of the period of a candidate; one that is no wave is told.
pub(crate) fn period(
    round: &Round,
    (machine, campaign): (&Machine, &Campaign),
    candidate: Candidate,
) -> Result<Period, DiagnoseError> {
    let Some((axis, period)) = wave_of(&candidate.term.shape) else { return Ok(Period::Told(candidate)) };
    let (lower_m, upper_m) = machine.stroke_m[axis.index()];
    let stroke_m = upper_m - lower_m;
    let frequencies = alike(period.recip(), &steps_m(campaign, axis), stroke_m);
    let term = |frequency: &f64| {
        let shape = candidate.term.shape.clone().number(PERIOD, frequency.recip());
        Ok((candidate.known, EffectTerm::new(candidate.known.name, shape, machine)?, candidate.trials))
    };
    let mut all = Vec::with_capacity(frequencies.len());
    for some in frequencies.chunks(AT_ONCE) {
        all.extend(score_all(round, some.iter().map(term).collect::<Result<_, DiagnoseError>>()?)?);
    }
    all.sort_by(|a, b| b.score.reduction.total_cmp(&a.score.reduction));
    all.truncate(REFINED);
    let mut all: Vec<Candidate> =
        all.into_iter().map(|other| refined(round, machine, other)).collect::<Result<_, DiagnoseError>>()?;
    all.push(candidate.clone());
    let highest = all.iter().map(|c| c.score.reduction).fold(0.0, f64::max);
    all.retain(|c| c.score.reduction > highest - AS_GOOD);
    all.sort_by(|a, b| period_m(b).total_cmp(&period_m(a)));
    if all.iter().any(|c| !are_one(period_m(c), period_m(&all[0]), stroke_m)) {
        let amplitude_m = all.iter().map(|c| c.score.estimate.iter().fold(0.0, |sum: f64, part| sum.hypot(*part)));
        let amplitude_m = amplitude_m.fold(0.0, f64::max);
        let periods_m = all.iter().map(period_m).collect();
        return Ok(Period::Open(OpenWave { axis, stroke_m, amplitude_m, periods_m, term: candidate.term }));
    }
    // Of one peak the highest place.
    let higher = |best: Candidate, c: Candidate| if c.score.reduction > best.score.reduction { c } else { best };
    Ok(Period::Told(all.into_iter().fold(candidate, higher)))
}

impl OpenWave {
    /// Why it corrects nothing.
    pub(crate) fn because(&self) -> String {
        let named: Vec<String> = self.periods_m.iter().take(NAMED).map(|m| format!("{:.4}", m * 1e3)).collect();
        let more = if self.periods_m.len() > NAMED { " and others" } else { "" };
        format!(
            "the places that were read do not tell its period: {}{more} mm explain as much; read lines along {} at unequal steps. The \
             uncertainty holds a wave of {:.2} µm",
            named.join(", "),
            self.axis.letter(),
            self.amplitude_m * 1e6
        )
    }

    /// Whether another is this one, proposed again.
    pub(crate) fn is(&self, other: &OpenWave) -> bool {
        self.axis == other.axis && other.periods_m.iter().any(|period_m| self.may_have(*period_m))
    }

    fn may_have(&self, period_m: f64) -> bool {
        self.periods_m.iter().any(|own_m| are_one(*own_m, period_m, self.stroke_m))
    }

    /// The model with the mean square of the wave in its uncertainty, unless an effect of it has found the wave since.
    pub(crate) fn told(&self, model: MachineModel) -> Result<MachineModel, ModelError> {
        let is_found =
            |shape: &Shape| wave_of(shape).is_some_and(|(axis, period_m)| axis == self.axis && self.may_have(period_m));
        if model.parts().effects.iter().any(|fitted| is_found(&fitted.shape)) {
            return Ok(model);
        }
        let mut unexplained_m = model.parts().quality.unexplained_m;
        let own_m = &mut unexplained_m[self.axis.index()];
        *own_m = own_m.hypot(self.amplitude_m / std::f64::consts::SQRT_2);
        model.with_unexplained(unexplained_m)
    }
}

/// The axis of a wave and its period (m); `None` for any other shape.
fn wave_of(shape: &Shape) -> Option<(Axis, f64)> {
    match (shape.0.get("axis"), shape.0.get(PERIOD)) {
        (Some(ShapeValue::Text(axis)), Some(ShapeValue::Number(period_m))) => {
            Some((Axis::from_lower(axis)?, *period_m))
        }
        _ => None,
    }
}

/// Whether two periods are one to a stroke: places within a wave of each other all along it.
fn are_one(a_m: f64, b_m: f64, stroke_m: f64) -> bool {
    (a_m.recip() - b_m.recip()).abs() * stroke_m <= 1.0
}

/// Frequencies (1/m) that equal steps take for this one, the lowest first.
fn alike(frequency: f64, steps_m: &[f64], stroke_m: f64) -> Vec<f64> {
    let mut all = Vec::new();
    for step_m in steps_m {
        let most = (TRIED as f64).min(step_m / SHORTEST_M) as i32;
        let other = |k: i32| (frequency + f64::from(k) / step_m).abs();
        let is_wave = |f: &f64| *f > 1.0 / stroke_m && *f < 1.0 / SHORTEST_M;
        all.extend((-most..=most).filter(|k| *k != 0).map(other).filter(is_wave));
    }
    all.sort_by(f64::total_cmp);
    all.truncate(TRIED);
    all
}

/// Steps (m) of the lines along an axis, the most common first.
fn steps_m(campaign: &Campaign, axis: Axis) -> Vec<f64> {
    let of_line = |line: &[RangeReading]| -> Option<f64> {
        let at_m = |k: usize| line[k].reading_m[axis.index()];
        let step_m = (at_m(line.len() - 1) - at_m(0)) / (line.len() - 1).max(1) as f64;
        let is_even = (1..line.len()).all(|k| (at_m(k) - at_m(k - 1) - step_m).abs() < UNEVEN * step_m.abs());
        (line.len() >= READINGS && is_even && step_m.abs() > SHORTEST_STEP_M).then_some(step_m.abs())
    };
    let lines = campaign.readings.chunk_by(|a, b| (a.station, a.line) == (b.station, b.line));
    let mut all: Vec<f64> = lines.filter_map(of_line).collect();
    all.sort_by(f64::total_cmp);
    let mut same: Vec<&[f64]> = all.chunk_by(|a, b| b - a < SAME_STEP * a).collect();
    same.sort_by_key(|steps| std::cmp::Reverse(steps.len()));
    same.into_iter().take(STEPS).map(|steps| steps.iter().sum::<f64>() / steps.len() as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::machine;

    fn wave(axis: Axis, periods_m: &[f64]) -> OpenWave {
        let shape = Shape::new().text("axis", axis.lower()).number(PERIOD, periods_m[0]);
        let term = EffectTerm::new("periodic_scale", shape, &machine()).unwrap();
        OpenWave { axis, stroke_m: 0.6, amplitude_m: 1e-6, periods_m: periods_m.to_vec(), term }
    }

    #[test]
    fn a_wave_is_known_again_by_its_axis_and_any_of_its_periods() {
        let known = wave(Axis::Y, &[4e-3, 0.2e-3]);
        assert!(known.is(&wave(Axis::Y, &[4.01e-3])) && known.is(&wave(Axis::Y, &[0.07e-3, 0.2e-3])));
        assert!(!known.is(&wave(Axis::X, &[4e-3])) && !known.is(&wave(Axis::Y, &[5e-3])));
    }

    #[test]
    fn equal_steps_take_these_frequencies_for_each_other() {
        let alike = alike(250.0, &[0.024], 0.6);
        let reads_alike = |f: &f64| {
            let turns = [(f - 250.0) * 0.024, (f + 250.0) * 0.024];
            turns.iter().any(|turns| (turns - turns.round()).abs() < 1e-9)
        };
        assert!(alike.iter().all(reads_alike));
        assert!(alike.windows(2).all(|pair| pair[0] <= pair[1]) && alike.len() > 1000 && alike[0] > 1.0 / 0.6);
    }

    #[test]
    fn steps_are_those_of_lines_that_are_even_the_commonest_first() {
        let line = |number: u32, at_mm: &[f64]| -> Vec<RangeReading> {
            let reading = |x: &f64| RangeReading {
                station: 0,
                line: number,
                time_s: 0.0,
                reading_m: [x * 1e-3, 0.0, 0.0],
                offset_m: [0.0; 3],
                length_m: 0.0,
            };
            at_mm.iter().map(reading).collect()
        };
        let lines = [
            line(0, &[0.0, 24.0, 48.0, 72.0]),
            line(1, &[90.0, 66.0, 42.0, 18.0]),
            line(2, &[0.0, 30.0, 60.0, 90.0]),
            line(3, &[0.0, 24.0, 60.0, 72.0]),
            line(4, &[5.0, 5.0, 5.0, 5.0]),
            line(5, &[0.0, 24.0]),
        ];
        let campaign = Campaign { readings: lines.concat(), ..Campaign::default() };
        let steps = steps_m(&campaign, Axis::X);
        assert_eq!(steps.len(), 2);
        assert!((steps[0] - 0.024).abs() < 1e-12 && (steps[1] - 0.03).abs() < 1e-12, "{steps:?}");
        assert_eq!(steps_m(&campaign, Axis::Y), Vec::<f64>::new());
    }
}
