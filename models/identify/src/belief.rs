//! What is believed of a machine before it is measured: how much each of its error functions bends.
//!
//! Place in the flow: [`crate::foresee()`] needs it in place of the smoothness that a fit chooses from the data. The penalty of
//! a spline is λ ∫ w f″² for unit noise, the density of a Gaussian process whose curvature has the variance 1/λ; so λ can be
//! told from how much the functions bend: E[mean square of f about its straight line] = tr(Q B S⁺ Bᵀ Q)/(λ m) at m places of
//! the stroke, S the roughness matrix, B the basis there, Q what takes a straight line out. Bends in m and rad.

use crate::identified::Identified;
use crate::linear::symmetric_eigen;
use crate::roughness::Curvature;
use crate::smoothing::Smoothness;
use abbe_geometry::ErrorId;
use abbe_geometry::error_function::Basis;
use abbe_geometry::layout::Layout;
use abbe_geometry::machine::{Machine, MachineError};
use abbe_geometry::model::MachineModel;
use faer::Mat;

/// Exponent of the profile where nothing tells it: the middle of those that a fit may choose.
const USUAL_EXPONENT: f64 = 1.0;
/// Exponents tried against a model.
const EXPONENTS: [f64; 9] = [0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0];
/// Places of the stroke at which a bend is taken.
const PLACES: usize = 41;
/// Least bend that is believed, as a share of the one given: keeps λ finite for an error said to be straight.
const LEAST_BEND: f64 = 1e-12;
/// Share of the largest eigenvalue below which a shape has no curvature.
const STRAIGHT: f64 = 1e-9;

/// Smoothness of every error function, without any data of the campaign to come.
#[derive(Debug, Clone, PartialEq)]
pub struct Belief {
    lambdas: [Option<f64>; ErrorId::COUNT],
    exponent: f64,
}

impl Belief {
    /// From the bend of each error function: rms of its departure from a straight line over the stroke (m or rad).
    ///
    /// # Errors
    /// A machine whose description is wrong.
    pub fn of_bends(machine: &Machine, bend: impl Fn(ErrorId) -> f64) -> Result<Belief, MachineError> {
        let layout = Layout::new(machine, [0.0; 3])?;
        let of = |id: ErrorId| {
            let square = unit_bend_square(layout.basis(id)?, USUAL_EXPONENT)?;
            Some(square / bend(id).abs().max(LEAST_BEND).powi(2))
        };
        let mut lambdas = [None; ErrorId::COUNT];
        ErrorId::all().for_each(|id| lambdas[id.index()] = of(id));
        Ok(Belief { lambdas, exponent: USUAL_EXPONENT })
    }

    /// What a fit found of its machine.
    pub fn of_fit(fit: &Identified) -> Belief {
        let smoothness = &fit.ended.smoothness;
        let layout = fit.model.layout();
        let mut lambdas = [None; ErrorId::COUNT];
        for id in ErrorId::all() {
            let own = smoothness.penalties.iter().find(|penalty| penalty.range == layout.range(id));
            lambdas[id.index()] = own.map(|penalty| penalty.lambda);
        }
        Belief { lambdas, exponent: smoothness.exponent() }
    }

    /// What a model says of its machine: the λ at which its coefficients and their covariance are a fixed point of the
    /// update that a fit makes, and the likeliest exponent.
    pub fn of_model(model: &MachineModel) -> Belief {
        let scale = model.parts().quality.chi2_per_dof.max(1.0);
        let tried = EXPONENTS.map(|exponent| {
            let mut belief = Belief { lambdas: [None; ErrorId::COUNT], exponent };
            let mut likelihood = 0.0;
            for id in ErrorId::all() {
                let Some((lambda, own)) = lambda_of(model, id, exponent, scale) else { continue };
                belief.lambdas[id.index()] = Some(lambda);
                likelihood += own;
            }
            (likelihood, belief)
        });
        let best = tried.into_iter().reduce(|a, b| if b.0 > a.0 { b } else { a });
        best.map_or(Belief { lambdas: [None; ErrorId::COUNT], exponent: USUAL_EXPONENT }, |(_, belief)| belief)
    }

    /// The same of a machine that bends this many times as much.
    pub fn bending(&self, times: f64) -> Belief {
        Belief { lambdas: self.lambdas.map(|lambda| lambda.map(|l| l / (times * times))), exponent: self.exponent }
    }

