//! How a corrected position depends on every parameter of the model, and the covariance that follows.
//!
//! Place in the flow: [`crate::correct`] fills it for each sample and takes J V Jᵀ (m²); [`crate::predict`] and
//! [`crate::volumetric`] take its component along a direction. J has as many columns as the model has parameters, but an error
//! function has only a few that are not zero at a position, side by side, and all of them move the position in one direction.
//! So the sum runs over pairs of functions, and over their few coefficients within: an eighth of the products of pairs of
//! parameters in three dimensions.

use crate::error_function::MAX_LOCAL;
use crate::model::{Combination, MachineModel};
use nalgebra::{Matrix3, Vector3};
use pulp::{Arch, Simd, WithSimd};
use smallvec::SmallVec;

/// Parameters besides error functions that a sample has room for: squareness, turn of the ram, an effect or two.
const ROOM: usize = 24;
/// Values of a cubic spline between two knots, which is what most functions are.
const SPLINE: usize = 4;

/// An error function at the sample: ∂position/∂parameter `first + k` is `column · values[k]`, for `k` below `len`.
struct Function {
    column: Vector3<f64>,
    first: usize,
    len: usize,
    values: [f64; MAX_LOCAL],
}

impl Function {
    fn values(&self) -> &[f64] {
        &self.values[..self.len]
    }

    /// The function with these numbers for its coefficients.
    #[inline(always)]
    fn dot(&self, all: &[f64]) -> f64 {
        let own = &all[self.first..self.first + self.len];
        self.values().iter().zip(own).map(|(value, v)| value * v).sum()
    }

    /// Covariance of the values of two functions.
    #[inline(always)]
    fn covariance(&self, other: &Function, model: &MachineModel) -> f64 {
        if self.len == SPLINE && other.len == SPLINE {
            return self.covariance_of_splines(other, model);
        }
        let along = |k: usize| other.dot(model.machine_covariance_row(self.first + k));
        self.values().iter().enumerate().map(|(k, value)| value * along(k)).sum()
    }

    /// The same of two splines between knots, with lengths that the compiler knows.
    #[inline(always)]
    fn covariance_of_splines(&self, other: &Function, model: &MachineModel) -> f64 {
        let mut combined = [0.0; SPLINE];
        for k in 0..SPLINE {
            let row = &model.machine_covariance_row(self.first + k)[other.first..other.first + SPLINE];
            for (sum, v) in combined.iter_mut().zip(row) {
                *sum += self.values[k] * v;
            }
        }
        combined.iter().zip(&other.values).map(|(sum, value)| sum * value).sum()
    }
}

/// The sum over pairs, in the widest registers that the processor has: the same operations in the same order, so the same
/// bits with any.
struct HalfCovariance<'a> {
    of: &'a Sensitivity,
    model: &'a MachineModel,
}

impl WithSimd for HalfCovariance<'_> {
    type Output = Matrix3<f64>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> Matrix3<f64> {
        self.of.half_covariance_m2(self.model)
    }
}

/// Sensitivities of the position by parameter.
#[derive(Default)]
pub(crate) struct Sensitivity {
    functions: SmallVec<[Function; 18]>,
    /// Parameters that stand alone: index and column.
    single: SmallVec<[(usize, Vector3<f64>); ROOM]>,
    /// Departures between nodes: index and column.
    between_nodes: SmallVec<[(usize, Vector3<f64>); 0]>,
}

impl Sensitivity {
    /// Adds one parameter.
    pub(crate) fn push(&mut self, index: usize, column: Vector3<f64>) {
        self.single.push((index, column));
    }

    /// Adds the coefficients of an error function that are not zero here; `column` is the partial by its value.
    pub(crate) fn push_function(&mut self, first: usize, column: Vector3<f64>, basis: &[f64]) {
        let mut values = [0.0; MAX_LOCAL];
        values[..basis.len()].copy_from_slice(basis);
        self.functions.push(Function { column, first, len: basis.len(), values });
    }

    /// Adds what straight lines between nodes miss.
    pub(crate) fn push_departure(&mut self, index: usize, column: Vector3<f64>) {
        self.between_nodes.push((index, column));
    }

    /// Sensitivity of the position's component in a direction.
    pub(crate) fn along(&self, direction: &Vector3<f64>) -> Combination {
        let functions = self.functions.iter().flat_map(|function| {
            let along = direction.dot(&function.column);
            function.values().iter().enumerate().map(move |(k, value)| (function.first + k, along * value))
        });
        let of = |(index, column): &(usize, Vector3<f64>)| (*index, direction.dot(column));
        Combination {
            parameters: functions.chain(self.single.iter().map(of)).collect(),
            between_nodes: self.between_nodes.iter().map(of).collect(),
        }
    }

    /// J V Jᵀ (m²), and what straight lines between nodes miss.
    pub(crate) fn covariance_m2(&self, model: &MachineModel) -> Matrix3<f64> {
        let half = Arch::new().dispatch(HalfCovariance { of: self, model });
        let mut total = half + half.transpose();
        for (index, column) in &self.between_nodes {
            total += column * column.transpose() * model.between_nodes().variance(*index);
        }
        total
    }

    /// Each pair of parts once, and each part with itself by half.
    #[inline(always)]
    fn half_covariance_m2(&self, model: &MachineModel) -> Matrix3<f64> {
        let mut half = Matrix3::zeros();
        for (k, a) in self.functions.iter().enumerate() {
            let mut weighted = a.column * (0.5 * a.covariance(a, model));
            for b in &self.functions[..k] {
                weighted += b.column * a.covariance(b, model);
            }
            half += a.column * weighted.transpose();
        }
        for (k, (index, column)) in self.single.iter().enumerate() {
            let row = model.machine_covariance_row(*index);
            let mut weighted = column * (0.5 * row[*index]);
            for b in &self.functions {
                weighted += b.column * b.dot(row);
            }
            for (other, b) in &self.single[..k] {
                weighted += b * row[*other];
            }
            half += column * weighted.transpose();
        }
        half
    }
}
