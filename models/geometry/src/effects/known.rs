//! The registry of effects: what each is, when it can be tested, and which shapes are worth testing.
//!
//! Place in the flow: diagnosis goes through [`REGISTRY`]; model files are read through [`construct`].

use super::shape::{EffectError, Shape};
use super::{
    Effect, acceleration, axis_term, carriage_sag, column_bow, dead_path, empirical, gimbal, gradient_bow, hysteresis,
    lagged_name, moisture_bow, of_lagged, outlying_run, periodic_scale, reflector_incidence, reflector_offset,
    refraction, reversal, scale_expansion, scale_growth, speed_lag, stand_jump, station_drift, table_load, warm_up,
    zero_jump,
};
use crate::machine::Machine;

/// What a campaign offers to an effect.
#[derive(Debug, Clone, Copy)]
pub struct Observed<'a> {
    /// The machine.
    pub machine: &'a Machine,
    /// Covariates that are logged for every reading and vary, `time_s` among them.
    pub varying: &'a [String],
    /// Station names.
    pub stations: &'a [String],
    /// The reflector offsets used (m, ram frame).
    pub offsets_m: &'a [[f64; 3]],
    /// First and last time (s since the campaign began).
    pub time_s: (f64, f64),
}

impl Observed<'_> {
    /// Whether a covariate is logged and varies.
    pub fn varies(&self, name: &str) -> bool {
        self.varying.iter().any(|known| known == name)
    }

    /// Varying covariates whose name begins and ends so.
    pub fn named<'b>(&'b self, prefix: &'b str, suffix: &'b str) -> impl Iterator<Item = &'b str> {
        self.varying.iter().map(String::as_str).filter(move |n| n.starts_with(prefix) && n.ends_with(suffix))
    }

    /// Each two temperatures that are logged, as they are and behind each time constant, both lagging alike.
    pub(super) fn differences(&self) -> Vec<(String, String)> {
        let logged: Vec<&str> = self.named("temp_", "_c").filter(|name| of_lagged(name).is_none()).collect();
        let pairs = logged.iter().enumerate().flat_map(|(k, warm)| logged[..k].iter().map(move |cold| (*warm, *cold)));
        let mut differences: Vec<(String, String)> = pairs.clone().map(|(a, b)| (a.to_owned(), b.to_owned())).collect();
        for lagged in self.named("temp_", "_c") {
            let Some((of, lag_s)) = of_lagged(lagged) else { continue };
            let partners = pairs.clone().filter(|(warm, _)| *warm == of);
            let behind = partners.filter_map(|(_, cold)| Some((lagged.to_owned(), lagged_name(cold, lag_s)?)));
            differences.extend(behind.filter(|(_, cold)| self.varies(cold)));
        }
        differences
    }
}

/// A figure of the shape that diagnosis may refine between the shapes proposed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refine {
    /// Key of the figure.
    pub key: &'static str,
    /// Ratio between neighbouring shapes that [`Known::propose`] gives: how far refinement may go either way.
    pub ratio: f64,
}

/// Makes an effect from its shape.
pub type Construct = fn(&Shape, &Machine) -> Result<Box<dyn Effect>, EffectError>;

/// One registered effect.
#[derive(Debug, Clone, Copy)]
pub struct Known {
    /// Name in model files.
    pub name: &'static str,
    /// Name for readers.
    pub title: &'static str,
    /// Formula in the parameters and covariates.
    pub formula: &'static str,
    /// Typical size in the literature.
    pub typical: &'static str,
    /// Where formula and size come from.
    pub source: &'static str,
    /// Sensors or moves without which it cannot be tested.
    pub needs: &'static str,
    /// Measurement that tells it from what looks alike.
    pub decided_by: &'static str,
    /// Makes it from its shape.
    pub construct: Construct,
    /// Shapes worth testing on a campaign; none where it lacks what the effect needs.
    pub propose: fn(&Observed) -> Vec<Shape>,
    /// Figure to refine.
    pub refine: Option<Refine>,
}

/// Every effect: the one place where a new one is entered.
pub const REGISTRY: &[Known] = &[
    acceleration::KNOWN,
    axis_term::KNOWN,
    carriage_sag::KNOWN,
    column_bow::KNOWN,
    dead_path::KNOWN,
    empirical::KNOWN,
    gimbal::KNOWN,
    gradient_bow::KNOWN,
    hysteresis::KNOWN,
    moisture_bow::KNOWN,
    outlying_run::KNOWN,
    periodic_scale::KNOWN,
    reflector_incidence::KNOWN,
    reflector_offset::KNOWN,
    refraction::KNOWN,
    reversal::KNOWN,
    scale_expansion::KNOWN,
    scale_growth::KNOWN,
    speed_lag::KNOWN,
    stand_jump::KNOWN,
    station_drift::KNOWN,
    table_load::KNOWN,
    warm_up::KNOWN,
    zero_jump::KNOWN,
];

/// The registered effect of that name.
pub fn known(name: &str) -> Option<&'static Known> {
    REGISTRY.iter().find(|entry| entry.name == name)
}

/// The effect of that name with that shape on that machine.
pub fn construct(name: &str, shape: &Shape, machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    match known(name) {
        Some(entry) => (entry.construct)(shape, machine),
        None => {
            let known = REGISTRY.iter().map(|entry| entry.name).collect::<Vec<_>>().join(", ");
            Err(EffectError::Unknown { name: name.to_owned(), known })
        }
    }
}
