//! What a plan will reach, as identification will state it.
//!
//! Place in the flow: the last step of [`crate::plan()`]; also states what any other campaign of nominal readings would reach, to
//! compare plans. The model that comes from [`abbe_identify::foresee`] is asked through the function that corrects
//! coordinates, so that what is said here of a point is what will stand beside a corrected one. SI, k = 1.

use crate::check::wrong;
use crate::error::PlanError;
use abbe_diagnose::Foresight;
use abbe_geometry::correct::correct;
use abbe_geometry::effects::{NoCovariates, State};
use abbe_geometry::machine::Machine;
use abbe_geometry::model::{MachineModel, ModelParts};
use abbe_geometry::{ErrorId, Matrix3, Vector3};
use abbe_identify::station_start::StationStart;
use abbe_identify::{Belief, Identified, IdentifyError, IdentifyOptions, foresee};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;

/// Points of the map over the volume, along each axis.
const STEPS: usize = 7;
/// Points over which the uncertainty is averaged, and the bases of their coordinates.
const SPREAD: usize = 400;
const BASES: [usize; 3] = [2, 3, 5];
/// Places of an axis at which an error is stated.
const PLACES: usize = 33;

/// What a plan will reach.
#[derive(Debug, Clone)]
pub struct Promise {
    /// Rms over the volume of the standard uncertainty of a corrected point, as a length in space, repeatability included (m).
    pub u_m: f64,
    /// The same of the model alone: what the average of many approaches has left (m).
    pub u_model_m: f64,
    /// The same along X, Y and Z, repeatability included (m).
    pub u_axis_m: [f64; 3],
    /// The largest of a corrected point, and its reading (m).
    pub largest_m: (f64, [f64; 3]),
    /// Each of the 18 error functions over the volume.
    pub errors: Vec<ErrorPromise>,
    /// Name and uncertainty of the three squareness angles (rad).
    pub squareness: Vec<(String, f64)>,
    /// Turn of the ram about X, Y, Z (rad).
    pub ram_turn: [f64; 3],
    /// Readings on the grid and the uncertainty of their points, the largest over the tips (m), X varying fastest.
    pub map: Vec<([f64; 3], f64)>,
    /// Points of the grid along each axis.
    pub steps: usize,
    /// Readings in all.
    pub readings: usize,
    /// Unknowns of the fit.
    pub unknowns: usize,
    /// Condition of what the plan tells of the lowest orders.
    pub condition: f64,
    /// What it will tell of effects; or why that cannot be said, in words. It informs: a plan stands without it.
    pub effects: Result<Foresight, String>,
}

/// What a plan will tell of one error function.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorPromise {
    /// ISO 230-1 name.
    pub name: String,
    /// Whether it is an angle (rad), or a length (m).
    pub is_angle: bool,
    /// Rms over the axis' part of the volume.
    pub u_rms: f64,
    /// Largest there.
    pub u_largest: f64,
}

/// The machine, its instrument and what is believed of them.
#[derive(Debug, Clone, Copy)]
pub struct Known<'a> {
    /// The machine.
    pub machine: &'a Machine,
    /// Uncertainty of the tracer's range.
    pub instrument: RangeUncertainty,
    /// How it will be identified.
    pub options: &'a IdentifyOptions,
    /// How much the error functions are believed to bend.
    pub belief: &'a Belief,
    /// χ² per degree of freedom that the noise is known to have (1: as declared), and what no model explained so far (m).
    pub misfit: (f64, [f64; 3]),
}

/// What a campaign of nominal readings will reach over a volume of readings (m) at these tips (m, ram frame).
///
/// # Errors
/// What identification would refuse.
pub fn of_campaign(
    known: Known,
    (campaign, stations): (&Campaign, &[StationStart]),
    volume_m: &[(f64, f64); 3],
    tips_m: &[[f64; 3]],
) -> Result<Promise, PlanError> {
    let mut promise = of_geometry(known, (campaign, stations), volume_m, tips_m)?;
    promise.effects = of_effects(known, (campaign, stations))?;
    Ok(promise)
}

