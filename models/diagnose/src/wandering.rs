//! What of a machine that wanders is said, and what stands in the uncertainty.
//!
//! Place in the flow: near the end of [`crate::diagnose()`], on what the search ended with; [`crate::wander`] looks.

use crate::candidates::Round;
use crate::error::DiagnoseError;
use crate::options::{DiagnoseOptions, Progress};
use crate::same_claim::has;
use crate::search::{Search, State};
use crate::tomorrow::is_course_beside;
use crate::wander::{self, Wander};
use abbe_geometry::model::FittedEffect;
use abbe_identify::{EffectTerm, Identified};

/// Significance that every probability passes.
const CERTAIN: f64 = 1.0;

/// What the machine does in a course that no effect describes: what is said of it, and what stands in the uncertainty. An effect that is only
/// a course in time corrects nothing, so that what it describes belongs there as well. Where nothing else was found, so does what the fit that the
/// search began with shows: noise that hangs together explains a slow change as well as the machine does, and nobody knows which it is.
pub(crate) fn both(
    search: &Search,
    state: &State,
    (start, base): (&Identified, &[EffectTerm]),
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<(Option<Wander>, Option<Wander>), DiagnoseError> {
    let find = |fit: &Identified, round: &Round, observe: &mut dyn FnMut(Progress) -> bool| {
        let mut go_on = || observe(Progress::Scoring { round: 1, effects: state.terms.len() });
        wander::find((&fit.model, round), search.campaign, &search.context, search.options, &mut go_on)
    };
    let said = find(&state.fit, &state.round, observe)?;
    let is_course = |fitted: &&FittedEffect| is_course_beside(base, fitted, search.campaign);
    let effects = &state.fit.model.parts().effects;
    let kept: Vec<EffectTerm> = effects.iter().filter(|fitted| !is_course(fitted)).map(EffectTerm::of).collect();
    let is_as_at_the_start = kept.iter().all(|term| has(base, term));
    let or_in_time = |found: Option<Wander>| match found {
        None => in_time(search, state, start, is_as_at_the_start),
        found => Ok(found),
    };
    if kept.len() == effects.len() {
        return Ok((said.clone(), or_in_time(said)?));
    }
    match search.attempt_under(&state.machine, &kept, state.fit.correlation, observe)? {
        Ok((fit, round)) => {
            let without = find(&fit, &round, observe)?;
            Ok((said.or_else(|| without.clone()), or_in_time(without)?))
        }
        Err(_) => Ok((said.clone(), or_in_time(said)?)),
    }
}

/// What shows in the course of time alone: of the fit that the search began with, where nothing else was found, as an identification asks; and of a
/// course that was set aside, which is there, whatever it is.
fn in_time(
    search: &Search,
    state: &State,
    start: &Identified,
    is_as_at_the_start: bool,
) -> Result<Option<Wander>, DiagnoseError> {
    let of =
        |fit: &Identified, significance: f64| wander::in_time(fit, search.instrument, search.campaign, significance);
    let at_the_start = if is_as_at_the_start { of(start, DiagnoseOptions::default().significance)? } else { None };
    if at_the_start.is_some() || !state.has_course_set_aside() {
        return Ok(at_the_start);
    }
    Ok(of(&state.fit, CERTAIN)?.and_then(Wander::of_what_was_set_aside))
}
