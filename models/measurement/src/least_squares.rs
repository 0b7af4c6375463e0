//! Least squares of few unknowns with rank, condition and covariance.
//!
//! Place in the flow: under the sphere fit, the probe's pose and the errors of a guideway. Rows are whitened by the caller or
//! have one common unit. Columns are brought to length one before the singular values are judged, so the verdict depends
//! neither on the units of the unknowns nor on the noise (Golub and Van Loan, Matrix Computations, 5.3 and 5.5).

use nalgebra::{DMatrix, DVector};

/// Singular value, relative to the largest, below which a combination of unknowns counts as not determined.
pub(crate) const DEPENDENT: f64 = 1e-9;

/// Least-squares solution.
#[derive(Debug, Clone)]
pub(crate) struct Solution {
    pub(crate) unknowns: DVector<f64>,
    /// (AᵀA)⁻¹: covariance of the unknowns for unit noise.
    pub(crate) cofactor: DMatrix<f64>,
    /// Largest over smallest singular value of A with columns of length one.
    pub(crate) condition: f64,
}

/// The rows do not determine the unknowns.
#[derive(Debug, Clone)]
pub(crate) struct RankDeficient {
    pub(crate) rank: usize,
    /// Combinations of unknowns that change no row, in the unknowns' own units, each of length one.
    pub(crate) free: Vec<DVector<f64>>,
}

/// Minimises |b − A·x|.
pub(crate) fn solve(matrix: &DMatrix<f64>, right: &DVector<f64>) -> Result<Solution, RankDeficient> {
    let unknowns = matrix.ncols();
    let scale: Vec<f64> = matrix.column_iter().map(|c| if c.norm() > 0.0 { c.norm() } else { 1.0 }).collect();
    // Fewer rows than unknowns are completed by zeros, so that every case below has as many singular values as unknowns.
    let rows = matrix.nrows().max(unknowns);
    let equal =
        DMatrix::from_fn(rows, unknowns, |i, j| if i < matrix.nrows() { matrix[(i, j)] / scale[j] } else { 0.0 });
    let observed = DVector::from_fn(rows, |i, _| if i < right.len() { right[i] } else { 0.0 });
    let qr = equal.qr();
    let mut turned = observed;
    qr.q_tr_mul(&mut turned);
    let svd = qr.r().svd(true, true);
    let (Some(u), Some(v_t)) = (&svd.u, &svd.v_t) else { return Err(RankDeficient { rank: 0, free: Vec::new() }) };
    let values = &svd.singular_values;
    let largest = values.max();
    let unscaled = |k: usize| DVector::from_fn(unknowns, |j, _| v_t[(k, j)] / scale[j]);
    // What is not a number is not determined either.
    let is_dependent = |value: f64| value.is_nan() || value <= DEPENDENT * largest;
    let free: Vec<DVector<f64>> =
        (0..unknowns).filter(|k| is_dependent(values[*k])).map(|k| unscaled(k).normalize()).collect();
    if !free.is_empty() {
        return Err(RankDeficient { rank: unknowns - free.len(), free });
    }
    let top = turned.rows(0, unknowns);
    let mut solution = DVector::zeros(unknowns);
    let mut cofactor = DMatrix::zeros(unknowns, unknowns);
    for k in 0..unknowns {
        let direction = unscaled(k) / values[k];
        solution += &direction * u.column(k).dot(&top);
        cofactor += &direction * direction.transpose();
    }
    Ok(Solution { unknowns: solution, cofactor, condition: largest / values.min() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_through_points_is_the_one_of_the_textbook() {
        let matrix = DMatrix::from_row_slice(4, 2, &[1.0, 0.0, 1.0, 1.0, 1.0, 2.0, 1.0, 3.0]);
        let right = DVector::from_vec(vec![1.0, 2.9, 5.1, 7.0]);
        let found = solve(&matrix, &right).unwrap();
        // Normal equations by hand: slope (4·28.1 − 6·16)/(4·14 − 36) = 0.82·... = 2.02, intercept (16 − 6·2.02)/4 = 0.97.
        assert!((found.unknowns[1] - 2.02).abs() < 1e-13 && (found.unknowns[0] - 0.97).abs() < 1e-13);
        let inverse = (matrix.transpose() * &matrix).try_inverse().unwrap();
        assert!((found.cofactor - inverse).norm() < 1e-13);
        assert!((matrix.transpose() * (right - &matrix * found.unknowns)).norm() < 1e-13);
    }

    #[test]
    fn rank_and_free_directions_do_not_depend_on_units() {
        for unit in [1e-6, 1.0, 1e6] {
            let matrix = DMatrix::from_fn(5, 3, |i, j| match j {
                0 => 1.0,
                1 => i as f64 * unit,
                _ => 2.0 + 3.0 * i as f64 * unit,
            });
            let deficient = solve(&matrix, &DVector::zeros(5)).unwrap_err();
            assert_eq!((deficient.rank, deficient.free.len()), (2, 1));
            assert!((&matrix * &deficient.free[0]).norm() < 1e-12 * matrix.norm());
        }
        let few = DMatrix::from_row_slice(1, 2, &[1.0, 1.0]);
        assert_eq!(solve(&few, &DVector::from_vec(vec![1.0])).unwrap_err().rank, 1);
    }
}
