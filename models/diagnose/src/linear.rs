//! A fit as a linear problem, and what further columns would tell of its residuals.
//!
//! Place in the flow: the engine under every kind of measured data (tracer ranges, ISO 230-2 runs, residual vectors,
//! sphere centres). Rows are whitened: divided by their standard uncertainty, so residuals have no unit and a column
//! has the inverse unit of its parameter. Parameters may have Gaussian priors (smooth error functions do); then
//! V = (JᵀJ + prior)⁻¹, and a candidate's columns C keep the information CᵀC − CᵀJ V JᵀC once the model's own columns
//! have taken what they can. This is the score test of the mixed model (Wood 2017, Generalized Additive Models, 6.12;
//! without priors it is the partial F test).

use crate::error::DiagnoseError;
use abbe_identify::{in_parallel, trace_of_product};
use faer::linalg::solvers::{DenseSolveCore, Llt, Solve};
use faer::{Mat, MatRef, Side};
use std::borrow::Borrow;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Eigenvalues of a block of the hat matrix, and their directions.
pub(crate) type Directions = (Vec<f64>, Vec<Vec<f64>>);

/// Rows, residuals and covariance of a settled fit.
#[derive(Debug, Clone)]
pub struct Linear {
    /// Rows × parameters, whitened; fits of the same rows share it.
    jacobian: Arc<Mat<f64>>,
    /// JᵀJ.
    normal: Mat<f64>,
    residuals: Vec<f64>,
    /// Posterior covariance of the parameters for unit noise.
    covariance: Mat<f64>,
    /// L with V = L Lᵀ.
    root: Mat<f64>,
    /// J L, made when it is first asked for.
    spread: OnceLock<Mat<f64>>,
    /// Directions of blocks of J V Jᵀ, by their rows, made when they are first asked for.
    directions: Arc<Mutex<BTreeMap<Vec<usize>, Arc<Directions>>>>,
    chi2: f64,
    degrees: f64,
}

/// What columns would tell: their gradient, their information alone and with the model's columns projected out.
#[derive(Debug, Clone)]
pub struct Projected {
    /// Cᵀr.
    pub gradient: Vec<f64>,
    /// CᵀC: what the columns would tell if nothing else were unknown.
    pub alone: Mat<f64>,
    /// CᵀC − CᵀJ V JᵀC: what is left of it.
    pub left: Mat<f64>,
}

impl Projected {
    /// The same for some of the columns.
    pub(crate) fn pick(&self, members: &[usize]) -> Projected {
        let of =
            |matrix: &Mat<f64>| Mat::from_fn(members.len(), members.len(), |i, j| matrix[(members[i], members[j])]);
        let gradient = members.iter().map(|k| self.gradient[*k]).collect();
        Projected { gradient, alone: of(&self.alone), left: of(&self.left) }
    }

    /// Share of the information that the model's columns take away, each column counting the same; 1 for no columns.
    pub(crate) fn absorbed(&self) -> f64 {
        let count = self.gradient.len();
        if count == 0 {
            return 1.0;
        }
        let one = |k: usize| match self.alone[(k, k)] {
            alone if alone > 0.0 => 1.0 - self.left[(k, k)] / alone,
            _ => 1.0,
        };
        (0..count).map(one).sum::<f64>() / count as f64
    }
}

/// Columns of several matrices, side by side.
pub(crate) fn joined<M: Borrow<Mat<f64>>>(parts: &[M]) -> Mat<f64> {
    let parts = || parts.iter().map(M::borrow);
    let rows = parts().next().map_or(0, Mat::nrows);
    let mut all = Mat::zeros(rows, parts().map(Mat::ncols).sum());
    let mut first = 0;
    for part in parts() {
        all.as_mut().subcols_mut(first, part.ncols()).copy_from(part);
        first += part.ncols();
    }
    all
}

