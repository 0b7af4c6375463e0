//! Which candidates belong in the model: added by evidence, removed where others take their place.
//!
//! Place in the flow: the middle of every study. A candidate comes in when its F test passes after Holm (1979) in whatever
//! noise the rows leave possible ([`super::significance`]), its evidence (twice the log likelihood, priced after Schwarz
//! 1978) is positive, and blocks left out are predicted better with it, over the same directions. What acts between blocks
//! must stand out from the scatter of blocks as well. After each addition the noise is estimated anew, and what has become
//! superfluous goes out again.

use super::beside::wave_beside_smooth;
use super::candidate::{Candidate, Goes};
use super::fit::{Fit, Part};
use super::outcome::Considered;
use super::placing::{best_placed, moved, placed, single, tried};
use super::reasons::{is_told_from_position, reason_against, reason_of_blocks, stands_apart, with_together};
use super::scored::{COMPARABLE, Scored};
use super::series::Theta;
use super::two_lines::TwoLines;
use super::view::View;
use super::waves::tuned;
use crate::error::DiagnoseError;
use crate::explanation::Explanation;
use crate::score::{Score, score};
use abbe_geometry::effects::is_scale;
use abbe_identify::in_parallel;
use std::collections::BTreeMap;

/// Settings of a study.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StudyOptions {
    /// Probability, over all candidates together, that anything is found where nothing is.
    pub significance: f64,
    /// Most effects that one study may find.
    pub most_effects: usize,
    /// Whether a mark that stands still was measured again and again, and neither the instrument nor what was measured on drifted: what goes
    /// with the time is the machine's then.
    pub instrument_checked: bool,
}

impl Default for StudyOptions {
    fn default() -> StudyOptions {
        StudyOptions { significance: 0.01, most_effects: 16, instrument_checked: false }
    }
}

/// Told now and then; `false` stops the study.
pub type Observe<'a> = dyn FnMut(Progress) -> bool + 'a;

/// Where a study stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Part of the data left out of this search, and the number of parts; `None` for the search on all data, which comes first.
    pub part: Option<(usize, usize)>,
    /// Effects found so far in this search.
    pub effects: usize,
    /// Candidates that each step tests.
    pub candidates: usize,
}

/// Candidates that are taken to the judge on one rung before the search ends, and of these forms of one thing.
const TRIED: usize = 12;
const FORMS: usize = 3;
/// Candidates that one thread tests at a time.
const TOGETHER: usize = 24;

/// Single candidates, and the best pair of straight lines.
type Scores = (Vec<Scored>, Option<TwoLines>);

