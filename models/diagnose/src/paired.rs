//! Two fits of the same readings, compared on blocks that neither saw.
//!
//! Place in the flow: under [`crate::gate`] and every figure "with and without". Both fits give the residuals of a block
//! left out (see [`crate::held_out`]); they are compared over the same readings with the same weights, the smaller of
//! both, and over the same directions: what only the block itself determines in one of the fits is judged in neither, nor
//! is what the first can hardly predict. Otherwise a fit that rejects more readings, or a parameter that lives in one
//! block, would look like a gain. Whitened residuals; no units.

use crate::candidates::Round;
use crate::linear::{Directions, Linear, column, picked};
use abbe_identify::{dot, in_parallel, symmetric_eigen};
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::solvers::{Llt, Solve};
use faer::{Accum, Mat, MatRef, Par, Side};
use std::sync::Arc;

/// 1 − eigenvalue of H below which only the block itself tells of a direction: predicted without it, its uncertainty is
/// a thousand times the noise.
const TOLD: f64 = 1e-6;
/// 1 − eigenvalue of H from which other blocks tell of a direction. Below, little but a prior does. Where the first fit knows
/// no more, nothing is judged. Where it does, what a term says counts, and that it could be anything does not excuse it.
const MEASURED: f64 = 1e-2;
/// Eigenvalue of H below which the model does not reach a direction: rounding is a thousandth of it.
const NONE: f64 = 1e-12;
/// Share of a direction's length that must be new for it to be another one.
const NEW: f64 = 1e-6;

/// One block predicted by two fits that did not see it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Pair {
    /// Sum of squares by the first fit.
    pub(crate) before: f64,
    /// Sum of squares by the second.
    pub(crate) after: f64,
    /// Variance of `before` − `after` for unit noise if the second fit is right.
    pub(crate) variance: f64,
    /// Directions judged.
    pub(crate) judged: usize,
}

/// What the second fit must say of directions that only its priors tell it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Untold {
    /// Its prior's mean is its word, and is judged: a correction is used there.
    Judged,
    /// Nothing: what acts on the range alone need not know a holder, line or station that it never saw.
    LeftOut,
}

/// Each block predicted by both fits.
pub(crate) fn pairs(before: &Round, after: &Round, blocks: &[Vec<usize>], untold: Untold) -> Vec<Pair> {
    in_parallel(blocks, |block| pair(before, after, block, untold)).into_iter().flatten().collect()
}

fn pair(before: &Round, after: &Round, block: &[usize], untold: Untold) -> Option<Pair> {
    let shared = |round: &Round, other: &Round| -> Vec<f64> {
        let of = |k: &usize| match (round.rows.whitening[*k], other.rows.whitening[*k]) {
            (own, other) if own > 0.0 => own.min(other) / own,
            _ => 0.0,
        };
        block.iter().map(of).collect()
    };
    let (to_before, to_after) = (shared(before, after), shared(after, before));
    let limit = match untold {
        Untold::Judged => TOLD,
        Untold::LeftOut => MEASURED,
    };
    let (first, second) = (left_out(&before.linear, block, MEASURED)?, left_out(&after.linear, block, limit)?);
    let mut hidden: Vec<Vec<f64>> = Vec::new();
    let own = first.own().into_iter().map(|own| times(&own, &to_before));
    let own = own.chain(second.own().into_iter().map(|own| times(&own, &to_after)));
    own.for_each(|direction| add(&mut hidden, direction));
    let common = |residuals: &[f64], factors: &[f64]| without(times(residuals, factors), &hidden);
    let (a, b) = (common(&first.residuals, &to_before), common(&second.residuals, &to_after));
    let difference: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a - b).collect();
    let variance = 4.0 * second.variance(&times(&difference, &to_after));
    let judged = to_after.iter().filter(|factor| **factor > 0.0).count().saturating_sub(hidden.len());
    Some(Pair { before: square(&a), after: square(&b), variance, judged })
}

/// A block predicted by a fit that did not see it.
struct LeftOut {
    /// Residuals, without what only the block tells.
    residuals: Vec<f64>,
    hat: Hat,
}

/// What the block itself has to do with its prediction.
enum Hat {
    /// Other blocks tell of every direction: (I − H)⁻¹ is all that is needed.
    Measured(Inverse),
    /// Eigenvalues of H and their directions, those that the model does not reach left out; and 1 − eigenvalue up to which only the
    /// block tells of a direction.
    Directions { all: Arc<Directions>, limit: f64 },
}