impl Linear {
    /// A fit whose posterior covariance (unit noise) is known; `used` rows are not zero.
    ///
    /// # Errors
    /// [`DiagnoseError::Singular`] where the covariance is not positive definite.
    pub fn new(
        jacobian: Mat<f64>,
        residuals: Vec<f64>,
        covariance: Mat<f64>,
        used: usize,
    ) -> Result<Linear, DiagnoseError> {
        let normal = jacobian.transpose() * &jacobian;
        Linear::of_parts(Arc::new(jacobian), normal, residuals, covariance, used)
    }

    fn of_parts(
        jacobian: Arc<Mat<f64>>,
        normal: Mat<f64>,
        residuals: Vec<f64>,
        covariance: Mat<f64>,
        used: usize,
    ) -> Result<Linear, DiagnoseError> {
        let llt = Llt::new(covariance.as_ref(), Side::Lower).map_err(|_| DiagnoseError::Singular)?;
        let root = llt.L().to_owned();
        // tr(J V Jᵀ) = tr(V JᵀJ): the rows are not needed again.
        let taken = trace_of_product(covariance.as_ref(), normal.as_ref());
        let chi2 = residuals.iter().map(|r| r * r).sum();
        let degrees = (used as f64 - taken).max(1.0);
        let (spread, directions) = (OnceLock::new(), Arc::default());
        Ok(Linear { jacobian, normal, residuals, covariance, root, spread, directions, chi2, degrees })
    }

    /// The same rows fitted without the priors, and its residuals: what the columns could absorb if nothing were known
    /// of their parameters. Candidates are tested against this fit, since a smoothness that the data chose is no
    /// evidence against a rough truth. Directions that the rows do not see keep a negligible prior.
    ///
    /// # Errors
    /// [`DiagnoseError::Singular`] where rounding leaves no covariance.
    pub fn without_priors(&self, used: usize) -> Result<Linear, DiagnoseError> {
        Linear::without_priors_of(Arc::clone(&self.jacobian), self.normal.clone(), &self.residuals, used)
    }

    fn without_priors_of(
        jacobian: Arc<Mat<f64>>,
        normal: Mat<f64>,
        residuals: &[f64],
        used: usize,
    ) -> Result<Linear, DiagnoseError> {
        // Equilibrated first: the negligible prior is then the same share of every column.
        // A column of zeros (the turn of the ram where only one offset was measured) has no scale; any does.
        let scale_of = |square: f64| if square > 0.0 { square.sqrt() } else { 1.0 };
        let scale: Vec<f64> = (0..normal.nrows()).map(|k| scale_of(normal[(k, k)])).collect();
        let equal = Mat::from_fn(normal.nrows(), normal.ncols(), |i, j| {
            normal[(i, j)] / (scale[i] * scale[j]) + if i == j { UNSEEN } else { 0.0 }
        });
        let inverse = Llt::new(equal.as_ref(), Side::Lower).map_err(|_| DiagnoseError::Singular)?.inverse();
        let covariance = scaled_back(&inverse, &scale);
        let change = &covariance * (jacobian.transpose() * column(residuals));
        let moved = &*jacobian * &change;
        let residuals = residuals.iter().enumerate().map(|(k, r)| r - moved[(k, 0)]).collect();
        Linear::of_parts(jacobian, normal, residuals, covariance, used)
    }

    /// The fit of some of the rows by the same columns, without priors.
    ///
    /// # Errors
    /// [`DiagnoseError::Singular`] where rounding leaves no covariance.
    pub(crate) fn part(&self, rows: &[usize]) -> Result<Linear, DiagnoseError> {
        let jacobian = picked(self.jacobian(), rows);
        let residuals: Vec<f64> = rows.iter().map(|k| self.residuals[*k]).collect();
        let normal = jacobian.transpose() * &jacobian;
        Linear::without_priors_of(Arc::new(jacobian), normal, &residuals, rows.len())
    }

