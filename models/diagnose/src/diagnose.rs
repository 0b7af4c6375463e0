//! The diagnosis of a tracer campaign: detect, search, judge, say what cannot be told.
//!
//! Place in the flow: the entry point behind `abbe diagnose` and the monitor's request. Model (its machine and effects)
//! and campaign in, SI, machine frame; nothing is read or written here.

use crate::alias;
use crate::aside;
use crate::candidates::{Candidate, Round, columns_of};
use crate::clock::{self, ClockShift};
use crate::competing::{self, Competing, Without};
use crate::context::read_by;
use crate::cut_off::CutOff;
use crate::diagnosis::{Blocked, Diagnosis, Found, Rival, Unseen};
use crate::error::DiagnoseError;
use crate::explanation::Explanation;
use crate::floor;
use crate::gate::{self, Verdict};
use crate::implausible;
use crate::judge;
use crate::kind;
use crate::lagged_columns::with_lags;
use crate::late::Late;
use crate::machine_step::{self, MachineStep};
use crate::noise;
use crate::options::{DiagnoseOptions, Progress};
use crate::same_claim::{has, is_of};
use crate::search::{Search, State};
use crate::step::{Addition, HELD, Step, added};
use crate::tomorrow::is_course_beside;
use crate::wander::{Slow, Wander};
use crate::wandering;
use crate::zero_of_scale::ZeroOfScale;
use crate::{together, tomorrow, worth};
use abbe_geometry::machine::Machine;
use abbe_geometry::model::{FittedEffect, MachineModel, ModelError};
use abbe_geometry::unseen_expansion::UnseenExpansions;
use abbe_identify::{EffectTerm, Identified, IdentifyError, unseen_expansions};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;

/// Lines per fold below which leaving lines out would starve the fit.
const LINES_PER_FOLD: usize = 5;
/// Next measurements named at most.
const MEASUREMENTS: usize = 12;
/// Why there is no error before and after.
const NOTHING: &str = "nothing was adopted, so that before and after are the same";
/// What decides after a step of the machine.
const AFTER_A_STEP: &str = "the whole campaign again, once what moved the machine is found and fixed";

