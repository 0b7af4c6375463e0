//! Explanations that compete with those found, kept instead of thrown away.
//!
//! Place in the flow: the end of [`crate::diagnose()`]. For each effect found, the candidates that explain nearly as much in its
//! place (another effect, another sensor, another time constant, a free dependence) are fitted as it was. Those that pass the same
//! gate are weighed by their restricted marginal likelihood over the same readings,
//!
//! w ∝ exp(−½ (Δ −2 log L)) / trials,
//!
//! and the model that corrects is the mean of all ([`abbe_geometry::mixture`]), whose covariance holds their disagreement. One effect is
//! replaced at a time. An effect of the places of the axes alone does not compete with itself, one axis taken for another: both were
//! measured all over the volume, and disagree on the frame alone, which no reading tells. Lengths in m.

use crate::candidates::{Candidate, Round, score_all};
use crate::context::follows_a_log;
use crate::error::DiagnoseError;
use crate::gate;
use crate::options::Progress;
use crate::same_claim::{has, is_of_its_kind};
use crate::search::{Search, State};
use crate::side_by_side::side_by_side;
use crate::worth;
use abbe_geometry::effects::Shape;
use abbe_geometry::mixture::mixture;
use abbe_geometry::model::{MachineModel, ModelError};
use abbe_identify::{EffectTerm, Identified, IdentifyError};

/// Weight beside the effect found below which an explanation is not kept: it would move a coordinate by a twentieth of what they differ,
/// and ask each sample for one more sensor.
const LEAST: f64 = 0.05;
/// Explanations tried in the place of each effect: each costs a fit.
const MOST_TRIED: usize = 3;

/// An explanation that is nearly as likely as an effect found, in its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Competing {
    /// Name.
    pub name: &'static str,
    /// Name for readers.
    pub title: &'static str,
    /// Its shape.
    pub shape: Shape,
    /// Its share of the mean; what was found has the rest.
    pub weight: f64,
}

/// An explanation in the place of an effect found.
struct Kept {
    said: Competing,
    model: MachineModel,
    /// Weight beside the effects found, which have one.
    weight: f64,
}

/// The fit without an effect found, and its rows.
pub(crate) type Without<'a> = (Identified, Round<'a>);

/// Of each term of the model, the fit without it; `None` of those that the model had before, and where there is no such fit.
pub(crate) fn without_each<'a>(
    search: &Search<'a>,
    state: &State<'a>,
    base: &[EffectTerm],
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Vec<Option<Without<'a>>>, DiagnoseError> {
    let without = |index: usize, observe: &mut dyn FnMut(Progress) -> bool| {
        let mut others = state.terms.clone();
        match has(base, &others.remove(index)) {
            true => Ok(None),
            false => Ok(search.attempt_under(&state.machine, &others, state.fit.correlation, observe)?.ok()),
        }
    };
    side_by_side(state.terms.len(), without, observe)?.into_iter().collect()
}

/// What is to be told to each model that is taken into the mean.
pub(crate) type Told<'t> = &'t dyn Fn(MachineModel) -> Result<MachineModel, ModelError>;

