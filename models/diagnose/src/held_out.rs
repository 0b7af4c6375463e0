//! Residuals of blocks that the fit did not see, without refitting.
//!
//! Place in the flow: the judge of every gain. For a linear fit with covariance V the residual of a block left out is
//! (I − H)⁻¹ r with H = J V Jᵀ over the block's rows (Cook & Weisberg 1982, generalised to blocks and priors; exact).
//! What only the block itself determines (the position of a station whose readings are all left out) has eigenvalue 1
//! in H: there the fit has no opinion, and that part of the block is not judged. With R = J L and V = L Lᵀ, H is R Rᵀ and
//! has the eigenvalues of RᵀR beside zeros. Whitened rows; no units.

use crate::linear::{Linear, column};
use abbe_identify::symmetric_eigen;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};

/// 1 − eigenvalue from which a direction of a block is determined by other blocks too.
const DETERMINED: f64 = 1e-6;
/// Eigenvalue of RᵀR below which a direction of the parameters is not in the block: rounding is a thousandth of it.
const NONE: f64 = 1e-12;

/// One block left out.
#[derive(Debug, Clone, Copy, PartialEq)]
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
    let spread = fit.spread();
    let rows = Mat::from_fn(block.len(), spread.ncols(), |i, j| spread[(block[i], j)]);
    let residuals: Vec<f64> = block.iter().map(|k| fit.residuals()[*k]).collect();
    if rows.nrows() > rows.ncols() { tall(&rows, &residuals) } else { determined(&rows, &residuals) }
}

/// A block of no more rows than parameters: where all its directions are determined by other blocks too, which Cholesky's
/// factor of (1 − limit) I − H shows, the residual left out is the solution of one equation.
fn determined(rows: &Mat<f64>, residuals: &[f64]) -> HeldOut {
    let hat = rows * rows.transpose();
    let rest = |limit: f64| {
        let entry = |i: usize, j: usize| if i == j { 1.0 - limit - hat[(i, j)] } else { -hat[(i, j)] };
        Llt::new(Mat::from_fn(hat.nrows(), hat.ncols(), entry).as_ref(), Side::Lower)
    };
    match (rest(DETERMINED), rest(0.0)) {
        (Ok(_), Ok(factor)) => {
            let left_out = factor.solve(column(residuals));
            HeldOut { square: left_out.squared_norm_l2(), judged: residuals.len() }
        }
        _ => by_directions(&hat, |_, vectors| vectors.transpose() * column(residuals)),
    }
}

/// A block of more rows than parameters: the directions in which H is not zero come from RᵀR, which has the size of the
/// parameters; in all others the residual stays as it is.
fn tall(rows: &Mat<f64>, residuals: &[f64]) -> HeldOut {
    let shared = rows.transpose() * column(residuals);
    let mut inside = 0.0;
    let of_model = by_directions(&(rows.transpose() * rows), |values, vectors| {
        let mut along = vectors.transpose() * &shared;
        for (k, value) in values.iter().enumerate() {
            along[(k, 0)] = if *value > NONE { along[(k, 0)] / value.sqrt() } else { 0.0 };
        }
        inside = along.squared_norm_l2();
        along
    });
    let all: f64 = residuals.iter().map(|r| r * r).sum();
    let judged = of_model.judged + rows.nrows() - rows.ncols();
    HeldOut { square: of_model.square + (all - inside).max(0.0), judged }
}

/// Sum over the eigenvectors of a symmetric matrix whose directions others determine too, given the residual along each.
fn by_directions(matrix: &Mat<f64>, along: impl FnOnce(&[f64], &Mat<f64>) -> Mat<f64>) -> HeldOut {
    let Some((values, vectors)) = symmetric_eigen(matrix) else { return HeldOut { square: 0.0, judged: 0 } };
    let along = along(&values, &vectors);
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

    /// The fit of 50 rows by four columns, and the sum of squares that a fit without `block` leaves there.
    fn refitted(block: &[usize]) -> (Linear, f64) {
        let count = 50;
        let base = Mat::from_fn(count, 4, |k, j| (k as f64 / 20.0).powi(j as i32));
        let observed: Vec<f64> = (0..count).map(|k| (0.7 * k as f64).sin()).collect();
        let (fit, _) = Linear::least_squares(base.clone(), &observed).unwrap();
        let kept: Vec<usize> = (0..count).filter(|k| !block.contains(k)).collect();
        let part = Mat::from_fn(kept.len(), 4, |i, j| base[(kept[i], j)]);
        let seen: Vec<f64> = kept.iter().map(|k| observed[*k]).collect();
        let (_, parameters) = Linear::least_squares(part, &seen).unwrap();
        let predicted = |k: usize| (0..4).map(|j| base[(k, j)] * parameters[j]).sum::<f64>();
        (fit, block.iter().map(|k| (observed[*k] - predicted(*k)).powi(2)).sum())
    }

    #[test]
    fn it_is_what_a_fit_without_the_block_predicts_for_blocks_smaller_and_larger_than_the_model() {
        for block in [vec![5], (10..13).collect(), (10..17).collect(), (3..40).collect::<Vec<_>>()] {
            let (fit, expected) = refitted(&block);
            let found = &held_out(&fit, std::slice::from_ref(&block))[0];
            assert_eq!(found.judged, block.len());
            assert!((found.square / expected - 1.0).abs() < 1e-8, "{} {expected}", found.square);
        }
    }

    #[test]
    fn what_only_the_block_determines_is_not_judged() {
        let base = Mat::from_fn(12, 2, |k, j| if (k < 6) == (j == 0) { 1.0 } else { 0.0 });
        let observed: Vec<f64> = (0..12).map(|k| f64::from(k % 3)).collect();
        let (fit, _) = Linear::least_squares(base, &observed).unwrap();
        let found = &held_out(&fit, &[(0..6).collect()])[0];
        assert_eq!(found.judged, 5);
        assert!((found.square - 4.0).abs() < 1e-9, "scatter about the block's own mean: {}", found.square);
        // A block of one row alone on its parameter, of fewer rows than parameters.
        let base = Mat::from_fn(7, 2, |k, j| if (k == 0) == (j == 0) { 1.0 } else { 0.0 });
        let (fit, _) = Linear::least_squares(base, &observed[..7]).unwrap();
        assert_eq!(held_out(&fit, &[vec![0]])[0], HeldOut { square: 0.0, judged: 0 });
    }
}
