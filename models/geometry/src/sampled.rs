//! Error functions of a model sampled at equal steps, as tables of controllers hold them.
//!
//! Place in the flow: a model in, values at nodes along each axis (m, rad) with what linear interpolation between them
//! misses, out; written by the exports of `nodes/files`. Error = actual − indicated, reference point as in the model: zero
//! at the lower end of each stroke, squareness as an angle (rad) that acts as angle · (reading − lower end). Effects that follow
//! the reading of one axis alone, along that axis, are part of its positioning error; beyond the readings that were identified they
//! keep the value they have at their end: a controller cannot be told that a polynomial there is worth nothing.

use crate::axis::{Axis, ErrorId};
use crate::chain::{ErrorValues, chain_point};
use crate::correct::{is_within, nearest_identified_m, undecided_m2 as of_effect_m2};
use crate::effects::{Acts, NoCovariates, State, TipColumns, tip_columns};
use crate::model::{Combination, FittedEffect, MachineModel};
use nalgebra::Vector3;
use thiserror::Error;

/// Parts into which each step is cut where table and function are compared.
const CHECKS_PER_STEP: usize = 8;
/// Places along the other axes at which an effect is compared with itself.
const SHARES: [f64; 4] = [0.0, 0.3, 0.7, 1.0];
/// Differences (m) that are rounding.
const ROUNDING_M: f64 = 1e-15;
/// Most nodes an axis may have.
const MOST_NODES: usize = 100_000;

/// The six errors of one axis at its nodes.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledAxis {
    /// The axis.
    pub axis: Axis,
    /// Readings, ascending, from the lower to the upper end of the stroke (m).
    pub positions_m: Vec<f64>,
    /// Values at each node: E_X E_Y E_Z (m), E_A E_B E_C (rad).
    pub errors: Vec<[f64; 6]>,
    /// Their standard uncertainties, k = 1.
    pub u: Vec<[f64; 6]>,
    /// What linear interpolation between the nodes misses at most (m, rad).
    pub missed: [f64; 6],
}

/// All 21 errors, and the turn of the ram.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledErrors {
    /// X, Y, Z.
    pub axes: [SampledAxis; 3],
    /// Squareness in the order of the machine: name, value and standard uncertainty (rad).
    pub squareness: Vec<(String, f64, f64)>,
    /// Turn of the ram about X, Y, Z: value and standard uncertainty (rad).
    pub ram_turn: [(f64, f64); 3],
}

/// A step that no table can have.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SampleError {
    /// Not above zero, or not finite.
    #[error("a step of {} mm is none; give one above zero", .0 * 1e3)]
    Step(f64),
    /// Too many nodes.
    #[error("a step of {} mm makes {nodes} nodes on axis {axis}; {MOST_NODES} are the most", .step_m * 1e3)]
    TooMany {
        /// Step (m).
        step_m: f64,
        /// Nodes it would make.
        nodes: f64,
        /// Letter of the axis.
        axis: char,
    },
}

impl SampledErrors {
    /// Samples a model at equal steps of at most `step_m` (m); both ends of every stroke are nodes.
    ///
    /// # Errors
    /// A step that is not above zero, or so small that a table would have too many nodes.
    pub fn of(model: &MachineModel, step_m: f64) -> Result<SampledErrors, SampleError> {
        if !(step_m.is_finite() && step_m > 0.0) {
            return Err(SampleError::Step(step_m));
        }
        let axes = [
            sampled_axis(model, Axis::X, step_m)?,
            sampled_axis(model, Axis::Y, step_m)?,
            sampled_axis(model, Axis::Z, step_m)?,
        ];
        let entries = model.parts().machine.squareness.iter().enumerate();
        let squareness = entries.map(|(k, entry)| {
            let (value, u) = model.squareness(k);
            (entry.name.clone(), value, u)
        });
        Ok(SampledErrors { axes, squareness: squareness.collect(), ram_turn: model.ram_turn() })
    }

    /// Largest miss of linear interpolation: of the linear errors (m) and of the angular ones (rad).
    pub fn missed(&self) -> (f64, f64) {
        let largest = |range: std::ops::Range<usize>| {
            self.axes.iter().flat_map(|axis| axis.missed[range.clone()].to_vec()).fold(0.0, f64::max)
        };
        (largest(0..3), largest(3..6))
    }
}

/// The six errors of an axis in the order of the tables: E_X E_Y E_Z E_A E_B E_C.
pub fn errors_of(axis: Axis) -> [ErrorId; 6] {
    [
        ErrorId::linear(Axis::X, axis),
        ErrorId::linear(Axis::Y, axis),
        ErrorId::linear(Axis::Z, axis),
        ErrorId::angular(Axis::X, axis),
        ErrorId::angular(Axis::Y, axis),
        ErrorId::angular(Axis::Z, axis),
    ]
}

/// Places of the effects of a model that are nothing but a positioning error of one axis, with that axis.
pub fn of_position(model: &MachineModel) -> Vec<(usize, Axis)> {
    let own =
        |(place, fitted)| Axis::ALL.into_iter().find(|axis| follows(model, fitted, *axis)).map(|axis| (place, axis));
    model.parts().effects.iter().enumerate().filter_map(own).collect()
}

