//! Normal equations summed row by row: cost linear in readings, memory independent of them.
//!
//! Place in the flow: one pass over the campaign gives JᵀWJ, JᵀWr and the weighted sum of squares; everything
//! about order, smoothness and rank is decided from these without going back to the readings. Readings are cut
//! into chunks, by their number alone, that are summed in order, so the result does not depend on the threads.

use crate::correlation::Whitener;
use crate::design::{Estimate, Row};
use crate::parallel::in_parallel;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, Mat, Par};
use std::ops::Range;

/// Most chunks of a campaign; it does not depend on the machine, so that the same input gives the same bytes on any.
const CHUNKS: usize = 8;
/// Rows that a chunk has at least: below, threads cost more than they save.
const LEAST_ROWS: usize = 1000;

/// Whitened rows multiplied at a time: enough for the product to be fast, few enough to stay in the cache.
const TOGETHER: usize = 256;

/// JᵀWJ (lower triangle not filled), JᵀWr and sums, in whitened units.
#[derive(Debug, Clone)]
pub(crate) struct NormalEquations {
    pub(crate) size: usize,
    /// Row-major square; only entries with column ≥ row are filled.
    pub(crate) matrix: Vec<f64>,
    pub(crate) gradient: Vec<f64>,
    /// Σ w (r/u)².
    pub(crate) weighted_square: f64,
    /// Σ w.
    pub(crate) weight: f64,
    /// Log determinant of the noise's correlation over that of white noise with the same weights; 0 for white noise.
    pub(crate) log_determinant: f64,
}

impl NormalEquations {
    fn zeros(size: usize) -> NormalEquations {
        let (matrix, gradient) = (vec![0.0; size * size], vec![0.0; size]);
        NormalEquations { size, matrix, gradient, weighted_square: 0.0, weight: 0.0, log_determinant: 0.0 }
    }

    /// An entry of JᵀWJ, which is symmetric.
    pub(crate) fn entry(&self, row: usize, column: usize) -> f64 {
        self.matrix[row.min(column) * self.size + row.max(column)]
    }

    fn add_row(&mut self, row: &Row, u_m: f64, weight: f64) {
        let information = weight / (u_m * u_m);
        let segments = row.segments();
        let mut rest = segments.clone();
        for (first, values) in segments {
            for (i, value) in values.iter().enumerate() {
                let scaled = value * information;
                self.gradient[first + i] += scaled * row.residual_m;
                let line = &mut self.matrix[(first + i) * self.size..(first + i + 1) * self.size];
                for (start, others) in rest.clone() {
                    add_scaled(&mut line[start..start + others.len()], scaled, others);
                }
            }
            rest.next();
        }
        self.weighted_square += information * row.residual_m * row.residual_m;
        self.weight += weight;
    }

    /// Adds sums over the same unknowns at the same estimate.
    pub(crate) fn absorb(&mut self, other: &NormalEquations) {
        self.matrix.iter_mut().zip(&other.matrix).for_each(|(a, b)| *a += b);
        self.gradient.iter_mut().zip(&other.gradient).for_each(|(a, b)| *a += b);
        self.weighted_square += other.weighted_square;
        self.weight += other.weight;
    }
}

/// line += scaled · others. Segments of four, which inner pieces of cubic splines and stations are, are most of the work
/// and get a loop of fixed length.
#[inline(always)]
fn add_scaled(line: &mut [f64], scaled: f64, others: &[f64]) {
    if let (Ok(line), Ok(others)) = (<&mut [f64; 4]>::try_from(&mut *line), <&[f64; 4]>::try_from(others)) {
        for k in 0..4 {
            line[k] += scaled * others[k];
        }
        return;
    }
    line.iter_mut().zip(others).for_each(|(entry, other)| *entry += scaled * other);
}

/// Sums the rows of all readings whose weight is not zero; a negative weight takes a row out again.
pub(crate) fn accumulate(estimate: &Estimate, weights: &[f64]) -> NormalEquations {
    let used: Vec<usize> = (0..estimate.campaign.readings.len()).filter(|k| weights[*k] != 0.0).collect();
    let sum = |indices: &Range<usize>| {
        let mut normal = NormalEquations::zeros(estimate.parameters.len());
        let mut row = Row::new();
        for index in &used[indices.clone()] {
            estimate.row(*index, &mut row);
            normal.add_row(&row, estimate.setup.u_m(&row.ray), weights[*index]);
        }
        normal
    };
    let parts = in_parallel(&chunks(used.len()), sum).into_iter();
    let together = |mut total: NormalEquations, part: NormalEquations| {
        total.absorb(&part);
        total
    };
    parts.reduce(together).unwrap_or_else(|| NormalEquations::zeros(estimate.parameters.len()))
}

