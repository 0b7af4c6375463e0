//! Restricted marginal likelihood of one component and its gradient.
//!
//! Place in the flow: what [`super::fit`] maximises and [`super::process`] predicts with. Everything is in scaled units:
//! inputs in extents of what was measured, errors in their own deviation, so that bounds and steps mean the same for any machine.
//! With K the covariance of the data, H the trend's columns and P = K⁻¹ − K⁻¹H(HᵀK⁻¹H)⁻¹HᵀK⁻¹:
//! −2 L = yᵀPy + ln|K| + ln|HᵀK⁻¹H| + (n − p) ln 2π, and ∂(−2 L) = tr(P ∂K) − yᵀP ∂K P y.
//! Source: Rasmussen & Williams 2006 eq. 2.45, 5.9; Patterson & Thompson 1971 for the restriction.

use super::kernel::Kernel;
use crate::error::MOST_INPUTS;
use faer::linalg::solvers::{DenseSolveCore, Llt, Solve};
use faer::{Mat, Side};

/// What is removed from the errors before they count as signal; its coefficients have a flat prior.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trend {
    /// Nothing: the field is zero far from the points.
    Zero,
    /// A constant: ordinary kriging.
    Constant,
    /// A constant and a slope along each input: universal kriging.
    Linear,
}

impl Trend {
    /// Values of the trend's functions at a scaled point; across a plane there is no slope.
    pub(crate) fn row(self, point: &[f64], normal: Option<usize>) -> Vec<f64> {
        match self {
            Trend::Zero => vec![],
            Trend::Constant => vec![1.0],
            Trend::Linear => {
                let slopes = (0..point.len()).filter(|d| normal != Some(*d)).map(|d| point[d]);
                std::iter::once(1.0).chain(slopes).collect()
            }
        }
    }
}

/// Parameters in scaled units: signal, a length scale for each input, and noise where it is fitted.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Scaled {
    pub(crate) signal: f64,
    pub(crate) length: Vec<f64>,
    pub(crate) noise: Option<f64>,
}

impl Scaled {
    /// From logarithms: signal, `size` lengths, and noise if there is one more.
    pub(crate) fn from_logarithms(logarithms: &[f64], size: usize) -> Scaled {
        let at = |k: usize| logarithms.get(k).map(|v| v.exp());
        let length = (1..=size).map(|k| at(k).unwrap_or(f64::NAN)).collect();
        Scaled { signal: at(0).unwrap_or(f64::NAN), length, noise: at(size + 1) }
    }

    pub(crate) fn logarithms(&self) -> Vec<f64> {
        std::iter::once(self.signal).chain(self.length.iter().copied()).chain(self.noise).map(f64::ln).collect()
    }

    /// Sum of (Δ_d/ℓ_d)² between two scaled points.
    pub(crate) fn square(&self, a: &[f64], b: &[f64]) -> f64 {
        self.length.iter().zip(a.iter().zip(b)).map(|(length, (a, b))| ((a - b) / length).powi(2)).sum()
    }

    /// Points in length scales, one after the other.
    fn in_lengths(&self, points: &[f64]) -> Vec<f64> {
        points
            .chunks_exact(self.length.len())
            .flat_map(|point| point.iter().zip(&self.length))
            .map(|(x, l)| x / l)
            .collect()
    }
}

/// Squares of the differences between two points in length scales, and their sum.
fn squares(a: &[f64], b: &[f64], parts: &mut [f64; MOST_INPUTS]) -> f64 {
    let mut sum = 0.0;
    for (part, (a, b)) in parts.iter_mut().zip(a.iter().zip(b)) {
        *part = (a - b).powi(2);
        sum += *part;
    }
    sum
}

/// Data of one component in scaled units.
#[derive(Debug, Clone)]
pub(crate) struct Data {
    /// Inputs of a point, and the points one after the other.
    pub(crate) size: usize,
    pub(crate) points: Vec<f64>,
    pub(crate) values: Vec<f64>,
    /// Declared noise variance of each value, where there is one.
    pub(crate) declared: Option<Vec<f64>>,
    /// Share of the fitted noise variance at each value, where it is not the same for all; 1 on average.
    pub(crate) shares: Option<Vec<f64>>,
    pub(crate) kernel: Kernel,
    pub(crate) trend: Trend,
    /// Input across the plane of the points, where they lie in one.
    pub(crate) normal: Option<usize>,
}

