//! The one function that corrects a coordinate, live and offline.
//!
//! Place in the flow: the geometric node, `abbe correct`, replay and every check call [`correct`]; the residual
//! step, live and on bags, then calls [`add_residual`]. Inputs: axis readings (m), offset (m, ram frame) and
//! covariates; output: the actual position of tip or reflector in the machine frame (m) with its covariance.
//! Corrected = indicated + offset + correction, and correction = error = actual − indicated.

use crate::axis::ErrorId;
use crate::chain::{ChainPoint, nominal_point_m};
use crate::doubt::{self, Open, is_outside, is_outside_or_none};
use crate::effects::{CovariateProblem, CovariateSource, State, TipColumns, tip_columns};
use crate::model::{FittedEffect, MachineModel};
use crate::residual_field::{ResidualField, ResidualPrediction};
use crate::sensitivity::Sensitivity;
use nalgebra::{Matrix3, Vector3};

/// How far beyond its end a stroke may be read, as a share of its length, before the reading is rejected.
const BEYOND_STROKE: f64 = 0.25;
/// How far beyond the identified offsets an offset may lie, at least (m), and as far as the longest stroke: a holder or
/// stylus is no longer than that, and one given in millimetres instead of metres is.
const BEYOND_OFFSETS_M: f64 = 1.0;
/// What an effect may add beyond the range that it was identified in, at least (m), and as a share of the longest stroke.
/// Machines err by micrometres to tenths of a millimetre; a law that adds more where nobody has seen it was given a reading
/// of a broken sensor, or has run away.
const BEYOND_RANGE_M: f64 = 100e-6;
const BEYOND_RANGE: f64 = 1e-3;
/// What a correction may be at most, as a share of the longest stroke and the offset: a machine that errs by a tenth of its
/// size is none, and its model is damaged.
const MOST_CORRECTION: f64 = 0.1;
/// Share of its trace by which rounding may leave a covariance below zero.
const ROUNDING: f64 = 1e-9;
/// Scales and offsets within this of the identified bounds are inside (m): less than any scale resolves.
const BOUND_TOLERANCE_M: f64 = 1e-9;

/// What a corrected coordinate is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Status {
    /// Inside the identified volume and offsets; the uncertainty holds.
    InVolume,
    /// Outside the identified volume, offsets or covariates; the uncertainty is a lower bound. An effect outside the range
    /// of its covariates widens it by all that it adds there. So is one whose covariates were never seen together so
    /// ([`crate::seen`]).
    Extrapolated,
    /// An effect lacks a covariate and was taken with that in the middle of its usual range; the uncertainty holds all that it does over
    /// the range.
    CovariateMissing,
    /// An effect's covariate is too old, which counts as missing.
    Stale,
    /// Nothing was corrected: a reading or offset is not finite or implausibly far (beyond the stroke by a quarter of it), an
    /// effect that lacks a covariate has no known bound, an effect adds an implausible amount beyond the range of its covariates, or the
    /// result is no number or no correction of a machine of that size.
    Rejected,
}

/// A corrected coordinate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correction {
    /// Rigid-body error at tip or reflector (m, machine frame).
    pub geometric_m: Vector3<f64>,
    /// What the effects add (m).
    pub effects_m: Vector3<f64>,
    /// Actual position of tip or reflector (m, machine frame); the indicated one when rejected.
    pub position_m: Vector3<f64>,
    /// Covariance of the position (m²); `None` when rejected.
    pub covariance_m2: Option<Matrix3<f64>>,
    /// What it is worth.
    pub status: Status,
}

impl Correction {
    /// The same sample rejected: what had been added is taken off again, to rounding.
    pub fn rejected(self) -> Correction {
        rejected(self.position_m - self.geometric_m - self.effects_m)
    }
}

/// Corrects one sample with the geometric model and its effects.
///
/// A sample is corrected with finite coordinates and a covariance that is one, or rejected.
pub fn correct(model: &MachineModel, state: &State) -> Correction {
    let rejected = || rejected(nominal_point_m(state.reading_m, state.offset_m));
    corrected(model, state, &mut Sensitivity::default()).unwrap_or_else(rejected)
}

/// What the corrected position depends on: for X, Y and Z the parameters of geometry and effects, by their place in the covariance,
/// and m per unit of each, with covariates that an effect lacks in the middle of their ranges. `None` where [`correct`] rejects the sample.
pub fn partials(model: &MachineModel, state: &State) -> Option<[Vec<(usize, f64)>; 3]> {
    let mut sensitivity = Sensitivity::default();
    corrected(model, state, &mut sensitivity)?;
    Some([Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| sensitivity.along(&axis).parameters.to_vec()))
}

