//! The test of an effect that acts on several chains at once, each with noise of its own.
//!
//! Place in the flow: where the search scores or gates a candidate that moves more than one component. The noise of a chain is
//! estimated from what the present fit leaves, so it holds what is missing. A candidate of one component is compared with
//! that component's rows alone, and its share of them is seen; in the sum over all chains the same change of one component
//! drowns among the others. So the deviations are estimated anew beside the columns, as the fit will do that has them, and
//! the gain is that of the whole likelihood: Σ ν ln(χ² before / χ² after) over the chains. The test has the degrees of freedom
//! of the chain that has fewest. Each time the products of each chain's columns, which are taken once, are weighted: the
//! rows are not needed again.

use super::combinations::{PLACES, combinations};
use crate::error::DiagnoseError;
use crate::linear::{Linear, Projected, column, covariance_of, factor_above, joined, picked};
use crate::score::{LEFT, Score, inverse_root, score, score_of};
use abbe_identify::trace_of_product;
use abbe_measurement::chance::beyond;
use faer::linalg::solvers::{DenseSolveCore, Llt};
use faer::{Mat, Scale, Side};
use statrs::distribution::FisherSnedecor;

/// Times that the deviations are estimated at most, and the change from which they are settled.
const PASSES: usize = 20;
const SETTLED: f64 = 1e-4;

/// Products of rows: of the fit's columns with further ones behind them (Z), and of the residuals (r).
#[derive(Debug, Clone)]
struct Products {
    /// ZᵀZ.
    square: Mat<f64>,
    /// Zᵀr, a column.
    along: Mat<f64>,
    /// rᵀr.
    chi2: f64,
    rows: usize,
}

/// The fit and further columns in the noise of certain deviations.
struct Weighted {
    /// What the further columns would tell beside the fit.
    group: Projected,
    /// χ² and degrees of freedom of the fit without them.
    chi2: f64,
    degrees: f64,
    /// Of the fit's own columns.
    covariance: Mat<f64>,
    /// By how much they take what the further columns do for their own.
    reach: Mat<f64>,
    /// By how much they move in these deviations.
    moved: Mat<f64>,
}

/// Tests columns, whitened as the fit is, that act on these chains (rows of each).
pub(super) fn score_together(fit: &Linear, rows: &[Vec<usize>], whitened: &Mat<f64>) -> Score {
    together(fit, rows, whitened).unwrap_or_else(|_| score_of(fit, whitened.as_ref()))
}

fn together(fit: &Linear, rows: &[Vec<usize>], whitened: &Mat<f64>) -> Result<Score, DiagnoseError> {
    let columns = joined(&[&fit.jacobian().to_owned(), whitened]);
    let of =
        |rows: &[usize]| Products::of(picked(columns.as_ref(), rows), rows.iter().map(|row| fit.residuals()[*row]));
    let chains: Vec<Products> = rows.iter().map(|rows| of(rows)).collect();
    let mut is_beside = vec![true; columns.nrows()];
    rows.iter().flatten().for_each(|row| is_beside[*row] = false);
    let beside: Vec<usize> = (0..columns.nrows()).filter(|row| is_beside[*row]).collect();
    let (beside, own) = (of(&beside), fit.jacobian().ncols());
    let mut deviations = vec![1.0; chains.len()];
    let mut passes = 0;
    loop {
        let all = Weighted::new(&beside, &chains, &deviations, own)?;
        let left = all.left(&chains, &deviations);
        let changes: Vec<f64> =
            left.iter().map(|(chi2, degrees)| (chi2 / degrees).sqrt().max(f64::MIN_POSITIVE)).collect();
        if passes == PASSES || changes.iter().all(|change| (change - 1.0).abs() < SETTLED) {
            return Ok(scored(&all, &chains, &left, &deviations));
        }
        passes += 1;
        deviations.iter_mut().zip(changes).for_each(|(deviation, change)| *deviation *= change);
    }
}

