//! The diagnosis of a tracer campaign: detect, search, judge, say what cannot be told.
//!
//! Place in the flow: the entry point behind `abbe diagnose` and the monitor's request. Model (its machine and effects)
//! and campaign in, SI, machine frame; nothing is read or written here.

use crate::alias;
use crate::aside::{self, Aside};
use crate::candidates::{Candidate, Round};
use crate::clock::{self, ClockShift};
use crate::competing::{Competing, Without};
use crate::context::read_by;
use crate::cut_off::CutOff;
use crate::diagnosis::{Blocked, Diagnosis, Found, Rival, Unseen};
use crate::ended::Ended;
use crate::error::DiagnoseError;
use crate::gate::{self, Verdict};
use crate::implausible;
use crate::judge;
use crate::kind;
use crate::lagged_columns::with_lags;
use crate::late::Late;
use crate::machine_step::{self, MachineStep};
use crate::noise;
use crate::options::{DiagnoseOptions, Progress};
use crate::same_claim::has;
use crate::score::score_of;
use crate::search::{Search, State};
use crate::step::{Addition, HELD, Step, added};
use crate::tomorrow::is_course_beside;
use crate::wander::Wander;
use crate::zero_of_scale::ZeroOfScale;
use crate::{together, tomorrow, worth};
use abbe_geometry::machine::Machine;
use abbe_geometry::model::{FittedEffect, MachineModel};
use abbe_identify::{EffectTerm, Identified, IdentifyError};
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
    let mut state = search.run(before.clone(), first.clone(), base.clone(), observe)?;
    together::hold(&search, &mut state, (machine, (&before.model, &first), &base), observe)?;
    let clock = clock::hold(&search, &mut state, &base, observe)?;
    machine_step::in_place::hold(&search, &mut state, &base, observe)?;
    implausible::hold(&search, &mut state, &base, observe)?;
    let alike = alike(&search, &state, (machine, &first, &base), observe)?;
    let start = Start { before, first, alike, base };
    let settled = settled(&search, machine, &start, state, observe)?;
    told(&search, start, settled, clock, observe)
}

/// What a search begins with.
struct Start<'a> {
    before: Identified,
    /// The rows of that fit.
    first: Round<'a>,
    /// The same under the noise that the search ended with.
    alike: Round<'a>,
    /// What the model had before.
    base: Vec<EffectTerm>,
}

/// What a search found, judged as a whole.
struct Settled<'a> {
    state: State<'a>,
    judged: Judged,
    ended: Ended<'a>,
    /// What was too costly together.
    withdrawn: Vec<EffectTerm>,
}

/// Keeps all that was found, or goes back to what the search began with: where lines that no step of it saw are predicted worse, where a step
/// of the machine explains more, or where it costs more than it tells.
fn settled<'a>(
    search: &Search<'a>,
    machine: &Machine,
    start: &Start<'a>,
    mut state: State<'a>,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Settled<'a>, DiagnoseError> {
    let Start { before, first, alike, base } = start;
    let beginning = || (before.clone(), first.clone(), base.clone());
    let judged = Judged::of(search, machine, (alike, base), &state, observe)?;
    if let Some(because) = &judged.not_adopted {
        state.withdraw(beginning(), because);
    }
    let ended = Ended::of(search, &state, (before, alike, base), judged.unseen.as_ref(), observe)?;
    let added = state.beside(base);
    let costs = |model: &MachineModel| -> Result<Option<String>, DiagnoseError> {
        let why = worth::refusal(&added, model, &ended.weighed()?, search.campaign);
        Ok(why.map(|because| format!("all that was found together: {because}")))
    };
    let is_outdone = !added.is_empty() && ended.machine_step.as_ref().is_some_and(|step| step.outdoes_found);
    let because = match is_outdone {
        true => Some("a step of the machine explains more than all that was found together".to_owned()),
        false => costs(&before.model)?,
    };
    let Some(because) = because else { return Ok(Settled { state, judged, ended, withdrawn: Vec::new() }) };
    let mut without = state.clone();
    without.withdraw(beginning(), &because);
    let plain = Ended::of(search, &without, (before, first, base), None, observe)?;
    let because = match is_outdone {
        true => plain.machine_step.is_some().then_some(because),
        // What is not told of the machine without it costs as well.
        false => costs(&plain.model)?,
    };
    let Some(because) = because else { return Ok(Settled { state, judged, ended, withdrawn: Vec::new() }) };
    state.withdraw(beginning(), &because);
    // What goes may have been a slow change, and that is there without it.
    let model = ended.slow.told(plain.model.clone()).map_err(IdentifyError::from)?;
    let unseen_missing = Some(NOTHING.to_owned());
    let judged = Judged { not_adopted: Some(because), unseen: None, unseen_missing, ..judged };
    let withdrawn = if is_outdone { Vec::new() } else { added };
    Ok(Settled { state, judged, ended: Ended { model, ..plain }, withdrawn })
}

