//! The Cramér-Rao bound: how well any unbiased method could know the machine from this campaign.
//!
//! Place in the flow: `abbe simulate` and the tests compare what identification achieves with it. Inputs: a model
//! (where the range model is linearised), the instrument and the campaign whose plan is judged (SI, machine frame);
//! the lengths play no part. The bound is (JᵀWJ)⁻¹ with the declared uncertainties, without penalty and without
//! rejected readings; only the turn of the ram and the zero of an absolute instrument keep their priors.

use crate::design::{Estimate, Setup};
use crate::error::IdentifyError;
use crate::linear::{Factor, select};
use crate::normal::accumulate;
use abbe_geometry::model::{FitQuality, MachineModel, ModelParts, packed};
use abbe_geometry::unseen_expansion::UnseenExpansions;
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;

/// The same model with the covariance of the Cramér-Rao bound instead of its own, so that errors, angles, stations and
/// corrected coordinates can be asked for their bound. Effects are left out.
///
/// # Errors
/// [`IdentifyError::Singular`] where the plan cannot determine all coefficients of the model.
pub fn at_cramer_rao_bound(
    model: &MachineModel,
    instrument: RangeUncertainty,
    campaign: &Campaign,
    absolute_range: bool,
) -> Result<MachineModel, IdentifyError> {
    let parts = model.parts();
    let mut parameters = parts.coefficients.clone();
    let mut free: Vec<usize> = (0..parameters.len()).collect();
    for station in &parts.stations {
        let first = parameters.len();
        parameters.extend(station.position_m.iter().chain([&station.dead_path_m]));
        free.extend(first..parameters.len());
    }
    let setup = Setup { machine: &parts.machine, layout: model.layout(), instrument, terms: &[] };
    let weights = vec![1.0; campaign.readings.len()];
    let normal = accumulate(&Estimate::new(setup, campaign, &parameters), &weights);
    let mut information = select(&normal.matrix, normal.size, &free);
    // All are free, so that each stands at its own place.
    let priors = setup.priors_with(parts.stations.len(), absolute_range);
    priors.into_iter().for_each(|(k, size)| information[(k, k)] += 1.0 / (size * size));
    let covariance = Factor::new(&information).map_err(|_| IdentifyError::Singular)?.inverse();
    let mut triangle = vec![0.0; parameters.len() * (parameters.len() + 1) / 2];
    for (i, row) in free.iter().enumerate() {
        for (j, column) in free.iter().enumerate().take(i + 1) {
            triangle[packed(*row, *column)] = covariance[(i, j)];
        }
    }
    Ok(MachineModel::new(ModelParts {
        machine: parts.machine.clone(),
        coefficients: parts.coefficients.clone(),
        offset_centre_m: parts.offset_centre_m,
        effects: Vec::new(),
        stations: parts.stations.clone(),
        covariance: triangle,
        chord_covariance: Vec::new(),
        identified: parts.identified.clone(),
        // Noise alone.
        quality: FitQuality { unseen_expansions: UnseenExpansions::default(), ..parts.quality.clone() },
    })?)
}
