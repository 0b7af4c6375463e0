//! Competing explanations are kept: where others explain the data nearly as well as what was chosen, the model holds all of
//! them, each believed to be as large as the effect that it would explain.
//!
//! Place in the flow: the end of [`crate::search`], before anything is judged. On the data such terms are nearly the same, and
//! what they do together is well known; how it is shared among them is not. So where they differ (another temperature, another
//! load, later in time; range or tip) the corrected coordinate is their average, weighted by prior and likelihood, and its
//! covariance holds their disagreement: both follow from one linear fit with Gaussian priors, whose posterior is
//! exactly that. Nothing changes for whoever corrects.

use crate::candidates::{Candidate, Round};
use crate::error::DiagnoseError;
use crate::options::Progress;
use crate::search::{Search, State, Step, has};
use abbe_identify::EffectTerm;

/// Rivals of one effect kept: each costs parameters, and those that are further behind say the same again.
const MOST_RIVALS: usize = 4;

/// Fits what was found once more together with its rivals; the fit stays as it was where that cannot be done.
pub(crate) fn with_rivals<'a>(
    search: &Search<'a>,
    state: &mut State<'a>,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<(), DiagnoseError> {
    let mut terms = state.terms.clone();
    for (index, rivals) in groups(state) {
        let Some(square) = signal(state, index)? else { continue };
        let own = state.terms[index].clone();
        let open: Vec<EffectTerm> = rivals.iter().map(|r| r.term.clone()).filter(|term| !has(&terms, term)).collect();
        if open.is_empty() {
            continue;
        }
        terms[index] = as_large(&state.round, own, square)?;
        for term in open.into_iter().take(MOST_RIVALS) {
            terms.push(as_large(&state.round, term, square)?);
        }
    }
    if terms.len() == state.terms.len() {
        return Ok(());
    }
    match search.attempt_as_believed(&state.machine, &terms, observe)? {
        Ok((fit, round)) => {
            (state.fit, state.round) = (fit, round);
            state.named = None;
            state.rivals = terms.split_off(state.terms.len());
        }
        Err(problem) => {
            state
                .steps
                .push(Step::Noted(format!("what explains nearly as much cannot be fitted beside it: {problem}")));
        }
    }
    Ok(())
}

/// Each term that was added and stayed, by its place, with what explains nearly as much.
fn groups(state: &State) -> Vec<(usize, Vec<Candidate>)> {
    let of = |step: &Step| match step {
        Step::Added { term, rivals, .. } if !rivals.is_empty() => {
            let same = |t: &EffectTerm| t.effect.name() == term.effect.name() && t.shape == term.shape;
            state.terms.iter().position(same).map(|index| (index, rivals.clone()))
        }
        _ => None,
    };
    state.steps.iter().filter_map(of).collect()
}

/// Mean square of what a term of the fit does to the whitened ranges; `None` where it does nothing.
fn signal(state: &State, index: usize) -> Result<Option<f64>, DiagnoseError> {
    let fitted = state.fit.model.parts().effects.get(index).ok_or(DiagnoseError::Singular)?;
    let columns = state.round.rows.columns(fitted.effect.as_ref())?;
    let value = |k: usize| fitted.parameters.iter().enumerate().map(|(j, p)| columns[(k, j)] * p).sum::<f64>();
    let sum: f64 = used(&state.round).map(|k| value(k).powi(2)).sum();
    Ok(Some(sum / state.round.used.max(1) as f64).filter(|square| *square > 0.0))
}

/// The term with a prior under which it is expected to do as much as this mean square.
fn as_large(round: &Round, term: EffectTerm, square: f64) -> Result<EffectTerm, DiagnoseError> {
    let columns = round.rows.columns(term.effect.as_ref())?;
    let plausible: Vec<f64> = term.effect.parameters().iter().map(|spec| spec.plausible).collect();
    let of = |k: usize| plausible.iter().enumerate().map(|(j, p)| (columns[(k, j)] * p).powi(2)).sum::<f64>();
    let most = used(round).map(of).sum::<f64>() / round.used.max(1) as f64;
    Ok(if most > 0.0 { term.believed((square / most).sqrt()) } else { term })
}

fn used<'r>(round: &'r Round<'_>) -> impl Iterator<Item = usize> + 'r {
    (0..round.rows.len()).filter(|k| round.rows.whitening[*k] > 0.0)
}
