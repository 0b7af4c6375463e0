//! Effects with a name that would have to be larger than anybody believes, and whose size the data hardly tell.
//!
//! Place in the flow: before what was found is judged. An effect that is surely there and larger than believed is said to be so. One of
//! which no parameter is told from zero, or that a free description outdoes, is a description already; if it takes more than its physics
//! can give, it describes something else in a form that is not that, and would go on in that form at other temperatures. So it stays
//! out, with this reason.

use crate::candidates::Candidate;
use crate::error::DiagnoseError;
use crate::options::Progress;
use crate::same_claim::has;
use crate::search::{Search, State};
use crate::step::Step;
use abbe_geometry::effects::ParameterSpec;
use abbe_geometry::model::FittedEffect;
use abbe_identify::{EffectTerm, Identified};
use statrs::distribution::{ContinuousCDF, Normal};

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
        if !is_told || search.is_outdone(state, &round, &candidate)? {
            state.take_out(term, (fit, round, rest), because);
        }
    }
    Ok(())
}

/// What a term was found as that is larger than believed, in words, and whether its size is told; `None` where it is not, or was not found.
fn larger_than_believed(state: &State, term: &EffectTerm, significance: f64) -> Option<(Candidate, String, bool)> {
    let (fitted, u) = of_fit(&state.fit, term)?;
    let specs = fitted.effect.parameters();
    let candidate = state.steps.iter().rev().find_map(|step| match step {
        Step::Added { term: added, candidate, .. } if has(std::slice::from_ref(term), added) => Some(candidate),
        _ => None,
    })?;
    let size = |((spec, value), u): ((&ParameterSpec, &f64), f64)| Size { value: *value, u, plausible: spec.plausible };
    let sizes: Vec<Size> = specs.iter().zip(&fitted.parameters).zip(u).map(size).collect();
    let (spec, size) = larger(&sizes).map(|k| (&specs[k], &sizes[k]))?;
    let because = format!(
        "it only describes, and would have to be larger than is plausible: {} is {:.2e} {}, beyond {:.2e}",
        spec.name, size.value, spec.unit, size.plausible
    );
    Some((candidate.as_ref().clone(), because, is_told(&sizes, candidate.trials, significance)))
}

/// A fitted parameter, with the magnitude beyond which it is not believed.
struct Size {
    value: f64,
    u: f64,
    plausible: f64,
}

/// The place of a parameter that is larger than believed.
fn larger(sizes: &[Size]) -> Option<usize> {
    sizes.iter().position(|size| size.value.abs() > size.plausible)
}

/// Whether one of the parameters is told from zero, of an effect that was chosen among so many.
fn is_told(sizes: &[Size], trials: usize, significance: f64) -> bool {
    let most = sizes.iter().map(|size| (size.value / size.u).abs()).fold(0.0, f64::max);
    2.0 * Normal::standard().cdf(-most) * (trials * sizes.len()) as f64 <= significance
}

/// A term as it was fitted, with the standard uncertainty of each of its parameters.
fn of_fit<'f>(fit: &'f Identified, term: &EffectTerm) -> Option<(&'f FittedEffect, Vec<f64>)> {
    let mut first = fit.model.layout().len();
    for fitted in &fit.model.parts().effects {
        let count = fitted.parameters.len();
        if fitted.effect.name() == term.effect.name() && fitted.shape == term.shape {
            let u = (first..first + count).map(|k| fit.model.covariance(k, k).max(0.0).sqrt());
            return Some((fitted, u.collect()));
        }
        first += count;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bow of 247 ± 88 µrad/(m·K), and a lean beside it, by one of 84 pairs of temperatures: 200 are believed.
    #[test]
    fn regress_what_is_larger_than_believed_and_hardly_told_stays_out() {
        let bow = |value: f64, u: f64| {
            vec![Size { value, u, plausible: 200e-6 }, Size { value: 4.4e-6, u: 9.2e-6, plausible: 200e-6 }]
        };
        let judged = |sizes: Vec<Size>| (larger(&sizes), is_told(&sizes, 84, 0.01));
        assert_eq!(judged(bow(247e-6, 88e-6)), (Some(0), false));
        assert_eq!(judged(bow(-247e-6, 88e-6)), (Some(0), false));
        assert_eq!(
            judged(bow(247e-6, 20e-6)),
            (Some(0), true),
            "it is surely there, and said to be larger than believed"
        );
        assert_eq!(judged(bow(150e-6, 88e-6)), (None, false), "a description that may be");
    }
}
