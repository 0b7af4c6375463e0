//! Are the parameters of a fitted effect together different from zero?
//!
//! Place in the flow: pruning in [`crate::search`], and p-values of the final model. Uses the model's own covariance,
//! which is widened by misfit already; directions that only the prior determines are left out.

use abbe_geometry::model::{FittedEffect, MachineModel};
use abbe_identify::Identified;
use abbe_identify::symmetric_eigen;
use faer::Mat;

/// Share of its prior's variance that a direction must have lost to count as measured.
const MEASURED: f64 = 0.5;

/// Share of the plausible size to which a direction must be known for the data to tell it.
const TOLD: f64 = 0.05;
/// Share of the squared size of what is told from which the variance of another direction counts as open.
const OPEN: f64 = 0.25;

/// Factor on the largest size told: a few directions tell the size of others to a factor of three (Student's t with one or two
/// degrees of freedom).
const FEW: f64 = 3.0;

/// Wald statistic of one effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Wald {
    /// γᵀ V⁻¹ γ over the measured directions.
    pub(crate) statistic: f64,
    /// Measured directions.
    pub(crate) degrees: usize,
}

impl Wald {
    /// What it is above the price of its directions over so many rows; without a measured direction nothing is earned.
    pub(crate) fn earned(self, rows: usize) -> f64 {
        match self.degrees {
            0 => f64::NEG_INFINITY,
            degrees => self.statistic - degrees as f64 * (rows.max(2) as f64).ln(),
        }
    }
}

/// Of every effect of the model, in its order.
pub(crate) fn of_terms(fit: &Identified) -> Vec<Wald> {
    of_each(fit, |first, fitted| of(&fit.model, first, &fitted.parameters, &plausible(fitted)))
}

/// For every effect, how large (as a share of its plausible sizes) its directions may be, by those that the data tell;
/// `None` where they tell all of them, or none.
pub(crate) fn told(fit: &Identified) -> Vec<Option<f64>> {
    of_each(fit, |first, fitted| told_of(&fit.model, first, &fitted.parameters, &plausible(fitted)))
}

/// Of every effect, with the place of its first parameter.
fn of_each<T>(fit: &Identified, of: impl Fn(usize, &FittedEffect) -> T) -> Vec<T> {
    let mut first = fit.model.layout().len();
    let mut all = Vec::new();
    for fitted in &fit.model.parts().effects {
        all.push(of(first, fitted));
        first += fitted.parameters.len();
    }
    all
}

fn told_of(model: &MachineModel, first: usize, values: &[f64], priors: &[f64]) -> Option<f64> {
    let count = values.len();
    let scaled = Mat::from_fn(count, count, |i, j| model.covariance(first + i, first + j) / (priors[i] * priors[j]));
    let (variances, directions) = symmetric_eigen(&scaled)?;
    let along = |k: usize| (0..count).map(|i| directions[(i, k)] * values[i] / priors[i]).sum::<f64>();
    let told = (0..count).filter(|k| variances[*k] < TOLD * TOLD);
    let largest = told.map(|k| along(k).abs()).reduce(f64::max)?;
    let believed = FEW * largest;
    variances.iter().any(|variance| *variance > OPEN * believed * believed).then_some(believed)
}

fn plausible(fitted: &FittedEffect) -> Vec<f64> {
    fitted.effect.parameters().iter().map(|spec| spec.plausible).collect()
}

/// Of the parameters without which an effect is something else, for every effect in its order; `None` where all make it what it is.
pub(crate) fn of_essential(fit: &Identified) -> Vec<Option<Wald>> {
    of_each(fit, |first, fitted| {
        let own = fitted.effect.essential();
        (!own.is_empty()).then(|| of_some(&fit.model, (first, own), &fitted.parameters, &plausible(fitted)))
    })
}

fn of(model: &MachineModel, first: usize, values: &[f64], priors: &[f64]) -> Wald {
    of_some(model, (first, &(0..values.len()).collect::<Vec<usize>>()), values, priors)
}

/// Of these parameters of an effect whose parameters begin at `first`.
fn of_some(model: &MachineModel, (first, own): (usize, &[usize]), values: &[f64], priors: &[f64]) -> Wald {
    let count = own.len();
    let scaled = Mat::from_fn(count, count, |i, j| {
        model.covariance(first + own[i], first + own[j]) / (priors[own[i]] * priors[own[j]])
    });
    let Some((variances, directions)) = symmetric_eigen(&scaled) else { return Wald { statistic: 0.0, degrees: 0 } };
    let (mut statistic, mut degrees) = (0.0, 0);
    for (k, variance) in variances.iter().enumerate().filter(|(_, v)| **v > 0.0 && **v < MEASURED) {
        let along: f64 = (0..count).map(|i| directions[(i, k)] * values[own[i]] / priors[own[i]]).sum();
        statistic += along * along / variance;
        degrees += 1;
    }
    Wald { statistic, degrees }
}
