//! Small statistics of samples that a report draws: rms, largest magnitude, quantiles.
//!
//! All functions return `None` for an empty sample, so that nothing is shown as zero.

use serde::{Deserialize, Serialize};

/// Root mean square of a sample, in the unit of the sample.
pub fn rms(values: &[f64]) -> Option<f64> {
    let count = values.len();
    (count > 0).then(|| (values.iter().map(|v| v * v).sum::<f64>() / count as f64).sqrt())
}

/// Largest magnitude of a sample, in the unit of the sample.
pub fn max_abs(values: &[f64]) -> Option<f64> {
    values.iter().map(|v| v.abs()).reduce(f64::max)
}

/// Quantile `p` (0 to 1) of an ascending sample, linear between order statistics (Hyndman–Fan type 7).
pub fn quantile_sorted(sorted: &[f64], p: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let position = p.clamp(0.0, 1.0) * last as f64;
    let low = sorted.get(position.floor() as usize)?;
    let high = sorted.get(position.ceil() as usize)?;
    Some(low + (high - low) * position.fract())
}

/// Ascending copy of a sample (total order, so the result never depends on the sort algorithm).
pub fn sorted(values: &[f64]) -> Vec<f64> {
    let mut copy = values.to_vec();
    copy.sort_by(f64::total_cmp);
    copy
}

/// What a box of a box plot shows; all in the unit of the sample.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BoxStats {
    /// Size of the sample.
    pub count: usize,
    /// 5 % quantile, lower whisker.
    pub p05: f64,
    /// Lower quartile.
    pub q25: f64,
    /// Median.
    pub median: f64,
    /// Upper quartile.
    pub q75: f64,
    /// 95 % quantile, upper whisker.
    pub p95: f64,
    /// Largest value.
    pub max: f64,
    /// Root mean square.
    pub rms: f64,
}

impl BoxStats {
    /// Statistics of a sample; `None` when it is empty.
    pub fn of(values: &[f64]) -> Option<Self> {
        let ascending = sorted(values);
        Some(Self {
            count: ascending.len(),
            p05: quantile_sorted(&ascending, 0.05)?,
            q25: quantile_sorted(&ascending, 0.25)?,
            median: quantile_sorted(&ascending, 0.5)?,
            q75: quantile_sorted(&ascending, 0.75)?,
            p95: quantile_sorted(&ascending, 0.95)?,
            max: *ascending.last()?,
            rms: rms(values)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn box_of_a_known_sample() {
        let stats = BoxStats::of(&[4.0, 1.0, 3.0, 2.0, 5.0]).unwrap();
        assert_eq!((stats.q25, stats.median, stats.q75, stats.max), (2.0, 3.0, 4.0, 5.0));
        assert_eq!(stats.rms, 11.0_f64.sqrt());
        assert!((stats.p95 - 4.8).abs() < 1e-12);
        assert_eq!(BoxStats::of(&[]), None);
    }
}
