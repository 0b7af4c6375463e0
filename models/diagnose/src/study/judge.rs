//! How well a fit predicts blocks that it did not see, with an interval.
//!
//! Place in the flow: every rung, effect and alternative is judged here. Whitened residuals in, µm out.

use super::candidate::Study;
use super::diagnosis::{HeldOutRms, Judgement};
use crate::held_out::{HeldOut, held_out};
use crate::linear::Linear;
use statrs::distribution::{ContinuousCDF, StudentsT};

const UM: f64 = 1e6;

/// Judges a fit on the study's blocks.
pub(super) fn judge(study: &dyn Study, linear: &Linear) -> Judgement {
    let unit_um = study.unit_m() * UM;
    let rows = linear.residuals().len().max(1) as f64;
    Judgement {
        rms_um: (linear.chi2() / rows).sqrt() * unit_um,
        held_out: held_out_rms(study, linear),
        chi2_per_dof: study.is_declared().then(|| linear.noise_factor()),
        estimated_sigma_um: linear.noise_factor().sqrt() * unit_um,
        degrees_of_freedom: linear.degrees(),
    }
}

/// Root mean square over all blocks, each predicted from the others.
pub(super) fn held_out_rms(study: &dyn Study, linear: &Linear) -> HeldOutRms {
    let unit_um = study.unit_m() * UM;
    let blocks = held_out(linear, study.blocks());
    let rms = pooled(blocks.iter());
    let interval_um = interval(&blocks).map(|(low, high)| (low * unit_um, high * unit_um));
    HeldOutRms { rms_um: rms * unit_um, interval_um, judged: blocks.iter().map(|block| block.judged).sum() }
}

fn pooled<'a>(blocks: impl Iterator<Item = &'a HeldOut>) -> f64 {
    let (square, judged) = blocks.fold((0.0, 0), |(s, n), block| (s + block.square, n + block.judged));
    if judged == 0 { 0.0 } else { (square / judged as f64).sqrt() }
}

/// Jackknife over blocks on ln(rms), so that the interval stays above zero (Efron & Tibshirani 1993, chapter 11).
fn interval(blocks: &[HeldOut]) -> Option<(f64, f64)> {
    let count = blocks.iter().filter(|block| block.judged > 0).count();
    let all = pooled(blocks.iter()).ln();
    let without = |k: usize| pooled(blocks.iter().enumerate().filter(|(j, _)| *j != k).map(|(_, block)| block)).ln();
    let partial: Vec<f64> = (0..blocks.len()).filter(|k| blocks[*k].judged > 0).map(without).collect();
    if count < 3 || !all.is_finite() || partial.iter().any(|value| !value.is_finite()) {
        return None;
    }
    let n = count as f64;
    let mean = partial.iter().sum::<f64>() / n;
    let spread = ((n - 1.0) / n * partial.iter().map(|value| (value - mean).powi(2)).sum::<f64>()).sqrt();
    let reach = StudentsT::new(0.0, 1.0, n - 1.0).ok()?.inverse_cdf(0.975) * spread;
    Some(((all - reach).exp(), (all + reach).exp()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_blocks_leave_no_doubt_and_unequal_ones_some() {
        let equal = vec![HeldOut { square: 8.0, judged: 2 }; 6];
        let (low, high) = interval(&equal).unwrap();
        assert!((pooled(equal.iter()) - 2.0).abs() < 1e-12 && (low - 2.0).abs() < 1e-9 && (high - 2.0).abs() < 1e-9);
        let mut unequal = equal;
        unequal[3].square = 40.0;
        let (low, high) = interval(&unequal).unwrap();
        assert!(low < pooled(unequal.iter()) && pooled(unequal.iter()) < high && low > 0.0);
        assert_eq!(interval(&unequal[..2]), None);
    }
}