    /// The fit without priors, with these columns beside its own.
    ///
    /// # Errors
    /// [`DiagnoseError::Singular`] where rounding leaves no covariance.
    pub fn widened(&self, columns: &[Mat<f64>], used: usize) -> Result<Linear, DiagnoseError> {
        let all: Vec<&Mat<f64>> = std::iter::once(&*self.jacobian).chain(columns).collect();
        let jacobian = joined(&all);
        let normal = jacobian.transpose() * &jacobian;
        Linear::without_priors_of(Arc::new(jacobian), normal, &self.residuals, used)
    }

    /// The least-squares fit of `observed` by these columns, and its parameters. Columns that the others contain are an
    /// error.
    ///
    /// # Errors
    /// [`DiagnoseError::Singular`] where the columns depend on each other to a millionth.
    pub fn least_squares(jacobian: Mat<f64>, observed: &[f64]) -> Result<(Linear, Vec<f64>), DiagnoseError> {
        let normal = jacobian.transpose() * &jacobian;
        let (scale, llt) = equilibrated(&normal)?;
        let right = jacobian.transpose() * column(observed);
        let scaled = Mat::from_fn(right.nrows(), 1, |k, _| right[(k, 0)] / scale[k]);
        let solution = llt.solve(&scaled);
        let parameters: Vec<f64> = (0..scale.len()).map(|k| solution[(k, 0)] / scale[k]).collect();
        let predicted = &jacobian * column(&parameters);
        let residuals = observed.iter().enumerate().map(|(k, value)| value - predicted[(k, 0)]).collect();
        let covariance = scaled_back(&llt.inverse(), &scale);
        Ok((Linear::new(jacobian, residuals, covariance, observed.len())?, parameters))
    }

    /// Sum of squared whitened residuals.
    pub fn chi2(&self) -> f64 {
        self.chi2
    }

    /// Degrees of freedom: rows used less the effective number of parameters.
    pub fn degrees(&self) -> f64 {
        self.degrees
    }

    /// χ² per degree of freedom.
    pub fn noise_factor(&self) -> f64 {
        self.chi2 / self.degrees
    }

    /// Whitened residuals.
    pub fn residuals(&self) -> &[f64] {
        &self.residuals
    }

