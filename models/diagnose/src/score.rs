//! The group test: do these columns explain more of the residual than chance, given what the model already has?
//!
//! Place in the flow: every candidate effect, every pair of quantities and every finer error function is judged here,
//! from [`crate::linear::Projected`]. No units: whitened rows.

use crate::linear::{Linear, Projected, column, factor_above};
use abbe_identify::symmetric_eigen;
use abbe_measurement::chance::beyond;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, MatRef, Side};
use statrs::distribution::FisherSnedecor;

/// Share of a direction's information that must be left for it to be tested: a twentieth of its amplitude. What is left
/// of less is dominated by how well the error functions can bend, not by the effect.
pub(crate) const LEFT: f64 = 0.0003;

/// Outcome of a group test.
#[derive(Debug, Clone, PartialEq)]
pub struct Score {
    /// Reduction of χ² that the group brings.
    pub reduction: f64,
    /// Directions tested: parameters less those that the model's own columns contain.
    pub degrees: usize,
    /// Probability of such a reduction by chance (F test), before any correction for the number of tests.
    pub p_value: f64,
    /// Gain of twice the log likelihood, with the noise estimated.
    pub gain: f64,
    /// Share of the found signature (of the whole group where nothing is found) that model columns could absorb.
    pub alias_share: f64,
    /// Estimate of each parameter, in the direction that the data determine.
    pub estimate: Vec<f64>,
}

impl Score {
    /// Evidence after a price for parameters and trials: gain − degrees · ln n − 2 ln(trials) (Schwarz 1978, with the
    /// choice among equals as a uniform prior).
    pub fn evidence(&self, rows: usize, trials: usize) -> f64 {
        evidence_of(self.gain, self.degrees, (rows, trials))
    }
}

/// Evidence of a gain by so many parameters, over so many rows and among so many trials.
pub(crate) fn evidence_of(gain: f64, degrees: usize, (rows, trials): (usize, usize)) -> f64 {
    gain - degrees as f64 * (rows.max(2) as f64).ln() - 2.0 * (trials.max(1) as f64).ln()
}

/// Gain of twice the log likelihood by a reduction of χ², with the noise estimated.
pub(crate) fn gain_of(reduction: f64, chi2: f64, degrees: f64) -> f64 {
    degrees.max(1.0) * (chi2 / (chi2 - reduction).max(f64::MIN_POSITIVE)).ln()
}

/// Tests a group of columns; `chi2` and `degrees` are those of the fit without it.
pub fn score(group: &Projected, chi2: f64, degrees: f64) -> Score {
    let count = group.gradient.len();
    let scale: Vec<f64> = (0..count).map(|k| inverse_root(group.alone[(k, k)])).collect();
    let left = Mat::from_fn(count, count, |i, j| 0.5 * (group.left[(i, j)] + group.left[(j, i)]) * scale[i] * scale[j]);
    let gradient: Vec<f64> = group.gradient.iter().zip(&scale).map(|(g, s)| g * s).collect();
    let solved = solved(&left, &gradient).or_else(|| solved_in_part(&left, &gradient));
    let Some((scaled, tested)) = solved else { return nothing(count) };
    let reduction: f64 = scaled.iter().zip(&gradient).map(|(estimate, gradient)| estimate * gradient).sum();
    let estimate: Vec<f64> = scaled.iter().zip(&scale).map(|(estimate, scale)| estimate * scale).collect();
    let rest = (degrees - tested as f64).max(1.0);
    let remaining = (chi2 - reduction).max(f64::MIN_POSITIVE);
    let gain = if tested == 0 { 0.0 } else { gain_of(reduction, chi2, degrees) };
    let p_value = p_of(reduction, tested, remaining, rest);
    Score { reduction, degrees: tested, p_value, gain, alias_share: alias_share(group, &estimate), estimate }
}

/// Tests columns (rows × m, whitened) against a fit.
pub(crate) fn score_of(fit: &Linear, columns: MatRef<f64>) -> Score {
    score(&fit.project(columns), fit.chi2(), fit.degrees())
}

/// A symmetric matrix of two columns: its diagonal, and what stands beside it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OfTwo {
    pub(crate) diagonal: [f64; 2],
    pub(crate) beside: f64,
}