/// The model to correct with, and what it takes the mean of in the place of each term; `found` is the model of the search with what
/// follows the time, and what the others are still to be told.
pub(crate) fn averaged(
    search: &Search,
    state: &State,
    (found, told): (&MachineModel, Told),
    without: &[Option<Without>],
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<(MachineModel, Vec<Vec<Competing>>), DiagnoseError> {
    let one = |index: usize, observe: &mut dyn FnMut(Progress) -> bool| match &without[index] {
        Some(without) => in_place_of(search, state, (index, without), observe),
        None => Ok(Vec::new()),
    };
    let mut all: Vec<Vec<Kept>> =
        side_by_side(without.len(), one, observe)?.into_iter().collect::<Result<_, DiagnoseError>>()?;
    let kept = || all.iter().flatten();
    if kept().next().is_none() {
        return Ok((found.clone(), all.iter().map(|_| Vec::new()).collect()));
    }
    let total = 1.0 + kept().map(|kept| kept.weight).sum::<f64>();
    for kept in all.iter_mut().flatten() {
        kept.model = told(kept.model.clone()).map_err(IdentifyError::from)?;
    }
    let kept = || all.iter().flatten();
    let members: Vec<(f64, &MachineModel)> =
        std::iter::once((1.0, found)).chain(kept().map(|kept| (kept.weight, &kept.model))).collect();
    let model = mixture(&members).map_err(IdentifyError::from)?;
    let share = |kept: &Kept| Competing { weight: kept.weight / total, ..kept.said.clone() };
    Ok((model, all.iter().map(|of_term| of_term.iter().map(share).collect()).collect()))
}

/// What explains nearly as much as one of the terms, fitted in its place.
fn in_place_of(
    search: &Search,
    state: &State,
    (index, (fit_without, without)): (usize, &Without),
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Vec<Kept>, DiagnoseError> {
    let mut others = state.terms.clone();
    let term = others.remove(index);
    let named = search.that_show(without, &search.named(without, &state.machine)?);
    let known = abbe_geometry::effects::known(term.effect.name()).ok_or(DiagnoseError::Singular)?;
    let trials = named.iter().filter(|c| c.known.name == known.name).map(|c| c.trials).max().unwrap_or(1);
    let scored = score_all(without, vec![(known, term.clone(), trials)])?;
    let Some(own) = scored.first() else { return Ok(Vec::new()) };
    let looked = search.look(without, &state.machine)?;
    let free = search.empirical(without, state, &looked)?;
    let least = own.evidence(without.used) - search.options.rival_margin;
    let mut open: Vec<&Candidate> = named.iter().chain(&free).filter(|c| c.evidence(without.used) > least).collect();
    open.retain(|c| !has(&state.terms, &c.term) && is_of_its_kind(&c.term, &term));
    open.retain(|c| !is_seen_as_the_same(&c.term, &term));
    open.retain(|c| !(state.distrusts_log && follows_a_log(&c.term)));
    open.sort_by(|a, b| b.evidence(without.used).total_cmp(&a.evidence(without.used)));
    let mut kept = Vec::new();
    for candidate in open.into_iter().take(MOST_TRIED) {
        let terms: Vec<EffectTerm> = others.iter().chain([&candidate.term]).cloned().collect();
        let Ok((fit, round)) = search.attempt_under(&state.machine, &terms, state.fit.correlation, observe)? else {
            continue;
        };
        let own_term = std::slice::from_ref(&candidate.term);
        let refused = gate::judge(without, &round, search.campaign, own_term).refused;
        if refused.or_else(|| worth::refusal(own_term, &fit_without.model, &fit.model, search.campaign)).is_some() {
            continue;
        }
        let tried = own.trials.max(1) as f64 / candidate.trials.max(1) as f64;
        let weight = weight(search, &state.fit, &fit) * tried.min(1.0);
        if weight < LEAST {
            continue;
        }
        let said = Competing {
            name: candidate.known.name,
            title: candidate.known.title,
            shape: candidate.term.shape.clone(),
            weight,
        };
        kept.push(Kept { said, model: fit.model, weight });
    }
    Ok(kept)
}

/// Whether both are one effect of places alone, without a figure of its own, such as a period, that would tell them apart between places.
fn is_seen_as_the_same(other: &EffectTerm, found: &EffectTerm) -> bool {
    let of_places = |term: &EffectTerm| term.effect.reads().is_empty() && term.shape.figures().next().is_none();
    other.effect.name() == found.effect.name() && of_places(other) && of_places(found)
}

/// Likelihood of the second fit over that of the first, on the readings that the first uses; 0 where it cannot be said. It is at most
/// one: the search chose the first, by what lines left out said and a cause before a description, and a free form always fits better.
fn weight(search: &Search, first: &Identified, second: &Identified) -> f64 {
    search.gain_alike(first, second).map_or(0.0, |gain| (0.5 * gain).min(0.0).exp())
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_geometry::effects::Shape;
    use abbe_geometry::machine::Machine;

    fn term(name: &str, shape: Shape) -> EffectTerm {
        EffectTerm::new(name, shape, &machine()).unwrap()
    }

    fn machine() -> Machine {
        crate::tests::machine()
    }

    /// The mean of a sag in three forms was uncertain by 31 µm at an error of 2: the forms agree on all but the frame.
    #[test]
    fn regress_an_effect_of_places_is_not_averaged_with_itself() {
        let sag = |carrying: &str, carriage: &str, form: &str| {
            let shape = Shape::new().text("carrying", carrying).text("carriage", carriage);
            term("carriage_sag", shape.text("about", "x").text("form", form))
        };
        let wave = |period_m: f64| {
            let shape = Shape::new().text("axis", "x").number("period_m", period_m);
            term("periodic_scale", shape)
        };
        let expansion = |sensor: &str| term("scale_expansion", Shape::new().text("axis", "x").text("sensor", sensor));
        assert!(is_seen_as_the_same(&sag("z", "y", "turn"), &sag("y", "z", "lean")));
        assert!(!is_seen_as_the_same(&wave(0.01), &wave(0.012)), "they part between the places that were measured");
        assert!(!is_seen_as_the_same(&expansion("temp_air_c"), &expansion("temp_scale_x_c")));
    }
}