/// A corrected sample; fills in the sensitivity of its position to every parameter of geometry and effects. `None` where [`correct`]
/// rejects it.
pub(crate) fn corrected(model: &MachineModel, state: &State, sensitivity: &mut Sensitivity) -> Option<Correction> {
    if !is_plausible(model, state) {
        return None;
    }
    let unread_outside = is_outside_or_none(model.unread(), state)?;
    let nominal_m = nominal_point_m(state.reading_m, state.offset_m);
    let chain = geometric_point(model, state.reading_m, state.offset_m, sensitivity);
    let point_m = chain.position_m;
    let effects = add_effects(model, state, &chain, sensitivity)?;
    let repeatability = Vector3::from(model.parts().machine.repeatability_m).map(|r| r * r);
    let position_m = point_m + effects.tip_m;
    let beyond_fit = model.unexplained_m2(state) + model.unseen_m2(state);
    let scatter = Matrix3::from_diagonal(&(repeatability + beyond_fit));
    let covariance_m2 = sensitivity.covariance_m2(model) + effects.doubt_m2 + scatter;
    let status = if effects.outside || unread_outside || !is_in_volume(model, state) {
        Status::Extrapolated
    } else {
        Status::InVolume
    };
    let most_m = MOST_CORRECTION * (longest_stroke_m(model) + Vector3::from(state.offset_m).norm());
    let sound = is_sound(&position_m, &covariance_m2) && (position_m - nominal_m).norm() <= most_m;
    let correction = Correction {
        geometric_m: point_m - nominal_m,
        effects_m: effects.tip_m,
        position_m,
        covariance_m2: Some(covariance_m2),
        status: effects.lacks.unwrap_or(status),
    };
    sound.then_some(correction)
}

/// Position and partials from the chain (m); adds the position's sensitivity to every geometric parameter.
pub(crate) fn geometric_point(
    model: &MachineModel,
    reading_m: [f64; 3],
    offset_m: [f64; 3],
    sensitivity: &mut Sensitivity,
) -> ChainPoint {
    let parts = model.parts();
    let point = model.layout().point(&parts.machine, &parts.coefficients, reading_m, offset_m);
    model.layout().visit_errors(&point, |first, partial, values| sensitivity.push_function(first, *partial, values));
    let squareness = model.layout().squareness();
    squareness.zip(&point.chain.by_squareness).for_each(|(index, column)| sensitivity.push(index, *column));
    let ram_turn = model.layout().ram_turn();
    ram_turn.zip(&point.by_ram_turn).for_each(|(index, column)| sensitivity.push(index, *column));
    if !model.between_nodes().is_empty() {
        add_departures(model, &point.chain, reading_m, sensitivity);
    }
    point.chain
}

/// Sensitivities of the position to what straight lines between nodes miss.
fn add_departures(model: &MachineModel, chain: &ChainPoint, reading_m: [f64; 3], sensitivity: &mut Sensitivity) {
    for id in ErrorId::all() {
        if let Some((index, shape)) = model.between_nodes().at(id, reading_m[id.axis().index()]) {
            sensitivity.push_departure(index, chain.by_error[id.index()] * shape);
        }
    }
}

/// What a residual field did to a sample.
#[derive(Debug, Clone, PartialEq)]
pub enum Added {
    /// It added this.
    Residual(ResidualPrediction),
    /// Nothing: a covariate cannot be used. The covariance holds what the field does wherever it was measured.
    LeftOut(CovariateProblem),
}

impl Added {
    /// What was added (m).
    pub fn residual_m(&self) -> Vector3<f64> {
        match self {
            Added::Residual(prediction) => prediction.residual_m,
            Added::LeftOut(_) => Vector3::zeros(),
        }
    }

    /// What the sample is worth by it.
    pub fn status(&self) -> Status {
        match self {
            Added::Residual(prediction) if prediction.inside => Status::InVolume,
            Added::Residual(_) => Status::Extrapolated,
            Added::LeftOut(CovariateProblem::Missing(_)) => Status::CovariateMissing,
            Added::LeftOut(CovariateProblem::Stale(_)) => Status::Stale,
        }
    }
}