/// The score in the noise of these deviations; of each chain χ² with the columns, and its degrees of freedom, are given.
fn scored(all: &Weighted, chains: &[Products], left: &[(f64, f64)], deviations: &[f64]) -> Score {
    let score = score(&all.group, all.chi2, all.degrees);
    if score.degrees == 0 {
        return score;
    }
    let each = chains.iter().zip(left).zip(deviations);
    let gain = each.map(|((before, (chi2, degrees)), deviation)| {
        degrees * (before.chi2 / (chi2 * deviation * deviation).max(f64::MIN_POSITIVE)).ln()
    });
    let gain = gain.sum::<f64>().max(0.0);
    let fewest = left.iter().map(|(_, degrees)| *degrees).fold(f64::INFINITY, f64::min);
    let statistic = score.reduction / score.degrees as f64;
    let p_value = FisherSnedecor::new(score.degrees as f64, fewest).map_or(1.0, |f| beyond(&f, statistic));
    Score { gain, p_value, ..score }
}

impl Products {
    fn of(columns: Mat<f64>, residuals: impl Iterator<Item = f64>) -> Products {
        let residuals = column(&residuals.collect::<Vec<f64>>());
        let (square, along) = (columns.transpose() * &columns, columns.transpose() * &residuals);
        Products { square, along, chi2: residuals.squared_norm_l2(), rows: columns.nrows() }
    }

    /// With the products of a chain whose rows count so much.
    fn add(&mut self, weight: f64, chain: &Products) {
        self.square += Scale(weight) * &chain.square;
        self.along += Scale(weight) * &chain.along;
        self.chi2 += weight * chain.chi2;
        self.rows += chain.rows;
    }

    /// χ² where the columns have these parameters.
    fn chi2_at(&self, parameters: &Mat<f64>) -> f64 {
        (self.chi2 - 2.0 * trace_of_product(self.along.as_ref(), parameters.as_ref())
            + trace_of_product(parameters.as_ref(), (&self.square * parameters).as_ref()))
        .max(0.0)
    }
}

impl Weighted {
    /// All rows divided by the deviations of their chains; of the columns, so many are the fit's own.
    fn new(beside: &Products, chains: &[Products], deviations: &[f64], own: usize) -> Result<Weighted, DiagnoseError> {
        let mut all = beside.clone();
        chains.iter().zip(deviations).for_each(|(chain, deviation)| all.add(deviation.powi(-2), chain));
        let new = all.square.ncols() - own;
        let block = |i: usize, j: usize, rows: usize, columns: usize| all.square.submatrix(i, j, rows, columns);
        let covariance = covariance_of(&block(0, 0, own, own).to_owned())?;
        let (shared, alone) = (block(0, own, own, new), block(own, own, new, new).to_owned());
        let reach = &covariance * shared;
        let left = &alone - shared.transpose() * &reach;
        let moved = &covariance * all.along.subrows(0, own);
        let gradient = all.along.subrows(own, new) - shared.transpose() * &moved;
        let chi2 = all.chi2 - trace_of_product(all.along.subrows(0, own), moved.as_ref());
        let degrees = (all.rows as f64 - own as f64).max(1.0);
        let group = Projected { gradient: gradient.col_as_slice(0).to_vec(), alone, left };
        Ok(Weighted { group, chi2, degrees, covariance, reach, moved })
    }

    /// χ² of each chain with the further columns, and its degrees of freedom.
    fn left(&self, chains: &[Products], deviations: &[f64]) -> Vec<(f64, f64)> {
        let of_new = inverse(&self.group.left, &self.group.alone);
        let found = &of_new * column(&self.group.gradient);
        let own = self.covariance.ncols();
        let parameters = stacked(&(&self.moved - &self.reach * &found), &found);
        // Covariance of all columns: of the fit's own alone, and what the further ones add.
        let beside = stacked(&-&self.reach, &Mat::identity(found.nrows(), found.nrows()));
        let added = &beside * of_new * beside.transpose();
        let covariance = Mat::from_fn(added.nrows(), added.ncols(), |i, j| {
            added[(i, j)] + if i < own && j < own { self.covariance[(i, j)] } else { 0.0 }
        });
        let of_chain = |(chain, deviation): (&Products, &f64)| {
            let weight = deviation.powi(-2);
            let taken = weight * trace_of_product(covariance.as_ref(), chain.square.as_ref());
            (weight * chain.chi2_at(&parameters), (chain.rows as f64 - taken).max(1.0))
        };
        chains.iter().zip(deviations).map(of_chain).collect()
    }
}