/// The same without a look at effects, which costs more than all the rest.
///
/// # Errors
/// What identification would refuse.
pub(crate) fn of_geometry(
    known: Known,
    (campaign, stations): (&Campaign, &[StationStart]),
    volume_m: &[(f64, f64); 3],
    tips_m: &[[f64; 3]],
) -> Result<Promise, PlanError> {
    let Known { machine, instrument, options, belief, .. } = known;
    let fit = foresee(machine, instrument, (campaign, stations), &[], belief, options)?;
    at(known, fit, volume_m, tips_m)
}

/// What a campaign of nominal readings will tell of effects, or why that cannot be said.
///
/// # Errors
/// What identification would refuse.
pub(crate) fn of_effects(
    known: Known,
    (campaign, stations): (&Campaign, &[StationStart]),
) -> Result<Result<Foresight, String>, PlanError> {
    let Known { machine, instrument, options, belief, .. } = known;
    let fit = foresee(machine, instrument, (campaign, stations), &[], belief, options)?;
    Ok(abbe_diagnose::foresee(machine, &fit, instrument, campaign).map_err(|error| error.to_string()))
}

/// Rms over the volume of the standard uncertainty of a corrected point, as [`Promise::u_m`].
///
/// # Errors
/// What identification would refuse.
pub(crate) fn rms_m(
    known: Known,
    (campaign, stations): (&Campaign, &[StationStart]),
    volume_m: &[(f64, f64); 3],
    tips_m: &[[f64; 3]],
) -> Result<f64, PlanError> {
    let Known { machine, instrument, options, belief, misfit } = known;
    let fit = foresee(machine, instrument, (campaign, stations), &[], belief, options)?;
    u_over(&with_misfit(fit.model, misfit)?, volume_m, tips_m)
}

/// What a foreseen fit says over a volume of readings (m) at these tips (m, ram frame).
///
/// # Errors
/// A volume outside of the machine.
fn at(known: Known, fit: Identified, volume_m: &[(f64, f64); 3], tips_m: &[[f64; 3]]) -> Result<Promise, PlanError> {
    let (readings, unknowns, condition) = (fit.residuals_m.len(), fit.evidence.unknowns, fit.evidence.condition);
    let model = with_misfit(fit.model, known.misfit)?;
    let points = points(&model, volume_m, tips_m)?;
    let repeatability = Vector3::from(known.machine.repeatability_m).map(|u| u * u);
    let mean = points.mean_m2;
    let squareness = known.machine.squareness.iter().enumerate();
    Ok(Promise {
        u_m: mean.sum().sqrt(),
        u_model_m: (mean - repeatability).sum().max(0.0).sqrt(),
        u_axis_m: [0, 1, 2].map(|d| mean[d].sqrt()),
        largest_m: points.largest,
        errors: ErrorId::all().filter_map(|id| error(&model, id, volume_m)).collect(),
        squareness: squareness.map(|(k, entry)| (entry.name.clone(), model.squareness(k).1)).collect(),
        ram_turn: model.ram_turn().map(|(_, u)| u),
        map: points.map,
        steps: STEPS,
        readings,
        unknowns,
        condition,
        effects: Err("they were not looked at".to_owned()),
    })
}

/// The model with the covariance that noise of this χ² gives, and what was left unexplained before.
fn with_misfit(model: MachineModel, (chi2_per_dof, unexplained_m): (f64, [f64; 3])) -> Result<MachineModel, PlanError> {
    let scale = chi2_per_dof.max(1.0);
    let ModelParts { covariance, chord_covariance, quality, .. } = model.parts().clone();
    let covariance = covariance.into_iter().map(|v| v * scale).collect();
    let quality = abbe_geometry::model::FitQuality { unexplained_m, ..quality };
    let parts = ModelParts { covariance, chord_covariance, quality, ..model.parts().clone() };
    Ok(MachineModel::new(parts).map_err(IdentifyError::from)?)
}

/// Rms over a volume of readings (m) and these tips (m, ram frame) of the standard uncertainty of a corrected point, in space (m): what a model
/// has reached, as [`Promise::u_m`] says what one will.
///
/// # Errors
/// A model that states no covariance there.
pub fn u_over(model: &MachineModel, volume_m: &[(f64, f64); 3], tips_m: &[[f64; 3]]) -> Result<f64, PlanError> {
    Ok(mean_variance(model, volume_m, tips_m)?.sum().sqrt())
}

