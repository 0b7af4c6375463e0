//! Periods of the scales: a periodogram of the residual along each axis, from 10 µm to the stroke.
//!
//! Place in the flow: proposes shapes of the periodic scale error to [`crate::search`]. The residuals, weighted by the
//! sight's component along the axis, are laid on a grid of two micrometres and transformed (FFT, in single precision: it says where the peaks
//! are); the highest peaks are scored exactly, with the model's columns projected out. Positions in m.

use crate::candidates::{Candidate, Round, score_all};
use crate::error::DiagnoseError;
use abbe_geometry::Axis;
use abbe_geometry::effects::{Shape, known};
use abbe_geometry::machine::Machine;
use abbe_identify::EffectTerm;
use abbe_measurement::campaign::Campaign;
use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlanner};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Grid on which positions are laid (m): a tenth of the pitch of usual scales, which keeps 97 % of its amplitude.
const GRID_M: f64 = 2e-6;
/// Shortest period looked for (m).
pub(crate) const SHORTEST_M: f64 = 10e-6;
/// Peaks scored exactly per axis.
const PEAKS: usize = 10;
/// Trial frequencies about each peak, as shares of the width of a peak.
const ABOUT: [f64; 7] = [-0.45, -0.3, -0.15, 0.0, 0.15, 0.3, 0.45];
/// Cells of a grid at least; far more than any stroke needs.
const LEAST_SIZE: usize = 8;
/// Reductions of χ² this close are equal to the eye of the data.
pub(crate) const AS_GOOD: f64 = 6.0;

/// Transforms that were planned and the memory that they need, for the next residual.
#[derive(Default)]
pub(crate) struct Periodogram {
    plans: BTreeMap<usize, Plan>,
    grid: Vec<Complex<f32>>,
    scratch: Vec<Complex<f32>>,
}

/// A transform of one size.
struct Plan {
    fft: Arc<dyn Fft<f32>>,
    /// e^(−πik/size) of the first frequencies: as many as were asked for.
    turns: Vec<Complex<f32>>,
}

impl Periodogram {
    /// Squared magnitudes of the first `count` frequencies of the real sequence that is packed into the grid, which is transformed in
    /// place: with E and O the transforms of even and odd places, the sequence's is E + e^(−2πik/N) O.
    fn powers(&mut self, count: usize) -> Vec<f32> {
        let half = self.grid.len();
        let plan = || Plan { fft: FftPlanner::new().plan_fft_forward(half), turns: Vec::new() };
        let plan = self.plans.entry(half).or_insert_with(plan);
        let turn = |k: usize| {
            let (sine, cosine) = (-std::f64::consts::PI * k as f64 / half as f64).sin_cos();
            Complex::new(cosine as f32, sine as f32)
        };
        plan.turns.extend((plan.turns.len()..count).map(turn));
        self.scratch.resize(plan.fft.get_inplace_scratch_len(), Complex::new(0.0, 0.0));
        plan.fft.process_with_scratch(&mut self.grid, &mut self.scratch);
        let packed = &self.grid;
        let power = |(k, turn): (usize, &Complex<f32>)| {
            let (forward, backward) = (packed[k % half], packed[(half - k % half) % half].conj());
            let (even, odd) = ((forward + backward) * 0.5, (forward - backward) * Complex::new(0.0, -0.5));
            (even + turn * odd).norm_sqr()
        };
        plan.turns.iter().take(count).enumerate().map(power).collect()
    }
}

/// Best period of each axis, and all others that explain as much.
pub(crate) fn candidates(
    round: &Round,
    machine: &Machine,
    campaign: &Campaign,
    periodogram: &mut Periodogram,
) -> Result<Vec<Candidate>, DiagnoseError> {
    let mut best = Vec::new();
    for axis in Axis::ALL {
        best.extend(best_of(round, machine, campaign, axis, periodogram)?);
    }
    Ok(best)
}