    /// Whitened columns of the model's own parameters.
    pub fn jacobian(&self) -> MatRef<'_, f64> {
        (*self.jacobian).as_ref()
    }

    /// Posterior covariance of the parameters for unit noise.
    pub fn covariance(&self) -> MatRef<'_, f64> {
        self.covariance.as_ref()
    }

    /// J L, whose product with its transpose is the hat matrix J V Jᵀ.
    pub(crate) fn spread(&self) -> MatRef<'_, f64> {
        self.spread.get_or_init(|| &*self.jacobian * &self.root).as_ref()
    }

    /// Directions of a block of the hat matrix, where they were kept: a fit is compared with many others on the same blocks.
    pub(crate) fn kept_directions(&self, block: &[usize]) -> Option<Arc<Directions>> {
        self.directions.lock().unwrap_or_else(PoisonError::into_inner).get(block).cloned()
    }

    /// Keeps the directions of a block of the hat matrix.
    pub(crate) fn keep_directions(&self, block: &[usize], directions: Arc<Directions>) {
        self.directions.lock().unwrap_or_else(PoisonError::into_inner).insert(block.to_vec(), directions);
    }

    /// L with V = L Lᵀ.
    pub(crate) fn root(&self) -> MatRef<'_, f64> {
        self.root.as_ref()
    }

    /// LᵀJᵀC, whose Gram matrix is what the model's columns take away.
    pub(crate) fn taken(&self, columns: MatRef<f64>) -> Mat<f64> {
        let shared = self.jacobian.transpose() * columns;
        self.root.transpose() * shared
    }

    /// V JᵀC: by how much the parameters take what the columns do for their own.
    pub(crate) fn reach(&self, columns: MatRef<f64>) -> Mat<f64> {
        &self.covariance * (self.jacobian.transpose() * columns)
    }

    /// Cᵀr.
    pub(crate) fn gradient(&self, columns: MatRef<f64>) -> Vec<f64> {
        let gradient = columns.transpose() * column(&self.residuals);
        (0..columns.ncols()).map(|k| gradient[(k, 0)]).collect()
    }

    /// What groups of columns would tell of the residuals; their columns are projected together, which is several times
    /// faster than one by one.
    pub fn project_all(&self, groups: &[Mat<f64>]) -> Vec<Projected> {
        let (mut batches, mut rest) = (Vec::new(), groups);
        while !rest.is_empty() {
            let mut count = 0;
            let fits = |group: &&Mat<f64>| {
                count += group.ncols();
                count <= TOGETHER
            };
            let (batch, later) = rest.split_at(rest.iter().take_while(fits).count().max(1));
            batches.push(batch);
            rest = later;
        }
        in_parallel(&batches, |batch| self.project_batch(batch)).into_iter().flatten().collect()
    }

    fn project_batch(&self, groups: &[Mat<f64>]) -> Vec<Projected> {
        let columns = joined(groups);
        let (taken, gradient) = (self.taken(columns.as_ref()), self.gradient(columns.as_ref()));
        let mut first = 0;
        let one = |group: &Mat<f64>| {
            let own = taken.as_ref().subcols(first, group.ncols());
            let alone = group.transpose() * group;
            let left = &alone - own.transpose() * own;
            let gradient = gradient[first..first + group.ncols()].to_vec();
            first += group.ncols();
            Projected { gradient, alone, left }
        };
        groups.iter().map(one).collect()
    }

    /// What columns (rows × m, whitened) would tell of the residuals.
    pub fn project(&self, columns: MatRef<f64>) -> Projected {
        let taken = self.taken(columns);
        let alone = columns.transpose() * columns;
        let left = &alone - taken.transpose() * &taken;
        Projected { gradient: self.gradient(columns), alone, left }
    }

    /// The fit with these columns added, without a prior on them.
    ///
    /// # Errors
    /// [`DiagnoseError::Singular`] where the model's own columns contain them.
    pub fn with(&self, columns: MatRef<f64>) -> Result<Linear, DiagnoseError> {
        let (rows, own, added) = (self.residuals.len(), self.jacobian.ncols(), columns.ncols());
        let shared = self.jacobian.transpose() * columns;
        let alone = columns.transpose() * columns;
        let reach = &self.covariance * &shared;
        let left = &alone - shared.transpose() * &reach;
        let inverse = Llt::new(left.as_ref(), Side::Lower).map_err(|_| DiagnoseError::Singular)?.inverse();
        let estimate = &inverse * column(&self.gradient(columns));
        // Blocks of the inverse of a partitioned matrix.
        let cross = -(&reach * &inverse);
        let corner = &self.covariance - &cross * reach.transpose();
        let blocks = |corner: &Mat<f64>, cross: &Mat<f64>, rest: &Mat<f64>| {
            Mat::from_fn(own + added, own + added, |i, j| match (i < own, j < own) {
                (true, true) => 0.5 * (corner[(i, j)] + corner[(j, i)]),
                (true, false) => cross[(i, j - own)],
                (false, true) => cross[(j, i - own)],
                (false, false) => 0.5 * (rest[(i - own, j - own)] + rest[(j - own, i - own)]),
            })
        };
        let covariance = blocks(&corner, &cross, &inverse);
        let normal = blocks(&self.normal, &shared, &alone);
        let moved = columns * &estimate - &*self.jacobian * (&reach * &estimate);
        let residuals = self.residuals.iter().zip(moved.col_as_slice(0)).map(|(r, moved)| r - moved).collect();
        let mut jacobian = Mat::zeros(rows, own + added);
        jacobian.as_mut().subcols_mut(0, own).copy_from(self.jacobian.as_ref());
        jacobian.as_mut().subcols_mut(own, added).copy_from(columns);
        let used = used_rows(&self.jacobian);
        Linear::of_parts(Arc::new(jacobian), normal, residuals, covariance, used)
    }
}

