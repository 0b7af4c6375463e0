//! How well a fit predicts blocks that it did not see, with an interval.
//!
//! Place in the flow: every rung, effect and alternative is judged here. Whitened residuals in, µm out.

use super::fit::Fit;
use super::outcome::{HeldOutRms, Judgement};
use super::view::View;
use crate::held_out::HeldOut;
use crate::linear::{joined, picked};
use abbe_identify::symmetric_eigen;
use faer::Mat;
use statrs::distribution::{ContinuousCDF, StudentsT};

const UM: f64 = 1e6;
/// 1 − eigenvalue from which a direction of a block is determined by other blocks too.
const DETERMINED: f64 = 1e-6;

/// Judges a fit on the study's blocks.
pub(super) fn judge(view: &View, fit: &Fit) -> Judgement {
    let unit_um = view.study.unit_m() * UM;
    let chi2: f64 = fit.raw_residuals.iter().map(|r| r * r).sum();
    let (rows, degrees) = (fit.raw_residuals.len().max(1) as f64, fit.linear.degrees());
    Judgement {
        rms_um: (chi2 / rows).sqrt() * unit_um,
        held_out: held_out_rms(view, fit),
        chi2_per_dof: view.study.is_declared().then_some(chi2 / degrees),
        estimated_sigma_um: (chi2 / degrees).sqrt() * unit_um,
        degrees_of_freedom: degrees,
    }
}

/// Root mean square over all blocks, each predicted from the others.
pub(super) fn held_out_rms(view: &View, fit: &Fit) -> HeldOutRms {
    rms_of(view, &held_out(view, fit))
}

/// The same from errors of blocks.
pub(super) fn rms_of(view: &View, blocks: &[HeldOut]) -> HeldOutRms {
    let unit_um = view.study.unit_m() * UM;
    let interval_um = interval(blocks).map(|(low, high)| (low * unit_um, high * unit_um));
    let judged = blocks.iter().map(|block| block.judged).sum();
    HeldOutRms { rms_um: pooled(blocks.iter()) * unit_um, interval_um, judged }
}

/// Errors of each block as the fit of the others predicts it, without refitting: with whitened rows R = J L, R_b those of
/// the block and S_b the same rows before whitening, the parameters move by −L (I − R_bᵀR_b)⁻¹ R_bᵀ r_b. Directions that
/// only the block determines are not judged.
fn held_out(view: &View, fit: &Fit) -> Vec<HeldOut> {
    predicted(view, fit).iter().map(|(error, own_only)| without(error, own_only)).collect()
}

/// The same of two fits, over the directions that both determine: a step is not determined where all that lies on one side of it is
/// left out, and what lies on the other side judges it all the same.
pub(super) fn held_out_alike(view: &View, one: &Fit, other: &Fit) -> (HeldOutRms, HeldOutRms) {
    let judged = |((one, own), (other, others)): (Predicted, Predicted)| {
        let own_only = joined(&[own, others]);
        (without(&one, &own_only), without(&other, &own_only))
    };
    let (one, other): (Vec<HeldOut>, Vec<HeldOut>) =
        predicted(view, one).into_iter().zip(predicted(view, other)).map(judged).unzip();
    (rms_of(view, &one), rms_of(view, &other))
}

/// Errors of the rows of a block, and the directions in them that only the block determines.
type Predicted = (Mat<f64>, Mat<f64>);

fn predicted(view: &View, fit: &Fit) -> Vec<Predicted> {
    let spread = fit.linear.spread();
    let raw = &fit.raw_columns * fit.linear.root();
    let one = |block: &Vec<usize>| {
        let (own, own_raw) = (picked(spread, block), picked(raw.as_ref(), block));
        let residuals = Mat::from_fn(block.len(), 1, |i, _| fit.linear.residuals()[block[i]]);
        let Some((values, vectors)) = symmetric_eigen(&(own.transpose() * &own)) else {
            return (Mat::zeros(block.len(), 1), Mat::identity(block.len(), block.len()));
        };
        let mut along = vectors.transpose() * (own.transpose() * &residuals);
        let free: Vec<usize> = (0..values.len()).filter(|k| 1.0 - values[*k] <= DETERMINED).collect();
        (0..values.len())
            .for_each(|k| along[(k, 0)] = if free.contains(&k) { 0.0 } else { along[(k, 0)] / (1.0 - values[k]) });
        let moved = &own_raw * (&vectors * &along);
        let error = Mat::from_fn(block.len(), 1, |i, _| fit.raw_residuals[block[i]] + moved[(i, 0)]);
        let own_only = &own_raw * Mat::from_fn(values.len(), free.len(), |i, j| vectors[(i, free[j])]);
        (error, own_only)
    };
    view.blocks().iter().map(one).collect()
}