fn best_of(
    round: &Round,
    machine: &Machine,
    campaign: &Campaign,
    axis: Axis,
    periodogram: &mut Periodogram,
) -> Result<Option<Candidate>, DiagnoseError> {
    let (lower_m, upper_m) = machine.stroke_m[axis.index()];
    let stroke_m = upper_m - lower_m;
    let Some(known) = known("periodic_scale") else { return Ok(None) };
    let trials = (stroke_m / SHORTEST_M) as usize;
    let mut terms = Vec::new();
    for frequency in peaks((round, campaign), axis, (lower_m, stroke_m), periodogram) {
        for about in ABOUT {
            let period_m = stroke_m / (frequency * stroke_m + about);
            if period_m > SHORTEST_M && period_m < stroke_m {
                let shape = Shape::new().text("axis", axis.lower()).number("period_m", period_m);
                terms.push((known, EffectTerm::new(known.name, shape, machine)?, trials));
            }
        }
    }
    let scored = score_all(round, terms)?;
    let highest = scored.iter().map(|c| c.score.reduction).fold(0.0, f64::max);
    // Of periods that a regular step cannot tell apart, the longest is the simplest.
    let as_good = scored.into_iter().filter(|c| c.score.reduction > highest - AS_GOOD);
    Ok(as_good.max_by(|a, b| period_m(a).total_cmp(&period_m(b)).then(a.score.reduction.total_cmp(&b.score.reduction))))
}

/// Period of a wave (m).
pub(crate) fn period_m(candidate: &Candidate) -> f64 {
    candidate.term.shape.figures().next().unwrap_or(0.0)
}

/// Frequencies (1/m) of the highest peaks, the highest first.
///
/// The grid is real, so that it is transformed as a complex one of half the length: even places are real parts, odd ones
/// imaginary parts.
fn peaks(
    (round, campaign): (&Round, &Campaign),
    axis: Axis,
    (lower_m, stroke_m): (f64, f64),
    periodogram: &mut Periodogram,
) -> Vec<f64> {
    // Twice the stroke, so that neighbouring frequencies are half a peak apart.
    let size = ((2.0 * stroke_m / GRID_M) as usize + 1).next_power_of_two().max(LEAST_SIZE);
    periodogram.grid.clear();
    periodogram.grid.resize(size / 2, Complex::new(0.0, 0.0));
    let rows = &round.rows;
    let residuals = rows.weighted(round.free.residuals());
    for (k, reading) in campaign.readings.iter().enumerate() {
        let place = ((reading.reading_m[axis.index()] - lower_m) / GRID_M).round();
        if place >= 0.0 && (place as usize) < size {
            let value = residuals[k] * rows.rays[k].direction[axis.index()];
            let cell = &mut periodogram.grid[place as usize / 2];
            *(if (place as usize).is_multiple_of(2) { &mut cell.re } else { &mut cell.im }) += value as f32;
        }
    }
    let step = 1.0 / (size as f64 * GRID_M);
    let last = ((1.0 / SHORTEST_M / step) as usize).min(size / 2 - 2);
    let powers = periodogram.powers(last + 2);
    let is_peak = |k: &usize| powers[*k] >= powers[k - 1] && powers[*k] > powers[k + 1];
    let mut peaks: Vec<usize> = (1..last).filter(is_peak).collect();
    let higher = |a: &usize, b: &usize| powers[*b].total_cmp(&powers[*a]).then(a.cmp(b));
    if peaks.len() > PEAKS {
        peaks.select_nth_unstable_by(PEAKS - 1, higher);
        peaks.truncate(PEAKS);
    }
    peaks.sort_by(higher);
    peaks.into_iter().map(|k| k as f64 * step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packed_transform_gives_the_powers_of_the_sequence() {
        let size = 64;
        let sequence: Vec<f32> = (0..size).map(|k| (0.37 * k as f32).sin() + 0.1 * (k % 5) as f32).collect();
        let power = |k: usize| {
            let turned = |(n, value): (usize, &f32)| {
                Complex::from_polar(f64::from(*value), -std::f64::consts::TAU * (k * n) as f64 / size as f64)
            };
            sequence.iter().enumerate().map(turned).sum::<Complex<f64>>().norm_sqr()
        };
        let whole: Vec<f64> = (0..size / 2).map(power).collect();
        let grid = sequence.chunks(2).map(|pair| Complex::new(pair[0], pair[1])).collect();
        let mut periodogram = Periodogram { grid, ..Periodogram::default() };
        let found = periodogram.powers(whole.len());
        let most = whole.iter().copied().fold(0.0, f64::max);
        let near = |(found, whole): (&f32, &f64)| (f64::from(*found) - whole).abs() < 1e-6 * most;
        assert!(found.iter().zip(&whole).all(near), "{found:?}");
    }
}