/// Adds what a residual field says at a corrected point: moves the point, widens its covariance; gives what it did.
/// `None`, and everything as it was, where that is no number or no covariance: such a sample is to be rejected.
pub fn add_residual(
    position_m: &mut Vector3<f64>,
    covariance_m2: &mut Matrix3<f64>,
    field: &dyn ResidualField,
    covariates: &dyn CovariateSource,
) -> Option<Added> {
    let added = field.predict(position_m, covariates).map_or_else(Added::LeftOut, Added::Residual);
    let (residual_m, residual_m2) = match &added {
        Added::Residual(prediction) => (prediction.residual_m, prediction.covariance_m2),
        Added::LeftOut(_) => (Vector3::zeros(), field.unknown_m2()),
    };
    let (moved_m, widened_m2) = (*position_m + residual_m, *covariance_m2 + residual_m2);
    if !is_sound(&residual_m, &residual_m2) || !is_sound(&moved_m, &widened_m2) {
        return None;
    }
    (*position_m, *covariance_m2) = (moved_m, widened_m2);
    Some(added)
}

/// Whether a position is a number and its covariance one: finite, and not below zero beyond rounding.
fn is_sound(position_m: &Vector3<f64>, covariance_m2: &Matrix3<f64>) -> bool {
    let finite = position_m.iter().chain(covariance_m2.iter()).all(|value| value.is_finite());
    let slack = ROUNDING * covariance_m2.trace() + f64::MIN_POSITIVE;
    finite && (covariance_m2 + Matrix3::identity() * slack).cholesky().is_some()
}

/// What the effects do to one sample.
struct Effects {
    tip_m: Vector3<f64>,
    /// What is not known of effects that lack a covariate or stand outside their ranges.
    doubt_m2: Matrix3<f64>,
    /// What is the matter with a covariate that an effect lacks, if one does.
    lacks: Option<Status>,
    /// Whether one stands outside the range of its covariates.
    outside: bool,
}

/// Adds the sensitivities to the effects' parameters; `None` where an effect is implausible or cannot be bounded.
fn add_effects(
    model: &MachineModel,
    state: &State,
    chain: &ChainPoint,
    sensitivity: &mut Sensitivity,
) -> Option<Effects> {
    let mut all = Effects { tip_m: Vector3::zeros(), doubt_m2: Matrix3::zeros(), lacks: None, outside: false };
    let mut first = model.layout().len();
    for (k, fitted) in model.parts().effects.iter().enumerate() {
        let own = OfEffect { model, k, first, fitted, by_error: &chain.by_error };
        match own.columns(state) {
            Ok(columns) => own.add(&mut all, state, &columns, sensitivity)?,
            Err(problem) => {
                if fitted.corrects() {
                    all.lacks = all.lacks.max(Some(match problem {
                        CovariateProblem::Missing(_) => Status::CovariateMissing,
                        CovariateProblem::Stale(_) => Status::Stale,
                    }));
                }
                let open = Open::new(model.usual_on_tip(k), state)?;
                let middle = open.middle();
                let middle = State { covariates: &middle, ..*state };
                let columns = own.columns(&middle).ok()?;
                own.add(&mut all, &middle, &columns, sensitivity)?;
                let beside = |state: &State| -> Option<TipColumns> {
                    let own = own.columns(state).ok()?;
                    Some(own.iter().zip(&columns).map(|(own, middle)| own - middle).collect())
                };
                let moved = |state: &State| Some(moved_m(fitted, &beside(state)?));
                all.doubt_m2 += open.doubt_m2(moved, |state| Some(own.covariance_m2(beside(state)?)))?;
            }
        }
        first += fitted.parameters.len();
    }
    Some(all)
}

/// One effect of a model at one sample.
struct OfEffect<'a> {
    model: &'a MachineModel,
    /// Its place among the effects, and that of its first parameter.
    k: usize,
    first: usize,
    fitted: &'a FittedEffect,
    by_error: &'a [Vector3<f64>; ErrorId::COUNT],
}

impl OfEffect<'_> {
    fn columns(&self, state: &State) -> Result<TipColumns, CovariateProblem> {
        tip_columns(self.fitted.effect.as_ref(), self.fitted.parameters.len(), state, self.by_error)
    }

    /// Covariance of what these columns do (m²).
    fn covariance_m2(&self, columns: TipColumns) -> Matrix3<f64> {
        let mut own = Sensitivity::default();
        columns.into_iter().enumerate().for_each(|(j, column)| own.push(self.first + j, column));
        own.covariance_m2(self.model)
    }

    /// Adds what it does in a state that has all that it reads; `None` where that is implausible.
    fn add(&self, all: &mut Effects, state: &State, columns: &TipColumns, sensitivity: &mut Sensitivity) -> Option<()> {
        let motion = |state: &State| Some(moved_m(self.fitted, &self.columns(state).ok()?));
        let here_m = moved_m(self.fitted, columns);
        all.tip_m += here_m;
        columns.iter().enumerate().for_each(|(j, column)| sensitivity.push(self.first + j, *column));
        all.doubt_m2 += undecided_m2((self.model, self.first), self.fitted, state, self.by_error);
        let usual = self.model.usual_on_tip(self.k);
        if is_outside(usual, state) {
            let (added_m, doubt_m2) = doubt::outside(usual, state, motion)?;
            all.outside = true;
            all.doubt_m2 += doubt_m2;
            (added_m.norm() <= most_beyond_m(self.model)).then_some(())?;
        }
        let (doubt_m2, is_apart) = doubt::apart(self.model.apart(self.k), state, motion)?;
        all.outside |= is_apart;
        all.doubt_m2 += doubt_m2;
        let inside_m = nearest_identified_m(self.model, state.reading_m);
        if inside_m != state.reading_m {
            // Effects are polynomials of the readings, which run away where the chain goes on as a straight line.
            let added_m = here_m - motion(&State { reading_m: inside_m, ..*state })?;
            all.doubt_m2 += added_m * added_m.transpose();
            (added_m.norm() <= most_beyond_m(self.model)).then_some(())?;
        }
        Some(())
    }
}

