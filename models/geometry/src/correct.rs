//! The one function that corrects a coordinate, live and offline.
//!
//! Place in the flow: the geometric node, `abbe correct`, replay and every check call [`correct`]; the residual
//! step, live and on bags, then calls [`add_residual`]. Inputs: axis readings (m), offset (m, ram frame) and
//! covariates; output: the actual position of tip or reflector in the machine frame (m) with its covariance.
//! Corrected = indicated + offset + correction, and correction = error = actual − indicated.

use crate::axis::ErrorId;
use crate::chain::{ChainPoint, nominal_point_m};
use crate::effects::{CovariateProblem, CovariateValue, Ray, State, tip_columns};
use crate::model::{Combination, IdentifiedVolume, MachineModel};
use crate::residual_field::{ResidualField, ResidualPrediction};
use nalgebra::{Matrix3, Vector3};

/// How far beyond its end a stroke may be read, as a share of its length, before the reading is rejected.
const BEYOND_STROKE: f64 = 0.25;
/// Scales and offsets within this of the identified bounds are inside (m): less than any scale resolves.
const BOUND_TOLERANCE_M: f64 = 1e-9;

/// What a corrected coordinate is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Status {
    /// Inside the identified volume and offsets; the uncertainty holds.
    InVolume,
    /// Outside the identified volume, offsets or covariates; the uncertainty is a lower bound.
    Extrapolated,
    /// An effect lacks a covariate and was left out.
    CovariateMissing,
    /// An effect's covariate is too old, and the effect was left out.
    Stale,
    /// The reading is not finite, or beyond the stroke by more than a quarter of it; nothing was corrected.
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

/// Corrects one sample with the geometric model and its effects.
pub fn correct(model: &MachineModel, state: &State) -> Correction {
    let nominal_m = nominal_point_m(state.reading_m, state.offset_m);
    if !is_plausible(model, state) {
        return rejected(nominal_m);
    }
    let parts = model.parts();
    let (chain, mut sensitivity) = geometric_point(model, state.reading_m, state.offset_m);
    let point_m = chain.position_m;
    let (effects_m, problem) = add_effects(model, state, &chain, &mut sensitivity);
    let repeatability = Vector3::from(parts.machine.repeatability_m).map(|r| r * r);
    Correction {
        geometric_m: point_m - nominal_m,
        effects_m,
        position_m: point_m + effects_m,
        covariance_m2: Some(sensitivity.covariance_m2(model) + Matrix3::from_diagonal(&repeatability)),
        status: problem.unwrap_or_else(|| volume_status(&parts.identified, state)),
    }
}

/// Length that a tracer on an identified station should read when tip or reflector is at `position_m` (the
/// corrected position of this reading and offset, of covariance `covariance_m2`), and its standard uncertainty without the
/// instrument's (m, k = 1).
///
/// The station comes from the same fit as the errors; their correlation is taken into account. What the position has beyond
/// the errors (repeatability, effects, a residual field) is taken as independent of the station. `None` for a station the
/// model does not know.
pub fn predicted_length_m(
    model: &MachineModel,
    reading_m: [f64; 3],
    offset_m: [f64; 3],
    position_m: &Vector3<f64>,
    covariance_m2: &Matrix3<f64>,
    station: &str,
) -> Option<(f64, f64)> {
    let (first, station) = model.station(station)?;
    let Ray { direction, range_m } = Ray::between(&station.position_m, position_m);
    let (_, sensitivity) = geometric_point(model, reading_m, offset_m);
    let mut length = sensitivity.along(&direction);
    let beyond_m2 = (direction.dot(&(covariance_m2 * direction)) - model.variance(&length)).max(0.0);
    let of_station = direction.iter().map(|u| -u).chain([-1.0]);
    length.parameters.extend(of_station.enumerate().map(|(d, value)| (first + d, value)));
    let variance_m2 = model.variance(&length).max(0.0) + beyond_m2;
    Some((range_m - station.dead_path_m, variance_m2.sqrt()))
}

/// Position and partials from the chain (m), and the position's sensitivity to every geometric parameter.
fn geometric_point(model: &MachineModel, reading_m: [f64; 3], offset_m: [f64; 3]) -> (ChainPoint, Sensitivity) {
    let parts = model.parts();
    let point = model.layout().point(&parts.machine, &parts.coefficients, reading_m, offset_m);
    let mut sensitivity = Sensitivity::default();
    model.layout().visit_errors(&point, |first, partial, values| {
        values.iter().enumerate().for_each(|(k, value)| sensitivity.push(first + k, partial * *value));
    });
    let squareness = model.layout().squareness();
    squareness.zip(&point.chain.by_squareness).for_each(|(index, column)| sensitivity.push(index, *column));
    if !model.between_nodes().is_empty() {
        sensitivity.between_nodes = departures(model, &point.chain, reading_m);
    }
    (point.chain, sensitivity)
}

