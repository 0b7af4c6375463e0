//! The verdict on a fit to a tracer campaign.
//!
//! Place in the flow: the entry point for `identify` and `diagnose`.

use super::by_station::by_station;
use super::causes::{Cause, Residuals};
use super::copies::copies;
use super::misfit::MISTAKEN;
use super::one_sided::{no_temperature, one_sided};
use super::{Counted, Finding, Grade, Verdict, equal_steps, of_noise, of_rejected, stroke};
use crate::identified::Identified;
use abbe_geometry::model::{MachineModel, ModelError};
use abbe_measurement::campaign::Campaign;

/// Readings up to which causes are looked for where nothing hangs on them; a million takes as long as the fit.
const SEARCHED: usize = 100_000;

/// Judges a fit to this campaign.
pub fn of_campaign(campaign: &Campaign, fit: &Identified) -> Verdict {
    let parts = fit.model.parts();
    let scale = fit.evidence.robust_scale.max(1.0);
    let residuals = Residuals {
        campaign,
        stations_m: parts.stations.iter().map(|station| station.position_m).collect(),
        residuals_m: &fit.residuals_m,
        u_m: fit.u_m.iter().map(|u_m| u_m * scale).collect(),
        is_rejected: fit.weights.iter().map(|weight| *weight == 0.0).collect(),
    };
    let counted = Counted { what: "readings", rejected: parts.quality.rejected, all: campaign.readings.len() };
    let rejected = match of_rejected(counted, Vec::new()) {
        Some(few) if few.grade == Grade::Message && counted.all > SEARCHED => Some(few),
        graded => graded.and_then(|_| of_rejected(counted, residuals.of_rejected())),
    };
    let degrees = fit.weights.iter().sum::<f64>() - fit.evidence.effective_unknowns;
    let noise = of_noise(fit.evidence.chi2_per_dof, degrees, Vec::new());
    let noise = noise.map(|finding| with_causes(finding, || of_misfit(&residuals, fit.evidence.chi2_per_dof)));
    let driven = stroke(&parts.machine, campaign.readings.iter().map(|reading| reading.reading_m));
    let sampled = equal_steps([true; 3], campaign.readings.iter().map(|reading| reading.reading_m));
    let too_many = rejected.as_ref().is_some_and(|finding| finding.grade == Grade::Refusal);
    let widening = if too_many { all_over_used(fit, degrees) } else { 1.0 };
    let (copied, for_copies) = copies(campaign);
    let told = [rejected, noise, copied, driven, sampled];
    let unseen = [by_station(campaign), one_sided(campaign), no_temperature(campaign)];
    Verdict::new(told.into_iter().chain(unseen).flatten().collect(), widening * for_copies)
}

fn with_causes(mut finding: Finding, causes: impl Fn() -> Vec<Cause>) -> Finding {
    finding.causes = causes();
    finding
}

fn of_misfit(residuals: &Residuals, chi2_per_dof: f64) -> Vec<Cause> {
    if chi2_per_dof < 1.0 {
        return vec![Cause::Overstated, Cause::Computed];
    }
    // A wrong offset leaves many times the noise: what is little more says nothing of offsets.
    let offsets = residuals.offsets().filter(|_| chi2_per_dof.sqrt() > MISTAKEN);
    let causes = residuals.rounded().into_iter().chain([Cause::Lacks]).chain(offsets);
    causes.chain([Cause::Understated]).collect()
}

/// χ² of all readings over that of those used: where rejected readings are no gross errors, they are data like the others,
/// and the uncertainty must hold for them too.
fn all_over_used(fit: &Identified, degrees: f64) -> f64 {
    let all: f64 = fit.residuals_m.iter().zip(&fit.u_m).map(|(residual_m, u_m)| (residual_m / u_m).powi(2)).sum();
    let rejected = fit.weights.iter().filter(|weight| **weight == 0.0).count() as f64;
    // The covariance holds at least the declared noise.
    let used = fit.evidence.chi2_per_dof.max(1.0);
    (all / (degrees + rejected).max(1.0) / used).max(1.0)
}

/// The model with every covariance times this factor: what an accepted misfit does to its uncertainty.
///
/// # Errors
/// Where the factor is no finite number.
pub fn widened(model: MachineModel, factor: f64) -> Result<MachineModel, ModelError> {
    if factor == 1.0 {
        return Ok(model);
    }
    let mut parts = model.parts().clone();
    parts.covariance.iter_mut().chain(&mut parts.chord_covariance).for_each(|value| *value *= factor);
    let quality = &mut parts.quality;
    let declared_m2 = quality.residual_rms_m.powi(2) / quality.chi2_per_dof.max(1.0);
    quality.unexplained_m =
        quality.unexplained_m.map(|u_m| (factor * u_m.powi(2) + (factor - 1.0) * declared_m2).sqrt());
    MachineModel::new(parts)
}