/// The gain of [`score`] for two columns, in closed form: no memory is taken, for those who look at thousands of them.
pub(crate) fn gain_of_two(gradient: [f64; 2], alone: OfTwo, left: OfTwo, chi2: f64, degrees: f64) -> f64 {
    let scale = alone.diagonal.map(inverse_root);
    let [g, h] = [gradient[0] * scale[0], gradient[1] * scale[1]];
    let [a, b] = [left.diagonal[0] * scale[0] * scale[0], left.diagonal[1] * scale[1] * scale[1]];
    let beside = left.beside * scale[0] * scale[1];
    let (middle, half) = (0.5 * (a + b), 0.5 * (a - b));
    let radius = (half * half + beside * beside).sqrt();
    if middle - radius > LEFT {
        let explained = (b * g * g - 2.0 * beside * g * h + a * h * h) / (a * b - beside * beside);
        return gain_of(explained, chi2, degrees);
    }
    // A direction of eigenvalue middle ± radius, by its angle.
    let angle = 0.5 * beside.atan2(half);
    let (sine, cosine) = angle.sin_cos();
    let along = [(middle + radius, cosine * g + sine * h), (middle - radius, cosine * h - sine * g)];
    let tested = along.iter().filter(|(value, _)| *value > LEFT);
    gain_of(tested.map(|(value, along)| along * along / value).sum(), chi2, degrees)
}

/// Estimate where enough is left of all directions, and their number: Cholesky's factor of `left` − limit·I shows that, in a
/// tenth of the time that eigenvectors take.
fn solved(left: &Mat<f64>, gradient: &[f64]) -> Option<(Vec<f64>, usize)> {
    let count = gradient.len();
    if count == 1 {
        return (left[(0, 0)] > LEFT).then(|| (vec![gradient[0] / left[(0, 0)]], 1));
    }
    factor_above(left, LEFT)?;
    let estimate = Llt::new(left.as_ref(), Side::Lower).ok()?.solve(column(gradient));
    Some(((0..count).map(|k| estimate[(k, 0)]).collect(), count))
}

/// Estimate in the directions of which enough is left, and their number.
fn solved_in_part(left: &Mat<f64>, gradient: &[f64]) -> Option<(Vec<f64>, usize)> {
    let count = gradient.len();
    let (values, vectors) = symmetric_eigen(left)?;
    let (mut estimate, mut tested) = (vec![0.0; count], 0);
    for (k, value) in values.iter().enumerate().filter(|(_, value)| **value > LEFT) {
        let along: f64 = (0..count).map(|i| vectors[(i, k)] * gradient[i]).sum();
        tested += 1;
        (0..count).for_each(|i| estimate[i] += vectors[(i, k)] * along / value);
    }
    Some((estimate, tested))
}

fn nothing(count: usize) -> Score {
    Score { reduction: 0.0, degrees: 0, p_value: 1.0, gain: 0.0, alias_share: 1.0, estimate: vec![0.0; count] }
}

pub(crate) fn inverse_root(value: f64) -> f64 {
    if value > 0.0 { value.sqrt().recip() } else { 0.0 }
}

/// Probability of a reduction of χ² by as many directions by chance (F test).
pub(crate) fn p_of(reduction: f64, tested: usize, remaining: f64, rest: f64) -> f64 {
    if tested == 0 {
        return 1.0;
    }
    let f = (reduction / tested as f64) / (remaining / rest);
    FisherSnedecor::new(tested as f64, rest).map_or(1.0, |distribution| beyond(&distribution, f))
}