/// A covariance matrix that cannot be factored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct NotPositiveDefinite;

/// Everything that follows from the covariance at one set of parameters.
pub(crate) struct Factored {
    pub(crate) factor: Llt<f64>,
    /// K⁻¹H (n × p).
    pub(crate) whitened_trend: Mat<f64>,
    /// (HᵀK⁻¹H)⁻¹ (p × p).
    pub(crate) trend_covariance: Mat<f64>,
    /// Coefficients of the trend.
    pub(crate) coefficients: Vec<f64>,
    /// Py = K⁻¹(y − Hβ).
    pub(crate) weights: Vec<f64>,
    /// −2 L, without the constant (n − p) ln 2π.
    pub(crate) minus_two_log: f64,
}

impl Data {
    /// A scaled point.
    pub(crate) fn point(&self, index: usize) -> &[f64] {
        &self.points[index * self.size..(index + 1) * self.size]
    }

    /// All of them.
    pub(crate) fn all_points(&self) -> impl Iterator<Item = &[f64]> {
        self.points.chunks_exact(self.size)
    }

    /// Lower half of the covariance matrix of the values, zeros above. `pair` is told of each entry below the diagonal, column by column, by its
    /// scaled square distance, and gives the correlation.
    fn covariance(&self, parameters: &Scaled, mut pair: impl FnMut(f64) -> f64) -> Mat<f64> {
        let count = self.values.len();
        let variance = parameters.signal * parameters.signal;
        let mut matrix = Mat::zeros(count, count);
        let at = parameters.in_lengths(&self.points);
        let mut parts = [0.0; MOST_INPUTS];
        for column in 0..count {
            let noise = parameters.noise.map_or(0.0, |noise| noise * noise * self.share(column));
            let declared = self.declared.as_ref().map_or(0.0, |list| list[column]);
            let entries = &mut matrix.col_as_slice_mut(column)[column..];
            entries[0] = variance + noise + declared;
            let mut points = at[column * self.size..].chunks_exact(self.size);
            let Some(own) = points.next() else { continue };
            for (entry, point) in entries[1..].iter_mut().zip(points) {
                *entry = variance * pair(squares(point, own, &mut parts));
            }
        }
        matrix
    }

    /// The values at these indices.
    pub(crate) fn picked(&self, indices: &[usize]) -> Data {
        let pick = |list: &Vec<f64>| indices.iter().map(|k| list[*k]).collect();
        Data {
            size: self.size,
            points: indices.iter().flat_map(|k| self.point(*k)).copied().collect(),
            values: pick(&self.values),
            declared: self.declared.as_ref().map(pick),
            shares: self.shares.as_ref().map(pick),
            kernel: self.kernel,
            trend: self.trend,
            normal: self.normal,
        }
    }

    /// Share of the fitted noise variance at a value.
    fn share(&self, index: usize) -> f64 {
        self.shares.as_ref().map_or(1.0, |list| list[index])
    }

    /// Columns of the trend (n × p).
    fn trend_columns(&self) -> Mat<f64> {
        let rows: Vec<Vec<f64>> = self.all_points().map(|point| self.trend.row(point, self.normal)).collect();
        Mat::from_fn(rows.len(), rows.first().map_or(0, Vec::len), |i, j| rows[i][j])
    }

    /// Factors the covariance and finds trend and weights.
    pub(crate) fn factored(&self, parameters: &Scaled) -> Result<Factored, NotPositiveDefinite> {
        self.factored_from(&self.covariance(parameters, |square| self.kernel.correlation(square)))
    }