/// JᵀJ with ones on its diagonal, factored, and the scale of each column.
fn equilibrated(normal: &Mat<f64>) -> Result<(Vec<f64>, Llt<f64>), DiagnoseError> {
    let scale: Vec<f64> = (0..normal.nrows()).map(|k| normal[(k, k)].sqrt()).collect();
    if scale.iter().any(|s| *s <= 0.0 || !s.is_finite()) {
        return Err(DiagnoseError::Singular);
    }
    let equal = Mat::from_fn(normal.nrows(), normal.ncols(), |i, j| normal[(i, j)] / (scale[i] * scale[j]));
    factor_above(&equal, DEPENDENT).ok_or(DiagnoseError::Singular)?;
    let llt = Llt::new(equal.as_ref(), Side::Lower).map_err(|_| DiagnoseError::Singular)?;
    Ok((scale, llt))
}

fn scaled_back(inverse: &Mat<f64>, scale: &[f64]) -> Mat<f64> {
    Mat::from_fn(scale.len(), scale.len(), |i, j| inverse[(i, j)] / (scale[i] * scale[j]))
}

/// (JᵀJ)⁻¹ of columns that do not depend on each other.
///
/// # Errors
/// [`DiagnoseError::Singular`] where they depend on each other to a millionth.
pub(crate) fn covariance_of(normal: &Mat<f64>) -> Result<Mat<f64>, DiagnoseError> {
    let (scale, llt) = equilibrated(normal)?;
    Ok(scaled_back(&llt.inverse(), &scale))
}

/// Rows that are not zero.
fn used_rows(jacobian: &Mat<f64>) -> usize {
    let mut is_used = vec![false; jacobian.nrows()];
    for j in 0..jacobian.ncols() {
        is_used.iter_mut().zip(jacobian.col_as_slice(j)).for_each(|(is_used, value)| *is_used |= *value != 0.0);
    }
    is_used.into_iter().filter(|is_used| *is_used).count()
}

/// Prior of directions that the rows do not see, as a share of each column's information.
const UNSEEN: f64 = 1e-9;
/// Columns projected together: enough for matrix products to be fast, few enough to stay in memory.
const TOGETHER: usize = 512;
/// Smallest eigenvalue of an equilibrated matrix below which its columns count as dependent.
const DEPENDENT: f64 = 1e-12;

/// These rows of a matrix.
pub(crate) fn picked(matrix: MatRef<f64>, rows: &[usize]) -> Mat<f64> {
    let mut own = Mat::zeros(rows.len(), matrix.ncols());
    for (j, all) in matrix.col_iter().enumerate() {
        let own = own.col_as_slice_mut(j).iter_mut().zip(rows);
        match all.try_as_col_major() {
            Some(all) => own.for_each(|(own, row)| *own = all.as_slice()[*row]),
            None => own.for_each(|(own, row)| *own = all[*row]),
        }
    }
    own
}

/// Cholesky's factor of a symmetric matrix less limit·I: there is one where every eigenvalue lies above the limit, which eigenvectors would
/// tell in ten times the time.
pub(crate) fn factor_above(matrix: &Mat<f64>, limit: f64) -> Option<Llt<f64>> {
    let mut less = matrix.clone();
    (0..less.nrows()).for_each(|k| less[(k, k)] -= limit);
    Llt::new(less.as_ref(), Side::Lower).ok()
}

/// Numbers as a column.
pub(crate) fn column(values: &[f64]) -> Mat<f64> {
    Mat::from_fn(values.len(), 1, |k, _| values[k])
}

