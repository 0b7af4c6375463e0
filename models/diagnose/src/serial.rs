//! What was found, held once more against correlated noise.
//!
//! Place in the flow: the end of [`crate::search`]. The search takes noise to be white, and so finds whatever it looks for in
//! noise correlated in time or along lines; but such noise may not be allowed for beforehand either, since what a
//! model lacks looks just like it. So it is asked of what is left once all that was found is fitted. Where that is white,
//! nothing changes. Where it is correlated, noise and effects are fitted side by side, and an effect stays only if it
//! earns its parameters beside that noise; the weakest goes first, and the noise is asked again after each. A description without a
//! name that leaves a third of the misfit or more is not the cause of it, whatever it earns. What then is left is
//! either noise or a cause that no candidate describes: nobody can tell from these data, and the fit counts it as noise
//! whose size stands in every corrected coordinate.

use crate::error::DiagnoseError;
use crate::options::Progress;
use crate::same_claim::has;
use crate::search::{Search, State};
use crate::step::Step;
use crate::wald;
use abbe_identify::{EffectTerm, Identified, correlation_left};

/// Share of the misfit that there was before anything was found, beyond noise, from which much is left.
const MUCH: f64 = 1.0 / 3.0;
/// The same from which most is left: then what was found, whatever its name, was found in something else.
const MOST: f64 = 0.6;
/// χ² per degree of freedom before anything was found from which the misfit, and not the noise, tells how much is left.
const LARGE: f64 = 2.0;

/// Takes out what does not stand beside correlated noise; `base` are the model's own, which stay.
pub(crate) fn hold<'a>(
    search: &Search<'a>,
    state: &mut State<'a>,
    (base, first_chi2_per_dof): (&[EffectTerm], f64),
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<(), DiagnoseError> {
    loop {
        let Some(noise) = correlation_left(&state.fit, search.instrument, search.campaign) else { return Ok(()) };
        let (fit, round) = match search.attempt_under(&state.machine, &state.terms, Some(noise), observe)? {
            Ok(fitted) => fitted,
            Err(problem) => {
                state.steps.push(Step::Noted(format!(
                    "what is left is correlated, but correlated noise cannot be fitted beside the rest: {problem}"
                )));
                return Ok(());
            }
        };
        let Some((weakest, because)) = weakest(search, state, &fit, (base, first_chi2_per_dof)) else {
            state.steps.push(Step::Noted(format!(
                "what is left is correlated (neighbours on a line {:+.2}): it is noise, or a cause whose form no candidate \
                 has; all figures allow for it",
                noise.of_neighbours(search.campaign)
            )));
            (state.fit, state.round, state.named) = (fit, round, None);
            return Ok(());
        };
        let term = state.terms.remove(weakest);
        match search.attempt(&state.machine, &state.terms, observe)? {
            Ok((fit, round)) => (state.fit, state.round, state.named) = (fit, round, None),
            Err(problem) => {
                state.terms.insert(weakest, term);
                state.steps.push(Step::Noted(format!("there is no fit without a doubtful term: {problem}")));
                return Ok(());
            }
        }
        state.steps.push(Step::set_aside(term, because));
    }
}

/// The found term that goes next: where much is left, one that only describes and has no name; where most is left, any; else the
/// one that earns least beside this noise, if it does not earn its parameters and the search for it.
fn weakest(
    search: &Search,
    state: &State,
    fit: &Identified,
    (base, first_chi2_per_dof): (&[EffectTerm], f64),
) -> Option<(usize, String)> {
    let left = fit.evidence.chi2_per_dof - 1.0;
    if left > MUCH * (first_chi2_per_dof - 1.0) {
        let describes = |term: &EffectTerm| !has(base, term) && term.shape.0.contains_key("p");
        if let Some(index) = state.terms.iter().rposition(describes) {
            let because = "it only describes, and much of what is missing is correlated beside it: it is not the cause";
            return Some((index, because.to_owned()));
        }
    }
    let is_found = |index: &usize| !has(base, &state.terms[*index]);
    if first_chi2_per_dof > LARGE
        && left > MOST * (first_chi2_per_dof - 1.0)
        && let Some(index) = (0..state.terms.len()).rev().find(is_found)
    {
        let because = "most of what is missing is correlated beside it: what it explains may well be a part of that";
        return Some((index, because.to_owned()));
    }
    let rows = fit.weights.iter().filter(|w| **w > 0.0).count();
    let earned = |(index, wald): (usize, wald::Wald)| {
        let price = wald.degrees as f64 * (rows.max(2) as f64).ln() + 2.0 * (trials(state, index) as f64).ln();
        (index, wald.statistic - price, wald.degrees)
    };
    let walds = wald::of_terms(fit).into_iter().enumerate();
    let found = walds.filter(|(index, _)| is_found(index)).map(earned);
    let (index, earned, degrees) = found.min_by(|a, b| a.1.total_cmp(&b.1))?;
    (earned < search.options.least_evidence || degrees == 0)
        .then(|| (index, "beside correlated noise, which the readings show, it is no more than chance".to_owned()))
}

/// Shapes among which the term at this place was chosen.
fn trials(state: &State, index: usize) -> usize {
    let own = &state.terms[index];
    let of = |step: &Step| match step {
        Step::Added { term, candidate, .. } if has(std::slice::from_ref(own), term) => Some(candidate.trials),
        _ => None,
    };
    state.steps.iter().rev().find_map(of).unwrap_or(1)
}