impl LeftOut {
    /// Directions of which only the block tells.
    fn own(&self) -> Vec<Vec<f64>> {
        match &self.hat {
            Hat::Measured(_) => Vec::new(),
            Hat::Directions { all, limit } => {
                let own = all.0.iter().zip(&all.1).filter(|(value, _)| 1.0 - **value <= *limit);
                own.map(|(_, direction)| direction.clone()).collect()
            }
        }
    }

    /// xᵀ (I − H)⁻¹ x: variance along x of what is predicted, for unit noise.
    fn variance(&self, x: &[f64]) -> f64 {
        let (values, directions, limit) = match &self.hat {
            Hat::Measured(inverse) => return dot(x, &inverse.of(x)),
            Hat::Directions { all, limit } => (&all.0, &all.1, *limit),
        };
        let mut variance = square(x);
        for (value, direction) in values.iter().zip(directions) {
            let along = dot(direction, x).powi(2);
            variance += match 1.0 - value {
                rest if rest > MEASURED => along * value / rest,
                rest if rest > limit => 0.0,
                _ => -along,
            };
        }
        variance.max(0.0)
    }
}

fn left_out(fit: &Linear, block: &[usize], limit: f64) -> Option<LeftOut> {
    let seen: Vec<f64> = block.iter().map(|k| fit.residuals()[*k]).collect();
    let all = match fit.kept_directions(block) {
        Some(all) => all,
        None => {
            let rows = picked(fit.spread(), block);
            if let Some(inverse) = Inverse::new(&rows) {
                return Some(LeftOut { residuals: inverse.of(&seen), hat: Hat::Measured(inverse) });
            }
            let all = Arc::new(directions(&rows)?);
            fit.keep_directions(block, Arc::clone(&all));
            all
        }
    };
    let mut residuals = seen.clone();
    for (value, direction) in all.0.iter().zip(&all.1) {
        let along = dot(direction, &seen);
        let change = if 1.0 - value > limit { along * value / (1.0 - value) } else { -along };
        residuals.iter_mut().zip(direction).for_each(|(residual, d)| *residual += change * d);
    }
    Some(LeftOut { residuals, hat: Hat::Directions { all, limit } })
}

/// Whitened residuals of a block predicted by a fit that did not see it, each with its variance for unit noise; without the directions of
/// which only the block tells. `None` where there is no such prediction.
pub(crate) fn untouched(fit: &Linear, block: &[usize]) -> Option<Vec<(f64, f64)>> {
    let left = left_out(fit, block, MEASURED)?;
    let mut own = Vec::new();
    left.own().into_iter().for_each(|direction| add(&mut own, direction));
    let residuals = without(left.residuals.clone(), &own);
    let variance = |k: usize| {
        let unit = (0..block.len()).map(|j| f64::from(u8::from(j == k))).collect();
        left.variance(&without(unit, &own))
    };
    Some(residuals.into_iter().enumerate().map(|(k, residual)| (residual, variance(k))).collect())
}

/// (I − H)⁻¹ with H = R Rᵀ, where other blocks measure every direction. Where R is tall, (I − R Rᵀ)⁻¹ = I + R (I − RᵀR)⁻¹ Rᵀ.
struct Inverse {
    factor: Llt<f64>,
    /// R where it is tall.
    tall: Option<Mat<f64>>,
}

impl Inverse {
    /// None where some direction is not measured by others: Cholesky's factor then does not exist.
    fn new(rows: &Mat<f64>) -> Option<Inverse> {
        let is_tall = rows.nrows() > rows.ncols();
        // Cholesky's factor reads the lower half alone.
        let hat = lower_half(if is_tall { rows.transpose() } else { rows.as_ref() });
        let rest = |limit: f64| {
            let entry = |i: usize, j: usize| if i == j { 1.0 - limit - hat[(i, j)] } else { -hat[(i, j)] };
            Llt::new(Mat::from_fn(hat.nrows(), hat.ncols(), entry).as_ref(), Side::Lower).ok()
        };
        rest(MEASURED)?;
        Some(Inverse { factor: rest(0.0)?, tall: is_tall.then(|| rows.clone()) })
    }

    fn of(&self, x: &[f64]) -> Vec<f64> {
        let x_column = column(x);
        let solved = match &self.tall {
            None => self.factor.solve(&x_column),
            Some(rows) => &x_column + rows * self.factor.solve(rows.transpose() * &x_column),
        };
        (0..x.len()).map(|k| solved[(k, 0)]).collect()
    }
}

