//! Combinations of columns of which enough is left beside the columns before them.
//!
//! Place in the flow: fits and tests take these in place of the columns; what is left out is counted, never inverted. A combination of a
//! table is held against what it tells alone as well: in correlated noise the slow ones tell less than a column, and all of it may be left.

use abbe_identify::symmetric_eigen;
use faer::Mat;

/// Share of what a column tells alone below which a combination of columns is rounding.
const ROUNDING: f64 = 1e-8;
/// Columns of a table, one a place, at least. Fewer are powers of a few quantities: where combinations of these tell little alone, the
/// quantities go together, and what they would be is anybody's guess.
pub(super) const PLACES: usize = 16;

/// The combinations (columns, over the rows that are the columns given) that keep more than this share of what a column tells alone, or, of
/// a table, of what they tell themselves; `left` is the information beside what is there already, `alone` that without it. They tell nothing
/// of each other in `left`.
pub(super) fn combinations(left: &Mat<f64>, alone: &Mat<f64>, share: f64) -> Mat<f64> {
    let scale = scale_of(alone);
    let of_table = || {
        let (values, vectors) = of_equal_columns(alone, &scale)?;
        let told: Vec<usize> = (0..values.len()).filter(|k| values[*k] > ROUNDING).collect();
        // Combinations that alone tell one each, and nothing of each other.
        let apart = Mat::from_fn(scale.len(), told.len(), |i, j| vectors[(i, told[j])] / values[told[j]].sqrt());
        let (values, turned) = symmetric_eigen(&halves(&(apart.transpose() * left * &apart)))?;
        Some((values, apart * turned))
    };
    let of_columns = || of_equal_columns(left, &scale);
    let found = if scale.len() < PLACES { of_columns() } else { of_table() };
    found.map_or_else(|| Mat::zeros(scale.len(), 0), |found| above(share, &found))
}

/// The combinations of columns with this information that tell more than this share of what one column tells.
pub(super) fn independent_of(alone: &Mat<f64>, share: f64) -> Mat<f64> {
    let found = of_equal_columns(alone, &scale_of(alone));
    found.map_or_else(|| Mat::zeros(alone.nrows(), 0), |found| above(share, &found))
}

/// The combinations whose value is more than this.
fn above(share: f64, (values, vectors): &(Vec<f64>, Mat<f64>)) -> Mat<f64> {
    let kept: Vec<usize> = (0..values.len()).filter(|k| values[*k] > share).collect();
    Mat::from_fn(vectors.nrows(), kept.len(), |i, j| vectors[(i, kept[j])])
}

/// What makes each column tell one alone; 0 for one that tells nothing.
fn scale_of(alone: &Mat<f64>) -> Vec<f64> {
    let of = |told: f64| if told > 0.0 { told.sqrt().recip() } else { 0.0 };
    (0..alone.nrows()).map(|k| of(alone[(k, k)])).collect()
}

/// Eigenvalues of information about columns of this scale, and its combinations of the columns as they were given.
fn of_equal_columns(information: &Mat<f64>, scale: &[f64]) -> Option<(Vec<f64>, Mat<f64>)> {
    let (count, both) = (scale.len(), halves(information));
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
        // They tell nothing of each other in what is left.
        let told = kept.transpose() * &left * &kept;
        let beside =
            (0..59).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| told[(i, j)].abs()).fold(0.0, f64::max);
        assert!(beside < 1e-9, "{beside}");
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