/// Inverse of what is left of columns, over the directions of which enough is left.
fn inverse(left: &Mat<f64>, alone: &Mat<f64>) -> Mat<f64> {
    let scale: Vec<f64> = (0..alone.nrows()).map(|k| inverse_root(alone[(k, k)])).collect();
    let equal = Mat::from_fn(scale.len(), scale.len(), |i, j| left[(i, j)] * scale[i] * scale[j]);
    // Of a table, combinations are kept by what they tell themselves.
    if scale.len() < PLACES
        && factor_above(&equal, LEFT).is_some()
        && let Ok(whole) = Llt::new(equal.as_ref(), Side::Lower)
    {
        let inverse = whole.inverse();
        return Mat::from_fn(scale.len(), scale.len(), |i, j| inverse[(i, j)] * scale[i] * scale[j]);
    }
    let map = combinations(left, alone, LEFT);
    let told = map.transpose() * left * &map;
    let each = Mat::from_fn(map.nrows(), map.ncols(), |i, j| map[(i, j)] / told[(j, j)].max(f64::MIN_POSITIVE));
    each * map.transpose()
}

fn stacked(above: &Mat<f64>, below: &Mat<f64>) -> Mat<f64> {
    let first = above.nrows();
    Mat::from_fn(
        first + below.nrows(),
        above.ncols(),
        |i, j| if i < first { above[(i, j)] } else { below[(i - first, j)] },
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::weighted;
    use crate::tests::normal;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    const ROWS: usize = 90;

    /// A fit by a constant and a slope, and two columns that act on chains of unlike noise; the last rows are of no chain.
    fn fitted(generator: &mut ChaCha8Rng) -> (Linear, Vec<Vec<usize>>, Mat<f64>) {
        let base = Mat::from_fn(ROWS, 2, |i, j| (i as f64 / ROWS as f64).powi(j as i32));
        let columns = Mat::from_fn(ROWS, 2, |_, _| normal(generator));
        let chains: Vec<Vec<usize>> = (0..3).map(|chain| (chain * 25..(chain + 1) * 25).collect()).collect();
        let deviation = |row: usize| [1.0, 3.0, 0.5].get(row / 25).copied().unwrap_or(1.0);
        let observed: Vec<f64> =
            (0..ROWS).map(|i| columns[(i, 0)] - columns[(i, 1)] + deviation(i) * normal(generator)).collect();
        (Linear::least_squares(base, &observed).unwrap().0, chains, columns)
    }

    #[test]
    fn products_of_chains_tell_what_a_fit_of_all_rows_tells() {
        let mut generator = ChaCha8Rng::seed_from_u64(5);
        let (fit, chains, columns) = fitted(&mut generator);
        let all = joined(&[&fit.jacobian().to_owned(), &columns]);
        let mut weights = vec![1.0; ROWS];
        // The deviations that fits of all rows settle at.
        let mut left = Vec::new();
        for _ in 0..PASSES {
            let observed: Vec<f64> = fit.residuals().iter().zip(&weights).map(|(r, weight)| r * weight).collect();
            let (whole, _) = Linear::least_squares(weighted(&all, &weights), &observed).unwrap();
            let of_chain = |rows: &Vec<usize>| {
                let spread = whole.spread();
                let taken: f64 =
                    rows.iter().map(|row| (0..spread.ncols()).map(|j| spread[(*row, j)].powi(2)).sum::<f64>()).sum();
                (rows.iter().map(|row| whole.residuals()[*row].powi(2)).sum::<f64>(), rows.len() as f64 - taken)
            };
            left = chains.iter().map(of_chain).collect::<Vec<(f64, f64)>>();
            for (rows, (chi2, degrees)) in chains.iter().zip(&left) {
                let change = (chi2 / degrees).sqrt();
                rows.iter().for_each(|row| weights[*row] /= change);
            }
        }
        let found = score_together(&fit, &chains, &columns);
        let before = |rows: &Vec<usize>| rows.iter().map(|row| fit.residuals()[*row].powi(2)).sum::<f64>();
        let each = chains.iter().zip(&left);
        let gain: f64 =
            each.map(|(rows, (chi2, degrees))| degrees * (before(rows) * weights[rows[0]].powi(2) / chi2).ln()).sum();
        assert_eq!(found.degrees, 2);
        assert!((found.gain / gain - 1.0).abs() < 1e-6, "{} {gain}", found.gain);
        assert!(found.p_value < 1e-6, "{}", found.p_value);
    }
}