/// Sensitivities of the position to what straight lines between nodes miss: index and column.
fn departures(model: &MachineModel, chain: &ChainPoint, reading_m: [f64; 3]) -> Vec<(usize, Vector3<f64>)> {
    let of = |id: ErrorId| {
        let (index, shape) = model.between_nodes().at(id, reading_m[id.axis().index()])?;
        Some((index, chain.by_error[id.index()] * shape))
    };
    ErrorId::all().filter_map(of).collect()
}

/// Corrected position (m) and its sensitivity to every parameter of geometry and effects; effects whose covariate is
/// missing are left out.
pub(crate) fn sensitive_point(model: &MachineModel, state: &State) -> (Vector3<f64>, Sensitivity) {
    let (chain, mut sensitivity) = geometric_point(model, state.reading_m, state.offset_m);
    let (effects_m, _) = add_effects(model, state, &chain, &mut sensitivity);
    (chain.position_m + effects_m, sensitivity)
}

/// Adds what a residual field says at a corrected point: moves the point, widens its covariance; gives what it said.
pub fn add_residual(
    position_m: &mut Vector3<f64>,
    covariance_m2: &mut Matrix3<f64>,
    field: &dyn ResidualField,
) -> ResidualPrediction {
    let prediction = field.predict(position_m);
    *position_m += prediction.residual_m;
    *covariance_m2 += prediction.covariance_m2;
    prediction
}

/// Sensitivities of the position by parameter: index and column.
#[derive(Default)]
pub(crate) struct Sensitivity {
    entries: Vec<(usize, Vector3<f64>)>,
    /// The same for departures between nodes.
    between_nodes: Vec<(usize, Vector3<f64>)>,
}

impl Sensitivity {
    fn push(&mut self, index: usize, column: Vector3<f64>) {
        self.entries.push((index, column));
    }

    /// Sensitivity of the position's component in a direction.
    pub(crate) fn along(&self, direction: &Vector3<f64>) -> Combination {
        let along = |entries: &[(usize, Vector3<f64>)]| {
            entries.iter().map(|(index, column)| (*index, direction.dot(column))).collect()
        };
        Combination { parameters: along(&self.entries), between_nodes: along(&self.between_nodes) }
    }

    /// J V Jᵀ (m²), and what straight lines between nodes miss.
    fn covariance_m2(&self, model: &MachineModel) -> Matrix3<f64> {
        let mut total = Matrix3::zeros();
        for (row, a) in &self.entries {
            let variances = model.machine_covariance_row(*row);
            let weighted: Vector3<f64> = self.entries.iter().map(|(column, b)| b * variances[*column]).sum();
            total += a * weighted.transpose();
        }
        for (index, column) in &self.between_nodes {
            total += column * column.transpose() * model.between_nodes().variance(*index);
        }
        (total + total.transpose()) * 0.5
    }
}

fn add_effects(
    model: &MachineModel,
    state: &State,
    chain: &ChainPoint,
    sensitivity: &mut Sensitivity,
) -> (Vector3<f64>, Option<Status>) {
    let mut tip_m = Vector3::zeros();
    let mut status = None;
    let mut index = model.layout().len();
    for fitted in &model.parts().effects {
        match tip_columns(fitted.effect.as_ref(), fitted.parameters.len(), state, &chain.by_error) {
            Ok(columns) => {
                for (k, (column, value)) in columns.iter().zip(&fitted.parameters).enumerate() {
                    tip_m += column * *value;
                    sensitivity.push(index + k, *column);
                }
            }
            Err(CovariateProblem::Missing(_)) => status = status.max(Some(Status::CovariateMissing)),
            Err(CovariateProblem::Stale(_)) => status = status.max(Some(Status::Stale)),
        }
        index += fitted.parameters.len();
    }
    (tip_m, status)
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
    let finite = state.reading_m.iter().chain(&state.offset_m).all(|v| v.is_finite());
    finite
        && model.parts().machine.stroke_m.iter().zip(state.reading_m).all(|((lower, upper), reading)| {
            let beyond = (upper - lower) * BEYOND_STROKE;
            (lower - beyond..=upper + beyond).contains(&reading)
        })
}

fn volume_status(identified: &IdentifiedVolume, state: &State) -> Status {
    let within = |bounds: &[(f64, f64); 3], values: [f64; 3]| {
        let inside = |(b, v): (&(f64, f64), f64)| v >= b.0 - BOUND_TOLERANCE_M && v <= b.1 + BOUND_TOLERANCE_M;
        bounds.iter().zip(values).all(inside)
    };
    // A covariate that cannot be read has its own status, which stands above this one.
    let known = |(name, (low, high)): (&String, &(f64, f64))| match state.covariates.covariate(name) {
        CovariateValue::Fresh(value) => (*low..=*high).contains(&value),
        CovariateValue::Stale | CovariateValue::Missing => true,
    };
    let usual = identified.covariates.iter().all(known);
    if usual && within(&identified.reading_m, state.reading_m) && within(&identified.offset_m, state.offset_m) {
        Status::InVolume
    } else {
        Status::Extrapolated
    }
}
