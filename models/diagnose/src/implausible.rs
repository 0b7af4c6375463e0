//! Effects with a name that would have to be larger than anybody believes, and whose size the data hardly tell.
//!
//! Place in the flow: before what was found is judged. An effect that is surely there and larger than believed is said to be so. One of
//! which no parameter is told from zero, or that a free description outdoes, is a description already; if it takes more than its physics
//! can give, it describes something else in a form that is not that, and would go on in that form at other temperatures. So it stays
//! out, with this reason.

use crate::candidates::Candidate;
use crate::diagnosis::FoundParameter;
use crate::error::DiagnoseError;
use crate::options::Progress;
use crate::search::{Search, State};
use crate::sizes;
use crate::step::added;
use abbe_identify::EffectTerm;

/// Takes such effects out; `base` are the model's own terms, which stay.
pub(crate) fn hold<'a>(
    search: &Search<'a>,
    state: &mut State<'a>,
    base: &[EffectTerm],
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<(), DiagnoseError> {
    for term in state.beside(base).into_iter().rev() {
        let Some((candidate, because, is_told)) = larger_than_believed(state, &term, search.options.significance)
        else {
            continue;
        };
        let rest = state.all_but(&term);
        let Ok((fit, round)) = search.attempt_under(&state.machine, &rest, state.fit.correlation, observe)? else {
            continue;
        };
        if !is_told || search.is_outdone(state, &round, (&candidate, 0))? {
            state.take_out(term, (fit, round, rest), because);
        }
    }
    Ok(())
}

/// What a term was found as that is larger than believed, in words, and whether its size is told; `None` where it is not, or was not found.
fn larger_than_believed(state: &State, term: &EffectTerm, significance: f64) -> Option<(Candidate, String, bool)> {
    let parameters = sizes::of_term(&state.fit.model, term)?;
    let candidate = added(state, term)?.candidate;
    let larger = larger(&parameters)?;
    let because = format!(
        "it only describes, and would have to be larger than is plausible: {} is {:.2e} {}, beyond {:.2e}",
        larger.name, larger.value, larger.unit, larger.plausible
    );
    let tests = candidate.trials * parameters.len();
    Some((candidate.clone(), because, sizes::is_told(&parameters, tests, significance)))
}

/// The first parameter that is larger than believed.
fn larger(parameters: &[FoundParameter]) -> Option<&FoundParameter> {
    parameters.iter().find(|parameter| !parameter.is_plausible())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bow of 247 ± 88 µrad/(m·K), and a lean beside it, by one of 84 pairs of temperatures: 200 are believed.
    #[test]
    fn regress_what_is_larger_than_believed_and_hardly_told_stays_out() {
        let size = |value: f64, u: f64| FoundParameter {
            name: "bow".to_owned(),
            unit: "rad/(m K)",
            value,
            u,
            plausible: 200e-6,
        };
        let bow = |value: f64, u: f64| vec![size(value, u), size(4.4e-6, 9.2e-6)];
        let judged =
            |sizes: Vec<FoundParameter>| (larger(&sizes).map(|one| one.value), sizes::is_told(&sizes, 168, 0.01));
        assert_eq!(judged(bow(247e-6, 88e-6)), (Some(247e-6), false));
        assert_eq!(judged(bow(-247e-6, 88e-6)), (Some(-247e-6), false));
        assert_eq!(
            judged(bow(247e-6, 20e-6)),
            (Some(247e-6), true),
            "it is surely there, and said to be larger than believed"
        );
        assert_eq!(judged(bow(150e-6, 88e-6)), (None, false), "a description that may be");
    }
}
