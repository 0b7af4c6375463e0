//! Smooth errors of position beside which a wave may be told, and those from which it must be.
//!
//! Place in the flow: part of the study of runs. A wave that the targets show as a slow one is much the same as a polynomial, and must be seen
//! beside these. One that goes up and down from target to target is like any other row of numbers there: beside what the fit has, chance
//! goes through as much of these as of any.

use super::super::shape::Shape;
use super::{AxisRuns, Runs};
use crate::study::series::left_by;
use crate::study::smooth::legendre;
use faer::Mat;
use std::f64::consts::TAU;

/// Highest degree of the polynomials that a wave must stand apart from.
const SMOOTH: usize = 6;
/// Highest degree of those beside which it is sought: with more, few targets leave nothing to be told by.
const BESIDE: usize = 3;

impl Runs {
    /// Polynomials of the target, up to one for every second target, where a wave is slow at the targets; else nothing.
    pub(super) fn smooth_for(&self, candidate: usize) -> Mat<f64> {
        let (axis, shape) = &self.shapes[candidate];
        let own = &self.axes[*axis];
        match shape {
            Shape::Periodic(period_m) if own.is_rough(*period_m) => Mat::zeros(0, 0),
            _ => self.shape_columns(*axis, &Shape::Position(own.smooth_degree())),
        }
    }

    /// Polynomials among the candidates of the axis of a wave.
    pub(super) fn smooth_of(&self, candidate: usize) -> Vec<usize> {
        let (axis, Shape::Periodic(_)) = &self.shapes[candidate] else { return Vec::new() };
        let is_own = |k: &usize| self.shapes[*k].0 == *axis && matches!(self.shapes[*k].1, Shape::Position(1..=BESIDE));
        (0..self.shapes.len()).filter(is_own).collect()
    }

    /// Smooth errors, or none, beside which a wave is tried.
    pub(super) fn forms_of(&self, candidate: usize) -> f64 {
        1.0 + self.smooth_of(candidate).len() as f64
    }
}

impl AxisRuns {
    fn smooth_degree(&self) -> usize {
        SMOOTH.min(self.ranges.targets.len() / 2)
    }

    /// Whether a wave is faster than the targets resolve, and polynomials do no more of it there than of any row of numbers.
    fn is_rough(&self, period_m: f64) -> bool {
        let (count, (low_m, high_m)) = (self.ranges.targets.len() as f64, self.ranges.target_m);
        let by_chance = self.smooth_degree() as f64 / (count - 1.0);
        2.0 * (high_m - low_m) > (count - 1.0) * period_m && self.smooth_share(period_m) < 0.5 * (1.0 + by_chance)
    }

    /// Share of a wave at the targets, beyond its mean, that polynomials explain.
    fn smooth_share(&self, period_m: f64) -> f64 {
        let (places_m, degree) = (self.ranges.places_m(), self.smooth_degree());
        let legendre = |x: &f64| legendre(*x, self.ranges.target_m, degree);
        let forms: Vec<_> = places_m.iter().map(legendre).collect();
        let up_to = |degree: usize| Mat::from_fn(forms.len(), degree + 1, |i, k| forms[i][k]);
        let turns: Vec<(f64, f64)> = places_m.iter().map(|x| (TAU * x / period_m).sin_cos()).collect();
        let wave = Mat::from_fn(turns.len(), 2, |i, k| if k == 0 { turns[i].0 } else { turns[i].1 });
        let left = |degree: usize| left_by(&up_to(degree), &wave).squared_norm_l2();
        1.0 - left(degree) / left(0).max(f64::MIN_POSITIVE)
    }
}