    fn factored_from(&self, covariance: &Mat<f64>) -> Result<Factored, NotPositiveDefinite> {
        let count = self.values.len();
        let factor = Llt::new(covariance.as_ref(), Side::Lower).map_err(|_| NotPositiveDefinite)?;
        let columns = self.trend_columns();
        let whitened_trend = factor.solve(&columns);
        let values = Mat::from_fn(count, 1, |row, _| self.values[row]);
        let mut minus_two_log = log_determinant(&factor, count);
        let (trend_covariance, coefficients) = if columns.ncols() == 0 {
            (Mat::zeros(0, 0), Mat::zeros(0, 1))
        } else {
            let information = columns.transpose() * &whitened_trend;
            let trend = Llt::new(information.as_ref(), Side::Lower).map_err(|_| NotPositiveDefinite)?;
            minus_two_log += log_determinant(&trend, columns.ncols());
            (trend.inverse(), trend.solve(&(whitened_trend.transpose() * &values)))
        };
        let residual = &values - &columns * &coefficients;
        let weights = factor.solve(&residual);
        minus_two_log += (0..count).map(|k| residual[(k, 0)] * weights[(k, 0)]).sum::<f64>();
        if !minus_two_log.is_finite() {
            return Err(NotPositiveDefinite);
        }
        let list = |column: &Mat<f64>| (0..column.nrows()).map(|k| column[(k, 0)]).collect();
        let (coefficients, weights) = (list(&coefficients), list(&weights));
        Ok(Factored { factor, whitened_trend, trend_covariance, coefficients, weights, minus_two_log })
    }

    /// −2 L and its gradient by the logarithms of the parameters.
    pub(crate) fn minus_two_log(&self, logarithms: &[f64]) -> Result<(f64, Vec<f64>), NotPositiveDefinite> {
        let parameters = Scaled::from_logarithms(logarithms, self.size);
        let mut pairs = Vec::with_capacity(self.values.len() * self.values.len().saturating_sub(1) / 2);
        let covariance = self.covariance(&parameters, |square| {
            let pair = self.kernel.with_derivative(square);
            pairs.push(pair);
            pair.0
        });
        let factored = self.factored_from(&covariance)?;
        let projector = factored.projector();
        let mut gradient = vec![0.0; logarithms.len()];
        let variance = parameters.signal * parameters.signal;
        let weights = &factored.weights;
        let mut parts = [0.0; MOST_INPUTS];
        let at = parameters.in_lengths(&self.points);
        let mut pairs = pairs.into_iter();
        for column in 0..self.values.len() {
            let own = projector[(column, column)] - weights[column] * weights[column];
            gradient[0] += 2.0 * variance * own;
            if let Some(noise) = parameters.noise {
                gradient[self.size + 1] += 2.0 * noise * noise * self.share(column) * own;
            }
            let mut below = [0.0; MOST_INPUTS + 1];
            let place = |k: usize| &at[k * self.size..(k + 1) * self.size];
            for (row, (correlation, slope)) in (column + 1..self.values.len()).zip(&mut pairs) {
                squares(place(row), place(column), &mut parts);
                let share = projector[(row, column)] - weights[row] * weights[column];
                below[0] += 2.0 * share * correlation;
                for (below, part) in below[1..=self.size].iter_mut().zip(&parts) {
                    *below += share * slope * part;
                }
            }
            // Each entry below the diagonal stands for itself and its mirror image.
            for (entry, sum) in gradient[..=self.size].iter_mut().zip(below) {
                *entry += 2.0 * variance * sum;
            }
        }
        Ok((factored.minus_two_log, gradient))
    }
}

impl Factored {
    /// P = K⁻¹ − K⁻¹H(HᵀK⁻¹H)⁻¹HᵀK⁻¹.
    pub(crate) fn projector(&self) -> Mat<f64> {
        let inverse = self.factor.inverse();
        if self.whitened_trend.ncols() == 0 {
            return inverse;
        }
        inverse - &self.whitened_trend * &self.trend_covariance * self.whitened_trend.transpose()
    }
}

fn log_determinant(factor: &Llt<f64>, size: usize) -> f64 {
    (0..size).map(|k| 2.0 * factor.L()[(k, k)].ln()).sum()
}