/// 1 − (what is left of the signature)² / (the signature)², for the estimate; for the group's trace without one.
fn alias_share(group: &Projected, estimate: &[f64]) -> f64 {
    let quadratic = |matrix: &Mat<f64>| -> f64 {
        (0..estimate.len())
            .map(|i| estimate[i] * (0..estimate.len()).map(|j| matrix[(i, j)] * estimate[j]).sum::<f64>())
            .sum()
    };
    let (left, alone) = (quadratic(&group.left), quadratic(&group.alone));
    if alone > 0.0 { (1.0 - left / alone).clamp(0.0, 1.0) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::normal;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    const ROWS: usize = 200;

    fn scored(seed: u64, size: f64) -> Score {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        let base = Mat::from_fn(ROWS, 4, |k, j| (k as f64 / ROWS as f64).powi(j as i32));
        let group = Mat::from_fn(ROWS, 3, |_, _| normal(&mut generator));
        let observed: Vec<f64> = (0..ROWS).map(|k| size * group[(k, 1)] + normal(&mut generator)).collect();
        let (fit, _) = Linear::least_squares(base, &observed).unwrap();
        score_of(&fit, group.as_ref())
    }

    #[test]
    fn p_values_of_nothing_are_uniform() {
        let mut values: Vec<f64> = (0..400).map(|seed| scored(seed, 0.0).p_value).collect();
        values.sort_by(f64::total_cmp);
        let distance = values.iter().enumerate().map(|(k, p)| (p - (k as f64 + 0.5) / 400.0).abs()).fold(0.0, f64::max);
        // Kolmogorov-Smirnov at 1 %: 1.63/sqrt(400).
        assert!(distance < 0.0815, "{distance}");
    }

    #[test]
    fn a_signal_is_found_with_its_size() {
        let found = scored(7, 2.0);
        assert!(found.p_value < 1e-12 && found.degrees == 3);
        assert!((found.estimate[1] - 2.0).abs() < 0.3 && found.estimate[0].abs() < 0.3, "{found:?}");
        assert!(found.alias_share < 0.1 && found.evidence(ROWS, 10) > 0.0);
    }

    #[test]
    fn two_columns_gain_alike_in_closed_form() {
        let mut generator = ChaCha8Rng::seed_from_u64(11);
        for case in 0..200 {
            let rows = Mat::from_fn(12, 2, |_, _| normal(&mut generator));
            let alone = rows.transpose() * &rows;
            // From nearly all left to nearly nothing, in one direction or in both.
            let kept = |k: usize| 10f64.powi(-(k as i32));
            let direction = case as f64;
            let (sine, cosine) = direction.sin_cos();
            let root = Mat::from_fn(2, 2, |i, j| match (i, j) {
                (0, 0) => cosine * kept(case % 4),
                (0, _) => sine * kept(case % 4),
                (_, 0) => -sine * kept(case % 7),
                _ => cosine * kept(case % 7),
            });
            let left = root.transpose() * &root;
            let gradient = [normal(&mut generator), normal(&mut generator)];
            let of = |m: &Mat<f64>| OfTwo { diagonal: [m[(0, 0)], m[(1, 1)]], beside: m[(0, 1)] };
            let group = Projected { gradient: gradient.to_vec(), alone: alone.clone(), left: left.clone() };
            let expected = score(&group, 4e3, 100.0).gain;
            let own = gain_of_two(gradient, of(&alone), of(&left), 4e3, 100.0);
            assert!((own - expected).abs() < 1e-7 * expected.abs().max(1.0), "{case}: {own} {expected}");
        }
        let none = OfTwo { diagonal: [0.0; 2], beside: 0.0 };
        assert_eq!(gain_of_two([1.0; 2], none, none, 10.0, 5.0), 0.0);
    }

    #[test]
    fn both_ways_to_an_estimate_agree_where_all_is_left() {
        let mut generator = ChaCha8Rng::seed_from_u64(3);
        let rows = Mat::from_fn(ROWS, 9, |_, _| normal(&mut generator) / (ROWS as f64).sqrt());
        let gradient: Vec<f64> = (0..9).map(|_| normal(&mut generator)).collect();
        let mut left = rows.transpose() * &rows;
        let ((whole, all), (part, tested)) =
            (solved(&left, &gradient).unwrap(), solved_in_part(&left, &gradient).unwrap());
        assert_eq!((all, tested), (9, 9));
        assert!(whole.iter().zip(&part).all(|(a, b)| (a - b).abs() < 1e-9), "{whole:?} {part:?}");
        // One direction of which less than the limit is left.
        (0..9).for_each(|k| (left[(k, 4)], left[(4, k)]) = (0.0, 0.0));
        left[(4, 4)] = 0.5 * LEFT;
        assert_eq!(solved(&left, &gradient), None);
        assert_eq!(solved_in_part(&left, &gradient).unwrap().1, 8);
    }

    /// Readings that repeat to the last digit leave nothing beside what explains them, or nothing at all.
    #[test]
    fn regress_statistics_without_bounds_have_probabilities() {
        for rest in [2.0, 30.0] {
            assert_eq!(p_of(1.0, 3, f64::MIN_POSITIVE, rest), 0.0);
            assert_eq!(p_of(-1e-20, 1, 1.0, rest), 1.0);
            assert_eq!(p_of(0.0, 2, 0.0, rest), 1.0);
        }
    }

    #[test]
    fn what_the_model_contains_is_not_tested() {
        let base = Mat::from_fn(ROWS, 4, |k, j| (k as f64 / ROWS as f64).powi(j as i32));
        let observed: Vec<f64> = (0..ROWS).map(|k| (k as f64 * 0.7).sin()).collect();
        let (fit, _) = Linear::least_squares(base.clone(), &observed).unwrap();
        let group = Mat::from_fn(ROWS, 2, |k, j| base[(k, j)] + base[(k, 3)]);
        let found = score_of(&fit, group.as_ref());
        assert_eq!((found.degrees, found.p_value), (0, 1.0));
    }
}
