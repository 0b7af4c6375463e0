//! Volumetric error of a model: as a map over the working volume, and as positioning along lines and body diagonals.
//!
//! Place in the flow: `abbe volumetric` and the comparison with an interferometer. Inputs SI, machine frame; error =
//! actual − indicated. The map is [`crate::correct::correct`] on a grid (FYXZ paper, eq. 1 and 3, fig. 5). Along a line from
//! p₀ the deviation at p is ‖q(p) − q(p₀)‖ − ‖p − p₀‖, what an interferometer that is set to zero at p₀ reads minus the
//! target (ISO 230-2; ISO 230-6 on diagonals), with the covariance of the same fit at both ends.

use crate::axis::Axis;
use crate::chain::{ErrorValues, chain_point};
use crate::correct::{Status, correct, corrected, undecided_m2};
use crate::effects::{NoCovariates, State};
use crate::model::MachineModel;
use crate::sensitivity::Sensitivity;
use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

/// Most grid points a map may have.
const LARGEST_MAP: usize = 10_000_000;

/// One point of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapPoint {
    /// Axis readings (m).
    pub reading_m: [f64; 3],
    /// Actual minus indicated position of tip or reflector (m, machine frame).
    pub error_m: Vector3<f64>,
    /// Its covariance (m²), repeatability included.
    pub covariance_m2: Matrix3<f64>,
    /// What it is worth.
    pub status: Status,
}

/// One target on a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinePoint {
    /// Axis readings (m).
    pub reading_m: [f64; 3],
    /// Nominal distance from the first target (m).
    pub distance_m: f64,
    /// Actual minus nominal distance (m).
    pub deviation_m: f64,
    /// Standard uncertainty of the model's deviation (m, k = 1); a single approach also has the repeatability.
    pub u_m: f64,
    /// What it is worth: the lesser of this target and of the first, to which it refers.
    pub status: Status,
}

/// A body diagonal, named by the sign of the motion of X, Y and Z.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Diagonal {
    positive: [bool; 3],
}

/// What cannot be evaluated.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum VolumetricError {
    /// Too few or too many grid points.
    #[error("{0} grid points were asked for; give 2 or more a direction, {LARGEST_MAP} in all at most")]
    Grid(usize),
    /// A line without length or with fewer than two targets.
    #[error("a line needs two targets or more, and two ends that are not the same")]
    Line,
    /// An offset or end that is not finite, or beyond the machine.
    #[error("the readings {reading_mm:?} mm with offset {offset_mm:?} mm are not a place in this machine")]
    Outside {
        /// Readings (mm).
        reading_mm: [f64; 3],
        /// Offset (mm).
        offset_mm: [f64; 3],
    },
}

impl Diagonal {
    /// The four of ISO 230-6 as the FYXZ paper names them: NPP, NPN, PPN, PPP.
    pub const ALL: [Diagonal; 4] = [
        Diagonal { positive: [false, true, true] },
        Diagonal { positive: [false, true, false] },
        Diagonal { positive: [true, true, false] },
        Diagonal { positive: [true, true, true] },
    ];

    /// The diagonal of that name: a P or an N for X, Y and Z; all eight ways are accepted.
    pub fn from_name(name: &str) -> Option<Diagonal> {
        let signs: Vec<bool> = name
            .chars()
            .map(|c| match c {
                'P' => Some(true),
                'N' => Some(false),
                _ => None,
            })
            .collect::<Option<_>>()?;
        Some(Diagonal { positive: signs.try_into().ok()? })
    }

    /// Name such as `NPP`.
    pub fn name(self) -> String {
        self.positive.map(|positive| if positive { 'P' } else { 'N' }).iter().collect()
    }

    /// First and last readings (m) in these bounds.
    pub fn ends_m(self, bounds_m: &[(f64, f64); 3]) -> [[f64; 3]; 2] {
        let end = |last: bool| {
            Axis::ALL.map(|axis| {
                let (lower_m, upper_m) = bounds_m[axis.index()];
                if self.positive[axis.index()] == last { upper_m } else { lower_m }
            })
        };
        [end(false), end(true)]
    }
}

/// Errors on an even grid over these bounds (m), X varying fastest.
///
/// # Errors
/// Fewer than two points a direction, or a place outside the machine.
pub fn error_map(
    model: &MachineModel,
    bounds_m: &[(f64, f64); 3],
    steps: [usize; 3],
    offset_m: [f64; 3],
) -> Result<Vec<MapPoint>, VolumetricError> {
    let count = steps.iter().fold(1_usize, |total, step| total.saturating_mul(*step));
    if steps.iter().any(|step| *step < 2) || count > LARGEST_MAP {
        return Err(VolumetricError::Grid(count));
    }
    let at = |axis: usize, step: usize| {
        let (lower_m, upper_m) = bounds_m[axis];
        lower_m + (upper_m - lower_m) * step as f64 / (steps[axis] - 1) as f64
    };
    let place = |k: usize| [at(0, k % steps[0]), at(1, k / steps[0] % steps[1]), at(2, k / (steps[0] * steps[1]))];
    (0..count).map(|k| map_point(model, place(k), offset_m)).collect()
}

