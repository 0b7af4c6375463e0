//! Error functions of a model sampled at equal steps, as tables of controllers hold them.
//!
//! Place in the flow: a model in, values at nodes along each axis (m, rad) with what linear interpolation between them
//! misses, out; written by the exports of `nodes/files`. Error = actual − indicated, reference point as in the model: zero
//! at the lower end of each stroke, squareness as an angle (rad) that acts as angle · (reading − lower end).

use crate::axis::{Axis, ErrorId};
use crate::model::MachineModel;
use thiserror::Error;

/// Parts into which each step is cut where table and function are compared.
const CHECKS_PER_STEP: usize = 8;
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
    let values = |position_m: f64| errors_of(axis).map(|id| model.error(id, position_m));
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
