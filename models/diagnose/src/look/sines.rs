//! Sines over the range of a quantity; scales have a periodogram of their own.
//!
//! Place in the flow: part of [`super::look`]. All frequencies are compared before projection, for all acts together;
//! those that look best are scored exactly. Quantities scaled to −1 … 1; whitened rows.

use super::{ACTS, Finding, POSITIONS, Variable};
use crate::candidates::Round;
use abbe_identify::in_parallel;
use faer::Mat;
use std::f64::consts::TAU;

/// Half cycles of sines over a quantity's range.
const HALF_CYCLES: std::ops::RangeInclusive<usize> = 3..=48;
/// Sines scored exactly, of those that look best before projection.
const SINES: usize = 24;

/// A sine of one quantity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Wave {
    power: f64,
    variable: usize,
    half_cycles: usize,
}

/// Those that look best before projection, for each act given by its weights, and how many were compared.
pub(super) fn strongest(round: &Round, variables: &[Variable], weights: &[Vec<f64>]) -> Vec<(Vec<Wave>, usize)> {
    let residuals = round.rows.weighted(round.free.residuals());
    let weighted: Vec<Vec<f64>> =
        weights.iter().map(|w| w.iter().zip(&residuals).map(|(w, r)| w * r).collect()).collect();
    let square = |w: &Vec<f64>| w.iter().zip(&round.rows.whitening).map(|(w, u)| (w * u).powi(2)).sum::<f64>();
    let norms: Vec<f64> = weights.iter().map(square).collect();
    let logged: Vec<usize> =
        (0..variables.len()).filter(|v| !POSITIONS.contains(&variables[*v].name.as_str())).collect();
    let of_variables = in_parallel(&logged, |variable| of_variable(*variable, &variables[*variable].scaled, &weighted));
    let choose = |(act, norm): (usize, &f64)| {
        let mut waves: Vec<Wave> = of_variables.iter().flat_map(|of_acts| &of_acts[act]).copied().collect();
        waves.iter_mut().for_each(|wave| wave.power /= norm.max(f64::MIN_POSITIVE));
        let order = |a: &Wave, b: &Wave| {
            let place = |w: &Wave| (w.variable, w.half_cycles);
            b.power.total_cmp(&a.power).then(place(a).cmp(&place(b)))
        };
        waves.sort_by(order);
        let compared = waves.len();
        waves.truncate(SINES);
        (waves, compared)
    };
    norms.iter().enumerate().map(choose).collect()
}

/// Squared amplitudes (not yet divided by the weights) of all sines of one quantity, by act.
fn of_variable(variable: usize, scaled: &[f64], weighted: &[Vec<f64>]) -> Vec<Vec<Wave>> {
    // Sine and cosine of one half cycle; the others follow by turning on.
    let base: Vec<(f64, f64)> = scaled.iter().map(|value| turn(*value, 1).sin_cos()).collect();
    let mut now: Vec<(f64, f64)> = vec![(0.0, 1.0); scaled.len()];
    let mut waves = vec![Vec::new(); weighted.len()];
    for half_cycles in 1..=*HALF_CYCLES.end() {
        for ((s, c), (s1, c1)) in now.iter_mut().zip(&base) {
            (*s, *c) = (*s * c1 + *c * s1, *c * c1 - *s * s1);
        }
        if !HALF_CYCLES.contains(&half_cycles) {
            continue;
        }
        for (waves, weighted) in waves.iter_mut().zip(weighted) {
            let (mut sine, mut cosine) = (0.0, 0.0);
            for (w, (s, c)) in weighted.iter().zip(&now) {
                sine += w * s;
                cosine += w * c;
            }
            waves.push(Wave { power: sine * sine + cosine * cosine, variable, half_cycles });
        }
    }
    waves
}

/// Scores of these sines with the model's columns projected out.
pub(super) fn findings(
    round: &Round,
    variables: &[Variable],
    act: usize,
    (weights, (waves, compared)): (&[f64], &(Vec<Wave>, usize)),
    trials: usize,
) -> Vec<Finding> {
    let column = |wave: &Wave| {
        let scaled = &variables[wave.variable].scaled;
        let angles = scaled.iter().map(|value| turn(*value, wave.half_cycles).sin_cos());
        let mut pair = Mat::zeros(weights.len(), 2);
        for (k, ((sine, cosine), weight)) in angles.zip(weights).enumerate() {
            pair[(k, 0)] = weight * sine;
            pair[(k, 1)] = weight * cosine;
        }
        (0..2).for_each(|j| round.rows.whiten(pair.col_as_slice_mut(j)));
        pair
    };
    let columns: Vec<Mat<f64>> = waves.iter().map(column).collect();
    let trials = trials + ACTS.len() * compared;
    let finding = |(wave, group): (&Wave, crate::linear::Projected)| Finding {
        acts: ACTS[act],
        variables: vec![wave.variable],
        half_cycles: Some(wave.half_cycles),
        score: round.score(&group),
        trials,
    };
    waves.iter().zip(round.free.project_all(&columns)).map(finding).collect()
}

/// Phase of a sine of so many half cycles over the range.
fn turn(scaled: f64, half_cycles: usize) -> f64 {
    TAU * 0.5 * half_cycles as f64 * 0.5 * (scaled + 1.0)
}
