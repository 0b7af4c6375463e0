//! Effects beyond rigid-body geometry: one file an effect, one line each in [`REGISTRY`].
//!
//! Place in the flow: diagnosis proposes effects for a campaign ([`Known::propose`]), identification fits their
//! parameters beside the geometry, the model stores them, correction adds what they do to the tip. An effect is
//! linear in its parameters for a given [`Shape`] (axis, period, time constant). It moves an error of the chain, the
//! tip, or only the range that the tracer reads; what moves only the range never touches a corrected coordinate.
//! A covariate that is missing or stale is reported, never guessed. SI; covariates in the unit of their name.

mod known;
mod registry;
mod shape;
mod source;

mod acceleration;
mod arch;
mod axis_term;
mod carriage_sag;
mod column_bow;
mod dead_path;
mod empirical;
mod gimbal;
mod gradient_bow;
mod growth;
mod hysteresis;
mod moisture_bow;
mod outlying_run;
mod periodic_scale;
mod range_bend;
mod reflector_incidence;
mod reflector_offset;
mod refraction;
mod reversal;
mod scale_expansion;
mod scale_growth;
mod scale_step;
mod speed_lag;
mod stand_jump;
mod station_drift;
mod table_load;
mod warm_up;
mod zero_jump;

pub use empirical::legendre;
pub use known::{Construct, Known, Observed, Refine};
pub use registry::{REGISTRY, construct, known};
pub use shape::{EffectError, Shape, ShapeValue, Wish};
pub use source::{
    CovariateProblem, CovariateSource, CovariateValue, NoCovariates, State, TIME, is_scale, known_covariate,
};

pub use crate::lagged::{Lag, Lagged, lagged_name, of_lagged};
pub use crate::travelled::{Travel, Travelled, logged_side, of_travelled, travelled_name};

use crate::axis::{Axis, ErrorId};
use nalgebra::Vector3;
use smallvec::SmallVec;
use std::fmt::Debug;

/// Whether a covariate of that name is made from what is logged, and no sensor of its own.
pub fn is_derived(name: &str) -> bool {
    of_lagged(name).is_some() || of_travelled(name).is_some()
}

/// The line of sight of a tracer reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Unit vector from the station to the reflector, machine frame.
    pub direction: Vector3<f64>,
    /// Distance from station to reflector (m).
    pub range_m: f64,
}

impl Ray {
    /// The line of sight from a station to a point (m, machine frame).
    pub fn between(station_m: &Vector3<f64>, point_m: &Vector3<f64>) -> Ray {
        let sight = point_m - station_m;
        let range_m = sight.norm();
        Ray { direction: sight / range_m, range_m }
    }
}

/// A tracer reading as effects on the range see it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight<'a> {
    /// Name of the station.
    pub station: &'a str,
    /// Name of the line (run of points measured in one go).
    pub line: &'a str,
    /// Line of sight.
    pub ray: Ray,
}

/// Name, unit and sane size of one parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterSpec {
    /// Name, unique within the effect.
    pub name: String,
    /// SI unit.
    pub unit: &'static str,
    /// Magnitude beyond which the parameter is not believed.
    pub plausible: f64,
}

impl ParameterSpec {
    /// A parameter of that name, SI unit and largest believable magnitude.
    pub fn new(name: impl Into<String>, unit: &'static str, plausible: f64) -> ParameterSpec {
        ParameterSpec { name: name.into(), unit, plausible }
    }
}

/// What one parameter moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Acts {
    /// One of the chain's errors (m or rad), with the lever that the chain gives it.
    Error(ErrorId),
    /// Tip or reflector along a machine axis (m).
    Tip(Axis),
}

impl Acts {
    /// What a unit of it does to the tip (machine frame), from the chain's partials by error.
    pub(crate) fn on_tip(self, by_error: &[Vector3<f64>; ErrorId::COUNT]) -> Vector3<f64> {
        match self {
            Acts::Error(id) => by_error[id.index()],
            Acts::Tip(axis) => axis.direction(),
        }
    }

    /// The part of that along a direction.
    fn along(self, by_error: &[Vector3<f64>; ErrorId::COUNT], direction: &Vector3<f64>) -> f64 {
        match self {
            Acts::Error(id) => by_error[id.index()].dot(direction),
            Acts::Tip(axis) => direction[axis.index()],
        }
    }
}

/// Takes parameter, what it moves, and by how much a unit of the parameter moves it (SI).
pub type Motion<'a> = dyn FnMut(usize, Acts, f64) + 'a;

/// An effect beyond geometry, linear in its parameters.
pub trait Effect: Debug + Send + Sync {
    /// Name in model files and reports.
    fn name(&self) -> &'static str;

    /// The parameters, in the order of the columns.
    fn parameters(&self) -> Vec<ParameterSpec>;

