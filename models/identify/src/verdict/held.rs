//! Which error functions that a machine file holds at zero the readings ask for.
//!
//! Place in the flow: after a fit that does not hold against the declared noise. Each held function is freed in turn, and the campaign
//! fitted again. What takes away much of the misfit is named, with what it leaves: whether the machine has that error, or it only stands
//! for another effect, a fit cannot tell.

use super::{Cause, Finding, Subject, Verdict};
use crate::error::IdentifyError;
use crate::options::{IdentifyOptions, Noise, Progress};
use crate::solve::identify_with;
use abbe_geometry::axis::ErrorId;
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::Machine;
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;

/// What a function is freed as: it bends as pitch errors and guideways do, and is smoothed.
const FREE: FunctionKind = FunctionKind::BSpline { intervals: 4 };
/// Mean square from which it is a misfit.
const MISFIT: f64 = 1.3;
/// Share of what is left of the misfit that one function must take away, and of all of it those that are named together.
const PART: f64 = 0.25;
const MOST: f64 = 0.5;
/// Functions that are named at most.
const NAMED: usize = 3;
/// Deviations of a reading beyond which it counts no more: gross errors are no misfit of a function.
const GROSS: f64 = 6.0;
/// Readings of a campaign that are fitted at most: a function that explains a misfit shows in a part of them.
const READINGS: usize = 4000;

/// Puts the held functions that explain a misfit before its other causes. `observe` sees each pass and returns false to stop.
///
/// # Errors
/// [`IdentifyError::Stopped`].
pub fn ask_held_functions(
    verdict: &mut Verdict,
    machine: &Machine,
    instrument: RangeUncertainty,
    campaign: &Campaign,
    options: &IdentifyOptions,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<(), IdentifyError> {
    if machine.kinds.iter().all(Option::is_some) || !verdict.findings.iter().any(is_misfit) {
        return Ok(());
    }
    let step = campaign.readings.len().div_ceil(READINGS).max(1);
    let part = campaign.part(&(0..campaign.readings.len()).step_by(step).collect::<Vec<_>>());
    let options = IdentifyOptions { noise: Noise::Given(None), ..*options };
    let mut refit = Refit { instrument, campaign: &part, options, observe };
    let Some(before) = refit.misfit(machine)? else { return Ok(()) };
    let (mut freed, mut named, mut left) = (machine.clone(), Vec::new(), before);
    while named.len() < NAMED && left > MISFIT {
        let Some(best) = refit.best_freed(&freed)?.filter(|best| left - best.misfit > PART * (left - 1.0)) else {
            break;
        };
        named.push(best.error.name());
        (left, freed) = (best.misfit, best.machine);
    }
    if before > MISFIT && before - left > MOST * (before - 1.0) {
        let cause = Cause::Held { errors: named, squares: (before, left) };
        let findings = verdict.findings.iter_mut().filter(|finding| is_misfit(finding));
        findings.for_each(|finding| finding.causes.insert(0, cause.clone()));
    }
    Ok(())
}

/// A machine with one more function free.
struct Freed {
    error: ErrorId,
    machine: Machine,
    misfit: f64,
}

/// What stays the same from fit to fit.
struct Refit<'a> {
    instrument: RangeUncertainty,
    campaign: &'a Campaign,
    options: IdentifyOptions,
    observe: &'a mut dyn FnMut(Progress) -> bool,
}

impl Refit<'_> {
    /// The held function that leaves the least misfit when it is free.
    fn best_freed(&mut self, machine: &Machine) -> Result<Option<Freed>, IdentifyError> {
        let mut best: Option<Freed> = None;
        for error in ErrorId::all().filter(|error| machine.kinds[error.index()].is_none()) {
            let mut with = machine.clone();
            with.kinds[error.index()] = Some(FREE);
            let Some(misfit) = self.misfit(&with)? else { continue };
            if best.as_ref().is_none_or(|best| misfit < best.misfit) {
                best = Some(Freed { error, machine: with, misfit });
            }
        }
        Ok(best)
    }

    /// Mean square of the normalised residuals of all readings, each counted to [`GROSS`] at most: a fit that rejects what it cannot explain
    /// has a small χ². `None` where these readings cannot determine the machine: so they say nothing of it.
    fn misfit(&mut self, machine: &Machine) -> Result<Option<f64>, IdentifyError> {
        let found = match identify_with(machine, self.instrument, self.campaign, &[], &self.options, self.observe) {
            Err(IdentifyError::Stopped) => return Err(IdentifyError::Stopped),
            Err(_) => return Ok(None),
            Ok(found) => found,
        };
        let squares = found.residuals_m.iter().zip(&found.u_m).map(|(residual_m, u_m)| (residual_m / u_m).powi(2));
        Ok(Some(squares.map(|square| square.min(GROSS * GROSS)).sum::<f64>() / found.u_m.len().max(1) as f64))
    }
}

/// Whether it may come from what the machine file lacks.
fn is_misfit(finding: &Finding) -> bool {
    match finding.subject {
        Subject::Rejected { .. } => finding.causes.contains(&Cause::Lacks),
        Subject::Noise { chi2_per_dof, .. } => chi2_per_dof > 1.0,
        Subject::Stroke { .. } | Subject::ByStation { .. } | Subject::Sampled { .. } => false,
        Subject::Copies { .. } | Subject::OneSided { .. } | Subject::NoTemperature | Subject::Wanders { .. } => false,
    }
}
