//! What the data show and do not tell from the machine's own errors: it corrects nothing, and stands in the uncertainty.
//!
//! Place in the flow: the end of [`crate::diagnose()`], on the model to correct with. A load that lay there while one station stood bends the
//! machine, and stations, angles and bows of the machine take most of that. To adopt the effect would ask of every coordinate what nobody
//! knows of it ([`crate::worth`]); to leave it out makes coordinates wrong by what it does, at loads that few stations saw by all of it.
//! What the fit with it moves them by is how large it shows; beside that counts as much again of what is not known of it
//! ([`abbe_geometry::mixture::beside`]).

use crate::error::DiagnoseError;
use crate::options::Progress;
use crate::same_claim::is_variant;
use crate::search::{Search, State};
use crate::step::Step;
use crate::worth::Cost;
use abbe_geometry::mixture;
use abbe_geometry::model::MachineModel;
use abbe_identify::{EffectTerm, IdentifyError, is_expansion};

/// The model with all of it in its uncertainty; `withdrawn` were too costly together.
pub(crate) fn told(
    search: &Search,
    state: &State,
    (model, withdrawn): (MachineModel, &[EffectTerm]),
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<MachineModel, DiagnoseError> {
    let mut model = model;
    // Of a scale that stretches the uncertainty has what these data leave open.
    let is_held =
        |term: &EffectTerm| is_expansion(term.effect.as_ref(), &state.fit, (search.instrument, search.campaign));
    for costly in one_each(state, withdrawn) {
        if costly.iter().all(is_held) {
            continue;
        }
        let terms: Vec<EffectTerm> = state.terms.iter().cloned().chain(costly).collect();
        let Ok((fit, _)) = search.attempt_under(&state.machine, &terms, state.fit.correlation, observe)? else {
            continue;
        };
        let without = &state.fit.model;
        let Some(cost) = Cost::of(without, &fit.model, search.campaign) else { continue };
        model = mixture::beside(&model, (without, &fit.model), cost.told_share()).map_err(IdentifyError::from)?;
    }
    Ok(model)
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

fn read_the_same(a: &EffectTerm, b: &EffectTerm) -> bool {
    let reads = b.effect.reads();
    a.effect.reads().iter().any(|name| reads.contains(name))
}
