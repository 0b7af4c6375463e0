//! What a search comes to: its model with all that stands in its uncertainty.
//!
//! Place in the flow: the end of [`crate::diagnose()`], once for what the search found, and once more without it where that costs more than
//! it tells, or a step of the machine explains more. Lengths in m.

use crate::candidates::{Round, columns_of};
use crate::competing::{self, Competing, Without};
use crate::diagnosis::Unseen;
use crate::error::DiagnoseError;
use crate::explanation::Explanation;
use crate::late::Late;
use crate::machine_step::{self, MachineStep};
use crate::options::Progress;
use crate::same_claim::{has, is_of};
use crate::search::{Search, State};
use crate::tomorrow::{self, is_course_beside};
use crate::wander::{Slow, Wander};
use crate::zero_of_scale::ZeroOfScale;
use crate::{floor, kind, noise, wandering};
use abbe_geometry::model::{FittedEffect, MachineModel, ModelError};
use abbe_geometry::unseen_expansion::UnseenExpansions;
use abbe_identify::{EffectTerm, Identified, IdentifyError, unseen_expansions};

/// What a search comes to: its model with all that stands in its uncertainty.
pub(crate) struct Ended<'a> {
    pub(crate) machine_step: Option<MachineStep>,
    pub(crate) wander: Option<Wander>,
    pub(crate) may_wander: Option<Wander>,
    pub(crate) slow: Slow,
    pub(crate) zeros: Vec<ZeroOfScale>,
    pub(crate) late: Option<Late>,
    /// What the residual says beside all that was found.
    pub(crate) left: noise::Detection,
    /// What was found, each a cause or a description.
    pub(crate) kinds: Vec<kind::Judged>,
    /// The model of the search.
    pub(crate) told: MachineModel,
    /// What it leaves unexplained where stands that move are just that (m).
    pub(crate) stands_alone: [f64; 3],
    /// Of each term, the fit without it, and what competes with it.
    pub(crate) without: Vec<Option<Without<'a>>>,
    pub(crate) competing: Vec<Vec<Competing>>,
    /// The mean of all that compete, to correct with.
    pub(crate) model: MachineModel,
}

impl<'a> Ended<'a> {
    pub(crate) fn of(
        search: &Search<'a>,
        state: &State<'a>,
        (start, alike, base): (&Identified, &Round, &[EffectTerm]),
        on_unseen: Option<&Unseen>,
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<Ended<'a>, DiagnoseError> {
        let campaign = search.campaign;
        let machine_step = machine_step(search, state, (alike, base), observe)?;
        let (wander, widening) = match machine_step {
            // Its courses would describe the step.
            Some(_) => (None, None),
            None => wandering::both(search, state, (start, base), observe)?,
        };
        let may_wander = widening.clone().filter(|_| wander.is_none());
        let zeros = ZeroOfScale::all(&state.fit.model, &state.round)?;
        let is_found = |fitted: &FittedEffect| !is_of(base, fitted);
        let found = state.fit.model.parts().effects.iter().filter(|fitted| is_found(fitted));
        let late = Late::of(found, &state.round, campaign)?;
        let without = competing::without_each(search, state, base, observe)?;
        // What is only a course in time corrects nothing, and a step is no slow change.
        let may_be_slow =
            |fitted: &FittedEffect| machine_step.is_none() && !is_course_beside(base, fitted, search.campaign);
        let slow = Slow::of((search, state), &without, &may_be_slow, observe)?;
        let widened = |model: MachineModel| {
            let model = widening.as_ref().map_or(Ok(model.clone()), |wander| wander.told(model))?;
            let model = slow.told(model)?;
            let model = state.open_waves.iter().try_fold(model, |model, wave| wave.told(model))?;
            let model = zeros.iter().try_fold(model, |model, zero| zero.told(model))?;
            late.as_ref().map_or(Ok(model.clone()), |late| late.told(model))
        };
        let left = noise::detect(&state.round, campaign, &state.fit.evidence);
        let sized = widened(state.fit.model.clone()).map_err(IdentifyError::from)?;
        let mut kinds = kind::judged(search, state, (&sized, &is_found), &without, &left)?;
        // A step that explains more than all of them: none is the cause.
        if machine_step.as_ref().is_some_and(|step| step.outdoes_found) {
            kinds.iter_mut().for_each(|own| own.kind = Explanation::Empirical);
        }
        kinds.iter_mut().filter(|own| slow.outdoes(&own.fitted)).for_each(|own| own.kind = Explanation::Empirical);
        let bumps: Vec<EffectTerm> =
            kinds.iter().filter(|own| own.is_bump()).map(|own| EffectTerm::of(&own.fitted)).collect();
        let is_bump = |fitted: &FittedEffect| is_of(&bumps, fitted);
        let told_of = |is_bump: &dyn Fn(&FittedEffect) -> bool| {
            tomorrow::told(state.fit.model.clone(), &state.round, campaign, (&is_found, is_bump))
        };
        let [told, stands_alone] = [told_of(&is_bump), told_of(&|fitted| fitted.effect.moves_stand())];
        let floor_m = floor::unexplained_m(&state.round, campaign);
        let unseen = open_expansions(search, (start, &state.fit), base);
        let whole = |told: Result<MachineModel, ModelError>| -> Result<MachineModel, IdentifyError> {
            let told = told
                .and_then(|model| with_unexplained(model, on_unseen, floor_m))
                .and_then(|model| model.with_unseen_expansions(unseen.clone()))
                .and_then(|model| machine_step.as_ref().map_or(Ok(model.clone()), |step| step.told(model)))
                .and_then(widened);
            Ok(told?)
        };
        let (told, stands_alone) = (whole(told)?, whole(stands_alone)?.parts().quality.unexplained_m);
        let (averaged, competing) = competing::averaged(search, state, (&told, &widened), &without, observe)?;
        let model = averaged.without(|fitted| is_course_beside(base, fitted, campaign));
        let model = model.map_err(IdentifyError::from)?;
        Ok(Ended {
            machine_step,
            wander,
            may_wander,
            slow,
            zeros,
            late,
            left,
            kinds,
            told,
            stands_alone,
            without,
            competing,
            model,
        })
    }

