//! Are the parameters of a fitted effect together different from zero?
//!
//! Place in the flow: pruning in [`crate::search`], and p-values of the final model. Uses the model's own covariance,
//! which is widened by misfit already; directions that only the prior determines are left out.

use abbe_geometry::model::MachineModel;
use abbe_identify::Identified;
use abbe_identify::symmetric_eigen;
use faer::Mat;

/// Share of its prior's variance that a direction must have lost to count as measured.
const MEASURED: f64 = 0.5;

/// Wald statistic of one effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Wald {
    /// γᵀ V⁻¹ γ over the measured directions.
    pub(crate) statistic: f64,
    /// Measured directions.
    pub(crate) degrees: usize,
}

/// Of every effect of the model, in its order.
pub(crate) fn of_terms(fit: &Identified) -> Vec<Wald> {
    let mut first = fit.model.layout().len();
    let mut all = Vec::new();
    for fitted in &fit.model.parts().effects {
        all.push(of(&fit.model, first, &fitted.parameters, &plausible(fitted)));
        first += fitted.parameters.len();
    }
    all
}

fn plausible(fitted: &abbe_geometry::model::FittedEffect) -> Vec<f64> {
    fitted.effect.parameters().iter().map(|spec| spec.plausible).collect()
}

fn of(model: &MachineModel, first: usize, values: &[f64], priors: &[f64]) -> Wald {
    let count = values.len();
    let scaled = Mat::from_fn(count, count, |i, j| model.covariance(first + i, first + j) / (priors[i] * priors[j]));
    let Some((variances, directions)) = symmetric_eigen(&scaled) else { return Wald { statistic: 0.0, degrees: 0 } };
    let (mut statistic, mut degrees) = (0.0, 0);
    for (k, variance) in variances.iter().enumerate().filter(|(_, v)| **v > 0.0 && **v < MEASURED) {
        let along: f64 = (0..count).map(|i| directions[(i, k)] * values[i] / priors[i]).sum();
        statistic += along * along / variance;
        degrees += 1;
    }
    Wald { statistic, degrees }
}
