//! The length that a tracer on an identified station should read: what identification fits, evaluated for one sample.
//!
//! Place in the flow: the monitor compares measured lengths with it. Inputs as for [`crate::correct::correct`], the
//! station and the line, and what a residual field added (m, machine frame); output: length and standard uncertainty (m).
//!
//! > l = |q₀ − S| − d + Σ p·(∂l/∂p) + u·r
//!
//! q₀ is the actual position by the chain alone, S and d the station and its dead path, p the parameters of the effects,
//! whose columns are those of identification ([`crate::effects::add_range_columns`]): what moves the tip, and what acts on the range alone;
//! u·r is the residual field along the line of sight u. Errors, effects and stations come from one fit, and their joint
//! covariance is used; what the position has beyond them (repeatability, a residual field, effects outside their ranges) is
//! independent of the station. Misfit that the fit could not explain, and expansions that it could not show, widen corrected positions and are
//! left out here: a comparison is to show them. Where no effect asks for covariates, none need have come: then as much is taken off as
//! such expansions do at the farthest temperature of the campaign, and repeatability stays.

use crate::correct::geometric_point;
use crate::doubt::{self, is_outside};
use crate::effects::{CovariateProblem, Effect, Ray, Sight, State, tip_and_range_columns};
use crate::model::MachineModel;
use crate::sensitivity::Sensitivity;
use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

/// A corrected sample as a tracer sees it.
#[derive(Debug, Clone, Copy)]
pub struct Sighted<'a> {
    /// Name of the station.
    pub station: &'a str,
    /// Name of the line; empty where there is none.
    pub line: &'a str,
    /// What a residual field added to the corrected position (m, machine frame).
    pub residual_m: Vector3<f64>,
    /// Covariance of the corrected position, all that it holds (m²).
    pub covariance_m2: Matrix3<f64>,
}

/// A predicted length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictedLength {
    /// Length that the tracer should read (m).
    pub length_m: f64,
    /// Its standard uncertainty without the instrument's (m, k = 1).
    pub u_m: f64,
}

/// Why no length can be predicted.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Unpredictable {
    /// The model does not know the station.
    #[error("the model knows no station {0}")]
    Station(String),
    /// An effect on the tip or on the range asks for a covariate.
    #[error(transparent)]
    Covariate(#[from] CovariateProblem),
    /// The result is no number, or the reflector stands at the station.
    #[error("the model predicts no finite length for this sample")]
    NotFinite,
}

/// Predicts the length of one sample.
///
/// # Errors
/// An unknown station, a covariate that an effect of the model reads and the sample lacks, a result that is no number.
pub fn predicted_length(
    model: &MachineModel,
    state: &State,
    sighted: &Sighted,
) -> Result<PredictedLength, Unpredictable> {
    let unknown = || Unpredictable::Station(sighted.station.to_owned());
    let (first_of_station, station) = model.station(sighted.station).ok_or_else(unknown)?;
    let mut sensitivity = Sensitivity::default();
    let chain = geometric_point(model, state.reading_m, state.offset_m, &mut sensitivity);
    let ray = Ray::between(&station.position_m, &chain.position_m);
    let sight = Sight { station: sighted.station, line: sighted.line, ray };
    let mut tip = sensitivity.along(&ray.direction);
    let mut length = tip.clone();
    let (mut effects_m, mut outside_m2) = (0.0, 0.0);
    let mut first = model.layout().len();
    for (k, fitted) in model.parts().effects.iter().enumerate() {
        let (effect, count) = (fitted.effect.as_ref(), fitted.parameters.len());
        let (moved, columns) = match tip_and_range_columns(effect, count, state, &sight, &chain.by_error) {
            Ok(columns) => columns,
            // It predicts nothing either.
            Err(_) if !fitted.corrects() => {
                first += count;
                continue;
            }
            Err(problem) => return Err(problem.into()),
        };
        effects_m += columns.iter().zip(&fitted.parameters).map(|(column, value)| column * value).sum::<f64>();
        tip.parameters.extend(moved.iter().enumerate().map(|(j, column)| (first + j, ray.direction.dot(column))));
        length.parameters.extend(columns.into_iter().enumerate().map(|(j, column)| (first + j, column)));
        let usual = model.usual_on_range(k);
        if is_outside(usual, state) {
            let on_range = |state: &State| on_range(effect, &fitted.parameters, state, &sight);
            outside_m2 += doubt::outside(usual, state, on_range).map_or(f64::INFINITY, |(_, m2)| m2[(0, 0)]);
        }
        first += count;
    }
    let of_station = ray.direction.iter().map(|u| -u).chain([-1.0]);
    length.parameters.extend(of_station.enumerate().map(|(d, value)| (first_of_station + d, value)));
    let along = |covariance_m2: &Matrix3<f64>| ray.direction.dot(&(covariance_m2 * ray.direction));
    // What the fit could not explain or show is what a comparison is to show: it is no part of what is allowed for.
    let on_sight_m2 = |by_axis_m2: Vector3<f64>| by_axis_m2.dot(&ray.direction.component_mul(&ray.direction));
    let explained_m2 = along(&sighted.covariance_m2) - model.variance(&tip) - on_sight_m2(model.unexplained_m2(state));
    let repeatability_m2 = on_sight_m2(Vector3::from(model.parts().machine.repeatability_m).map(|r| r * r));
    let least_m2 = explained_m2.min(repeatability_m2).max(0.0);
    let beyond_m2 = (explained_m2 - on_sight_m2(model.unseen_m2(state))).max(least_m2);
    let length_m = ray.range_m - station.dead_path_m + effects_m + ray.direction.dot(&sighted.residual_m);
    let as_fitted_m2 = model.variance(&length) - model.absorbed_m2(&length);
    let u_m = (as_fitted_m2.max(0.0) + beyond_m2 + outside_m2).sqrt();
    match length_m.is_finite() && u_m.is_finite() {
        true => Ok(PredictedLength { length_m, u_m }),
        false => Err(Unpredictable::NotFinite),
    }
}

/// What an effect adds to the range alone (m), as the first component.
fn on_range(effect: &dyn Effect, parameters: &[f64], state: &State, sight: &Sight) -> Option<Vector3<f64>> {
    let mut added_m = 0.0;
    effect.range(state, sight, &mut |parameter, amount| added_m += parameters[parameter] * amount).ok()?;
    Some(Vector3::x() * added_m)
}
