//! Another sensor in the place of one that was chosen while other effects were still missing.
//!
//! Place in the flow: where a round of [`crate::search`] lets nothing more in. Sensors of a machine go together, so that the first
//! effect takes whichever imitates the missing ones best. Beside the wrong one the right one has little left to explain, and is set
//! aside. So each term is taken out once more, and where the same effect by another quantity makes the data far more likely beside all
//! the rest, and passes the same gate, it takes the place. Likelihood rises with each exchange: the search ends.

use crate::candidates::{Candidate, proposals, score_all};
use crate::error::DiagnoseError;
use crate::gate::{self, Verdict};
use crate::named::named;
use crate::options::Progress;
use crate::same_claim::{has, is_of_its_kind};
use crate::search::{Search, State};
use crate::step::Step;
use crate::worth;
use abbe_identify::{EffectTerm, Identified};

/// Twice the log likelihood that an exchange has to gain: twenty times as likely. What is closer is averaged in the end.
const FAR_MORE: f64 = 6.0;

/// Exchanges one term, if that is far more likely; `base` are the model's own terms, which stay. False where none was.
pub(crate) fn one<'a>(
    search: &Search<'a>,
    state: &mut State<'a>,
    base: &[EffectTerm],
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<bool, DiagnoseError> {
    // Alone it was chosen beside all that the model has.
    if state.terms.iter().filter(|term| !has(base, term)).count() < 2 {
        return Ok(false);
    }
    for index in 0..state.terms.len() {
        if has(base, &state.terms[index]) {
            continue;
        }
        if let Some(other) = better(search, state, index, observe)? {
            let out = std::mem::replace(&mut state.terms[index], other.candidate.term.clone());
            state.set_aside.clear();
            (state.fit, state.round) = (other.fit, other.round);
            let was = named(other.candidate.known.title, &out.shape);
            state.steps.push(Step::Noted(format!("exchanged {was}: another quantity makes the data far more likely")));
            state.steps.push(Step::Added {
                term: other.candidate.term.clone(),
                p_corrected: (other.candidate.score.p_value * other.candidate.trials as f64).min(1.0),
                candidate: Box::new(other.candidate),
                rivals: Vec::new(),
                verdict: other.verdict,
            });
            return Ok(true);
        }
    }
    Ok(false)
}

/// What takes the place of a term.
struct Other<'a> {
    candidate: Candidate,
    fit: Identified,
    round: crate::candidates::Round<'a>,
    verdict: Verdict,
}

fn better<'a>(
    search: &Search<'a>,
    state: &State<'a>,
    index: usize,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Option<Other<'a>>, DiagnoseError> {
    let term = &state.terms[index];
    let alike: Vec<_> = proposals(&state.machine, &search.context)?
        .into_iter()
        .filter(|(_, other, _)| is_by_another(other, term) && !has(&state.terms, other))
        .collect();
    let Some((known, _, trials)) = alike.first().cloned() else { return Ok(None) };
    let mut others = state.terms.clone();
    others.remove(index);
    let Ok((fit_without, without)) = search.attempt_under(&state.machine, &others, state.fit.correlation, observe)?
    else {
        return Ok(None);
    };
    let own = score_all(&without, vec![(known, term.clone(), trials)])?;
    let own = own.first().map_or(0.0, |own| own.score.reduction);
    let scored = score_all(&without, alike)?;
    let best = scored.into_iter().max_by(|a, b| a.score.reduction.total_cmp(&b.score.reduction));
    let Some(candidate) = best.filter(|best| best.score.reduction > own + FAR_MORE) else { return Ok(None) };
    others.insert(index, candidate.term.clone());
    let Ok((fit, round)) = search.attempt_under(&state.machine, &others, state.fit.correlation, observe)? else {
        return Ok(None);
    };
    let gains = search.gain_alike(&state.fit, &fit).is_ok_and(|gain| gain > FAR_MORE);
    let added = std::slice::from_ref(&candidate.term);
    let verdict = gate::judge(&without, &round, search.campaign, added);
    let is_refused =
        verdict.refused.is_some() || worth::refusal(added, &fit_without.model, &fit.model, search.campaign).is_some();
    Ok((gains && !is_refused).then_some(Other { candidate, fit, round, verdict }))
}

/// The same effect on the same axis, by another quantity, and no freer.
fn is_by_another(other: &EffectTerm, term: &EffectTerm) -> bool {
    let axis = |term: &EffectTerm| term.shape.0.get("axis").cloned();
    let reads = |term: &EffectTerm| term.effect.reads();
    other.effect.name() == term.effect.name()
        && axis(other) == axis(term)
        && other.effect.parameters().len() == term.effect.parameters().len()
        && reads(other) != reads(term)
        && is_of_its_kind(other, term)
}
