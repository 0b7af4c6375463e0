//! Figures of columns of a campaign: their range, whether they vary, how far two go together.
//!
//! Place in the flow: what is offered to effects, and what is the same to the data, is decided by these. Units are those of the columns.

use abbe_measurement::campaign::Campaign;

/// Spread, as a share of the largest magnitude, from which a covariate counts as varying.
const VARYING: f64 = 1e-9;

/// Least and greatest of some values.
pub(crate) fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
}

/// Whether a column has a number everywhere, and more than one.
pub(crate) fn varies(values: &[Option<f64>]) -> bool {
    let is_whole = values.iter().all(|value| value.is_some_and(f64::is_finite));
    let (low, high) = range(values.iter().flatten().copied());
    is_whole && high - low > VARYING * low.abs().max(high.abs())
}

/// Pearson's coefficient of correlation.
pub(crate) fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
    let (ma, mb) = (mean(a), mean(b));
    let sum = |f: &dyn Fn(f64, f64) -> f64| a.iter().zip(b).map(|(x, y)| f(x - ma, y - mb)).sum::<f64>();
    sum(&|x, y| x * y) / (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt()
}

/// Share of the campaign that has passed at each reading, from the first to the last of those used. Without times the order has to do.
pub(crate) fn passed(campaign: &Campaign, used: impl Iterator<Item = usize>) -> Vec<f64> {
    let readings = &campaign.readings;
    let (first_s, last_s) = range(used.map(|k| readings[k].time_s));
    let of = |k: usize| match last_s > first_s {
        true => (readings[k].time_s - first_s) / (last_s - first_s),
        false => k as f64 / readings.len() as f64,
    };
    (0..readings.len()).map(of).collect()
}
