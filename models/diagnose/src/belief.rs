//! How far an explanation is believed: as far as all of it together explains readings that it was not fitted to.
//!
//! Place in the flow: the last step of [`crate::diagnose()`], on the model that is adopted. Terms that are not the cause can
//! follow the residual of the readings at hand, and then their residual says nothing of the next reading. So blocks are left
//! out (lines, spans of time, stations, offsets) and their residuals held against what the fit says of its own
//! predictions, rᵀ(I − H)⁻¹r a direction, which is one where the explanation is right. Where it is φ in the worst kind of block:
//!
//! - the model is widened as if its residual were that of these predictions;
//! - the share 1 − 1/φ of what is left has a cause that the model lacks, and in that share each effect found may be that
//!   cause in disguise: its size counts as uncertain as a whole, its parameters γ by share · γγᵀ;
//! - what an effect took for the instrument's may have been the tip's, and then corrected points lack it: its mean square on
//!   the range counts in that share as unexplained.
//!
//! Where the cause is in the list φ is one but for chance, and nothing changes. Whitened residuals; no units.

use crate::candidates::Round;
use crate::gate;
use crate::held_out::held_out;
use crate::judge;
use abbe_geometry::effects::State;
use abbe_geometry::model::{FittedEffect, MachineModel, ModelError};
use abbe_identify::verdict::widened;
use abbe_identify::{CampaignRow, EffectTerm};
use abbe_measurement::campaign::Campaign;

/// Standard deviations of φ by chance that are not counted. Four kinds of block are looked at, and the worst counts.
const CHANCE: f64 = 3.0;

/// The model with the uncertainty that its explanation deserves; `base` are the effects that it had before.
pub(crate) fn believed(
    model: &MachineModel,
    round: &Round,
    campaign: &Campaign,
    base: &[EffectTerm],
) -> Result<MachineModel, ModelError> {
    let (phi, judged) = worst(round, campaign);
    let chance = CHANCE * (2.0 / judged.max(1.0)).sqrt();
    let seen = round.linear.noise_factor();
    let model = match phi > seen.max(1.0) * (1.0 + chance) {
        true => widened(model.clone(), phi / seen.max(1.0))?,
        false => model.clone(),
    };
    let share = 1.0 - (phi - chance).max(1.0).recip();
    if share == 0.0 {
        return Ok(model);
    }
    let mut parts = model.parts().clone();
    let mut first = model.layout().len();
    for fitted in &model.parts().effects {
        if !is_of(base, fitted) {
            add_outer(&mut parts.covariance, first, &fitted.parameters, share);
            if !moves_tip(campaign, fitted) {
                let quality = &mut parts.quality;
                quality.unexplained_m = (quality.unexplained_m.powi(2) + share * on_range_m2(round, fitted)).sqrt();
            }
        }
        first += fitted.parameters.len();
    }
    MachineModel::new(parts)
}

/// Mean square of standardised residuals left out, in the kind of block where it is largest, and the directions in it.
fn worst(round: &Round, campaign: &Campaign) -> (f64, f64) {
    let mut kinds: Vec<Vec<Vec<usize>>> =
        judge::blocks(campaign, round).into_iter().map(|(_, blocks)| blocks).collect();
    kinds.push(gate::by_offset(campaign, round));
    let of = |blocks: Vec<Vec<usize>>| {
        let all = held_out(&round.linear, &blocks);
        let judged = all.iter().map(|block| block.judged).sum::<usize>() as f64;
        (all.iter().map(|block| block.standardised).sum::<f64>() / judged.max(1.0), judged)
    };
    let judged = kinds.into_iter().filter(|blocks| blocks.len() > 1).map(of);
    judged.fold((1.0, 1.0), |worst, kind| if kind.0 > worst.0 { kind } else { worst })
}

fn is_of(base: &[EffectTerm], fitted: &FittedEffect) -> bool {
    base.iter().any(|term| term.effect.name() == fitted.effect.name() && term.shape == fitted.shape)
}

fn moves_tip(campaign: &Campaign, fitted: &FittedEffect) -> bool {
    (0..campaign.readings.len()).any(|reading| {
        let r = &campaign.readings[reading];
        let row = CampaignRow { campaign, reading };
        let state = State { reading_m: r.reading_m, offset_m: r.offset_m, covariates: &row };
        let mut moves = false;
        let known = fitted.effect.motion(&state, &mut |_, _, amount| moves |= amount != 0.0);
        known.is_ok() && moves
    })
}

/// Variance of what an effect does to the ranges used (m²).
fn on_range_m2(round: &Round, fitted: &FittedEffect) -> f64 {
    let Ok(columns) = round.rows.columns(fitted.effect.as_ref()) else { return 0.0 };
    let used: Vec<usize> = (0..round.rows.len()).filter(|k| round.rows.whitening[*k] > 0.0).collect();
    let value = |k: &usize| {
        let whitened: f64 = fitted.parameters.iter().enumerate().map(|(j, p)| columns[(*k, j)] * p).sum();
        whitened / round.rows.whitening[*k]
    };
    let values: Vec<f64> = used.iter().map(value).collect();
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count
}

/// Adds share · γγᵀ to a packed covariance.
fn add_outer(packed: &mut [f64], first: usize, gamma: &[f64], share: f64) {
    for (i, a) in gamma.iter().enumerate() {
        for (j, b) in gamma.iter().enumerate().take(i + 1) {
            let (row, column) = (first + i, first + j);
            packed[row * (row + 1) / 2 + column] += share * a * b;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_of_an_effect_is_uncertain_as_a_whole() {
        let mut packed = vec![0.0; 10];
        add_outer(&mut packed, 1, &[2.0, -3.0], 0.25);
        assert_eq!(packed, [0.0, 0.0, 1.0, 0.0, -1.5, 2.25, 0.0, 0.0, 0.0, 0.0]);
    }
}
