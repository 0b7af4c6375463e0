//! Periods of the scales: a periodogram of the residual along each axis, from 10 µm to the stroke.
//!
//! Place in the flow: proposes shapes of the periodic scale error to [`crate::search`]. The residuals, weighted by the
//! sight's component along the axis, are laid on a grid of two micrometres and transformed (FFT); the highest peaks are
//! scored exactly, with the model's columns projected out. Positions in m.

use crate::candidates::{Candidate, Round, score_all};
use crate::error::DiagnoseError;
use abbe_geometry::Axis;
use abbe_geometry::effects::{Shape, known};
use abbe_geometry::machine::Machine;
use abbe_identify::EffectTerm;
use abbe_measurement::campaign::Campaign;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex;

/// Grid on which positions are laid (m): a tenth of the pitch of usual scales, which keeps 97 % of its amplitude.
const GRID_M: f64 = 2e-6;
/// Shortest period looked for (m).
const SHORTEST_M: f64 = 10e-6;
/// Peaks scored exactly per axis.
const PEAKS: usize = 10;
/// Trial frequencies about each peak, as shares of the width of a peak.
const ABOUT: [f64; 7] = [-0.45, -0.3, -0.15, 0.0, 0.15, 0.3, 0.45];
/// Reductions of χ² this close are equal to the eye of the data.
pub(crate) const AS_GOOD: f64 = 6.0;

/// Best period of each axis, and all others that explain as much.
pub(crate) fn candidates(
    round: &Round,
    machine: &Machine,
    campaign: &Campaign,
) -> Result<Vec<Candidate>, DiagnoseError> {
    let mut best = Vec::new();
    for axis in Axis::ALL {
        best.extend(best_of(round, machine, campaign, axis)?);
    }
    Ok(best)
}

fn best_of(
    round: &Round,
    machine: &Machine,
    campaign: &Campaign,
    axis: Axis,
) -> Result<Option<Candidate>, DiagnoseError> {
    let (lower_m, upper_m) = machine.stroke_m[axis.index()];
    let stroke_m = upper_m - lower_m;
    let Some(known) = known("periodic_scale") else { return Ok(None) };
    let trials = (stroke_m / SHORTEST_M) as usize;
    let mut terms = Vec::new();
    for frequency in peaks(round, campaign, axis, lower_m, stroke_m) {
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

fn period_m(candidate: &Candidate) -> f64 {
    candidate.term.shape.figures().next().unwrap_or(0.0)
}

/// Frequencies (1/m) of the highest peaks.
fn peaks(round: &Round, campaign: &Campaign, axis: Axis, lower_m: f64, stroke_m: f64) -> Vec<f64> {
    // Twice the stroke, so that neighbouring frequencies are half a peak apart.
    let size = ((2.0 * stroke_m / GRID_M) as usize + 1).next_power_of_two();
    let mut grid = vec![Complex::new(0.0, 0.0); size];
    let rows = &round.rows;
    for (k, reading) in campaign.readings.iter().enumerate() {
        let place = ((reading.reading_m[axis.index()] - lower_m) / GRID_M).round();
        if place >= 0.0 && (place as usize) < size {
            grid[place as usize].re +=
                round.free.residuals()[k] * rows.whitening[k] * rows.rays[k].direction[axis.index()];
        }
    }
    FftPlanner::new().plan_fft_forward(size).process(&mut grid);
    let step = 1.0 / (size as f64 * GRID_M);
    let last = ((1.0 / SHORTEST_M / step) as usize).min(size / 2 - 2);
    let power = |k: usize| grid[k].norm_sqr();
    let mut peaks: Vec<usize> = (1..last).filter(|k| power(*k) >= power(k - 1) && power(*k) > power(k + 1)).collect();
    peaks.sort_by(|a, b| power(*b).total_cmp(&power(*a)).then(a.cmp(b)));
    peaks.into_iter().take(PEAKS).map(|k| k as f64 * step).collect()
}