/// Places of the effects of a model that move the tip and need nothing logged: a grid of errors holds them.
pub fn of_places(model: &MachineModel) -> Vec<usize> {
    let machine = &model.parts().machine;
    let at = |k: usize| {
        let share = |d: usize| SHARES[k / SHARES.len().pow(d as u32) % SHARES.len()];
        std::array::from_fn(|d| machine.stroke_m[d].0 + share(d) * (machine.stroke_m[d].1 - machine.stroke_m[d].0))
    };
    let offset_m = model.parts().offset_centre_m;
    let tips: Vec<Tip> = (0..SHARES.len().pow(3)).map(|k| Tip::new(model, at(k), offset_m)).collect();
    let is_motion = |columns: TipColumns| columns.iter().any(|column| *column != Vector3::zeros());
    let moves = |fitted: &FittedEffect| tips.iter().any(|tip| tip.columns(fitted).is_some_and(is_motion));
    let all = model.parts().effects.iter().enumerate();
    all.filter(|(_, fitted)| fitted.effect.reads().is_empty() && moves(fitted)).map(|(place, _)| place).collect()
}

/// What these effects do to the tip at a reading, with this offset (m); beyond the readings that were identified as at the nearest of them.
pub fn places_effects_m(
    model: &MachineModel,
    effects: &[usize],
    reading_m: [f64; 3],
    offset_m: [f64; 3],
) -> Vector3<f64> {
    let tip = Tip::new(model, nearest_identified_m(model, reading_m), offset_m);
    let moved_m = |fitted: &FittedEffect| -> Option<Vector3<f64>> {
        let columns = tip.columns(fitted)?;
        Some(columns.iter().zip(&fitted.parameters).map(|(column, value)| column * *value).sum())
    };
    effects.iter().filter_map(|place| moved_m(&model.parts().effects[*place])).sum()
}

/// A place at which effects are asked for that need nothing logged.
struct Tip {
    reading_m: [f64; 3],
    offset_m: [f64; 3],
    by_error: [Vector3<f64>; ErrorId::COUNT],
}

impl Tip {
    fn new(model: &MachineModel, reading_m: [f64; 3], offset_m: [f64; 3]) -> Tip {
        let by_error = chain_point(&model.parts().machine, reading_m, offset_m, &ErrorValues::ZERO).by_error;
        Tip { reading_m, offset_m, by_error }
    }

    /// Motion per unit of each parameter of an effect (m per unit).
    fn columns(&self, fitted: &FittedEffect) -> Option<TipColumns> {
        let state = State { reading_m: self.reading_m, offset_m: self.offset_m, covariates: &NoCovariates };
        tip_columns(fitted.effect.as_ref(), fitted.parameters.len(), &state, &self.by_error).ok()
    }
}

/// Axes whose stroke goes beyond the readings that were identified, with those (m).
pub fn beyond_identified(model: &MachineModel) -> impl Iterator<Item = (Axis, (f64, f64))> {
    let parts = model.parts();
    let beyond = |axis: &Axis| {
        let (stroke_m, identified_m) = (parts.machine.stroke_m[axis.index()], parts.identified.reading_m[axis.index()]);
        !is_within(identified_m, stroke_m.0) || !is_within(identified_m, stroke_m.1)
    };
    Axis::ALL.into_iter().filter(beyond).map(|axis| (axis, parts.identified.reading_m[axis.index()]))
}

/// Whether an effect needs nothing logged, and moves the axis along itself by the same wherever the others stand.
fn follows(model: &MachineModel, fitted: &FittedEffect, axis: Axis) -> bool {
    if !fitted.effect.reads().is_empty() {
        return false;
    }
    let at = |axis: Axis, share: f64| {
        let (lower_m, upper_m) = model.parts().machine.stroke_m[axis.index()];
        lower_m + share * (upper_m - lower_m)
    };
    SHARES.into_iter().all(|own| {
        let values = SHARES.map(|others| {
            along_m(fitted, axis, Axis::ALL.map(|other| at(other, if other == axis { own } else { others })))
        });
        values.iter().all(|value| matches!((value, values[0]), (Some(a), Some(b)) if (a - b).abs() < ROUNDING_M))
    }) && !columns(fitted, axis, lower_ends_m(model)).unwrap_or_default().is_empty()
}

fn lower_ends_m(model: &MachineModel) -> [f64; 3] {
    model.parts().machine.stroke_m.map(|(lower_m, _)| lower_m)
}

/// Readings (m) at which effects are asked for an axis at this one, the others at their lower ends: the nearest that were identified.
fn held_m(model: &MachineModel, axis: Axis, reading_m: f64) -> [f64; 3] {
    nearest_identified_m(model, at_m(model, axis, reading_m))
}

/// An axis at this reading, the others at their lower ends (m).
fn at_m(model: &MachineModel, axis: Axis, reading_m: f64) -> [f64; 3] {
    let mut place_m = lower_ends_m(model);
    place_m[axis.index()] = reading_m;
    place_m
}