/// Diagnoses a campaign with the machine's model as it is: its error functions and the effects it already has. By what was not logged at every
/// reading nothing is tried: [`crate::mended`] comes first.
///
/// # Errors
/// What identification refuses, covariates that the model's own effects lack, or [`DiagnoseError::Stopped`].
pub fn diagnose(
    machine: &Machine,
    effects: &[FittedEffect],
    instrument: RangeUncertainty,
    campaign: &Campaign,
    options: &DiagnoseOptions,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Diagnosis, DiagnoseError> {
    // What stands in the uncertainty alone is looked for anew.
    let base: Vec<EffectTerm> = effects.iter().filter(|fitted| fitted.corrects()).map(EffectTerm::of).collect();
    let campaign = &with_lags(campaign, base.iter().flat_map(|term| term.effect.reads()));
    let search = Search::new(instrument, campaign, options);
    let before = search.fit(machine, &base, observe)?;
    let first = search.round(&before)?;
    let detection_before = noise::detect(&first, campaign, &before.evidence);
    let mut state = search.run(before.clone(), first.clone(), base.clone(), observe)?;
    together::hold(&search, &mut state, (machine, (&before.model, &first), &base), observe)?;
    let clock = clock::hold(&search, &mut state, &base, observe)?;
    machine_step::in_place::hold(&search, &mut state, &base, observe)?;
    implausible::hold(&search, &mut state, &base, observe)?;
    let alike = alike(&search, &state, (machine, &first, &base), observe)?;
    let mut judged = Judged::of(&search, machine, (&alike, &base), &state, observe)?;
    let start = (before.clone(), first.clone(), base.clone());
    if let Some(because) = &judged.not_adopted {
        state.withdraw(start.clone(), because);
    }
    let mut ended = Ended::of(&search, &state, (&before, &alike, &base), judged.unseen.as_ref(), observe)?;
    let added = state.beside(&base);
    let of_all = |why: Option<String>| why.map(|because| format!("all that was found together: {because}"));
    let is_outdone = !added.is_empty() && ended.machine_step.as_ref().is_some_and(|step| step.outdoes_found);
    let because = match is_outdone {
        true => Some("a step of the machine explains more than all that was found together".to_owned()),
        false => of_all(worth::refusal(&added, &before.model, &ended.weighed()?, campaign)),
    };
    let mut withdrawn = Vec::new();
    if let Some(because) = because {
        let mut without = state.clone();
        without.withdraw(start.clone(), &because);
        let plain = Ended::of(&search, &without, (&before, &first, &base), None, observe)?;
        let because = match is_outdone {
            true => plain.machine_step.is_some().then_some(because),
            // What is not told of the machine without it costs as well.
            false => of_all(worth::refusal(&added, &plain.model, &ended.weighed()?, campaign)),
        };
        if let Some(because) = because {
            state.withdraw(start, &because);
            if !is_outdone {
                withdrawn = added;
            }
            // What goes may have been a slow change, and that is there without it.
            let model = ended.slow.told(plain.model.clone()).map_err(IdentifyError::from)?;
            ended = Ended { model, ..plain };
            judged =
                Judged { not_adopted: Some(because), unseen: None, unseen_missing: Some(NOTHING.to_owned()), ..judged };
        }
    }
    let is_course = |fitted: &FittedEffect| is_course_beside(&base, fitted, campaign);
    let aside = aside::told(&search, &state, (ended.model, &withdrawn), &is_course, observe)?;
    ended.model = aside.model;
    state.fit.model = ended.told.clone();
    let Ended {
        machine_step,
        wander,
        may_wander,
        slow,
        zeros,
        late,
        left: detection_after,
        kinds,
        without,
        competing,
        model,
        ..
    } = ended;
    let named = match state.named.take() {
        Some(named) => named,
        None => search.named(&state.round, &state.machine)?,
    };
    let last = state.round.clone();
    let enriched = state.is_enriched();
    let others = without.iter().zip(competing).zip(&state.terms).filter(|(_, term)| !has(&base, term));
    let found = found(&search, &state, &kinds, others.map(|(other, _)| other))?;
    let not_identifiable = alias::not_identifiable(&last, &state.fit.model, &named)?;
    let untestable = alias::untestable(&state.machine, &search.context);
    let mut next_measurements = next_measurements(&found, &not_identifiable, &untestable);
    let rejected_lines = rejected_lines(campaign, &state.fit.weights);
    let set_aside = state.set_aside(&aside.terms);
    let structured = enriched || detection_after.has_structure() || !rejected_lines.is_empty();
    let hangs_together = state.fit.correlation.is_some();
    let nothing = found.is_empty() && judged.not_adopted.is_none();
    let quiet = nothing && !structured && machine_step.is_none() && wander.is_none();
    let first = machine_step.iter().map(|_| AFTER_A_STEP.to_owned()).chain(late.as_ref().map(Late::next));
    next_measurements.splice(0..0, first);
    let said = rejected_lines.iter().map(|line| format!("line {line} was rejected: most of its readings are outliers"));
    Ok(Diagnosis {
        // What was significant and stays out is no noise either; in correlated noise, it was significant for white noise.
        consistent_with_noise: quiet && set_aside.is_empty() && !hangs_together && may_wander.is_none(),
        only_correlated: quiet && hangs_together,
        steps: state
            .steps
            .iter()
            .map(Step::words)
            .chain(said)
            .chain(CutOff::all(campaign, &rejected_lines).iter().map(CutOff::words))
            .chain(clock.as_ref().map(ClockShift::words))
            .chain(machine_step.as_ref().map(MachineStep::words))
            .chain(wander.as_ref().map(Wander::words))
            .chain(may_wander.as_ref().map(Wander::words_of_doubt))
            .chain(slow.words())
            .chain(zeros.iter().map(ZeroOfScale::words))
            .collect(),
        rejected_lines,
        blocked: blocked(campaign, &alike, &last),
        before,
        after: state.fit,
        model,
        detection_before,
        detection_after,
        found,
        enriched,
        machine_step,
        wander,
        may_wander,
        slow,
        late,
        clock,
        set_aside,
        not_adopted: judged.not_adopted.map(|because| match has_all(&aside.terms, &withdrawn) {
            true => format!("{because}; {HELD}"),
            false => because,
        }),
        holds_aside: !aside.terms.is_empty(),
        gate: judged.gate,
        unseen: judged.unseen,
        unseen_missing: judged.unseen_missing,
        not_identifiable,
        untestable,
        next_measurements,
    })
}

/// Whether some terms are there, and all of them are among these.
fn has_all(terms: &[EffectTerm], some: &[EffectTerm]) -> bool {
    !some.is_empty() && some.iter().all(|term| has(terms, term))
}

/// What a search comes to: its model with all that stands in its uncertainty.
struct Ended<'a> {
    machine_step: Option<MachineStep>,
    wander: Option<Wander>,
    may_wander: Option<Wander>,
    slow: Slow,
    zeros: Vec<ZeroOfScale>,
    late: Option<Late>,
    /// What the residual says beside all that was found.
    left: noise::Detection,
    /// What was found, each a cause or a description.
    kinds: Vec<kind::Judged>,
    /// The model of the search.
    told: MachineModel,
    /// What it leaves unexplained where stands that move are just that (m).
    stands_alone: [f64; 3],
    /// Of each term, the fit without it, and what competes with it.
    without: Vec<Option<Without<'a>>>,
    competing: Vec<Vec<Competing>>,
    /// The mean of all that compete, to correct with.
    model: MachineModel,
}