/// The same of rows that this whitener, made with these weights, has taken the noise's correlation from. Each row then holds
/// something of the rows before it, and is multiplied in full.
pub(crate) fn accumulate_whitened(estimate: &Estimate, weights: &[f64], whitener: &Whitener) -> NormalEquations {
    let size = estimate.parameters.len();
    let mut normal = NormalEquations::zeros(size);
    let mut sums = Sums::new(size + 1);
    let mut row = Row::new();
    let fill = |index: usize, values: &mut [f64]| {
        estimate.row(index, &mut row);
        let u_m = estimate.setup.u_m(&row.ray);
        values.fill(0.0);
        for (first, partials) in row.segments() {
            values[first..first + partials.len()].iter_mut().zip(partials).for_each(|(value, p)| *value = p / u_m);
        }
        values[size] = row.residual_m / u_m;
    };
    whitener.stream(size + 1, fill, |_, values| sums.add(values));
    let sums = sums.finish();
    for row in 0..size {
        (row..size).for_each(|column| normal.matrix[row * size + column] = sums[(column, row)]);
        normal.gradient[row] = sums[(size, row)];
    }
    normal.weighted_square = sums[(size, size)];
    normal.weight = weights.iter().sum();
    let of_weights: f64 = weights.iter().filter(|w| **w > 0.0).map(|w| w.ln()).sum();
    normal.log_determinant = whitener.log_determinant() + of_weights;
    normal
}

/// Lower triangle of the sum of products of rows, many at a time.
struct Sums {
    total: Mat<f64>,
    /// Columns are rows that wait.
    waiting: Mat<f64>,
    count: usize,
}

impl Sums {
    fn new(size: usize) -> Sums {
        Sums { total: Mat::zeros(size, size), waiting: Mat::zeros(size, TOGETHER), count: 0 }
    }

    fn add(&mut self, row: &[f64]) {
        self.waiting.col_as_slice_mut(self.count).copy_from_slice(row);
        self.count += 1;
        if self.count == TOGETHER {
            self.multiply();
        }
    }

    fn multiply(&mut self) {
        let rows = self.waiting.as_ref().subcols(0, self.count);
        let (half, full) = (BlockStructure::TriangularLower, BlockStructure::Rectangular);
        triangular::matmul(self.total.as_mut(), half, Accum::Add, rows, full, rows.transpose(), full, 1.0, Par::Seq);
        self.count = 0;
    }

    fn finish(mut self) -> Mat<f64> {
        self.multiply();
        self.total
    }
}

/// Residual (m) and its standard uncertainty (m) of all readings.
pub(crate) fn residuals(estimate: &Estimate) -> Vec<(f64, f64)> {
    let evaluate = |indices: Range<usize>| -> Vec<(f64, f64)> {
        let one = |index| {
            let (residual_m, ray) = estimate.residual(index);
            (residual_m, estimate.setup.u_m(&ray))
        };
        indices.map(one).collect()
    };
    let parts = in_parallel(&chunks(estimate.campaign.readings.len()), |indices| evaluate(indices.clone()));
    parts.into_iter().flatten().collect()
}

/// So many rows in runs of neighbours.
fn chunks(count: usize) -> Vec<Range<usize>> {
    let chunks = (count / LEAST_ROWS).clamp(1, CHUNKS);
    let size = count.div_ceil(chunks);
    (0..chunks).map(|k| (k * size).min(count)..((k + 1) * size).min(count)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_hold_every_row_once_in_order() {
        for (count, expected) in [(0, 1), (999, 1), (1999, 1), (2000, 2), (7999, 7), (20_001, CHUNKS)] {
            let chunks = chunks(count);
            assert_eq!(chunks.len(), expected, "{count}");
            assert_eq!(chunks.into_iter().flatten().collect::<Vec<usize>>(), (0..count).collect::<Vec<usize>>());
        }
    }
}