/// What an effect does along an axis (m); `None` where it moves anything else.
fn along_m(fitted: &FittedEffect, axis: Axis, reading_m: [f64; 3]) -> Option<f64> {
    let columns = columns(fitted, axis, reading_m)?;
    Some(columns.iter().map(|(k, part)| part * fitted.parameters.get(*k).copied().unwrap_or(0.0)).sum())
}

/// The same per unit of each parameter.
fn columns(fitted: &FittedEffect, axis: Axis, reading_m: [f64; 3]) -> Option<Vec<(usize, f64)>> {
    let along = Acts::Error(ErrorId::linear(axis, axis));
    let state = State { reading_m, offset_m: [0.0; 3], covariates: &NoCovariates };
    let (mut columns, mut is_along) = (Vec::new(), true);
    let mut add = |k: usize, acts: Acts, part: f64| {
        // What moves the tip along the axis is its positioning error as well.
        is_along &= acts == along || acts == Acts::Tip(axis);
        columns.push((k, part));
    };
    fitted.effect.motion(&state, &mut add).ok()?;
    is_along.then_some(columns)
}

/// Value and standard uncertainty of an error of an axis at a reading, with the effects that belong to it.
fn error(model: &MachineModel, effects: &[usize], axis: Axis, id: ErrorId, reading_m: f64) -> (f64, f64) {
    let (value, u) = model.error(id, reading_m);
    if id != ErrorId::linear(axis, axis) || effects.is_empty() {
        return (value, u);
    }
    let place_m = held_m(model, axis, reading_m);
    let own_m = at_m(model, axis, reading_m);
    let (mut total, mut parameters, mut undecided_m2) = (value, Vec::new(), 0.0);
    if let Some(basis) = model.layout().basis(id) {
        let local = basis.at(reading_m);
        let first = model.layout().range(id).start + local.first;
        parameters.extend(local.values().iter().enumerate().map(|(k, value)| (first + k, *value)));
    }
    let mut first = model.layout().len();
    for (place, fitted) in model.parts().effects.iter().enumerate() {
        if effects.contains(&place) {
            let held = columns(fitted, axis, place_m).unwrap_or_default();
            total += held.into_iter().map(|(k, part)| part * fitted.parameters[k]).sum::<f64>();
            // What is not known beyond the readings grows with the distance from them.
            let own = columns(fitted, axis, own_m).unwrap_or_default();
            parameters.extend(own.into_iter().map(|(k, part)| (first + k, part)));
            let Tip { reading_m, offset_m, by_error } = Tip::new(model, place_m, [0.0; 3]);
            let at = State { reading_m, offset_m, covariates: &NoCovariates };
            undecided_m2 += of_effect_m2((model, first), fitted, &at, &by_error)[(axis.index(), axis.index())];
        }
        first += fitted.parameters.len();
    }
    let between_nodes = model.between_nodes().at(id, reading_m).into_iter().collect();
    let known_m2 = model.variance(&Combination { parameters, between_nodes }).max(0.0);
    (total, (known_m2 + undecided_m2).sqrt())
}

fn sampled_axis(model: &MachineModel, axis: Axis, step_m: f64) -> Result<SampledAxis, SampleError> {
    let (lower_m, upper_m) = model.parts().machine.stroke_m[axis.index()];
    // A step that divides the stroke up to rounding makes no further node.
    let steps = ((upper_m - lower_m) / step_m - 1e-9).ceil().max(1.0);
    if steps + 1.0 > MOST_NODES as f64 {
        return Err(SampleError::TooMany { step_m, nodes: steps + 1.0, axis: axis.letter() });
    }
    let steps = steps as usize;
    let at =
        |k: usize, of: usize| if k == of { upper_m } else { lower_m + (upper_m - lower_m) * (k as f64 / of as f64) };
    let own = of_position(model).into_iter().filter(|(_, own)| *own == axis);
    let effects: Vec<usize> = own.map(|(place, _)| place).collect();
    let values = |position_m: f64| errors_of(axis).map(|id| error(model, &effects, axis, id, position_m));
    let positions_m: Vec<f64> = (0..=steps).map(|k| at(k, steps)).collect();
    let nodes: Vec<[(f64, f64); 6]> = positions_m.iter().map(|position_m| values(*position_m)).collect();
    let mut missed = [0.0_f64; 6];
    for k in 0..steps * CHECKS_PER_STEP {
        let (cell, share) = (k / CHECKS_PER_STEP, (k % CHECKS_PER_STEP) as f64 / CHECKS_PER_STEP as f64);
        let actual = values(at(k, steps * CHECKS_PER_STEP));
        for error in 0..6 {
            let (left, right) = (nodes[cell][error].0, nodes[cell + 1][error].0);
            missed[error] = missed[error].max((left + (right - left) * share - actual[error].0).abs());
        }
    }
    Ok(SampledAxis {
        axis,
        positions_m,
        errors: nodes.iter().map(|node| node.map(|(value, _)| value)).collect(),
        u: nodes.iter().map(|node| node.map(|(_, u)| u)).collect(),
        missed,
    })
}
