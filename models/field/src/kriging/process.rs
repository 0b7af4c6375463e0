//! One component, ready to predict.
//!
//! Place in the flow: made by [`super::fit`], asked for each point. Mean h·β + kᵀK⁻¹(y − Hβ); variance
//! k(x,x) − kᵀK⁻¹k + (h − HᵀK⁻¹k)ᵀ(HᵀK⁻¹H)⁻¹(h − HᵀK⁻¹k). Source: Rasmussen & Williams 2006 eq. 2.41-2.42.

use super::likelihood::{Data, Factored, Scaled};
use faer::Mat;
use faer::linalg::solvers::{Llt, Solve};

/// From inputs in their units to what the process computes in.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Scaling {
    /// Middle of the points.
    pub(crate) middle: Vec<f64>,
    /// Their extents.
    pub(crate) extent: Vec<f64>,
    /// Deviation of the errors (m).
    pub(crate) deviation_m: f64,
}

impl Scaling {
    pub(crate) fn point(&self, point: &[f64]) -> Vec<f64> {
        point
            .iter()
            .zip(self.middle.iter().zip(&self.extent))
            .map(|(at, (middle, extent))| (at - middle) / extent)
            .collect()
    }
}

/// One component.
#[derive(Debug, Clone)]
pub(crate) struct Process {
    data: Data,
    scaling: Scaling,
    parameters: Scaled,
    factor: Llt<f64>,
    whitened_trend: Mat<f64>,
    trend_covariance: Mat<f64>,
    coefficients: Vec<f64>,
    weights: Vec<f64>,
    /// Diagonal of P.
    projector_diagonal: Vec<f64>,
}

impl Process {
    pub(crate) fn new(data: Data, scaling: Scaling, parameters: Scaled, factored: Factored) -> Process {
        let projector = factored.projector();
        let projector_diagonal = (0..data.values.len()).map(|k| projector[(k, k)]).collect();
        let Factored { factor, whitened_trend, trend_covariance, coefficients, weights, .. } = factored;
        let trend = (whitened_trend, trend_covariance);
        Process {
            data,
            scaling,
            parameters,
            factor,
            whitened_trend: trend.0,
            trend_covariance: trend.1,
            coefficients,
            weights,
            projector_diagonal,
        }
    }

    /// Covariance of the signal at a scaled point with that at each measured point.
    fn covariances<'a>(&'a self, point: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        let variance = self.parameters.signal * self.parameters.signal;
        let of = move |other| variance * self.data.kernel.correlation(self.parameters.square(point, other));
        self.data.all_points().map(of)
    }

    /// Expected error (m).
    pub(crate) fn mean(&self, point: &[f64]) -> f64 {
        let point = self.scaling.point(point);
        let trend: f64 =
            self.data.trend.row(&point, self.data.normal).iter().zip(&self.coefficients).map(|(h, b)| h * b).sum();
        let signal: f64 = self.covariances(&point).zip(&self.weights).map(|(k, w)| k * w).sum();
        (trend + signal) * self.scaling.deviation_m
    }

    /// Expected error and standard uncertainty of the field (m).
    pub(crate) fn predict(&self, point: &[f64]) -> (f64, f64) {
        let point = self.scaling.point(point);
        let covariances: Vec<f64> = self.covariances(&point).collect();
        let row = self.data.trend.row(&point, self.data.normal);
        let trend: f64 = row.iter().zip(&self.coefficients).map(|(h, b)| h * b).sum();
        let signal: f64 = covariances.iter().zip(&self.weights).map(|(k, w)| k * w).sum();
        let count = covariances.len();
        let solved = self.factor.solve(&Mat::from_fn(count, 1, |k, _| covariances[k]));
        let known: f64 = (0..count).map(|k| covariances[k] * solved[(k, 0)]).sum();
        let mut variance = self.parameters.signal * self.parameters.signal - known;
        let open: Vec<f64> = (0..row.len())
            .map(|j| row[j] - (0..count).map(|k| self.whitened_trend[(k, j)] * covariances[k]).sum::<f64>())
            .collect();
        for i in 0..open.len() {
            for j in 0..open.len() {
                variance += open[i] * self.trend_covariance[(i, j)] * open[j];
            }
        }
        let deviation_m = self.scaling.deviation_m;
        // Rounding may leave less than nothing where the field is known exactly.
        ((trend + signal) * deviation_m, variance.max(0.0).sqrt() * deviation_m)
    }

    /// At each measured point: what the others predict, and the standard uncertainty of the difference (m).
    pub(crate) fn leave_one_out(&self) -> Vec<(f64, f64)> {
        let deviation_m = self.scaling.deviation_m;
        let one = |((value, weight), own): ((&f64, &f64), &f64)| {
            ((value - weight / own) * deviation_m, (1.0 / own).sqrt() * deviation_m)
        };
        self.data.values.iter().zip(&self.weights).zip(&self.projector_diagonal).map(one).collect()
    }
}
