//! The least that a model must leave unexplained: what blocks left out of its own fit show.
//!
//! Place in the flow: the end of [`crate::diagnose()`], on the fit that is adopted, whatever was found; and of an identification alone, where it leaves
//! more than its noise. A fit with some two hundred
//! parameters takes a good part of what it does not explain into errors and stations, above all where a few hundred readings are all
//! there is: the readings that it saw then look explained, and a corrected point, which it never saw, is not. So whole lines and spans
//! of time are left out, exactly and without refitting ([`crate::paired`]), and what they show beyond their declared noise and
//! the uncertainty of their prediction counts as unexplained:
//!
//! mean of u² (ρ² − 1 − φ (e − 1)), less one standard deviation between blocks; ρ = ((I − H)⁻¹ r), e the diagonal of (I − H)⁻¹,
//!
//! φ ≥ 1 what the covariance of the model is scaled by already. m, along each axis.

use crate::blocks::blocks;
use crate::candidates::Round;
use crate::error::DiagnoseError;
use crate::options::DiagnoseOptions;
use crate::paired::untouched;
use crate::wander::{self, Wander};
use abbe_geometry::model::MachineModel;
use abbe_identify::verdict::{Verdict, widened};
use abbe_identify::{Excess, Identified, IdentifyError, by_axis, in_parallel};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;

/// Kinds of block that are left out.
const LEFT_OUT: [&str; 2] = ["line", "time"];

/// An identification alone, as a model that holds what the fit does not explain.
#[derive(Debug, Clone)]
pub struct Alone {
    /// The model.
    pub model: MachineModel,
    /// What the machine does in the course of the campaign, where the readings show it; the model has it in its uncertainty.
    pub wander: Option<Wander>,
}

/// The model of a fit, with what lines and spans of time left out of it show in its uncertainty, where it leaves more than its noise; and with
/// what changes in the course of time and was taken for stations and errors, where its residual does not tell of it.
///
/// # Errors
/// Rows that cannot be factored.
pub fn with_left_out(
    fit: &Identified,
    instrument: RangeUncertainty,
    campaign: &Campaign,
) -> Result<Alone, DiagnoseError> {
    let own_m = fit.model.parts().quality.unexplained_m;
    let mut model = fit.model.clone();
    if own_m != [0.0; 3] {
        let left_m = unexplained_m(&Round::new(fit, instrument, campaign)?, campaign);
        model =
            model.with_unexplained(std::array::from_fn(|d| own_m[d].max(left_m[d]))).map_err(IdentifyError::from)?;
    }
    let wander = wander::in_time(fit, instrument, campaign, DiagnoseOptions::default().significance)?;
    if let Some(wander) = &wander {
        model = wander.told(model).map_err(IdentifyError::from)?;
    }
    Ok(Alone { model, wander })
}

/// A fit as it is stated, by whatever it was made: the model with what the campaign leaves open ([`with_left_out`]) and what a misfit costs that
/// is accepted, and the verdict with what the machine does in the course of the campaign.
///
/// # Errors
/// Rows that cannot be factored.
pub fn stated(
    fit: &Identified,
    instrument: RangeUncertainty,
    campaign: &Campaign,
    verdict: Verdict,
) -> Result<(MachineModel, Verdict), DiagnoseError> {
    let Alone { model, wander } = with_left_out(fit, instrument, campaign)?;
    let verdict = wander.iter().fold(verdict, |verdict, wander| verdict.with(wander.finding()));
    Ok((widened(model, verdict.widening).map_err(IdentifyError::from)?, verdict))
}

/// Standard deviation along X, Y and Z (m) of what blocks left out show beyond noise and prediction; 0 where chance explains it.
pub(crate) fn unexplained_m(round: &Round, campaign: &Campaign) -> [f64; 3] {
    let kinds = blocks(campaign, round).into_iter().filter(|(by, _)| LEFT_OUT.contains(by));
    let of_kinds: Vec<[f64; 3]> = kinds.map(|(_, blocks)| of_blocks(round, &blocks)).collect();
    std::array::from_fn(|d| of_kinds.iter().map(|u_m| u_m[d]).fold(0.0, f64::max))
}

fn of_blocks(round: &Round, blocks: &[Vec<usize>]) -> [f64; 3] {
    let factor = round.linear.noise_factor().max(1.0);
    let one = |(block, number): &(&Vec<usize>, u32)| -> Vec<Excess> {
        let Some(predicted) = untouched(&round.linear, block) else { return Vec::new() };
        let excess = |(k, (residual, variance)): (&usize, (f64, f64))| Excess {
            direction: round.rows.rays[*k].direction,
            square_m2: (residual * residual - 1.0 - factor * (variance - 1.0).max(0.0))
                / round.rows.whitening[*k].powi(2),
            line: *number,
        };
        block.iter().zip(predicted).map(excess).collect()
    };
    let numbered: Vec<(&Vec<usize>, u32)> = blocks.iter().zip(0..).collect();
    let by_block = in_parallel(&numbered, one);
    let sums = by_block.iter().map(|block| (block.iter().map(|one| one.square_m2).sum::<f64>(), block.len() as f64));
    let sums: Vec<(f64, f64)> = sums.collect();
    let count = sums.iter().map(|(_, count)| count).sum::<f64>().max(1.0);
    let mean_m2 = sums.iter().map(|(sum, _)| sum).sum::<f64>() / count;
    let scatter: f64 = sums.iter().map(|(sum, count)| (sum - mean_m2 * count).powi(2)).sum();
    let spread = (sums.len() as f64 / (sums.len() as f64 - 1.0).max(1.0) * scatter).sqrt() / count;
    by_axis(&by_block.concat(), (mean_m2 - spread).max(0.0).sqrt())
}