/// What is said of it all.
fn told(
    search: &Search,
    Start { before, first, alike, base }: Start,
    Settled { mut state, judged, ended, withdrawn }: Settled,
    clock: Option<ClockShift>,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Diagnosis, DiagnoseError> {
    let campaign = search.campaign;
    let rejected_lines = rejected_lines(campaign, &state.fit.weights);
    let steps = steps(search, &state, &ended, (&rejected_lines, clock.as_ref()));
    let Ended { machine_step, wander, may_wander, slow, late, left, kinds, told, without, competing, model, .. } =
        ended;
    let is_course = |fitted: &FittedEffect| is_course_beside(&base, fitted, campaign);
    let Aside { model, terms: aside } = aside::told(search, &state, (model, &withdrawn), &is_course, observe)?;
    state.fit.model = told;
    let named = match state.named.take() {
        Some(named) => named,
        None => search.named(&state.round, &state.machine)?,
    };
    let others = without.iter().zip(competing).zip(&state.terms).filter(|(_, term)| !has(&base, term));
    let found = found(search, &state, &kinds, others.map(|(other, _)| other))?;
    let not_identifiable = alias::not_identifiable(&state.round, &state.fit.model, &named)?;
    let untestable = alias::untestable(&state.machine, &search.context);
    let mut next_measurements = next_measurements(&found, &not_identifiable, &untestable);
    let first_of_all = machine_step.iter().map(|_| AFTER_A_STEP.to_owned()).chain(late.as_ref().map(Late::next));
    next_measurements.splice(0..0, first_of_all);
    let set_aside = state.set_aside(&aside);
    let enriched = state.is_enriched();
    let structured = enriched || left.has_structure() || !rejected_lines.is_empty();
    let hangs_together = state.fit.correlation.is_some();
    let nothing = found.is_empty() && judged.not_adopted.is_none();
    let quiet = nothing && !structured && machine_step.is_none() && wander.is_none();
    Ok(Diagnosis {
        // What was significant and stays out is no noise either; in correlated noise, it was significant for white noise.
        consistent_with_noise: quiet && set_aside.is_empty() && !hangs_together && may_wander.is_none(),
        only_correlated: quiet && hangs_together,
        steps,
        rejected_lines,
        blocked: blocked(campaign, &alike, &state.round),
        detection_before: noise::detect(&first, campaign, &before.evidence),
        before,
        after: state.fit,
        model,
        detection_after: left,
        found,
        enriched,
        machine_step,
        wander,
        may_wander,
        slow,
        late,
        clock,
        set_aside,
        not_adopted: judged.not_adopted.map(|because| match has_all(&aside, &withdrawn) {
            true => format!("{because}; {HELD}"),
            false => because,
        }),
        holds_aside: !aside.is_empty(),
        gate: judged.gate,
        unseen: judged.unseen,
        unseen_missing: judged.unseen_missing,
        not_identifiable,
        untestable,
        next_measurements,
    })
}

/// What was done and seen, one after another, in words.
fn steps(
    search: &Search,
    state: &State,
    ended: &Ended,
    (rejected_lines, clock): (&[String], Option<&ClockShift>),
) -> Vec<String> {
    let rejected =
        rejected_lines.iter().map(|line| format!("line {line} was rejected: most of its readings are outliers"));
    let searched = state.steps.iter().map(Step::words).chain(rejected);
    searched
        .chain(CutOff::all(search.campaign, rejected_lines).iter().map(CutOff::words))
        .chain(clock.map(ClockShift::words))
        .chain(ended.machine_step.as_ref().map(MachineStep::words))
        .chain(ended.wander.as_ref().map(Wander::words))
        .chain(ended.may_wander.as_ref().map(Wander::words_of_doubt))
        .chain(ended.slow.words())
        .chain(ended.zeros.iter().map(ZeroOfScale::words))
        .collect()
}

/// Whether some terms are there, and all of them are among these.
fn has_all(terms: &[EffectTerm], some: &[EffectTerm]) -> bool {
    !some.is_empty() && some.iter().all(|term| has(terms, term))
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
        alias_share = score_of(&without.free, columns.as_ref()).alias_share;
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
