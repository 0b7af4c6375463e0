//! Which candidates belong in the model: added by evidence, removed where others take their place.
//!
//! Place in the flow: the middle of every study. A candidate comes in when its F test passes after Holm (1979), its
//! evidence (twice the log likelihood, priced after Schwarz 1978) is positive, blocks left out are predicted better with
//! it, over the same directions, and at most one placebo in twenty does as well. After each addition what has become
//! superfluous goes out again.

use super::candidate::Study;
use super::diagnosis::{Considered, Kind};
use super::fit::Fit;
use super::judge::held_out_rms;
use super::placebo::placebo;
use crate::error::DiagnoseError;
use crate::score::Score;

/// Settings of a study.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Probability, over all candidates together, that anything is found where nothing is.
    pub significance: f64,
    /// Placebos drawn for each effect.
    pub placebo_draws: usize,
    /// Seed of the placebos.
    pub seed: u64,
    /// Most effects that one study may find.
    pub most_effects: usize,
}

impl Default for Options {
    fn default() -> Options {
        Options { significance: 0.01, placebo_draws: 50, seed: 1, most_effects: 10 }
    }
}

/// Share of placebos that may do as well as the columns themselves.
const PLACEBO_SHARE: f64 = 0.05;
/// Difference in evidence within which two candidates explain the same: odds of 20 to 1 (Kass & Raftery 1995).
pub(super) const COMPARABLE: f64 = 6.0;
/// Candidates that are taken to the judge on one rung before the search ends.
const TRIED: usize = 12;

/// Score of a candidate among others.
#[derive(Debug, Clone)]
pub(super) struct Scored {
    pub(super) candidate: usize,
    pub(super) score: Score,
    pub(super) p_holm: f64,
    pub(super) evidence: f64,
}

