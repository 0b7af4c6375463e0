//! A term taken out of what a search found, with the reason.
//!
//! Place in the flow: the looks at all that was found together, [`crate::implausible`] and [`crate::machine_step::in_place`].

use crate::candidates::Round;
use crate::same_claim::has;
use crate::search::State;
use crate::step::Step;
use abbe_identify::{EffectTerm, Identified};

impl<'a> State<'a> {
    /// All terms but this one.
    pub(crate) fn all_but(&self, term: &EffectTerm) -> Vec<EffectTerm> {
        self.terms.iter().filter(|own| !has(std::slice::from_ref(term), own)).cloned().collect()
    }

    /// Goes on with the fit of the rest.
    pub(crate) fn take_out(
        &mut self,
        term: EffectTerm,
        (fit, round, rest): (Identified, Round<'a>, Vec<EffectTerm>),
        because: String,
    ) {
        (self.fit, self.round, self.terms, self.named) = (fit, round, rest, None);
        self.steps.push(Step::set_aside(term, because));
    }
}