/// What the search ends with.
#[derive(Debug)]
pub(super) struct Found {
    /// Candidates in the order in which they came in.
    pub(super) set: Vec<usize>,
    /// All candidates against the base model.
    pub(super) considered: Vec<Considered>,
    /// Candidates that passed the tests but not the judge, with the reason.
    pub(super) refused: Vec<(usize, &'static str)>,
    /// Whether it was asked to stop before nothing more came in.
    pub(super) is_stopped: bool,
}

/// Scores all candidates outside the fit.
pub(super) fn score_all(view: &View, fit: &Fit) -> Vec<Scored> {
    let inside = fit.set();
    let mut outside: Vec<(Option<usize>, usize)> = (0..view.study.candidates().len())
        .filter(|k| !inside.contains(k) && view.study.is_offered(*k))
        .map(|k| (view.chain_of(k), k))
        .collect();
    // Those of one chain go through its matrix products together.
    outside.sort_unstable();
    let chunks: Vec<&[(Option<usize>, usize)]> =
        outside.chunk_by(|a, b| a.0 == b.0).flat_map(|own| own.chunks(TOGETHER)).collect();
    let parts: Vec<Part> = (0..view.chains().len()).map(|chain| fit.part(view, &[chain])).collect();
    let mut scores = in_parallel(&chunks, |chunk| score_chunk(view, fit, &parts, chunk)).concat();
    scores.sort_unstable_by_key(|(candidate, ..)| *candidate);
    let tested = scores.iter().filter(|(_, score, _)| score.degrees > 0).count();
    let mut all: Vec<Scored> = scores
        .into_iter()
        .map(|(candidate, score, rows)| Scored {
            candidate,
            evidence: score.evidence(rows, tested),
            p_holm: 1.0,
            score,
        })
        .collect();
    holm(&mut all, tested);
    all
}

/// Candidates that act on one chain, or on several, with their scores and the rows that they act on.
fn score_chunk(view: &View, fit: &Fit, parts: &[Part], chunk: &[(Option<usize>, usize)]) -> Vec<(usize, Score, usize)> {
    let candidates = || chunk.iter().map(|(_, candidate)| *candidate);
    let Some(chain) = chunk.first().and_then(|(chain, _)| *chain) else {
        let one = |candidate| {
            let (score, rows) = fit.score_columns(view, &view.columns(&fit.point, candidate));
            (candidate, score, rows)
        };
        return candidates().map(one).collect();
    };
    let part = &parts[chain];
    let (columns, counts) = view.chain_columns(chain, &candidates().collect::<Vec<usize>>());
    let projected = part.project_all(columns.as_ref(), &counts);
    let one = |(candidate, group)| (candidate, score(&group, part.chi2, part.degrees), part.rows());
    candidates().zip(projected).map(one).collect()
}

/// Scores all candidates, the best wave of each family with its frequency adjusted: between two frequencies of the scan a large
/// wave would lose against a table of errors.
fn refined(view: &mut View, fit: &Fit) -> Vec<Scored> {
    let mut all = score_all(view, fit);
    placed(view, fit, &[], &mut all);
    let tested = all.iter().filter(|scored| scored.score.degrees > 0).count();
    let mut best: BTreeMap<String, usize> = BTreeMap::new();
    for k in (0..all.len()).filter(|k| view.study.frequency(all[*k].candidate).is_some()) {
        let own = best.entry(view.study.candidates()[all[k].candidate].family.clone()).or_insert(k);
        if all[k].evidence > all[*own].evidence {
            *own = k;
        }
    }
    let chosen: Vec<usize> = best.values().map(|k| all[*k].candidate).collect();
    for k in best.into_values() {
        let candidate = all[k].candidate;
        view.refine(fit, candidate);
        let (score, rows) = fit.score(view, candidate);
        let tried = tried(&*view.study, candidate) as f64;
        all[k].evidence = score.evidence(rows, tested) - 2.0 * tried.ln();
        all[k].score = Score { p_value: (score.p_value * tried).min(1.0), ..score };
    }
    // Further waves of an axis wait until one of them is found: they would be the same.
    all.retain(|own| chosen.contains(&own.candidate) || view.study.scan(own.candidate).is_empty());
    holm(&mut all, tested);
    all
}

/// Holm's step-down correction; `tested` counts all that could have been found.
fn holm(all: &mut [Scored], tested: usize) {
    let mut order: Vec<usize> = (0..all.len()).filter(|k| all[*k].score.degrees > 0).collect();
    order.sort_by(|a, b| all[*a].score.p_value.total_cmp(&all[*b].score.p_value));
    // A wave that was the same as others at its proposed period may tell something at another.
    let tested = tested.max(order.len());
    let mut largest: f64 = 0.0;
    for (rank, k) in order.into_iter().enumerate() {
        largest = largest.max(all[k].score.p_value * (tested - rank) as f64).min(1.0);
        all[k].p_holm = largest;
    }
}

/// Searches.
pub(super) fn search(
    view: &mut View,
    options: &StudyOptions,
    part: Option<(usize, usize)>,
    observe: &mut Observe,
) -> Result<Found, DiagnoseError> {
    let mut fit = view.adapt(&[])?;
    let candidates = view.study.candidates().len();
    let mut considered = Vec::new();
    let mut refused: Vec<(usize, &'static str)> = Vec::new();
    let mut seen = vec![Vec::new()];
    let mut is_stopped = false;
    while fit.added.len() < options.most_effects {
        if !observe(Progress { part, effects: fit.added.len(), candidates }) {
            // What a search on part of the data found by then judges nothing.
            if part.is_some() || fit.added.is_empty() {
                return Err(DiagnoseError::Stopped);
            }
            is_stopped = true;
            break;
        }
        let scored = refined(view, &fit);
        if considered.is_empty() {
            considered = scored.iter().map(|scored| considered_as(view, scored)).collect();
        }
        let next = match names_together(view, &fit, options)? {
            Some(next) => Some(next),
            None => wave_beside_smooth(view, &fit, options.significance)?,
        };
        let next = match next {
            Some(next) => Some(next),
            None => {
                let lines = TwoLines::best(view, &fit);
                step(view, &fit, (scored, lines), options, &mut refused)?
            }
        };
        let next = match next {
            Some(next) => Some(next),
            // What is missing may have passed for slow noise, and all that describes it for chance.
            None => match scored_in_white(view, &fit)? {
                Some(scored) => step(view, &fit, scored, options, &mut refused)?,
                None => None,
            },
        };
        let next = match next {
            Some(next) => Some(next),
            None => sets_together(view, &fit, options)?,
        };
        let Some(next) = next else { break };
        let next = single(view, &next);
        let next = prune(view, next, options)?;
        let mut sorted = next.clone();
        sorted.sort_unstable();
        // What was pruned may come back and be pruned again: a set seen before ends the search.
        if seen.contains(&sorted) {
            break;
        }
        seen.push(sorted);
        fit = view.adapt(&next)?;
        if let Some(next) = moved(view, &next)? {
            fit = view.adapt(&next)?;
        }
        if tuned(view, &fit.set())? {
            fit = view.adapt(&fit.set())?;
        }
    }
    let set = fit.set();
    refused.retain(|(k, _)| !set.contains(k));
    Ok(Found { set, considered, refused, is_stopped })
}

/// The set with several of what is named before any other, where these pass together: with the others missing, none may stand
/// out from what then looks like slow noise, as the scales and the squareness of a plate that was measured along a path.
fn names_together(view: &mut View, fit: &Fit, options: &StudyOptions) -> Result<Option<Vec<usize>>, DiagnoseError> {
    let own = fit.set();
    let candidates = view.study.candidates();
    // What the base model holds, such as the squareness of a plate whose form is unknown, has no part in it.
    let is_open = |k: &usize| fit.score(view, *k).0.degrees > 0;
    let is_name = |k: &usize| candidates[*k].goes == Goes::First && !own.contains(k) && is_open(k);
    let names: Vec<usize> = (0..candidates.len()).filter(is_name).collect();
    all_together(view, fit, &names, options)
}

/// The set with one that the study names to be tried as one, where no candidate passes alone.
fn sets_together(view: &mut View, fit: &Fit, options: &StudyOptions) -> Result<Option<Vec<usize>>, DiagnoseError> {
    let own = fit.set();
    for mut members in view.study.together() {
        members.retain(|k| !own.contains(k));
        if let Some(set) = all_together(view, fit, &members, options)? {
            return Ok(Some(set));
        }
    }
    Ok(None)
}

/// The set with these, where two or more of them pass together.
fn all_together(
    view: &mut View,
    fit: &Fit,
    members: &[usize],
    options: &StudyOptions,
) -> Result<Option<Vec<usize>>, DiagnoseError> {
    if members.len() < 2 {
        return Ok(None);
    }
    let (own, trials) = (fit.set(), view.study.candidates().len());
    let Some(set) = with_together(view, fit, members, trials, options.significance)? else { return Ok(None) };
    let noises = view.noises();
    // What came in last is never pruned: once more with another one there.
    let mut set = prune(view, set, options)?;
    set.rotate_right(1);
    let set = prune(view, set, options)?;
    view.take_noises(noises);
    let is_new = set.iter().filter(|k| !own.contains(k)).count() > 1;
    Ok(is_new.then_some(set))
}

/// Scores as if the noise were white; nothing where it is taken as such. The gate decides with what the noise may be.
fn scored_in_white(view: &mut View, fit: &Fit) -> Result<Option<Scores>, DiagnoseError> {
    let noises = view.noises();
    if noises.iter().all(|noise| noise.theta == Theta::WHITE) {
        return Ok(None);
    }
    view.take_white(fit);
    let scored = Fit::settle(view, &fit.set()).map(|white| (refined(view, &white), TwoLines::best(view, &white)));
    view.take_noises(noises);
    scored.map(Some)
}

/// The set with the best candidate that passes everything, or with two straight lines at once.
fn step(
    view: &mut View,
    fit: &Fit,
    (mut passing, lines): Scores,
    options: &StudyOptions,
    refused: &mut Vec<(usize, &'static str)>,
) -> Result<Option<Vec<usize>>, DiagnoseError> {
    if let Some(lines) = lines
        && let Some(set) = lines.passed(view, fit, &passing, options.significance)?
    {
        return Ok(Some(set));
    }
    let tested = passing.iter().filter(|scored| scored.score.degrees > 0).count();
    passing.retain(|scored| scored.p_holm <= options.significance);
    passing.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    best_placed(view, &mut passing);
    simplest_first(view, &mut passing);
    named_first(view, &mut passing);
    let mut tried: BTreeMap<String, usize> = BTreeMap::new();
    let mut is_tried = |scored: &&Scored| {
        let forms = tried.entry(view.study.candidates()[scored.candidate].family.clone()).or_default();
        *forms += 1;
        *forms <= FORMS
    };
    let tried: Vec<&Scored> = passing.iter().filter(&mut is_tried).take(TRIED).collect();
    for scored in tried {
        let mut set = fit.set();
        set.push(scored.candidate);
        let reason = match reason_against(view, fit, scored.candidate, tested, options.significance)? {
            Some(reason) => Some(reason),
            None => reason_of_blocks(view, &set, set.len() - 1),
        };
        match reason {
            None => return Ok(Some(set)),
            Some(reason) if !refused.iter().any(|(k, _)| *k == scored.candidate) => {
                refused.push((scored.candidate, reason));
            }
            Some(_) => {}
        }
    }
    Ok(None)
}

/// Moves to the front what explains as well as the best in simpler words, where the evidence is close: a physical
/// effect before a description, and of its forms the simplest. The finer form has to pass on what the simple one leaves.
fn simplest_first(view: &View, passing: &mut Vec<Scored>) {
    let Some(most) = passing.first().map(|scored| scored.evidence) else { return };
    let candidate = |scored: &Scored| &view.study.candidates()[scored.candidate];
    let close = |scored: &Scored| most - scored.evidence < COMPARABLE;
    let is_physical = |scored: &&Scored| close(scored) && candidate(scored).kind == Explanation::Attributed;
    let Some(best) = passing.iter().find(is_physical).or(passing.first()) else { return };
    let family = candidate(best).family.clone();
    let forms = (0..passing.len()).filter(|k| close(&passing[*k]) && candidate(&passing[*k]).family == family);
    if let Some(k) = forms.min_by_key(|k| passing[*k].score.degrees) {
        let first = passing.remove(k);
        passing.insert(0, first);
    }
}

/// Moves to the front what is named before any other, the best of several: bent forms would take some of it along. Else an error of one axis
/// goes before a form of positions, which may hold the errors of several axes.
fn named_first(view: &View, passing: &mut Vec<Scored>) {
    let candidate = |scored: &Scored| &view.study.candidates()[scored.candidate];
    let is_of_positions =
        |own: &Candidate| !own.covariates.is_empty() && own.covariates.iter().all(|name| is_scale(name));
    let describes = passing
        .first()
        .map(candidate)
        .is_some_and(|first| first.kind == Explanation::Empirical && is_of_positions(first));
    let best_of = |goes: Goes| {
        let best = |a: &usize, b: &usize| passing[*b].evidence.total_cmp(&passing[*a].evidence);
        (0..passing.len()).filter(|k| candidate(&passing[*k]).goes == goes).min_by(best)
    };
    let first = best_of(Goes::First).or_else(|| describes.then(|| best_of(Goes::BeforeDescriptions)).flatten());
    if let Some(k) = first {
        let first = passing.remove(k);
        passing.insert(0, first);
    }
}

/// Removes, weakest first, what the others have made superfluous; waves that a later term can do as well go, too.
fn prune(view: &mut View, mut set: Vec<usize>, options: &StudyOptions) -> Result<Vec<usize>, DiagnoseError> {
    // In the noise that all of them leave: without the newest, what it explains would pass for slow noise.
    view.adapt(&set)?;
    let view = &*view;
    loop {
        let places: Vec<usize> = (0..set.len().saturating_sub(1)).collect();
        let tested = in_parallel(&places, |k| evidence_against(view, &set, *k, options));
        let mut weakest: Option<(f64, usize)> = None;
        for (k, evidence) in tested.into_iter().enumerate() {
            if let Some(evidence) = evidence?
                && weakest.is_none_or(|(least, _)| evidence < least)
            {
                weakest = Some((evidence, k));
            }
        }
        match weakest {
            Some((_, k)) => drop(set.remove(k)),
            None => return Ok(set),
        }
    }
}

/// Evidence for one of a set beside the others, where it does not pass.
fn evidence_against(
    view: &View,
    set: &[usize],
    place: usize,
    options: &StudyOptions,
) -> Result<Option<f64>, DiagnoseError> {
    let mut rest = set.to_vec();
    let candidate = rest.remove(place);
    // What the others cannot be fitted without is not superfluous.
    let Ok(without) = Fit::settle(view, &rest) else { return Ok(None) };
    let (score, rows) = without.score(view, candidate);
    let trials = view.study.candidates().len().saturating_mul(tried(&*view.study, candidate));
    let passes = score.p_value * trials as f64 <= options.significance
        && stands_apart(view, &without, candidate, trials, options.significance)?
        && is_told_from_position(view, &without, candidate, trials, options.significance)?;
    Ok((!passes).then(|| score.evidence(rows, trials)))
}

fn considered_as(view: &View, scored: &Scored) -> Considered {
    let candidate = &view.study.candidates()[scored.candidate];
    Considered {
        name: candidate.name.clone(),
        kind: candidate.kind,
        tested: scored.score.degrees,
        p_value: scored.score.p_value,
        p_holm: scored.p_holm,
        evidence: scored.evidence,
        alias_share: scored.score.alias_share,
    }
}
