//! Means, reversal values and repeatability target by target, as ISO 230-2 tabulates them.
//!
//! Place in the flow: beside the diagnosis, for the report. Metres in, metres out. Source: ISO 230-2:2014, 3.11–3.21.

use super::{Approach, Run};
use std::collections::BTreeMap;

/// One target of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionSummary {
    /// Axis.
    pub axis: String,
    /// Target (m).
    pub target_m: f64,
    /// Mean error in the positive direction (m).
    pub mean_positive_m: Option<f64>,
    /// Mean error in the negative direction (m).
    pub mean_negative_m: Option<f64>,
    /// Standard deviation of one approach in the positive direction (m); needs two.
    pub deviation_positive_m: Option<f64>,
    /// Standard deviation of one approach in the negative direction (m); needs two.
    pub deviation_negative_m: Option<f64>,
}

impl PositionSummary {
    /// Reversal value B: positive less negative mean (m).
    pub fn reversal_m(&self) -> Option<f64> {
        Some(self.mean_positive_m? - self.mean_negative_m?)
    }
}

/// Targets closer than this are one (m).
const SAME_M: f64 = 1e-9;

/// A target as whole nanometres, to order and group by.
pub(super) fn key(target_m: f64) -> i64 {
    (target_m / SAME_M).round() as i64
}

/// Every target of every axis, in order.
pub fn positions(runs: &[Run]) -> Vec<PositionSummary> {
    let mut groups: BTreeMap<(&str, i64), Vec<&Run>> = BTreeMap::new();
    for run in runs {
        groups.entry((&run.axis, key(run.target_m))).or_default().push(run);
    }
    groups.into_iter().map(|((axis, _), runs)| summary(axis, &runs)).collect()
}

fn summary(axis: &str, runs: &[&Run]) -> PositionSummary {
    let errors = |approach: Approach| -> Vec<f64> {
        runs.iter().filter(|run| run.approach == approach).map(|run| run.error_m()).collect()
    };
    let (positive, negative) = (errors(Approach::Positive), errors(Approach::Negative));
    PositionSummary {
        axis: axis.to_owned(),
        target_m: runs[0].target_m,
        mean_positive_m: mean(&positive),
        mean_negative_m: mean(&negative),
        deviation_positive_m: deviation(&positive),
        deviation_negative_m: deviation(&negative),
    }
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

fn deviation(values: &[f64]) -> Option<f64> {
    let mean = mean(values).filter(|_| values.len() > 1)?;
    let square: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    Some((square / (values.len() - 1) as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reversal_value_is_positive_less_negative() {
        let run = |approach, cycle, error_um: f64| Run {
            axis: "X".to_owned(),
            target_m: 0.1,
            approach,
            cycle,
            measured_m: 0.1 + error_um * 1e-6,
            time_s: None,
            covariates: BTreeMap::new(),
        };
        use Approach::{Negative, Positive};
        let table = positions(&[run(Positive, 1, 3.0), run(Negative, 1, 1.0), run(Positive, 2, 5.0)]);
        assert_eq!(table.len(), 1);
        assert!((table[0].reversal_m().unwrap() - 3e-6).abs() < 1e-15);
        assert!((table[0].deviation_positive_m.unwrap() - 2f64.sqrt() * 1e-6).abs() < 1e-12);
        assert_eq!(table[0].deviation_negative_m, None);
    }
}