    /// Parameters without which it is another effect: data that the rest explains as well do not show this one. None by default.
    fn essential(&self) -> &'static [usize] {
        &[]
    }

    /// Whether it moves the stand of a tracer: to stations that were measured one after the other, the machine may have moved instead.
    fn moves_stand(&self) -> bool {
        false
    }

    /// Whether it happens once, at an instant that a search found: it is no course in time.
    fn happens_once(&self) -> bool {
        false
    }

    /// Whether it changes from one reading to the next along an axis: error functions with more coefficients come nearer to it, and never
    /// follow it.
    fn is_abrupt(&self) -> bool {
        false
    }

    /// Whether it stretches all ranges and takes for granted at which value of what it reads they are right: no campaign tells that
    /// from the scale of the machine.
    fn has_open_zero(&self) -> bool {
        false
    }

    /// Covariates that a sample must carry to be corrected: those that [`Effect::motion`] reads.
    fn covariates(&self) -> Vec<String> {
        Vec::new()
    }

    /// Covariates that a campaign must carry beyond those: those that [`Effect::range`] reads.
    fn range_covariates(&self) -> Vec<String> {
        Vec::new()
    }

    /// Both of them.
    fn reads(&self) -> Vec<String> {
        [self.covariates(), self.range_covariates()].concat()
    }

    /// Lines of the campaign that it is about. Lines measured later may bear the same names, and are other runs.
    fn runs(&self) -> Vec<String> {
        Vec::new()
    }

    /// What a unit of each parameter does to chain and tip in this state.
    fn motion(&self, _state: &State, _part: &mut Motion) -> Result<(), CovariateProblem> {
        Ok(())
    }

    /// Standard deviation, for a unit of each parameter, of what it does to chain and tip in this state where its shape leaves that open
    /// (a step whose place is known to lie between two readings). It widens the uncertainty there. Nothing by default.
    fn undecided(&self, _state: &State, _part: &mut Motion) {}

    /// What a unit of each parameter adds to the range read (m per unit) beyond what the tip's motion does.
    fn range(&self, _state: &State, _sight: &Sight, _part: &mut dyn FnMut(usize, f64)) -> Result<(), CovariateProblem> {
        Ok(())
    }
}

/// A column a parameter. No effect that is measured has more than these, so that a sample takes no memory.
pub type TipColumns = SmallVec<[Vector3<f64>; 24]>;
/// A few numbers of one sample, likewise.
pub type Values = SmallVec<[f64; 16]>;

/// Motion of tip or reflector per unit of each of the effect's `count` parameters (m per unit, machine frame), from the
/// chain's partials by error in the order of [`ErrorId::index`].
pub fn tip_columns(
    effect: &dyn Effect,
    count: usize,
    state: &State,
    by_error: &[Vector3<f64>; ErrorId::COUNT],
) -> Result<TipColumns, CovariateProblem> {
    let mut columns = TipColumns::from_elem(Vector3::zeros(), count);
    effect.motion(state, &mut |parameter, acts, amount| {
        columns[parameter] += acts.on_tip(by_error) * amount;
    })?;
    Ok(columns)
}

/// What a unit of each of the effect's `count` parameters moves the tip along an axis by (m per unit), as a linear error of any axis or as a
/// motion of the tip: not by levers of rotations.
pub fn along_columns(
    effect: &dyn Effect,
    count: usize,
    state: &State,
    axis: Axis,
) -> Result<Vec<f64>, CovariateProblem> {
    let mut columns = vec![0.0; count];
    effect.motion(state, &mut |parameter, acts, amount| {
        let is_along = |own: &Axis| acts == Acts::Error(ErrorId::linear(axis, *own));
        if acts == Acts::Tip(axis) || Axis::ALL.iter().any(is_along) {
            columns[parameter] += amount;
        }
    })?;
    Ok(columns)
}

/// Adds the change of the measured range per unit of each of the effect's parameters (m per unit) to `columns`, one a
/// parameter: the tip's motion along the sight, and what acts on the range alone. `by_error` as in [`tip_columns`].
pub fn add_range_columns(
    effect: &dyn Effect,
    state: &State,
    sight: &Sight,
    by_error: &[Vector3<f64>; ErrorId::COUNT],
    columns: &mut [f64],
) -> Result<(), CovariateProblem> {
    let direction = &sight.ray.direction;
    effect.motion(state, &mut |parameter, acts, amount| {
        columns[parameter] += amount * acts.along(by_error, direction);
    })?;
    effect.range(state, sight, &mut |parameter, amount| columns[parameter] += amount)
}

/// What [`tip_columns`] and [`add_range_columns`] give, from one evaluation of the effect.
pub(crate) fn tip_and_range_columns(
    effect: &dyn Effect,
    count: usize,
    state: &State,
    sight: &Sight,
    by_error: &[Vector3<f64>; ErrorId::COUNT],
) -> Result<(TipColumns, Vec<f64>), CovariateProblem> {
    let (mut tip, mut range) = (TipColumns::from_elem(Vector3::zeros(), count), vec![0.0; count]);
    effect.motion(state, &mut |parameter, acts, amount| {
        tip[parameter] += acts.on_tip(by_error) * amount;
        range[parameter] += amount * acts.along(by_error, &sight.ray.direction);
    })?;
    effect.range(state, sight, &mut |parameter, amount| range[parameter] += amount)?;
    Ok((tip, range))
}

#[cfg(test)]
pub(crate) mod tests;