/// Rows of a matrix, each times its weight.
pub(crate) fn weighted(matrix: &Mat<f64>, weights: &[f64]) -> Mat<f64> {
    let mut weighted = matrix.clone();
    for j in 0..matrix.ncols() {
        weighted.col_as_slice_mut(j).iter_mut().zip(weights).for_each(|(value, weight)| *value *= weight);
    }
    weighted
}

/// Standard uncertainty of the size of a column, given with one of each row, if the errors of all rows act together in the worst way:
/// Σ|c|u / Σc².
pub(crate) fn in_the_worst_way(rows: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (worst, square) = rows.fold((0.0, 0.0), |(worst, square), (c, u)| (worst + c.abs() * u, square + c * c));
    if square > 0.0 { worst / square } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(count: usize) -> (Mat<f64>, Mat<f64>, Vec<f64>) {
        let wave = |k: usize, a: f64| (a * k as f64 + 0.3 * a).sin();
        let base = Mat::from_fn(count, 3, |k, j| wave(k, 0.37 * (j + 1) as f64) + if j == 0 { 1.0 } else { 0.0 });
        let more = Mat::from_fn(count, 2, |k, j| wave(k, 0.91 * (j + 1) as f64) + 0.4 * wave(k, 0.37));
        let observed = (0..count).map(|k| 0.7 + wave(k, 0.91) + 0.01 * wave(k, 7.7)).collect();
        (base, more, observed)
    }

    #[test]
    fn adding_columns_gives_the_joint_least_squares_fit() {
        let (base, more, observed) = rows(60);
        let (fit, _) = Linear::least_squares(base.clone(), &observed).unwrap();
        let both = Mat::from_fn(60, 5, |k, j| if j < 3 { base[(k, j)] } else { more[(k, j - 3)] });
        let (joint, _) = Linear::least_squares(both, &observed).unwrap();
        let added = fit.with(more.as_ref()).unwrap();
        assert!((added.chi2() / joint.chi2() - 1.0).abs() < 1e-9);
        assert!((added.degrees() - 55.0).abs() < 1e-9);
        let difference = added.covariance().to_owned() - joint.covariance();
        assert!(difference.norm_max() < 1e-9);
        assert!(added.residuals().iter().zip(joint.residuals()).all(|(a, b)| (a - b).abs() < 1e-10));
    }

    #[test]
    fn regress_a_column_that_no_row_sees_does_not_spoil_the_fit_without_priors() {
        let (base, more, observed) = rows(60);
        let (whole, _) = Linear::least_squares(base.clone(), &observed).unwrap();
        let wider = Mat::from_fn(60, 4, |k, j| if j < 3 { base[(k, j)] } else { 0.0 });
        let covariance = Mat::from_fn(4, 4, |i, j| match (i < 3, j < 3) {
            (true, true) => whole.covariance()[(i, j)],
            (false, false) => 4e-8,
            _ => 0.0,
        });
        let with_unseen = Linear::new(wider, whole.residuals().to_vec(), covariance, 60).unwrap();
        let (alone, beside) = (whole.without_priors(60).unwrap(), with_unseen.without_priors(60).unwrap());
        assert!(beside.covariance().norm_max().is_finite());
        let (left, expected) = (beside.project(more.as_ref()).left, alone.project(more.as_ref()).left);
        assert!((&left - &expected).norm_max() < 1e-9 * expected.norm_max());
        assert!((beside.chi2() / alone.chi2() - 1.0).abs() < 1e-9 && (beside.degrees() - alone.degrees()).abs() < 1e-6);
    }

    #[test]
    fn dependent_columns_are_refused() {
        let (base, _, observed) = rows(60);
        let twice = Mat::from_fn(60, 4, |k, j| base[(k, j % 3)]);
        assert!(matches!(Linear::least_squares(twice, &observed), Err(DiagnoseError::Singular)));
        let (fit, _) = Linear::least_squares(base.clone(), &observed).unwrap();
        let left = fit.project(base.as_ref()).left;
        assert!(left.norm_max() < 1e-9 * fit.project(base.as_ref()).alone.norm_max());
    }
}
