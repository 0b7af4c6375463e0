//! What an effect says of itself in the registry, and what a campaign offers it.
//!
//! Place in the flow: each effect's file holds one [`Known`]; [`super::registry`] lists them all. Diagnosis asks each for the shapes
//! that are worth testing on a campaign ([`Observed`]).

use super::shape::{EffectError, Shape};
use super::{Effect, lagged_name, of_lagged};
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
