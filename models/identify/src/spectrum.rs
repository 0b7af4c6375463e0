//! Low-order unknowns of a plan, and what its normal matrix sees of them.
//!
//! Place in the flow: [`crate::observability`] judges a plan by it, [`crate::proposal`] the lines that it would add.

use crate::linear::symmetric_eigen;
use faer::Mat;

/// Eigenvalue of the equilibrated normal matrix below which a combination is not seen: a signature of less than
/// a thousandth of its own parts.
const RANK_TOLERANCE: f64 = 1e-6;
/// Information of an unknown, as a share of the largest, below which it is not seen at all: a lever of a thousandth
/// of a millimetre in a metre. Equilibrating such a column would only magnify rounding.
const COLUMN_TOLERANCE: f64 = 1e-12;

/// One low-order unknown: its name, and what it means in the full parameters.
pub(crate) struct Shape {
    pub(crate) name: String,
    /// Which coordinate of a station it is, if it is one.
    pub(crate) of_station: Option<&'static str>,
    pub(crate) entries: Vec<(usize, f64)>,
}

impl Shape {
    /// This unknown's part of a row of partials by all parameters.
    pub(crate) fn of_row(&self, row: &[f64]) -> f64 {
        self.entries.iter().map(|(k, v)| row[*k] * v).sum()
    }
}

/// Eigenvalues (ascending) and eigenvectors of an equilibrated normal matrix.
pub(crate) struct Spectrum {
    values: Vec<f64>,
    vectors: Mat<f64>,
}

impl Spectrum {
    /// Equilibrates and decomposes; an unknown that nothing was measured of stays a zero row and column.
    pub(crate) fn new(matrix: &Mat<f64>) -> Option<Spectrum> {
        let n = matrix.nrows();
        let largest = (0..n).map(|k| matrix[(k, k)]).fold(0.0, f64::max);
        let inverse =
            |k: usize| if matrix[(k, k)] > COLUMN_TOLERANCE * largest { matrix[(k, k)].powf(-0.5) } else { 0.0 };
        let scales: Vec<f64> = (0..n).map(inverse).collect();
        let equilibrated = Mat::from_fn(n, n, |i, j| matrix[(i, j)] * scales[i] * scales[j]);
        let (values, vectors) = symmetric_eigen(&equilibrated)?;
        Some(Spectrum { values, vectors })
    }

    /// Number of combinations that are not seen.
    pub(crate) fn unseen(&self) -> usize {
        self.values.iter().filter(|value| **value < RANK_TOLERANCE).count()
    }

    pub(crate) fn null_space(&self) -> Mat<f64> {
        Mat::from_fn(self.vectors.nrows(), self.unseen(), |i, j| self.vectors[(i, j)])
    }

    pub(crate) fn condition(&self) -> f64 {
        match (self.values.first(), self.values.last()) {
            (Some(least), Some(most)) => (most / least).sqrt(),
            _ => 1.0,
        }
    }
}
