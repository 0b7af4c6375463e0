//! Combinations of columns of which enough is left beside the columns before them.
//!
//! Place in the flow: fits and tests take these in place of the columns; what is left out is counted, never inverted. A combination is
//! held against what it tells alone, not against its columns: in correlated noise the slow combinations of a table tell little alone, and
//! all of it may be left.

use abbe_identify::symmetric_eigen;
use faer::Mat;

/// Share of what a column tells alone below which a combination of columns is rounding.
const ROUNDING: f64 = 1e-8;

/// The combinations (columns, over the rows that are the columns given) that keep more than this share of what each tells alone; `left`
/// is the information beside what is there already, `alone` that without it.
pub(super) fn combinations(left: &Mat<f64>, alone: &Mat<f64>, share: f64) -> Mat<f64> {
    let Some((values, vectors)) = of_equal_columns(alone) else { return Mat::zeros(alone.nrows(), 0) };
    let told: Vec<usize> = (0..values.len()).filter(|k| values[*k] > ROUNDING).collect();
    // Combinations that alone tell one each, and nothing of each other.
    let apart = Mat::from_fn(alone.nrows(), told.len(), |i, j| vectors[(i, told[j])] / values[told[j]].sqrt());
    let beside = apart.transpose() * left * &apart;
    let Some((values, vectors)) = symmetric_eigen(&halves(&beside)) else { return Mat::zeros(alone.nrows(), 0) };
    let kept: Vec<usize> = (0..values.len()).filter(|k| values[*k] > share).collect();
    apart * Mat::from_fn(told.len(), kept.len(), |i, j| vectors[(i, kept[j])])
}

/// The combinations of columns with this information that tell more than this share of what one column tells.
pub(super) fn independent_of(alone: &Mat<f64>, share: f64) -> Mat<f64> {
    let Some((values, vectors)) = of_equal_columns(alone) else { return Mat::zeros(alone.nrows(), 0) };
    let kept: Vec<usize> = (0..values.len()).filter(|k| values[*k] > share).collect();
    Mat::from_fn(alone.nrows(), kept.len(), |i, j| vectors[(i, kept[j])])
}

/// Eigenvalues of information in which each column counts the same, and combinations of the columns as they were given.
fn of_equal_columns(alone: &Mat<f64>) -> Option<(Vec<f64>, Mat<f64>)> {
    let count = alone.nrows();
    let scale: Vec<f64> =
        (0..count).map(|k| if alone[(k, k)] > 0.0 { alone[(k, k)].sqrt().recip() } else { 0.0 }).collect();
    let both = halves(alone);
    let equal = Mat::from_fn(count, count, |i, j| both[(i, j)] * scale[i] * scale[j]);
    let (values, vectors) = symmetric_eigen(&equal).filter(|_| count > 0)?;
    Some((values, Mat::from_fn(count, vectors.ncols(), |i, j| vectors[(i, j)] * scale[i])))
}

/// The matrix without what rounding made of its symmetry.
fn halves(matrix: &Mat<f64>) -> Mat<f64> {
    Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, j| 0.5 * (matrix[(i, j)] + matrix[(j, i)]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gram(columns: &Mat<f64>) -> Mat<f64> {
        columns.transpose() * columns
    }

    /// Steps from row to row, which is how rows look after noise that hangs together: indicator columns of neighbours are nearly collinear.
    fn steps(count: usize) -> Mat<f64> {
        Mat::from_fn(count, count, |i, j| f64::from(i == j) - 0.995 * f64::from(i == j + 1))
    }

    #[test]
    fn regress_a_slow_combination_that_tells_little_alone_is_kept_where_all_of_it_is_left() {
        let columns = steps(60);
        let alone = gram(&columns);
        assert_eq!(combinations(&alone, &alone, 1e-2).ncols(), 60, "nothing is there already");
        // A constant is there already: that one is not left.
        let there = &columns * Mat::from_fn(60, 1, |_, _| 1.0);
        let size = gram(&there)[(0, 0)];
        let shared = columns.transpose() * &there;
        let left = &alone - faer::Scale(1.0 / size) * (&shared * shared.transpose());
        let kept = combinations(&left, &alone, 1e-2);
        assert_eq!(kept.ncols(), 59);
        // Each tells one alone, and the constant tells nothing of them.
        let told = kept.transpose() * &alone * &kept;
        assert!((0..59).all(|k| (told[(k, k)] - 1.0).abs() < 1e-6));
        assert!((there.transpose() * &columns * kept).norm_max() < 1e-6 * size.sqrt());
    }

    #[test]
    fn columns_that_depend_on_others_give_no_combination() {
        let columns =
            Mat::from_fn(8, 3, |i, j| if j == 2 { 5.0 * (i as f64 + 1.0) } else { (i as f64).powi(j as i32) });
        let alone = gram(&columns);
        assert_eq!(combinations(&alone, &alone, 1e-2).ncols(), 2);
        assert_eq!(independent_of(&alone, 1e-9).ncols(), 2);
        let none = Mat::zeros(0, 0);
        assert_eq!((combinations(&none, &none, 0.1).ncols(), independent_of(&none, 0.1).ncols()), (0, 0));
    }
}