impl<'a> Ended<'a> {
    fn of(
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
    fn weighed(&self) -> Result<MachineModel, IdentifyError> {
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

/// The rows of what the model had before, under the noise that the search ended with: only so can both be compared.
pub(crate) fn alike<'a>(
    search: &Search<'a>,
    state: &State<'a>,
    (machine, first, base): (&Machine, &Round<'a>, &[EffectTerm]),
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Round<'a>, DiagnoseError> {
    match state.fit.correlation {
        None => Ok(first.clone()),
        noise => search.round(&search.fit_under(machine, base, noise, observe)?),
    }
}

/// What is said of all that the search found together.
#[derive(Default)]
struct Judged {
    gate: Option<Verdict>,
    unseen: Option<Unseen>,
    unseen_missing: Option<String>,
    not_adopted: Option<String>,
}

impl Judged {
    fn of(
        search: &Search,
        machine: &Machine,
        (first, base): (&Round, &[EffectTerm]),
        state: &State,
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<Judged, DiagnoseError> {
        let added = state.beside(base);
        if added.is_empty() && !state.is_enriched() {
            let missing = "nothing was added, so that before and after are the same".to_owned();
            return Ok(Judged { unseen_missing: Some(missing), ..Judged::default() });
        }
        let gate = gate::judge(first, &state.round, search.campaign, &added);
        if let Some(because) = &gate.refused {
            let missing = Some(NOTHING.to_owned());
            let not_adopted = Some(format!("all that was found together: {because}"));
            return Ok(Judged { not_adopted, gate: Some(gate), unseen_missing: missing, unseen: None });
        }
        let enough = search.campaign.lines.len() >= LINES_PER_FOLD * search.options.folds && search.options.folds > 1;
        let unseen = match enough {
            true => judge::unseen(search, machine, base, (&state.fit.weights, &first.rows.rays), observe)?,
            false => Err("the campaign has too few lines to leave some out of the whole search".to_owned()),
        };
        let mut judged = Judged { gate: Some(gate), ..Judged::default() };
        match unseen {
            Ok(unseen) if unseen.loses() => {
                let (before, after) = (unseen.before.rms_m * 1e6, unseen.after.rms_m * 1e6);
                judged.unseen_missing = Some(NOTHING.to_owned());
                judged.not_adopted = Some(format!(
                    "lines that no step of the search saw are predicted worse with what it found: {before:.3} → {after:.3} µm"
                ));
            }
            Ok(unseen) => judged.unseen = Some(unseen),
            Err(missing) => judged.unseen_missing = Some(missing),
        }
        Ok(judged)
    }
}

/// Lines of which more than half was rejected: a run that is off as a whole never reaches the search, since the fit
/// gives it no weight.
fn rejected_lines(campaign: &Campaign, weights: &[f64]) -> Vec<String> {
    let mut counts = vec![(0_usize, 0_usize); campaign.lines.len()];
    for (reading, weight) in campaign.readings.iter().zip(weights) {
        let (all, rejected) = &mut counts[reading.line as usize];
        *all += 1;
        *rejected += usize::from(*weight == 0.0);
    }
    let lost = campaign.lines.iter().zip(counts).filter(|(_, (all, rejected))| *all > 1 && 2 * rejected > *all);
    lost.map(|(line, _)| line.clone()).collect()
}

/// Blocks left out of both fits, judged over the readings and directions that both have.
fn blocked(campaign: &Campaign, before: &Round, after: &Round) -> Vec<Blocked> {
    let verdict = gate::judge(before, after, campaign, &[]).judged.into_iter();
    verdict.map(|judged| Blocked { by: judged.by, before: judged.before, after: judged.after }).collect()
}

fn found<'a>(
    search: &Search,
    state: &State,
    kinds: &[kind::Judged],
    others: impl Iterator<Item = (&'a Option<Without<'a>>, Vec<Competing>)>,
) -> Result<Vec<Found>, DiagnoseError> {
    kinds
        .iter()
        .zip(others)
        .map(|(judged, (without, competing))| Ok(Found { competing, ..one(search, state, judged, without.as_ref())? }))
        .collect()
}

fn one(
    search: &Search,
    state: &State,
    judged: &kind::Judged,
    without: Option<&Without>,
) -> Result<Found, DiagnoseError> {
    let (last, fitted) = (&state.round, &judged.fitted);
    let Addition { candidate, rivals, p_corrected, verdict } =
        added(state, &EffectTerm::of(fitted)).ok_or(DiagnoseError::Singular)?;
    let columns = last.rows.columns(fitted.effect.as_ref())?;
    // Where there is no fit without it, what it gains cannot be said; that it was found can.
    let (mut held_out_gain_m, mut placebo, mut alias_share) = (None, None, candidate.score.alias_share);
    if let Some((_, without)) = without {
        let draws = (search.options.placebos, search.options.seed);
        placebo = judge::placebo(without, &columns, search.campaign, draws).ok();
        alias_share = without.score(&without.free.project(columns.as_ref())).alias_share;
        let lines = gate::judge(without, last, search.campaign, &[]).judged.into_iter().find(|j| j.by == "line");
        held_out_gain_m = lines.map(|lines| (lines.before - lines.after) * typical_u_m(&state.fit));
    }
    Ok(Found {
        name: candidate.known.name,
        title: candidate.known.title,
        formula: candidate.known.formula,
        kind: judged.kind,
        shape: fitted.shape.clone(),
        covariates: read_by(fitted.effect.as_ref(), &fitted.shape),
        p_value: p_corrected,
        evidence: candidate.evidence(last.used),
        alias_share,
        parameters: judged.parameters.clone(),
        size_m: size_m(last, fitted)?,
        rivals: rivals.iter().map(|r| rival(candidate, r, last.used)).collect(),
        competing: Vec::new(),
        corrects: !tomorrow::is_course(fitted, search.campaign),
        held_out_gain_m,
        placebo,
        gate: verdict.clone(),
    })
}

fn rival(chosen: &Candidate, rival: &Candidate, rows: usize) -> Rival {
    let evidence_behind = chosen.evidence(rows) - rival.evidence(rows);
    Rival { name: rival.known.name, shape: rival.term.shape.clone(), evidence_behind }
}

/// Rms of what an effect does to the ranges, about its mean (m).
fn size_m(round: &Round, fitted: &FittedEffect) -> Result<f64, DiagnoseError> {
    let values: Vec<f64> = round.on_ranges_m(fitted)?.into_iter().map(|(_, value)| value).collect();
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    Ok((values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len().max(1) as f64).sqrt())
}

/// Rms of the declared uncertainties (m): turns whitened figures into metres.
fn typical_u_m(fit: &Identified) -> f64 {
    (fit.u_m.iter().map(|u| u * u).sum::<f64>() / fit.u_m.len().max(1) as f64).sqrt()
}

fn next_measurements(
    found: &[Found],
    not_identifiable: &[crate::diagnosis::NotIdentifiable],
    untestable: &[crate::diagnosis::Untestable],
) -> Vec<String> {
    let decided = |name: &str| abbe_geometry::effects::known(name).map(|known| known.decided_by.to_owned());
    let doubted = found.iter().filter(|f| !f.rivals.is_empty());
    let doubted = doubted.flat_map(|f| std::iter::once(f.name).chain(f.rivals.iter().map(|r| r.name)));
    let mut list: Vec<String> = Vec::new();
    let mut push = |text: String| {
        if list.len() < MEASUREMENTS && !list.contains(&text) {
            list.push(text);
        }
    };
    doubted.filter_map(decided).for_each(&mut push);
    not_identifiable.iter().for_each(|n| push(n.decided_by.to_owned()));
    untestable.iter().for_each(|u| push(format!("log {}", u.needs)));
    list
}
