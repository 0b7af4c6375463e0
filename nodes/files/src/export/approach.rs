//! What depends on the side that an axis comes from: the reversal value of a model along each axis.
//!
//! Place in the flow: a model in; B(x) = error of approaches in + less that in − (m, ISO 230-2; play is negative) out, for formats
//! that have a place for it. Of all effects those count that need no covariate but the sign of approach of their own axis and that
//! no other axis changes; all others stay named as left out. Beyond the readings that were identified B keeps its value at their end.

use abbe_geometry::axis::{Axis, ErrorId};
use abbe_geometry::effects::{Acts, CovariateSource, CovariateValue, State};
use abbe_geometry::machine::Machine;
use abbe_geometry::model::{FittedEffect, MachineModel};
use abbe_geometry::sampled::SampledAxis;

/// Names of the signs of approach.
const SIGNS: [&str; 3] = ["dir_x", "dir_y", "dir_z"];
/// Places along the other axes at which an effect is compared with itself.
const SHARES: [f64; 4] = [0.0, 0.3, 0.7, 1.0];
/// Differences (m) that are rounding.
const ROUNDING_M: f64 = 1e-15;

/// Reversal of each axis.
#[derive(Debug, Clone, Default)]
pub struct Approach {
    /// Effects of X, Y, Z.
    effects: [Vec<FittedEffect>; 3],
    /// Readings that were identified (m).
    identified_m: [(f64, f64); 3],
    /// The one side from which X, Y, Z were measured, where what the other does differently is not known.
    only: [Option<f64>; 3],
    /// Places of the effects of the model that stand for the other side.
    untold: Vec<usize>,
}

/// One sign of approach, and nothing else known.
struct From {
    sign: &'static str,
    value: f64,
}

impl CovariateSource for From {
    fn covariate(&self, name: &str) -> CovariateValue {
        if name == self.sign { CovariateValue::Fresh(self.value) } else { CovariateValue::Missing }
    }
}

impl Approach {
    /// Of a model; with it the places of the effects that are in it.
    pub(super) fn of(model: &MachineModel) -> (Approach, Vec<usize>) {
        let parts = model.parts();
        let identified_m = parts.identified.reading_m;
        let (mut approach, mut held) = (Approach { identified_m, ..Approach::default() }, Vec::new());
        for (place, fitted) in parts.effects.iter().enumerate() {
            let axis = Axis::ALL.into_iter().find(|axis| fitted.effect.covariates() == [SIGNS[axis.index()]]);
            let Some(axis) = axis.filter(|axis| is_of_one_axis(fitted, *axis, &parts.machine)) else { continue };
            match measured_side(fitted, axis) {
                Some(side) if fitted.parameters.iter().all(|value| *value == 0.0) => {
                    approach.only[axis.index()] = Some(side);
                    approach.untold.push(place);
                }
                _ => {
                    held.push(place);
                    approach.effects[axis.index()].push(fitted.clone());
                }
            }
        }
        (approach, held)
    }

    /// Sides that nobody measured, in words.
    pub(super) fn not_measured(&self) -> impl Iterator<Item = String> {
        Axis::ALL.into_iter().filter_map(|axis| {
            let (own, other) = if self.only[axis.index()]? > 0.0 { ("+", "-") } else { ("-", "+") };
            let letter = axis.letter();
            Some(format!(
                "NOT measured: {letter} in approaches in {other}; all values of {letter} are those of approaches in {own}, and a reversal of \
                 zero here means that nobody knows it"
            ))
        })
    }

    /// Whether an effect of the model only stands for a side that nobody measured.
    pub(super) fn is_untold(&self, place: usize) -> bool {
        self.untold.contains(&place)
    }

    /// Whether this axis was measured from one side only.
    pub(super) fn is_one_sided(&self, axis: Axis) -> bool {
        self.only[axis.index()].is_some()
    }

    /// Whether anything is known of this axis.
    pub(super) fn has(&self, axis: Axis) -> bool {
        !self.effects[axis.index()].is_empty()
    }

    /// Reversal value at a reading of the axis (m).
    pub(super) fn reversal_m(&self, axis: Axis, position_m: f64) -> f64 {
        let mut reading_m = [0.0; 3];
        let (lower_m, upper_m) = self.identified_m[axis.index()];
        reading_m[axis.index()] = position_m.max(lower_m).min(upper_m);
        self.effects[axis.index()].iter().filter_map(|fitted| reversal_m(fitted, axis, reading_m)).sum()
    }

    /// Reversal values at the nodes of an axis, and their mean (m).
    pub(super) fn reversals_m(&self, axis: &SampledAxis) -> (Vec<f64>, f64) {
        let values_m: Vec<f64> = axis.positions_m.iter().map(|p| self.reversal_m(axis.axis, *p)).collect();
        let mean_m = values_m.iter().sum::<f64>() / values_m.len() as f64;
        (values_m, mean_m)
    }
}

/// The side from which an effect does nothing whatever its parameters are, if it does something from the other.
fn measured_side(fitted: &FittedEffect, axis: Axis) -> Option<f64> {
    let is_nothing = |value: f64| {
        let from = From { sign: SIGNS[axis.index()], value };
        let state = State { reading_m: [0.0; 3], offset_m: [0.0; 3], covariates: &from };
        let mut is_nothing = true;
        fitted.effect.motion(&state, &mut |_, _, part| is_nothing &= part == 0.0).is_ok() && is_nothing
    };
    match (is_nothing(1.0), is_nothing(-1.0)) {
        (true, false) => Some(1.0),
        (false, true) => Some(-1.0),
        _ => None,
    }
}

/// Whether the effect moves the axis along itself alone, and by the same wherever the other axes stand.
fn is_of_one_axis(fitted: &FittedEffect, axis: Axis, machine: &Machine) -> bool {
    let at = |axis: Axis, share: f64| {
        let (lower_m, upper_m) = machine.stroke_m[axis.index()];
        lower_m + share * (upper_m - lower_m)
    };
    SHARES.into_iter().all(|own| {
        let values = SHARES.map(|others| {
            let place = Axis::ALL.map(|other| at(other, if other == axis { own } else { others }));
            reversal_m(fitted, axis, place)
        });
        values.iter().all(|value| matches!((value, values[0]), (Some(a), Some(b)) if (a - b).abs() < ROUNDING_M))
    })
}

/// What the effect does to approaches in + less that in − (m); `None` where it moves anything else.
fn reversal_m(fitted: &FittedEffect, axis: Axis, reading_m: [f64; 3]) -> Option<f64> {
    let along = Acts::Error(ErrorId::linear(axis, axis));
    let mut total_m = 0.0;
    for value in [1.0, -1.0] {
        let from = From { sign: SIGNS[axis.index()], value };
        let state = State { reading_m, offset_m: [0.0; 3], covariates: &from };
        let mut is_along = true;
        let mut add = |k: usize, acts: Acts, part: f64| {
            is_along &= acts == along;
            total_m += value * part * fitted.parameters.get(k).copied().unwrap_or(0.0);
        };
        fitted.effect.motion(&state, &mut add).ok()?;
        if !is_along {
            return None;
        }
    }
    Some(total_m)
}