fn map_point(model: &MachineModel, reading_m: [f64; 3], offset_m: [f64; 3]) -> Result<MapPoint, VolumetricError> {
    let correction = correct(model, &State { reading_m, offset_m, covariates: &NoCovariates });
    let covariance_m2 = correction.covariance_m2.ok_or_else(|| outside(reading_m, offset_m))?;
    let error_m = correction.geometric_m + correction.effects_m;
    Ok(MapPoint { reading_m, error_m, covariance_m2, status: correction.status })
}

/// Deviations at evenly spaced targets on a straight line of readings (m).
///
/// # Errors
/// A line without length, or a place outside the machine.
pub fn along_line(
    model: &MachineModel,
    [from_m, to_m]: [[f64; 3]; 2],
    targets: usize,
    offset_m: [f64; 3],
) -> Result<Vec<LinePoint>, VolumetricError> {
    let span_m = Vector3::from(to_m) - Vector3::from(from_m);
    let length_m = span_m.norm();
    if targets < 2 || length_m == 0.0 {
        return Err(VolumetricError::Line);
    }
    let fractions = (0..targets).map(|k| k as f64 / (targets - 1) as f64);
    at_distances(model, [from_m, to_m], &fractions.map(|f| f * length_m).collect::<Vec<_>>(), offset_m)
}

/// Deviations at these distances (m) from the first end of a line, which is where the instrument was set to zero.
///
/// # Errors
/// A line without length, or a place outside the machine.
pub fn at_distances(
    model: &MachineModel,
    [from_m, to_m]: [[f64; 3]; 2],
    distances_m: &[f64],
    offset_m: [f64; 3],
) -> Result<Vec<LinePoint>, VolumetricError> {
    let span_m = Vector3::from(to_m) - Vector3::from(from_m);
    let length_m = span_m.norm();
    if !(length_m > 0.0 && length_m.is_finite()) {
        return Err(VolumetricError::Line);
    }
    let direction = span_m / length_m;
    let point = |reading_m: [f64; 3]| {
        let state = State { reading_m, offset_m, covariates: &NoCovariates };
        let mut sensitivity = Sensitivity::default();
        let correction = corrected(model, &state, &mut sensitivity).ok_or_else(|| outside(reading_m, offset_m))?;
        let undecided_m2 = direction.dot(&(undecided_at_m2(model, &state) * direction));
        Ok((correction.position_m, sensitivity, undecided_m2, correction.status))
    };
    let (first_m, first, first_undecided_m2, first_status) = point(from_m)?;
    let target = |distance_m: &f64| {
        let reading_m: [f64; 3] = (Vector3::from(from_m) + direction * *distance_m).into();
        let (actual_m, sensitivity, undecided_m2, own_status) = point(reading_m)?;
        let moved_m = actual_m - first_m;
        // Small minus small instead of length minus length: ‖n + e‖ − ‖n‖ = (2 n·e + e·e)/(‖n + e‖ + ‖n‖).
        let (nominal_m, distance_m) = (direction * *distance_m, *distance_m);
        let error_m = moved_m - nominal_m;
        let lengths_m = moved_m.norm() + distance_m.abs();
        let deviation_m = if lengths_m > 0.0 {
            distance_m.signum() * error_m.dot(&(nominal_m * 2.0 + error_m)) / lengths_m
        } else {
            0.0
        };
        let difference = sensitivity.along(&direction).minus(first.along(&direction));
        // What is undecided at one end may be decided at the other; at the same place it is the same.
        let undecided_m2 = if reading_m == from_m { 0.0 } else { first_undecided_m2 + undecided_m2 };
        let u_m = (model.variance(&difference).max(0.0) + undecided_m2).sqrt();
        let status = first_status.max(own_status);
        Ok(LinePoint { reading_m, distance_m, deviation_m, u_m, status })
    };
    distances_m.iter().map(target).collect()
}

/// Covariance of the tip (m²) by what the shapes of all effects leave open.
fn undecided_at_m2(model: &MachineModel, state: &State) -> Matrix3<f64> {
    let machine = &model.parts().machine;
    let by_error = chain_point(machine, state.reading_m, state.offset_m, &ErrorValues::ZERO).by_error;
    let mut first = model.layout().len();
    let mut total_m2 = Matrix3::zeros();
    for fitted in &model.parts().effects {
        total_m2 += undecided_m2((model, first), fitted, state, &by_error);
        first += fitted.parameters.len();
    }
    total_m2
}

fn outside(reading_m: [f64; 3], offset_m: [f64; 3]) -> VolumetricError {
    VolumetricError::Outside { reading_mm: reading_m.map(|v| v * 1e3), offset_mm: offset_m.map(|v| v * 1e3) }
}
