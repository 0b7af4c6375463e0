//! Cubic B-spline error function on equal intervals with clamped ends.
//!
//! Place in the flow: one kind of [`super::Basis`]; identification penalises its curvature. With clamped ends the
//! first coefficient is the value at the lower end and the last the value at the upper end, so the gauge
//! constraints are coefficients left out (de Boor, A Practical Guide to Splines).

use super::{Closure, LocalBasis, without_fixed};

const DEGREE: usize = 3;

/// B-splines (or first derivatives) at `t` in 0 … 1.
pub(super) fn local(intervals: usize, closure: Closure, t: f64, derivative: bool) -> LocalBasis {
    let span = span(intervals, t);
    let values = if derivative { derivative_values(intervals, span, t) } else { values(intervals, span, t, DEGREE) };
    without_fixed(span, &values, intervals + DEGREE, closure)
}

/// ∫ f″² over the unit stroke, exact by Simpson's rule: f″ is linear in each interval.
pub(super) fn roughness(intervals: usize, closure: Closure) -> Vec<f64> {
    let total = intervals + DEGREE;
    let free: Vec<usize> = (1..total - usize::from(closure == Closure::BothEnds)).collect();
    let mut full = vec![0.0; total * total];
    let width = 1.0 / intervals as f64;
    for span in 0..intervals {
        for (at, weight) in [(0.0, 1.0 / 6.0), (0.5, 4.0 / 6.0), (1.0, 1.0 / 6.0)] {
            let second = second_derivative_values(intervals, span, (span as f64 + at) * width);
            for i in 0..=DEGREE {
                for j in 0..=DEGREE {
                    full[(span + i) * total + span + j] += weight * width * second[i] * second[j];
                }
            }
        }
    }
    free.iter().flat_map(|i| free.iter().map(move |j| (i, j))).map(|(i, j)| full[i * total + j]).collect()
}

fn span(intervals: usize, t: f64) -> usize {
    ((t * intervals as f64).floor() as usize).min(intervals - 1)
}

/// Knot `index` of the clamped vector for splines of `degree`, counted so that interval `s` lies between knots
/// `s + degree` and `s + degree + 1`.
fn knot(intervals: usize, degree: usize, index: usize) -> f64 {
    index.saturating_sub(degree).min(intervals) as f64 / intervals as f64
}

/// The `degree + 1` B-splines that are non-zero in `span`, by the Cox-de Boor recurrence; unused entries are 0. Knots
/// are counted in intervals here, where they are whole numbers.
fn values(intervals: usize, span: usize, t: f64, degree: usize) -> [f64; DEGREE + 1] {
    let at = t * intervals as f64;
    let mut n = [0.0; DEGREE + 1];
    n[0] = 1.0;
    for d in 1..=degree {
        let mut saved = 0.0;
        for r in 0..d {
            let right = (span + r + 1).min(intervals) as f64;
            let left = (span + r + 1).saturating_sub(d) as f64;
            let part = n[r] / (right - left);
            n[r] = saved + (right - at) * part;
            saved = (at - left) * part;
        }
        n[d] = saved;
    }
    n
}

/// First derivatives of the cubics from the quadratics of the same span.
fn derivative_values(intervals: usize, span: usize, t: f64) -> [f64; DEGREE + 1] {
    differentiate(intervals, span, &values(intervals, span, t, DEGREE - 1), DEGREE)
}

/// Second derivatives of the cubics from the hats of the same span.
fn second_derivative_values(intervals: usize, span: usize, t: f64) -> [f64; DEGREE + 1] {
    let first = differentiate(intervals, span, &values(intervals, span, t, DEGREE - 2), DEGREE - 1);
    differentiate(intervals, span, &first, DEGREE)
}

/// One differentiation: B′ of `degree` = degree · (Bᵢ/(kᵢ₊d − kᵢ) − Bᵢ₊₁/(kᵢ₊₁₊d − kᵢ₊₁)) of degree − 1.
fn differentiate(intervals: usize, span: usize, lower: &[f64; DEGREE + 1], degree: usize) -> [f64; DEGREE + 1] {
    let mut out = [0.0; DEGREE + 1];
    let d = degree as f64;
    for i in 0..degree {
        let width = knot(intervals, degree, span + i + 1 + degree) - knot(intervals, degree, span + i + 1);
        out[i] -= d * lower[i] / width;
        out[i + 1] += d * lower[i] / width;
    }
    out
}
