//! Dense symmetric solves on the free parameters.
//!
//! Place in the flow: [`crate::smoothing`] and [`crate::solve`] factor the normal equations here. faer does the
//! large factorisations (measured faster than nalgebra at this size, several-fold).

use faer::linalg::solvers::{DenseSolveCore, Llt, Solve};
use faer::{Mat, MatRef, Side};

/// Sums that run side by side.
const LANES: usize = 4;

/// Cholesky factor of a positive definite matrix.
pub(crate) struct Factor {
    llt: Llt<f64>,
    size: usize,
}

/// The matrix is not positive definite to working precision.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct NotPositiveDefinite;

impl Factor {
    /// Factors a symmetric matrix given by its lower triangle.
    pub(crate) fn new(matrix: &Mat<f64>) -> Result<Factor, NotPositiveDefinite> {
        let llt = Llt::new(matrix.as_ref(), Side::Lower).map_err(|_| NotPositiveDefinite)?;
        Ok(Factor { llt, size: matrix.nrows() })
    }

    pub(crate) fn solve(&self, right: &[f64]) -> Vec<f64> {
        let right = Mat::from_fn(self.size, 1, |row, _| right[row]);
        let solution = self.llt.solve(&right);
        (0..self.size).map(|row| solution[(row, 0)]).collect()
    }

    /// Logarithm of the determinant of the factored matrix.
    pub(crate) fn log_determinant(&self) -> f64 {
        log_determinant(&self.llt)
    }

    /// Inverse of the factored matrix.
    pub(crate) fn inverse(&self) -> Mat<f64> {
        self.llt.inverse()
    }
}

/// Sum of products, in lanes that a processor adds side by side.
#[inline]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a, b) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest: f64 = a.remainder().iter().zip(b.remainder()).map(|(a, b)| a * b).sum();
    let mut sums = [0.0; LANES];
    a.zip(b).for_each(|(a, b)| (0..LANES).for_each(|k| sums[k] += a[k] * b[k]));
    rest + sums.iter().sum::<f64>()
}

/// ln det of a matrix by its Cholesky factor.
pub fn log_determinant(factor: &Llt<f64>) -> f64 {
    (0..factor.L().nrows()).map(|k| 2.0 * factor.L()[(k, k)].ln()).sum()
}

/// tr(AᵀB) of matrices of the same shape: the sum of the products of their elements.
pub fn trace_of_product(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> f64 {
    a.col_iter().zip(b.col_iter()).map(|(a, b)| a.iter().zip(b.iter()).map(|(a, b)| a * b).sum::<f64>()).sum()
}

/// Symmetric matrix of the free parameters, both triangles filled, from a row-major upper triangle.
pub(crate) fn select(matrix: &[f64], size: usize, free: &[usize]) -> Mat<f64> {
    Mat::from_fn(free.len(), free.len(), |i, j| {
        let (row, column) = (free[i].min(free[j]), free[i].max(free[j]));
        matrix[row * size + column]
    })
}

/// Eigenvalues (ascending) and eigenvectors (columns) of a symmetric matrix; `None` if it cannot be decomposed.
pub fn symmetric_eigen(matrix: &Mat<f64>) -> Option<(Vec<f64>, Mat<f64>)> {
    let eigen = matrix.self_adjoint_eigen(Side::Lower).ok()?;
    let values = (0..matrix.nrows()).map(|k| eigen.S()[k]).collect();
    Some((values, eigen.U().to_owned()))
}