/// Square of an error outside the span of columns, and the directions left.
pub(super) fn without(error: &Mat<f64>, columns: &Mat<f64>) -> HeldOut {
    let all = error.squared_norm_l2();
    if columns.ncols() == 0 {
        return HeldOut { square: all, judged: error.nrows() };
    }
    let basis = super::series::independent(columns);
    let inside = (basis.transpose() * error).squared_norm_l2();
    HeldOut { square: (all - inside).max(0.0), judged: error.nrows() - basis.ncols() }
}

fn pooled<'a>(blocks: impl Iterator<Item = &'a HeldOut>) -> f64 {
    let (square, judged) = blocks.fold((0.0, 0), |(s, n), block| (s + block.square, n + block.judged));
    if judged == 0 { 0.0 } else { (square / judged as f64).sqrt() }
}

/// Jackknife over blocks on ln(rms), so that the interval stays above zero (Efron & Tibshirani 1993, chapter 11).
fn interval(blocks: &[HeldOut]) -> Option<(f64, f64)> {
    let used: Vec<&HeldOut> = blocks.iter().filter(|block| block.judged > 0).collect();
    let of = |list: &[&HeldOut]| pooled(list.iter().copied()).ln();
    let (all, reach) = jackknife(&used, &of, 0.975)?;
    Some(((all - reach).exp(), (all + reach).exp()))
}

/// Whether the error comes down from the first to the second by more than the blocks differ in, with this probability (one-sided).
pub(super) fn comes_down(before: &[HeldOut], after: &[HeldOut], probability: f64) -> bool {
    let used: Vec<(&HeldOut, &HeldOut)> = before.iter().zip(after).filter(|(own, _)| own.judged > 0).collect();
    let of = |list: &[(&HeldOut, &HeldOut)]| {
        let ln = |rms: f64| rms.max(f64::MIN_POSITIVE).ln();
        ln(pooled(list.iter().map(|(_, after)| *after))) - ln(pooled(list.iter().map(|(before, _)| *before)))
    };
    jackknife(&used, &of, probability).is_some_and(|(all, reach)| all + reach < 0.0)
}

/// A figure of all blocks, and how far it may be off with this probability (one-sided); `None` with fewer than three.
fn jackknife<T: Copy>(blocks: &[T], of: &dyn Fn(&[T]) -> f64, probability: f64) -> Option<(f64, f64)> {
    let without = |k: usize| {
        let rest: Vec<T> = (0..blocks.len()).filter(|j| *j != k).map(|j| blocks[j]).collect();
        of(&rest)
    };
    let all = of(blocks);
    let partial: Vec<f64> = (0..blocks.len()).map(without).collect();
    if blocks.len() < 3 || !all.is_finite() || partial.iter().any(|value| !value.is_finite()) {
        return None;
    }
    let n = blocks.len() as f64;
    let mean = partial.iter().sum::<f64>() / n;
    let spread = ((n - 1.0) / n * partial.iter().map(|value| (value - mean).powi(2)).sum::<f64>()).sqrt();
    let reach = StudentsT::new(0.0, 1.0, n - 1.0).ok()?.inverse_cdf(probability) * spread;
    Some((all, reach))
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

    #[test]
    fn an_error_comes_down_where_most_blocks_agree_and_not_where_one_decides() {
        let of = |squares: [f64; 6]| squares.map(|square| HeldOut { square, judged: 2 });
        let before = of([8.0, 9.0, 7.0, 8.0, 9.0, 7.0]);
        assert!(comes_down(&before, &of([4.0, 5.0, 4.0, 4.0, 3.0, 4.0]), 0.95));
        // The mean comes down, by one block alone.
        assert!(!comes_down(&before, &of([8.0, 9.0, 7.0, 1.0, 9.0, 8.0]), 0.95));
        assert!(!comes_down(&before, &before, 0.95));
    }
}