/// Covariance of the tip (m²) by what the shape of an effect leaves open in this state; `first` is the place of its first parameter.
pub(crate) fn undecided_m2(
    (model, first): (&MachineModel, usize),
    fitted: &FittedEffect,
    state: &State,
    by_error: &[Vector3<f64>; ErrorId::COUNT],
) -> Matrix3<f64> {
    let mut total_m2 = Matrix3::zeros();
    fitted.effect.undecided(state, &mut |j, acts, amount| {
        let column = acts.on_tip(by_error) * amount;
        // The expectation of the square: of what is there with some probability only, too (`crate::mixture`).
        let square = fitted.parameters[j].powi(2) + model.covariance(first + j, first + j);
        total_m2 += column * column.transpose() * square;
    });
    total_m2
}

/// The identified readings (m) that are nearest to these.
pub fn nearest_identified_m(model: &MachineModel, reading_m: [f64; 3]) -> [f64; 3] {
    let bounds = &model.parts().identified.reading_m;
    // Not clamp, which ends the program where a damaged model has its bounds the wrong way round.
    std::array::from_fn(|d| reading_m[d].max(bounds[d].0).min(bounds[d].1))
}

/// Motion of the tip by an effect with its fitted parameters (m).
fn moved_m(fitted: &FittedEffect, columns: &[Vector3<f64>]) -> Vector3<f64> {
    columns.iter().zip(&fitted.parameters).map(|(column, value)| column * *value).sum()
}

fn most_beyond_m(model: &MachineModel) -> f64 {
    (longest_stroke_m(model) * BEYOND_RANGE).max(BEYOND_RANGE_M)
}

fn longest_stroke_m(model: &MachineModel) -> f64 {
    model.parts().machine.travel_m().into_iter().fold(0.0, f64::max)
}

fn rejected(nominal_m: Vector3<f64>) -> Correction {
    Correction {
        geometric_m: Vector3::zeros(),
        effects_m: Vector3::zeros(),
        position_m: nominal_m,
        covariance_m2: None,
        status: Status::Rejected,
    }
}

fn is_plausible(model: &MachineModel, state: &State) -> bool {
    let parts = model.parts();
    let finite = state.reading_m.iter().chain(&state.offset_m).all(|v| v.is_finite());
    let within = |(value, ((lower, upper), beyond)): (f64, ((f64, f64), f64))| {
        (lower - beyond..=upper + beyond).contains(&value)
    };
    let strokes = parts.machine.stroke_m.map(|(lower, upper)| ((lower, upper), (upper - lower) * BEYOND_STROKE));
    let beyond_m = longest_stroke_m(model).max(BEYOND_OFFSETS_M);
    let offsets = parts.identified.offset_m.map(|bounds| (bounds, beyond_m));
    finite
        && state.reading_m.into_iter().zip(strokes).all(within)
        && state.offset_m.into_iter().zip(offsets).all(within)
}

/// Whether a reading or an offset (m) lies between these bounds, but for rounding.
pub fn is_within((lower_m, upper_m): (f64, f64), value_m: f64) -> bool {
    value_m >= lower_m - BOUND_TOLERANCE_M && value_m <= upper_m + BOUND_TOLERANCE_M
}

fn is_in_volume(model: &MachineModel, state: &State) -> bool {
    let within = |bounds: &[(f64, f64); 3], values: [f64; 3]| bounds.iter().zip(values).all(|(b, v)| is_within(*b, v));
    let identified = &model.parts().identified;
    within(&identified.reading_m, state.reading_m) && within(&identified.offset_m, state.offset_m)
}

#[cfg(test)]
pub(crate) mod tests;