/// Mean variance over a volume of readings (m) and these tips, along X, Y and Z (m²).
fn mean_variance(
    model: &MachineModel,
    volume_m: &[(f64, f64); 3],
    tips_m: &[[f64; 3]],
) -> Result<Vector3<f64>, PlanError> {
    if tips_m.is_empty() {
        return Err(wrong("tips", "there is no tip at which an uncertainty could be stated", "name one"));
    }
    let mut sum_m2 = Vector3::zeros();
    for reading_m in spread_m(volume_m, SPREAD) {
        for offset_m in tips_m {
            sum_m2 += covariance_m2(model, reading_m, *offset_m)?.diagonal();
        }
    }
    Ok(sum_m2 / (SPREAD * tips_m.len()) as f64)
}

fn covariance_m2(model: &MachineModel, reading_m: [f64; 3], offset_m: [f64; 3]) -> Result<Matrix3<f64>, PlanError> {
    let state = State { reading_m, offset_m, covariates: &NoCovariates };
    Ok(correct(model, &state).covariance_m2.ok_or(IdentifyError::Singular)?)
}

struct Points {
    /// Mean variance over the volume and the tips (m²).
    mean_m2: Vector3<f64>,
    largest: (f64, [f64; 3]),
    map: Vec<([f64; 3], f64)>,
}

fn points(model: &MachineModel, volume_m: &[(f64, f64); 3], tips_m: &[[f64; 3]]) -> Result<Points, PlanError> {
    let mean_m2 = mean_variance(model, volume_m, tips_m)?;
    let mut points = Points { mean_m2, largest: (0.0, [0.0; 3]), map: Vec::new() };
    for reading_m in grid_m(volume_m, STEPS) {
        let mut most_m = 0.0_f64;
        for offset_m in tips_m {
            most_m = most_m.max(covariance_m2(model, reading_m, *offset_m)?.trace().sqrt());
        }
        if most_m > points.largest.0 {
            points.largest = (most_m, reading_m);
        }
        points.map.push((reading_m, most_m));
    }
    Ok(points)
}

/// An even grid of readings (m), X varying fastest.
fn grid_m(volume_m: &[(f64, f64); 3], steps: usize) -> impl Iterator<Item = [f64; 3]> + '_ {
    let share = move |step: usize| step as f64 / (steps - 1) as f64;
    let place = move |k: usize| [k % steps, k / steps % steps, k / (steps * steps)].map(share);
    (0..steps * steps * steps).map(move |k| at_m(volume_m, place(k)))
}

/// Readings that fill the volume evenly (Halton's sequence; m). A grid would have the levels at which lines lie among its own,
/// where an axis is known best, and promise too much.
pub(crate) fn spread_m(volume_m: &[(f64, f64); 3], count: usize) -> impl Iterator<Item = [f64; 3]> + '_ {
    (1..=count).map(move |k| at_m(volume_m, BASES.map(|base| halton(k, base))))
}

fn at_m(volume_m: &[(f64, f64); 3], share: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|d| {
        let (low_m, high_m) = volume_m[d];
        low_m + (high_m - low_m) * share[d]
    })
}

/// The digits of a number in a base, mirrored at the point.
fn halton(mut number: usize, base: usize) -> f64 {
    let (mut value, mut digit) = (0.0, 1.0);
    while number > 0 {
        digit /= base as f64;
        value += digit * (number % base) as f64;
        number /= base;
    }
    value
}

fn error(model: &MachineModel, id: ErrorId, volume_m: &[(f64, f64); 3]) -> Option<ErrorPromise> {
    model.layout().basis(id)?;
    let (low_m, high_m) = volume_m[id.axis().index()];
    let u = |k: usize| model.error(id, low_m + (high_m - low_m) * k as f64 / (PLACES - 1) as f64).1;
    let all: Vec<f64> = (0..PLACES).map(u).collect();
    Some(ErrorPromise {
        name: id.name(),
        is_angle: id.is_angular(),
        u_rms: (all.iter().map(|u| u * u).sum::<f64>() / PLACES as f64).sqrt(),
        u_largest: all.iter().fold(0.0, |most: f64, u| most.max(*u)),
    })
}
