//! Effects beyond rigid-body geometry: one file an effect, one line each in [`REGISTRY`].
//!
//! Place in the flow: a model lists fitted effects; correction adds what they do to tip or reflector, and
//! identification adds their columns beside the geometry. An effect is linear in its parameters for a given
//! shape (periods, time constants); it may move the tip or change the range, and names the covariates that the
//! scale sample must carry. A covariate that is missing or stale is reported, never guessed.

mod reversal;
mod scale_expansion;

use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::fmt::Debug;
use thiserror::Error;

/// What a sample says about one covariate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CovariateValue {
    /// A value fresh enough to use, in the unit of the name's suffix.
    Fresh(f64),
    /// A value older than allowed.
    Stale,
    /// Nothing known.
    Missing,
}

/// Where an effect finds its covariates.
pub trait CovariateSource {
    /// The covariate of that name, unit as suffix.
    fn covariate(&self, name: &str) -> CovariateValue;
}

/// A source without any covariate.
#[derive(Debug, Clone, Copy)]
pub struct NoCovariates;

impl CovariateSource for NoCovariates {
    fn covariate(&self, _name: &str) -> CovariateValue {
        CovariateValue::Missing
    }
}

/// Why an effect could not be evaluated for a sample.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum CovariateProblem {
    /// The sample does not carry it.
    #[error("covariate {0} is missing from the sample; log it beside the scales")]
    Missing(String),
    /// The sample carries an old value.
    #[error("covariate {0} is older than allowed; check its sensor")]
    Stale(String),
}

/// State of the machine at one sample.
#[derive(Clone, Copy)]
pub struct State<'a> {
    /// Indicated axis positions (m).
    pub reading_m: [f64; 3],
    /// Tip or reflector relative to the ram reference point (m, ram frame).
    pub offset_m: [f64; 3],
    /// Logged quantities.
    pub covariates: &'a dyn CovariateSource,
}

impl State<'_> {
    /// A covariate, or why it cannot be used.
    pub fn covariate(&self, name: &str) -> Result<f64, CovariateProblem> {
        match self.covariates.covariate(name) {
            CovariateValue::Fresh(value) => Ok(value),
            CovariateValue::Stale => Err(CovariateProblem::Stale(name.to_owned())),
            CovariateValue::Missing => Err(CovariateProblem::Missing(name.to_owned())),
        }
    }
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

/// An effect beyond geometry, linear in its parameters.
pub trait Effect: Debug + Send + Sync {
    /// Name in model files and reports.
    fn name(&self) -> &'static str;

    /// Covariates that a sample must carry.
    fn covariates(&self) -> Vec<String>;

    /// The parameters, in the order of the columns.
    fn parameters(&self) -> Vec<ParameterSpec>;

    /// Motion of tip or reflector per unit of each parameter (m per unit, machine frame).
    fn tip_columns(&self, state: &State) -> Result<Vec<Vector3<f64>>, CovariateProblem>;

    /// Change of the measured range per unit of each parameter (m per unit) beyond what the tip's motion does.
    fn range_columns(&self, _state: &State, _ray: &Ray) -> Result<Vec<f64>, CovariateProblem> {
        Ok(vec![0.0; self.parameters().len()])
    }
}

/// Shape of an effect: named figures that it is not linear in, SI.
pub type Shape = BTreeMap<String, f64>;

/// An unknown effect or a shape that does not fit it.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum EffectError {
    /// No effect of that name.
    #[error("unknown effect {name:?}; known are {known}")]
    Unknown {
        /// The name asked for.
        name: String,
        /// All names.
        known: String,
    },
    /// The shape holds a key the effect does not have, or lacks one.
    #[error("effect {effect}: shape key {key:?} {problem}")]
    Shape {
        /// Effect.
        effect: &'static str,
        /// Key.
        key: String,
        /// What is wrong.
        problem: &'static str,
    },
}

type Constructor = fn(&Shape) -> Result<Box<dyn Effect>, EffectError>;

/// Every effect: the one place where a new one is entered.
pub const REGISTRY: &[(&str, Constructor)] =
    &[(reversal::NAME, reversal::construct), (scale_expansion::NAME, scale_expansion::construct)];

/// The effect of that name with that shape.
pub fn construct(name: &str, shape: &Shape) -> Result<Box<dyn Effect>, EffectError> {
    match REGISTRY.iter().find(|(known, _)| *known == name) {
        Some((_, constructor)) => constructor(shape),
        None => {
            let known = REGISTRY.iter().map(|(known, _)| *known).collect::<Vec<_>>().join(", ");
            Err(EffectError::Unknown { name: name.to_owned(), known })
        }
    }
}

/// Refuses a shape that an effect without shape was given.
fn without_shape(effect: &'static str, shape: &Shape) -> Result<(), EffectError> {
    match shape.keys().next() {
        None => Ok(()),
        Some(key) => {
            Err(EffectError::Shape { effect, key: key.clone(), problem: "is not known; this effect has no shape" })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct One(f64);
    impl CovariateSource for One {
        fn covariate(&self, _name: &str) -> CovariateValue {
            CovariateValue::Fresh(self.0)
        }
    }

    /// Laws that hold for every registered effect: a new file is covered by being entered in the registry.
    #[test]
    fn laws_of_every_effect() {
        for (name, constructor) in REGISTRY {
            let effect = constructor(&Shape::new()).unwrap();
            assert_eq!(effect.name(), *name);
            let source = One(1.0);
            let state = State { reading_m: [0.3, 0.2, 0.1], offset_m: [0.0, 0.0, -0.06], covariates: &source };
            let ray = Ray { direction: Vector3::x(), range_m: 0.5 };
            let count = effect.parameters().len();
            assert_eq!(effect.tip_columns(&state).unwrap().len(), count, "{name}: one column a parameter");
            assert_eq!(effect.range_columns(&state, &ray).unwrap().len(), count, "{name}");
            assert!(effect.parameters().iter().all(|p| p.plausible > 0.0 && !p.unit.is_empty()), "{name}");
            let blind = State { covariates: &NoCovariates, ..state };
            assert_eq!(
                effect.tip_columns(&blind).is_err(),
                !effect.covariates().is_empty(),
                "{name}: needs its covariates"
            );
        }
    }

    #[test]
    fn unknown_effects_and_shapes_are_refused_by_name() {
        assert!(construct("scale_expansoin", &Shape::new()).unwrap_err().to_string().contains("scale_expansion"));
        let shape = Shape::from([("period_m".to_owned(), 0.02)]);
        assert!(construct(reversal::NAME, &shape).unwrap_err().to_string().contains("period_m"));
    }
}
