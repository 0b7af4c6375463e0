//! What a model says something of, and of which errors its zeros are no measurement.
//!
//! Place in the flow: under [`super::About`]. A model in; whether it says anything of the positioning of an axis along itself, and
//! the names of the errors that it only holds at zero, out. A table of zeros would take away what a controller has, so an effect counts for an
//! axis only where it depends on where that axis stands or from which side it came: one that moves X with the reading of Y is no
//! positioning of X.

use abbe_geometry::axis::Axis;
use abbe_geometry::effects::{CovariateSource, CovariateValue, State, along_columns};
use abbe_geometry::model::{FittedEffect, MachineModel};
use abbe_geometry::sampled::{errors_of, of_position};

/// Names of the signs of approach.
const SIGNS: [&str; 3] = ["dir_x", "dir_y", "dir_z"];
/// Whether a logged quantity is a side of approach.
pub(super) fn is_sign(name: &str) -> bool {
    SIGNS.contains(&name)
}

/// Shares of a stroke at which an effect is compared with itself: no two of them lie a whole period of the same wave apart.
const SHARES: [f64; 4] = [0.0, 0.3, 0.7, 0.9];
/// Differences of an effect (m, times its parameter) that are rounding.
const ROUNDING: f64 = 1e-15;

/// Covariates at one end of what a model was identified from, coming from one side of one axis.
struct Seen<'a> {
    model: &'a MachineModel,
    is_upper: bool,
    sign: &'static str,
    value: f64,
}

impl CovariateSource for Seen<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        if name == self.sign {
            return CovariateValue::Fresh(self.value);
        }
        let ranges = &self.model.parts().identified.covariates;
        match ranges.iter().find(|(own, _)| own.as_str() == name) {
            Some((_, range)) => CovariateValue::Fresh(if self.is_upper { range.1 } else { range.0 }),
            // What time it is, or a mean of what was logged: whether the effect depends on the axis does not hang on the value.
            None => CovariateValue::Fresh(f64::from(u8::from(self.is_upper))),
        }
    }
}

/// Whether an effect of the model says something of the positioning of an axis along itself.
pub(super) fn is_said_along(model: &MachineModel, axis: Axis) -> bool {
    let is_of_position = of_position(model).into_iter().any(|(_, own)| own == axis);
    // Those of position alone that also follow another axis are in no table.
    let others = model.parts().effects.iter().filter(|fitted| !fitted.effect.reads().is_empty());
    is_of_position || others.into_iter().any(|fitted| depends_on_own(model, fitted, axis))
}

/// Whether what an effect does along an axis depends on where that axis stands, or from which side it came.
fn depends_on_own(model: &MachineModel, fitted: &FittedEffect, axis: Axis) -> bool {
    [false, true].into_iter().any(|is_upper| {
        let mut first = None;
        let sides = SHARES.into_iter().flat_map(|share| [(share, 1.0), (share, -1.0)]);
        let found = sides.filter_map(|(share, value)| {
            let seen = Seen { model, is_upper, sign: SIGNS[axis.index()], value };
            along(model, fitted, axis, share, &seen)
        });
        found.into_iter().any(|own| {
            let same = first.get_or_insert_with(|| own.clone());
            same.iter().zip(&own).any(|(a, b)| (a - b).abs() > ROUNDING)
        })
    })
}

/// What a unit of each parameter does along an axis that stands at this share of its stroke; `None` where it cannot be said.
fn along(model: &MachineModel, fitted: &FittedEffect, axis: Axis, share: f64, seen: &Seen) -> Option<Vec<f64>> {
    let stroke_m = &model.parts().machine.stroke_m;
    let mut reading_m = stroke_m.map(|(lower_m, _)| lower_m);
    reading_m[axis.index()] += share * (stroke_m[axis.index()].1 - stroke_m[axis.index()].0);
    let state = State { reading_m, offset_m: model.parts().offset_centre_m, covariates: seen };
    along_columns(fitted.effect.as_ref(), fitted.parameters.len(), &state, axis).ok()
}

/// Errors of which a model says nothing: functions of kind zero, but for positioning along which an effect acts, and squareness without
/// an uncertainty.
pub(super) fn held_at_zero(model: &MachineModel, with_effects: &[Axis]) -> Vec<String> {
    let machine = &model.parts().machine;
    let is_held = |axis: Axis, k: usize| machine.kinds[errors_of(axis)[k].index()].is_none();
    let is_of_effects = |axis: Axis, k: usize| k == axis.index() && with_effects.contains(&axis);
    let functions = Axis::ALL.into_iter().flat_map(|axis| (0..6).map(move |k| (axis, k)));
    let functions = functions.filter(|(axis, k)| is_held(*axis, *k) && !is_of_effects(*axis, *k));
    let functions = functions.map(|(axis, k)| errors_of(axis)[k].name());
    let squareness = machine.squareness.iter().enumerate().filter(|(k, _)| model.squareness(*k) == (0.0, 0.0));
    functions.chain(squareness.map(|(_, entry)| entry.name.clone())).collect()
}
