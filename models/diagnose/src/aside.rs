//! What the data show and do not tell from the machine's own errors: it corrects nothing, and stands in the uncertainty.
//!
//! Place in the flow: the end of [`crate::diagnose()`], on the model to correct with. A load that lay there while one station stood bends the
//! machine, and stations, angles and bows of the machine take most of that. To adopt the effect would ask of every coordinate what nobody
//! knows of it ([`crate::worth`]); to leave it out makes coordinates wrong by what it does, at loads that few stations saw by all of it.
//! What the fit with it moves them by is how large it shows; beside that counts as much again of what is not known of it
//! ([`abbe_geometry::mixture::beside`]).

use crate::error::DiagnoseError;
use crate::options::Progress;
use crate::same_claim::{is_of, is_variant, read_the_same};
use crate::search::{Search, State};
use crate::step::Step;
use crate::worth::Cost;
use abbe_geometry::mixture;
use abbe_geometry::model::{FittedEffect, MachineModel, ModelError};
use abbe_identify::{EffectTerm, IdentifyError, is_expansion};

/// A model with what was too costly in its uncertainty.
pub(crate) struct Aside {
    pub(crate) model: MachineModel,
    /// What stands in it.
    pub(crate) terms: Vec<EffectTerm>,
}

/// The model with all of it in its uncertainty; `withdrawn` were too costly together. `is_out` are courses in time, which no model to correct with
/// has: their time is that of the campaign.
pub(crate) fn told(
    search: &Search,
    state: &State,
    (model, withdrawn): (MachineModel, &[EffectTerm]),
    is_out: &dyn Fn(&FittedEffect) -> bool,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Aside, DiagnoseError> {
    let mut aside = Aside { model, terms: Vec::new() };
    // Of a scale that stretches the uncertainty has what these data leave open.
    let is_held =
        |term: &EffectTerm| is_expansion(term.effect.as_ref(), &state.fit, (search.instrument, search.campaign));
    for costly in one_each(state, withdrawn) {
        if costly.iter().all(is_held) {
            continue;
        }
        let terms: Vec<EffectTerm> = state.terms.iter().chain(&costly).cloned().collect();
        let Ok((fit, _)) = search.attempt_under(&state.machine, &terms, state.fit.correlation, observe)? else {
            continue;
        };
        let without = &state.fit.model;
        let Some(cost) = Cost::of(without, &fit.model, search.campaign) else { continue };
        let widened = match fit.model.parts().effects.iter().any(|own| is_out(own) && is_of(&costly, own)) {
            true => everywhere(&aside.model, &cost),
            false => place_by_place(&aside.model, (without, &fit.model), is_out, &cost),
        };
        aside.model = widened.map_err(IdentifyError::from)?;
        aside.terms.extend(costly);
    }
    Ok(aside)
}

/// What is only a course in time may do as much anywhere.
fn everywhere(model: &MachineModel, cost: &Cost) -> Result<MachineModel, ModelError> {
    let by_axis_m = (cost.moved_m2 / 3.0).sqrt();
    model.with_unexplained(model.parts().quality.unexplained_m.map(|own_m| own_m.hypot(by_axis_m)))
}

fn place_by_place(
    model: &MachineModel,
    (without, with): (&MachineModel, &MachineModel),
    is_out: &dyn Fn(&FittedEffect) -> bool,
    cost: &Cost,
) -> Result<MachineModel, ModelError> {
    let (without, with) = (without.without(is_out)?, with.without(is_out)?);
    mixture::beside(model, (&without, &with), cost.told_share())
}

/// Terms that were too costly and did not go in later, together where they were so together. Of those that read the same the first:
/// another form of it says the same again.
fn one_each(state: &State, withdrawn: &[EffectTerm]) -> Vec<Vec<EffectTerm>> {
    let mut all: Vec<Vec<EffectTerm>> = Vec::new();
    let costly = state.steps.iter().filter_map(|step| match step {
        Step::SetAside { term, is_costly: true, .. } => Some(vec![term.clone()]),
        _ => None,
    });
    for terms in std::iter::once(withdrawn.to_vec()).chain(costly).filter(|terms| !terms.is_empty()) {
        let is_in = |term: &EffectTerm| state.terms.iter().any(|own| is_variant(own, term));
        let is_again = |term: &EffectTerm| all.iter().flatten().any(|other| read_the_same(other, term));
        if !terms.iter().any(|term| is_in(term) || is_again(term)) {
            all.push(terms);
        }
    }
    all
}
