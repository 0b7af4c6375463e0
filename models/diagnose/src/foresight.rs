//! What a planned campaign will tell of effects, before anything is measured.
//!
//! Place in the flow: planning hands the fit that it foresees ([`abbe_identify::foresee`]) and the nominal campaign; the same
//! proposals, projections and limit as in a diagnosis of measured data say which effects can be told, how well, and which
//! cannot. SI.

use crate::alias;
use crate::candidates::{Candidate, Round, proposals, score_all};
use crate::context::Context;
use crate::diagnosis::{NotIdentifiable, Untestable};
use crate::error::DiagnoseError;
use abbe_geometry::effects::Shape;
use abbe_geometry::machine::Machine;
use abbe_identify::Identified;
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use faer::Side;
use faer::linalg::solvers::{DenseSolveCore, Llt};

/// Standard deviations by which an effect must exceed the price of its search to be found in nearly every campaign.
const SURELY: f64 = 2.0;

/// What a campaign will tell of effects.
#[derive(Debug, Clone, PartialEq)]
pub struct Foresight {
    /// Effects that can be told, the simplest shape of each.
    pub told: Vec<Told>,
    /// Effects that the model's own parameters absorb.
    pub not_identifiable: Vec<NotIdentifiable>,
    /// Effects that need what is not logged or not varied.
    pub untestable: Vec<Untestable>,
}

/// An effect that can be told.
#[derive(Debug, Clone, PartialEq)]
pub struct Told {
    /// Name in the registry.
    pub name: &'static str,
    /// Name for readers.
    pub title: &'static str,
    /// Its shape.
    pub shape: Shape,
    /// Share of its signature that errors, stations and dead paths absorb.
    pub alias_share: f64,
    /// How well its parameters will be known.
    pub parameters: Vec<ToldParameter>,
}

/// A parameter of an effect that can be told.
#[derive(Debug, Clone, PartialEq)]
pub struct ToldParameter {
    /// Name.
    pub name: String,
    /// SI unit.
    pub unit: &'static str,
    /// Standard uncertainty (k = 1) where the effect is fitted beside the geometry.
    pub u: f64,
    /// Size from which a diagnosis will find it in nearly every campaign.
    pub found_from: f64,
}

/// What a campaign of these nominal readings will tell.
///
/// # Errors
/// A fit whose columns depend on each other.
pub fn foresee(
    machine: &Machine,
    fit: &Identified,
    instrument: RangeUncertainty,
    campaign: &Campaign,
) -> Result<Foresight, DiagnoseError> {
    let round = Round::new(fit, instrument, campaign)?;
    let context = Context::new(campaign);
    let named = score_all(&round, proposals(machine, &context)?)?;
    let not_identifiable = alias::not_identifiable(&round, &fit.model, &named)?;
    let untestable = alias::untestable(machine, &context);
    let simplest = alias::told(&named);
    let told = simplest.into_iter().map(|candidate| told(&round, candidate)).collect::<Result<_, _>>()?;
    Ok(Foresight { told, not_identifiable, untestable })
}

fn told(round: &Round, candidate: &Candidate) -> Result<Told, DiagnoseError> {
    let effect = candidate.term.effect.as_ref();
    let columns = round.rows.columns(effect)?;
    let projected = round.free.project_all(&[columns]).pop().ok_or(DiagnoseError::Singular)?;
    let specs = effect.parameters();
    let mut information = projected.left;
    for (k, spec) in specs.iter().enumerate() {
        information[(k, k)] += spec.plausible.powi(-2);
    }
    let covariance = Llt::new(information.as_ref(), Side::Lower).map_err(|_| DiagnoseError::Singular)?.inverse();
    let price = (round.used.max(2) as f64).ln() + 2.0 * (candidate.trials.max(1) as f64).ln();
    let parameter = |(k, spec): (usize, abbe_geometry::effects::ParameterSpec)| {
        let u = covariance[(k, k)].max(0.0).sqrt();
        ToldParameter { name: spec.name, unit: spec.unit, u, found_from: u * (price.sqrt() + SURELY) }
    };
    Ok(Told {
        name: candidate.known.name,
        title: candidate.known.title,
        shape: candidate.term.shape.clone(),
        alias_share: candidate.absorbed,
        parameters: specs.into_iter().enumerate().map(parameter).collect(),
    })
}