/// What the search ends with.
#[derive(Debug)]
pub(super) struct Found {
    /// Candidates in the order in which they came in.
    pub(super) set: Vec<usize>,
    /// All candidates against the base model.
    pub(super) considered: Vec<Considered>,
    /// Candidates that passed the tests but not the judge, with the reason.
    pub(super) refused: Vec<(usize, &'static str)>,
}

/// Scores all candidates outside the fit.
pub(super) fn score_all(study: &dyn Study, fit: &Fit) -> Vec<Scored> {
    let inside = fit.set();
    let outside = (0..study.candidates().len()).filter(|k| !inside.contains(k));
    let scores: Vec<(usize, Score)> = outside.map(|k| (k, fit.score(study, k))).collect();
    let tested = scores.iter().filter(|(_, score)| score.degrees > 0).count();
    let rows = fit.linear.residuals().len();
    let mut all: Vec<Scored> = scores
        .into_iter()
        .map(|(candidate, score)| Scored { candidate, evidence: score.evidence(rows, tested), p_holm: 1.0, score })
        .collect();
    holm(&mut all, tested);
    all
}

/// Holm's step-down correction.
fn holm(all: &mut [Scored], tested: usize) {
    let mut order: Vec<usize> = (0..all.len()).filter(|k| all[*k].score.degrees > 0).collect();
    order.sort_by(|a, b| all[*a].score.p_value.total_cmp(&all[*b].score.p_value));
    let mut largest: f64 = 0.0;
    for (rank, k) in order.into_iter().enumerate() {
        largest = largest.max(all[k].score.p_value * (tested - rank) as f64).min(1.0);
        all[k].p_holm = largest;
    }
}

/// Searches.
pub(super) fn search(study: &mut dyn Study, options: &Options) -> Result<Found, DiagnoseError> {
    let mut fit = Fit::settle(study, &[])?;
    let first = score_all(study, &fit);
    let considered = first.iter().map(|scored| considered(study, scored)).collect();
    let mut refused: Vec<(usize, &'static str)> = Vec::new();
    let mut seen = vec![Vec::new()];
    while fit.added.len() < options.most_effects {
        let Some(next) = step(study, &fit, options, &mut refused)? else { break };
        let next = prune(study, next, options)?;
        let mut sorted = next.set();
        sorted.sort_unstable();
        // What was pruned may come back and be pruned again: a set seen before ends the search.
        if seen.contains(&sorted) {
            break;
        }
        seen.push(sorted);
        fit = next;
    }
    let set = fit.set();
    refused.retain(|(k, _)| !set.contains(k));
    Ok(Found { set, considered, refused })
}

/// The fit with the best candidate that passes everything.
fn step(
    study: &mut dyn Study,
    fit: &Fit,
    options: &Options,
    refused: &mut Vec<(usize, &'static str)>,
) -> Result<Option<Fit>, DiagnoseError> {
    let mut passing = score_all(study, fit);
    passing.retain(|scored| scored.p_holm <= options.significance && scored.evidence > 0.0);
    passing.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    simplest_first(study, &mut passing);
    for scored in passing.iter().take(TRIED) {
        study.refine(&fit.linear, scored.candidate);
        let mut set = fit.set();
        set.push(scored.candidate);
        // One candidate that has no fit must not take the others with it.
        let (next, reason) = match Fit::settle(study, &set) {
            Ok(next) => {
                let reason = reason_against(study, fit, &next, scored.candidate, options)?;
                (Some(next), reason)
            }
            Err(_) => (None, Some("it cannot be fitted beside the rest")),
        };
        match reason {
            None => return Ok(next),
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
fn simplest_first(study: &dyn Study, passing: &mut Vec<Scored>) {
    let Some(most) = passing.first().map(|scored| scored.evidence) else { return };
    let candidate = |scored: &Scored| &study.candidates()[scored.candidate];
    let close = |scored: &Scored| most - scored.evidence < COMPARABLE;
    let is_physical = |scored: &&Scored| close(scored) && candidate(scored).kind == Kind::Attributed;
    let Some(best) = passing.iter().find(is_physical).or(passing.first()) else { return };
    let family = candidate(best).family.clone();
    let forms = (0..passing.len()).filter(|k| close(&passing[*k]) && candidate(&passing[*k]).family == family);
    if let Some(k) = forms.min_by_key(|k| passing[*k].score.degrees) {
        let first = passing.remove(k);
        passing.insert(0, first);
    }
}

fn reason_against(
    study: &dyn Study,
    fit: &Fit,
    next: &Fit,
    candidate: usize,
    options: &Options,
) -> Result<Option<&'static str>, DiagnoseError> {
    let (before, after) = (held_out_rms(study, &fit.linear), held_out_rms(study, &next.linear));
    if after.judged < before.judged {
        return Ok(Some("it rests on single blocks: with any one of them left out it is not determined"));
    }
    if after.rms_um >= before.rms_um {
        return Ok(Some("it fits, but does not predict blocks left out any better"));
    }
    let columns = study.columns(&fit.point, candidate);
    let placebo = placebo(study, fit, &columns, options.placebo_draws, options.seed)?;
    Ok((placebo.share_as_good > PLACEBO_SHARE).then_some("shuffled columns of the same flexibility do as well"))
}

/// Removes, weakest first, what the others have made superfluous.
fn prune(study: &dyn Study, mut fit: Fit, options: &Options) -> Result<Fit, DiagnoseError> {
    loop {
        let set = fit.set();
        let mut weakest: Option<(f64, Fit)> = None;
        for k in 0..set.len().saturating_sub(1) {
            let mut rest = set.clone();
            let candidate = rest.remove(k);
            // What the others cannot be fitted without is not superfluous.
            let Ok(without) = Fit::settle(study, &rest) else { continue };
            let score = without.score(study, candidate);
            let trials = study.candidates().len();
            let evidence = score.evidence(without.linear.residuals().len(), trials);
            let passes = evidence > 0.0 && score.p_value * trials as f64 <= options.significance;
            if !passes && weakest.as_ref().is_none_or(|(least, _)| evidence < *least) {
                weakest = Some((evidence, without));
            }
        }
        match weakest {
            Some((_, without)) => fit = without,
            None => return Ok(fit),
        }
    }
}

fn considered(study: &dyn Study, scored: &Scored) -> Considered {
    let candidate = &study.candidates()[scored.candidate];
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
