//! A step of the machine in the place of one of several effects that were found.
//!
//! Place in the flow: before what was found is judged. Something that changed overnight is described by whatever changed overnight as well: beside a
//! true expansion, another sensor takes the step. In the place of all that was found the step explains less, and beside all of it nothing
//! is left of it. So each effect is left out alone, the last one first, and the step competes with that one.

use super::{Competing, find};
use crate::candidates::columns_of;
use crate::error::DiagnoseError;
use crate::options::Progress;
use crate::search::{Search, State};
use abbe_identify::EffectTerm;

/// Takes out the effect that a step of the machine explains better than it does; `base` are the model's own terms, which stay.
pub(crate) fn hold<'a>(
    search: &Search<'a>,
    state: &mut State<'a>,
    base: &[EffectTerm],
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<(), DiagnoseError> {
    let added = state.beside(base);
    if added.len() < 2 {
        return Ok(());
    }
    for term in added.into_iter().rev() {
        let rest = state.all_but(&term);
        let Ok((fit, round)) = search.attempt_under(&state.machine, &rest, state.fit.correlation, observe)? else {
            continue;
        };
        let instead = Competing { found: Some(columns_of(&round, &[&term])?), ..Competing::default() };
        let mut go_on = || observe(Progress::Scoring { round: 1, effects: rest.len() });
        if find(&round, search.campaign, search.options, &instead, &mut go_on)?.is_some() {
            let because = "a step of the machine explains more than it does".to_owned();
            state.take_out(term, (fit, round, rest), because);
            return Ok(());
        }
    }
    Ok(())
}
