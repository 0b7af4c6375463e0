//! How likely a fit makes the readings, on weights that are not its own.
//!
//! Place in the flow: wherever two fits of one campaign are compared. Robust weights are each fit's own, and a fit that
//! rejects more readings has less to explain: its likelihood looks better for it. So both are put on the same weights.

use crate::design::{Estimate, Setup};
use crate::error::IdentifyError;
use crate::identified::{Ended, Identified};
use crate::normal::{accumulate, accumulate_whitened};
use crate::rows::parameters_of;
use crate::smoothing::solve;
use crate::term::EffectTerm;
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;

/// −2 log of the restricted marginal likelihood of a settled fit of this campaign with these weights, one a reading, up to a
/// constant of data and weights; smaller is better. Smoothness and noise are those that are likeliest with these weights.
///
/// # Errors
/// [`IdentifyError::Singular`] where these weights leave some of its parameters undetermined.
pub fn minus_two_log_likelihood_on(
    fit: &Identified,
    instrument: RangeUncertainty,
    campaign: &Campaign,
    weights: &[f64],
) -> Result<f64, IdentifyError> {
    let parts = fit.model.parts();
    let terms: Vec<EffectTerm> = parts.effects.iter().map(EffectTerm::of).collect();
    let setup = Setup { machine: &parts.machine, layout: fit.model.layout(), instrument, terms: &terms };
    let parameters = parameters_of(&fit.model);
    let estimate = Estimate::new(setup, campaign, &parameters);
    let normal = match &fit.correlation {
        Some(correlation) => accumulate_whitened(&estimate, weights, &correlation.whitener(campaign, weights)),
        None => accumulate(&estimate, weights),
    };
    let Ended { free, smoothness, noise_factor } = &fit.ended;
    let mut smoothness = smoothness.clone();
    let mut at_noise = |noise_factor: f64, choose: bool| {
        solve(&normal, &parameters, free, &mut smoothness, noise_factor, choose).map_err(|_| IdentifyError::Singular)
    };
    let chosen = at_noise(*noise_factor, true)?;
    Ok(at_noise(chosen.noise_factor, false)?.minus_two_log_likelihood)
}
