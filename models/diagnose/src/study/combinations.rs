//! Combinations of columns of which enough is left beside the columns before them.
//!
//! Place in the flow: fits and tests take these in place of the columns; what is left out is counted, never inverted. Of each column
//! its information alone counts as one.

use abbe_identify::symmetric_eigen;
use faer::Mat;

/// The combinations (columns, over the rows that are the columns given) that keep more than this share; `left` is the information
/// beside what is there already, `alone` that without it.
pub(super) fn combinations(left: &Mat<f64>, alone: &Mat<f64>, share: f64) -> Mat<f64> {
    let count = alone.nrows();
    if count == 0 {
        return Mat::zeros(0, 0);
    }
    let scale: Vec<f64> =
        (0..count).map(|k| if alone[(k, k)] > 0.0 { alone[(k, k)].sqrt().recip() } else { 0.0 }).collect();
    let equal = Mat::from_fn(count, count, |i, j| 0.5 * (left[(i, j)] + left[(j, i)]) * scale[i] * scale[j]);
    let Some((values, vectors)) = symmetric_eigen(&equal) else { return Mat::zeros(count, 0) };
    let kept: Vec<usize> = (0..count).filter(|k| values[*k] > share).collect();
    Mat::from_fn(count, kept.len(), |i, j| vectors[(i, kept[j])] * scale[i])
}
