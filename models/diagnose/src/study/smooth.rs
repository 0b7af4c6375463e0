//! Smooth shapes of logged quantities: Legendre polynomials of one or two, scaled to their own range.
//!
//! Place in the flow: the look without candidates, and every "smooth function of" in positioning runs.

use abbe_geometry::effects;

/// Range of the values, `None` where they do not vary.
pub(super) fn range(values: &[f64]) -> Option<(f64, f64)> {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    (high - low > 1e-9 * high.abs().max(low.abs())).then_some((low, high))
}

/// P_0 … P_degree at the share of the range scaled to −1 … 1.
pub(super) fn legendre(value: f64, (low, high): (f64, f64), degree: usize) -> Vec<f64> {
    effects::legendre(2.0 * (value - low) / (high - low) - 1.0, degree).into_vec()
}

/// Number of different values.
pub(super) fn levels(values: &[f64]) -> usize {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup_by(|a, b| (*a - *b).abs() <= 1e-9 * (1.0 + b.abs()));
    sorted.len()
}
