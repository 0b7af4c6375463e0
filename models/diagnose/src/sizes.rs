//! How large the effects of a fit are, and whether that is told from nothing.
//!
//! Place in the flow: read by what takes implausible effects out, and by the diagnosis that says what was found.

use crate::diagnosis::FoundParameter;
use abbe_geometry::model::{FittedEffect, MachineModel};
use abbe_identify::EffectTerm;
use statrs::distribution::{ContinuousCDF, Normal};

/// The parameters of a fitted effect whose first is this one of the model's.
pub(crate) fn of(model: &MachineModel, fitted: &FittedEffect, first: usize) -> Vec<FoundParameter> {
    let named = fitted.effect.parameters().into_iter().zip(&fitted.parameters);
    let sized = named.enumerate().map(|(k, (spec, value))| FoundParameter {
        name: spec.name,
        unit: spec.unit,
        value: *value,
        u: model.covariance(first + k, first + k).max(0.0).sqrt(),
        plausible: spec.plausible,
    });
    sized.collect()
}

/// The parameters of a term as it was fitted; `None` where it was not.
pub(crate) fn of_term(model: &MachineModel, term: &EffectTerm) -> Option<Vec<FoundParameter>> {
    let mut first = model.layout().len();
    for fitted in &model.parts().effects {
        if fitted.effect.name() == term.effect.name() && fitted.shape == term.shape {
            return Some(of(model, fitted, first));
        }
        first += fitted.parameters.len();
    }
    None
}

/// Whether the size of at least one parameter is told from zero, among so many tests: what several parameters explain only in the sum,
/// each of them open, is no cause that was seen.
pub(crate) fn is_told(parameters: &[FoundParameter], tests: usize, significance: f64) -> bool {
    let most = parameters.iter().map(|p| (p.value / p.u).abs()).fold(0.0, f64::max);
    2.0 * Normal::standard().cdf(-most) * tests as f64 <= significance
}