    /// Bend (m or rad, rms about a straight line) that is believed of an error function of this machine.
    pub fn bend(&self, machine: &Machine, id: ErrorId) -> Option<f64> {
        let layout = Layout::new(machine, [0.0; 3]).ok()?;
        let square = unit_bend_square(layout.basis(id)?, self.exponent)?;
        Some((square / self.lambdas[id.index()]?).sqrt())
    }

    /// The penalties of a layout; a function of which nothing is believed has none.
    pub(crate) fn smoothness(&self, layout: &Layout) -> Smoothness {
        let mut smoothness = Smoothness::new(layout);
        smoothness.believe(self.exponent, |range| {
            let id = ErrorId::all().find(|id| layout.range(*id) == *range)?;
            self.lambdas[id.index()]
        });
        smoothness
    }
}

/// Mean square about a straight line (m² or rad²) of a function whose λ is 1; `None` where it has no curvature.
fn unit_bend_square(basis: &Basis, exponent: f64) -> Option<f64> {
    let roughness = Curvature::new(basis)?.at(exponent)?;
    let n = basis.len();
    let (values, vectors) = symmetric_eigen(&Mat::from_fn(n, n, |i, j| roughness.matrix[i * n + j]))?;
    let largest = values.last().copied()?;
    let (lower_m, upper_m) = basis.stroke_m();
    let share = |k: usize| k as f64 / (PLACES - 1) as f64;
    let mut shapes = Mat::zeros(PLACES, n);
    for k in 0..PLACES {
        let local = basis.at(lower_m + share(k) * (upper_m - lower_m));
        local.values().iter().enumerate().for_each(|(i, value)| shapes[(k, local.first + i)] = *value);
    }
    let curved = &shapes * &vectors;
    let bent = |j: usize| -> f64 {
        let values: Vec<f64> = (0..PLACES).map(|k| curved[(k, j)]).collect();
        mean_square_about_line(&values)
    };
    let seen = (0..n).filter(|j| values[*j] > STRAIGHT * largest);
    Some(seen.map(|j| bent(j) / values[j]).sum())
}

/// Mean square of evenly spaced values about their straight line.
fn mean_square_about_line(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let at = |k: usize| k as f64 - (count - 1.0) / 2.0;
    let square: f64 = (0..values.len()).map(|k| at(k).powi(2)).sum();
    let slope = values.iter().enumerate().map(|(k, value)| at(k) * value).sum::<f64>() / square;
    values.iter().enumerate().map(|(k, value)| (value - mean - slope * at(k)).powi(2)).sum::<f64>() / count
}

/// λ of one error function of a model, and twice the log density of its curvature but for what λ = fixed point leaves alike.
fn lambda_of(model: &MachineModel, id: ErrorId, exponent: f64, scale: f64) -> Option<(f64, f64)> {
    let basis = model.layout().basis(id)?;
    let curvature = Curvature::new(basis)?;
    let roughness = curvature.at(exponent)?;
    let (first, n) = (model.layout().range(id).start, basis.len());
    let coefficients = &model.parts().coefficients;
    let mut spread = 0.0;
    for i in 0..n {
        for j in 0..n {
            let product = coefficients[first + i] * coefficients[first + j];
            spread += roughness.matrix[i * n + j] * (product + model.covariance(first + i, first + j) / scale);
        }
    }
    let rank = curvature.rank() as f64;
    if spread <= 0.0 || rank < 2.0 {
        return None;
    }
    let lambda = (rank - 1.0) / spread;
    Some((lambda, rank * lambda.ln() + roughness.log_determinant))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_as_far_from_its_line_as_by_hand() {
        // t² − t on 0 … 1 about its best line: variance of t² − t + 1/6 is 1/180; the two ends count in full, 1e-3 of it.
        let values: Vec<f64> = (0..4001).map(|k| f64::from(k) / 4000.0).map(|t| t * t - t).collect();
        assert!((mean_square_about_line(&values) * 180.0 - 1.0).abs() < 2e-3);
        let line: Vec<f64> = (0..41).map(|k| 3.0 - 0.2 * f64::from(k)).collect();
        assert!(mean_square_about_line(&line) < 1e-24);
    }
}