    /// The model as it is weighed against another: the path of the machine's zero that may stand behind stands that move is a rigid motion of all
    /// points, and is there or not whether or not it is told.
    pub(crate) fn weighed(&self) -> Result<MachineModel, IdentifyError> {
        let own_m = self.model.parts().quality.unexplained_m;
        Ok(self.model.with_unexplained(std::array::from_fn(|d| own_m[d].min(self.stands_alone[d])))?)
    }
}

/// The model with what it leaves on lines that no step of the search saw, or that its own fit did not see, where that is more than
/// on those that it saw.
fn with_unexplained(
    model: MachineModel,
    unseen: Option<&Unseen>,
    floor_m: [f64; 3],
) -> Result<MachineModel, ModelError> {
    let own_m = model.parts().quality.unexplained_m;
    let unseen_m = unseen.map_or([0.0; 3], |unseen| unseen.unexplained_m);
    model.with_unexplained(std::array::from_fn(|d| own_m[d].max(unseen_m[d]).max(floor_m[d])))
}

/// What the data leave open of expansions. What is only a course in time may be one, and corrects nothing: beside it they look smaller than
/// they may be, so that the fit that the search began with has a say.
fn open_expansions(search: &Search, (start, fit): (&Identified, &Identified), base: &[EffectTerm]) -> UnseenExpansions {
    let is_out = |fitted: &FittedEffect| is_course_beside(base, fitted, search.campaign);
    let of = |fit: &Identified| unseen_expansions(fit, search.instrument, search.campaign, &|fitted| !is_out(fitted));
    let mut all = of(fit);
    if fit.model.parts().effects.iter().any(is_out) {
        let before = of(start);
        let alike = |sensor: &str| before.by_sensor.iter().find(|other| other.sensor == sensor);
        all.by_sensor.iter_mut().for_each(|own| {
            if let Some(other) = alike(&own.sensor) {
                own.widen(other)
            }
        });
    }
    all
}

/// A step of the machine, in place of all that the search found or beside it.
fn machine_step(
    search: &Search,
    state: &State,
    (alike, base): (&Round, &[EffectTerm]),
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Option<MachineStep>, DiagnoseError> {
    let found: Vec<&EffectTerm> = state.terms.iter().filter(|term| !has(base, term)).collect();
    let competing = |round: &Round, found: &[&EffectTerm]| -> Result<machine_step::Competing, DiagnoseError> {
        let found = if found.is_empty() { None } else { Some(columns_of(round, found)?) };
        let set_aside = state.causes_set_aside().map(|term| columns_of(round, &[term])).collect::<Result<_, _>>()?;
        Ok(machine_step::Competing { found, set_aside })
    };
    let mut go_on = || observe(Progress::Scoring { round: 1, effects: found.len() });
    match machine_step::find(alike, search.campaign, search.options, &competing(alike, &found)?, &mut go_on)? {
        None if !found.is_empty() => {
            let beside = competing(&state.round, &[])?;
            machine_step::find(&state.round, search.campaign, search.options, &beside, &mut go_on)
        }
        step => Ok(step),
    }
}
