//! Residuals of blocks that the fit did not see, without refitting.
//!
//! Place in the flow: the judge of every gain. For a linear fit with covariance V the residual of a block left out is
//! (I − H)⁻¹ r with H = J V Jᵀ over the block's rows (Cook & Weisberg 1982, generalised to blocks and priors; exact).
//! What only the block itself determines (the position of a station whose readings are all left out) has eigenvalue 1
//! in H: there the fit has no opinion, and that part of the block is not judged. Whitened rows; no units.

use crate::linear::{Linear, column};
use abbe_identify::symmetric_eigen;
use faer::Mat;

/// 1 − eigenvalue from which a direction of a block is determined by other blocks too.
const DETERMINED: f64 = 1e-6;

/// One block left out.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldOut {
    /// Sum of squared whitened residuals of the block, predicted without it.
    pub square: f64,
    /// Directions judged: rows of the block less those that only the block determines.
    pub judged: usize,
}

/// Predicts each block (indices of rows) from all others.
pub fn held_out(fit: &Linear, blocks: &[Vec<usize>]) -> Vec<HeldOut> {
    blocks.iter().map(|block| one(fit, block)).collect()
}

fn one(fit: &Linear, block: &[usize]) -> HeldOut {
    let parameters = fit.jacobian().ncols();
    let rows = Mat::from_fn(block.len(), parameters, |i, j| fit.jacobian()[(block[i], j)]);
    let hat = &rows * fit.covariance() * rows.transpose();
    let residuals: Vec<f64> = block.iter().map(|k| fit.residuals()[*k]).collect();
    let Some((values, vectors)) = symmetric_eigen(&hat) else { return HeldOut { square: 0.0, judged: 0 } };
    let along = vectors.transpose() * column(&residuals);
    let (mut square, mut judged) = (0.0, 0);
    for (k, value) in values.iter().enumerate() {
        let rest = 1.0 - value;
        if rest > DETERMINED {
            square += (along[(k, 0)] / rest).powi(2);
            judged += 1;
        }
    }
    HeldOut { square, judged }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_what_a_fit_without_the_block_predicts() {
        let count = 50;
        let base = Mat::from_fn(count, 4, |k, j| (k as f64 / 20.0).powi(j as i32));
        let observed: Vec<f64> = (0..count).map(|k| (0.7 * k as f64).sin()).collect();
        let (fit, _) = Linear::least_squares(base.clone(), &observed).unwrap();
        let block: Vec<usize> = (10..17).collect();
        let kept: Vec<usize> = (0..count).filter(|k| !block.contains(k)).collect();
        let part = Mat::from_fn(kept.len(), 4, |i, j| base[(kept[i], j)]);
        let seen: Vec<f64> = kept.iter().map(|k| observed[*k]).collect();
        let (_, parameters) = Linear::least_squares(part, &seen).unwrap();
        let predicted = |k: usize| (0..4).map(|j| base[(k, j)] * parameters[j]).sum::<f64>();
        let expected: f64 = block.iter().map(|k| (observed[*k] - predicted(*k)).powi(2)).sum();
        let found = &held_out(&fit, &[block])[0];
        assert_eq!(found.judged, 7);
        assert!((found.square / expected - 1.0).abs() < 1e-8, "{} {expected}", found.square);
    }

    #[test]
    fn what_only_the_block_determines_is_not_judged() {
        let base = Mat::from_fn(12, 2, |k, j| if (k < 6) == (j == 0) { 1.0 } else { 0.0 });
        let observed: Vec<f64> = (0..12).map(|k| f64::from(k % 3)).collect();
        let (fit, _) = Linear::least_squares(base, &observed).unwrap();
        let found = &held_out(&fit, &[(0..6).collect()])[0];
        assert_eq!(found.judged, 5);
        assert!((found.square - 4.0).abs() < 1e-9, "scatter about the block's own mean: {}", found.square);
    }
}
