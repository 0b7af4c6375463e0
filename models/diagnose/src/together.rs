//! All that was found, judged together; what does not hold beside the rest goes.
//!
//! Place in the flow: after the search. Each term passed the gate when it came in, beside what was known then. Together they may
//! still lose: then the weakest term goes whose absence lets the others pass, or the weakest of all, and the rest is judged again.

use crate::candidates::Round;
use crate::diagnose::alike;
use crate::error::DiagnoseError;
use crate::gate;
use crate::options::Progress;
use crate::same_claim::has;
use crate::search::{Search, State};
use crate::step::Step;
use crate::{wald, worth};
use abbe_geometry::machine::Machine;
use abbe_geometry::model::MachineModel;
use abbe_identify::{EffectTerm, Identified};

/// Takes out what keeps the rest from passing; `base` are the model's own terms, which stay.
pub(crate) fn hold<'a>(
    search: &Search<'a>,
    state: &mut State<'a>,
    (machine, first, base): (&Machine, (&MachineModel, &Round<'a>), &[EffectTerm]),
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<(), DiagnoseError> {
    loop {
        let added = state.beside(base);
        if added.len() < 2 {
            return Ok(());
        }
        let before = (first.0, &alike(search, state, (machine, first.1, base), observe)?);
        let Some((because, is_costly)) = refusal(search, before, (&state.fit, &state.round), &added) else {
            return Ok(());
        };
        let Some((out, fit, round)) = without_one(search, state, (before, base), observe)? else { return Ok(()) };
        let term = state.terms.remove(out);
        (state.fit, state.round, state.named) = (fit, round, None);
        let because = format!("beside all else that was found: {because}");
        state.steps.push(Step::set_aside_for(term, (because, is_costly)));
    }
}

/// Why these terms together stay out, and whether for what they cost; `None` where they may go in.
fn refusal(
    search: &Search,
    (model, before): (&MachineModel, &Round),
    (fit, after): (&Identified, &Round),
    added: &[EffectTerm],
) -> Option<(String, bool)> {
    let refused = gate::judge(before, after, search.campaign, added).refused.map(|words| (words, false));
    refused.or_else(|| worth::refusal(added, model, &fit.model, search.campaign).map(|words| (words, true)))
}

/// The term to go and the fit without it: the weakest whose absence lets the rest pass, else the weakest; `None` without a fit.
fn without_one<'a>(
    search: &Search<'a>,
    state: &State<'a>,
    (before, base): ((&MachineModel, &Round<'a>), &[EffectTerm]),
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Option<(usize, Identified, Round<'a>)>, DiagnoseError> {
    let walds = wald::of_terms(&state.fit).into_iter().enumerate();
    let mut found: Vec<(usize, f64)> = walds.map(|(index, wald)| (index, wald.statistic)).collect();
    found.retain(|(index, _)| !has(base, &state.terms[*index]));
    found.sort_by(|a, b| a.1.total_cmp(&b.1));
    let mut weakest = None;
    for (index, _) in found {
        let mut rest = state.terms.clone();
        rest.remove(index);
        let Ok((fit, round)) = search.attempt_under(&state.machine, &rest, state.fit.correlation, observe)? else {
            continue;
        };
        let added: Vec<EffectTerm> = rest.iter().filter(|term| !has(base, term)).cloned().collect();
        if refusal(search, before, (&fit, &round), &added).is_none() {
            return Ok(Some((index, fit, round)));
        }
        weakest = weakest.or(Some((index, fit, round)));
    }
    Ok(weakest)
}