/// The lower half of M Mᵀ, zeros above.
fn lower_half(m: MatRef<f64>) -> Mat<f64> {
    let (full, half) = (BlockStructure::Rectangular, BlockStructure::TriangularLower);
    let mut product = Mat::zeros(m.nrows(), m.nrows());
    triangular::matmul(product.as_mut(), half, Accum::Replace, m, full, m.transpose(), full, 1.0, Par::Seq);
    product
}

/// Eigenvalues and eigenvectors of R Rᵀ, from whichever of R Rᵀ and RᵀR is smaller.
fn directions(rows: &Mat<f64>) -> Option<Directions> {
    let is_tall = rows.nrows() > rows.ncols();
    let (values, vectors) = match is_tall {
        true => symmetric_eigen(&(rows.transpose() * rows))?,
        false => symmetric_eigen(&(rows * rows.transpose()))?,
    };
    let vectors = if is_tall { rows * &vectors } else { vectors };
    let reached: Vec<usize> = (0..values.len()).filter(|k| values[*k] > NONE).collect();
    let direction = |k: &usize| {
        let length = if is_tall { values[*k].sqrt() } else { 1.0 };
        (0..rows.nrows()).map(|i| vectors[(i, *k)] / length).collect()
    };
    Some((reached.iter().map(|k| values[*k]).collect(), reached.iter().map(direction).collect()))
}

/// Adds what is new of a direction to an orthonormal set.
pub(crate) fn add(set: &mut Vec<Vec<f64>>, direction: Vec<f64>) {
    let length = square(&direction).sqrt();
    // Twice: once leaves rounding of the order of what was taken away.
    let mut new = without(without(direction, set), set);
    let left = square(&new).sqrt();
    if left > NEW * length.max(NEW) {
        new.iter_mut().for_each(|v| *v /= left);
        set.push(new);
    }
}

/// A vector without its part in the span of an orthonormal set.
pub(crate) fn without(mut vector: Vec<f64>, set: &[Vec<f64>]) -> Vec<f64> {
    for direction in set {
        let along = dot(direction, &vector);
        vector.iter_mut().zip(direction).for_each(|(v, d)| *v -= along * d);
    }
    vector
}

fn times(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a * b).collect()
}

/// Sum of squares.
pub(crate) fn square(a: &[f64]) -> f64 {
    dot(a, a)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of J L whose hat matrix has eigenvalues below one.
    fn rows(count: usize, parameters: usize, scale: f64) -> Mat<f64> {
        Mat::from_fn(count, parameters, |i, j| scale * (0.7 * (i + 1) as f64 * (j + 2) as f64 + j as f64).sin())
    }

    #[test]
    fn what_is_measured_by_others_is_predicted_alike_by_either_way() {
        for (count, parameters) in [(7, 12), (15, 6)] {
            let rows = rows(count, parameters, 0.1);
            let x: Vec<f64> = (0..count).map(|k| (1.3 * k as f64).cos()).collect();
            let (values, directions) = directions(&rows).unwrap();
            assert!(values.iter().all(|value| 1.0 - value > MEASURED), "{values:?}");
            let mut by_directions = x.clone();
            for (value, direction) in values.iter().zip(&directions) {
                let along = dot(direction, &x) * value / (1.0 - value);
                by_directions.iter_mut().zip(direction).for_each(|(sum, d)| *sum += along * d);
            }
            let inverse = Inverse::new(&rows).unwrap();
            let solved = inverse.of(&x);
            let close = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-12;
            assert!(solved.iter().zip(&by_directions).all(close), "{solved:?} {by_directions:?}");
            let hat = Hat::Directions { all: Arc::new((values, directions)), limit: TOLD };
            let slow = LeftOut { residuals: by_directions, hat }.variance(&x);
            let fast = LeftOut { residuals: solved, hat: Hat::Measured(inverse) }.variance(&x);
            assert!((slow - fast).abs() < 1e-12 * slow, "{slow} {fast}");
        }
    }

    #[test]
    fn a_direction_that_only_the_block_tells_is_looked_at_by_its_eigenvalue() {
        let mut rows = rows(7, 12, 0.1);
        (0..12).for_each(|j| rows[(3, j)] = if j == 0 { 1.0 } else { 0.0 });
        assert!(Inverse::new(&rows).is_none());
    }
}
