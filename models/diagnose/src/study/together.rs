//! The test of an effect that acts on several chains at once, each with noise of its own.
//!
//! Place in the flow: where the search scores or gates a candidate that moves more than one component. The noise of a chain is
//! estimated from what the present fit leaves, so it holds what is missing. A candidate of one component is compared with
//! that component's rows alone, and its share of them is seen; in the sum over all chains the same change of one component
//! drowns among the others. So the deviations are estimated anew beside the columns, as the fit will do that has them, and
//! the gain is that of the whole likelihood: Σ ν ln(χ² before / χ² after) over the chains. The test has the degrees of freedom
//! of the chain that has fewest.

use super::combinations::combinations;
use crate::error::DiagnoseError;
use crate::linear::Linear;
use crate::score::{LEFT, Score, score};
use abbe_measurement::chance::beyond;
use faer::Mat;
use statrs::distribution::FisherSnedecor;

/// Times that the deviations are estimated at most, and the change from which they are settled.
const PASSES: usize = 20;
const SETTLED: f64 = 1e-4;

/// What one pass leaves of the chains.
struct Pass {
    score: Score,
    /// χ² of each chain, in its deviations of this pass, and the degrees of freedom.
    left: Vec<(f64, f64)>,
}

/// Tests columns, whitened as the fit is, that act on these chains (rows of each).
pub(super) fn score_together(fit: &Linear, rows: &[Vec<usize>], whitened: &Mat<f64>) -> Score {
    together(fit, rows, whitened).unwrap_or_else(|_| score(&fit.project(whitened.as_ref()), fit.chi2(), fit.degrees()))
}

fn together(fit: &Linear, rows: &[Vec<usize>], whitened: &Mat<f64>) -> Result<Score, DiagnoseError> {
    let square = |rows: &Vec<usize>| rows.iter().map(|row| fit.residuals()[*row].powi(2)).sum::<f64>();
    let before: Vec<f64> = rows.iter().map(square).collect();
    let mut deviations = vec![1.0; rows.len()];
    let mut last = pass(fit, whitened, rows, &deviations)?;
    for _ in 0..PASSES {
        let mut largest: f64 = 0.0;
        for (deviation, (chi2, degrees)) in deviations.iter_mut().zip(&last.left) {
            let change = (chi2 / degrees).sqrt().max(f64::MIN_POSITIVE);
            *deviation *= change;
            largest = largest.max((change - 1.0).abs());
        }
        last = pass(fit, whitened, rows, &deviations)?;
        if largest < SETTLED {
            break;
        }
    }
    let tested = last.score.degrees;
    if tested == 0 {
        return Ok(last.score);
    }
    let each = before.iter().zip(&last.left).zip(&deviations);
    let gain = each.map(|((before, (chi2, degrees)), deviation)| {
        degrees * (before / (chi2 * deviation * deviation).max(f64::MIN_POSITIVE)).ln()
    });
    let gain = gain.sum::<f64>().max(0.0);
    let fewest = last.left.iter().map(|(_, degrees)| *degrees).fold(f64::INFINITY, f64::min);
    let statistic = last.score.reduction / tested as f64;
    let p_value = FisherSnedecor::new(tested as f64, fewest).map_or(1.0, |f| beyond(&f, statistic));
    Ok(Score { gain, p_value, ..last.score })
}

/// One fit with the columns beside it, rows divided by the deviations of their chains.
fn pass(fit: &Linear, columns: &Mat<f64>, rows: &[Vec<usize>], deviations: &[f64]) -> Result<Pass, DiagnoseError> {
    let mut weights = vec![1.0; columns.nrows()];
    for (rows, deviation) in rows.iter().zip(deviations) {
        rows.iter().for_each(|row| weights[*row] = deviation.recip());
    }
    let jacobian = fit.jacobian();
    let own = Mat::from_fn(jacobian.nrows(), jacobian.ncols(), |i, j| jacobian[(i, j)] * weights[i]);
    let observed: Vec<f64> = fit.residuals().iter().zip(&weights).map(|(r, weight)| r * weight).collect();
    let (linear, _) = Linear::least_squares(own, &observed)?;
    let columns = Mat::from_fn(columns.nrows(), columns.ncols(), |i, j| columns[(i, j)] * weights[i]);
    let group = linear.project(columns.as_ref());
    let score = score(&group, linear.chi2(), linear.degrees());
    // Orthonormal directions of the columns beside the fit.
    let map = combinations(&group.left, &group.alone, LEFT);
    let beside = &columns - linear.spread() * linear.taken(columns.as_ref());
    let mut basis = &beside * &map;
    for column in basis.col_iter_mut() {
        let norm = column.norm_l2().max(f64::MIN_POSITIVE);
        column.iter_mut().for_each(|value| *value /= norm);
    }
    let along = basis.transpose() * crate::linear::column(linear.residuals());
    let explained = &basis * &along;
    let spread = linear.spread();
    let of_rows = |rows: &Vec<usize>| {
        let chi2 = rows.iter().map(|row| (linear.residuals()[*row] - explained[(*row, 0)]).powi(2)).sum::<f64>();
        let taken = |row: &usize| spread.row(*row).squared_norm_l2() + basis.row(*row).squared_norm_l2();
        let degrees = (rows.len() as f64 - rows.iter().map(taken).sum::<f64>()).max(1.0);
        (chi2, degrees)
    };
    Ok(Pass { score, left: rows.iter().map(of_rows).collect() })
}
