//! A wave beside a smooth error, where a table of errors place by place would take both.
//!
//! Place in the flow: in each round of the search, before single candidates are tried. Of a pitch error and a wave of the screw neither
//! explains as much alone as the table does, which is then found first and leaves a wave nothing. So both are tried together, in place
//! of what was found of position. They are taken where their evidence is clearly more than that of any table or polynomial, and where the
//! wave passes all that waves must beside the smooth error.

use super::fit::Fit;
use super::placing::tried;
use super::reasons::{reason_against, reason_of_blocks};
use super::scored::COMPARABLE;
use super::view::View;
use crate::error::DiagnoseError;
use crate::linear::joined;

/// A smooth error, if any, and a wave beside it at its best frequency.
struct Pair {
    smooth: Option<usize>,
    wave: usize,
    frequency: f64,
    evidence: f64,
}

/// The set with a smooth error and a wave in place of what it holds of position; `None` where that is no better.
pub(super) fn wave_beside_smooth(
    view: &mut View,
    fit: &Fit,
    significance: f64,
) -> Result<Option<Vec<usize>>, DiagnoseError> {
    let set = fit.set();
    for waves in families(view, &set) {
        let smooth = view.study.smooth_beside(waves[0]);
        let Some(first) = smooth.first() else { continue };
        let family = view.study.candidates()[*first].family.clone();
        let is_rival = |k: &usize| view.study.candidates()[*k].family == family;
        let (replaced, rest): (Vec<usize>, Vec<usize>) = set.iter().copied().partition(is_rival);
        let rivals: Vec<usize> = (0..view.study.candidates().len()).filter(is_rival).collect();
        let without = if replaced.is_empty() { None } else { Some(Fit::settle(view, &rest)?) };
        let without = without.as_ref().unwrap_or(fit);
        let rival = most_of_one(view, without, &replaced, &rivals);
        let Some(pair) = best_pair(view, without, &smooth, &waves)? else { continue };
        if pair.evidence < rival.max(0.0) + COMPARABLE {
            continue;
        }
        if let Some(found) = passed(view, rest, &pair, significance)? {
            return Ok(Some(found));
        }
    }
    Ok(None)
}

/// Waves of each family of which the set has none.
fn families(view: &View, set: &[usize]) -> Vec<Vec<usize>> {
    let candidates = view.study.candidates();
    let is_wave = |k: &usize| candidates[*k].stands_apart && view.study.frequency(*k).is_some();
    let mut families: std::collections::BTreeMap<&str, Vec<usize>> = std::collections::BTreeMap::new();
    for k in (0..candidates.len()).filter(is_wave) {
        families.entry(&candidates[k].family).or_default().push(k);
    }
    let has_one = |waves: &Vec<usize>| waves.iter().any(|k| set.contains(k));
    families.into_values().filter(|waves| !has_one(waves)).collect()
}

/// Evidence for what was found of position together, or for the best of all forms of it.
fn most_of_one(view: &View, without: &Fit, replaced: &[usize], rivals: &[usize]) -> f64 {
    let count = view.study.candidates().len();
    let of = |set: &[usize]| {
        let columns: Vec<_> = set.iter().map(|k| view.columns(&without.point, *k)).collect();
        let (score, rows) = without.score_columns(view, &joined(&columns));
        score.evidence(rows, count)
    };
    let found = if replaced.is_empty() { f64::NEG_INFINITY } else { of(replaced) };
    rivals.iter().map(|k| of(&[*k])).fold(found, f64::max)
}

/// The smooth error and the wave that together have most evidence.
fn best_pair(view: &mut View, without: &Fit, smooth: &[usize], waves: &[usize]) -> Result<Option<Pair>, DiagnoseError> {
    let mut best: Option<Pair> = None;
    let count = view.study.candidates().len();
    for smooth in std::iter::once(None).chain(smooth.iter().copied().map(Some)) {
        let set = [without.set(), smooth.into_iter().collect()].concat();
        // A polynomial that few places do not determine is none.
        let Ok(beside) = Fit::settle(view, &set) else { continue };
        let alone = waves.iter().map(|k| (*k, beside.score(view, *k).0.gain));
        let Some((wave, _)) = alone.max_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
        view.refine(&beside, wave);
        let Some((frequency, _)) = view.study.frequency(wave) else { continue };
        let columns: Vec<_> = smooth.iter().chain([&wave]).map(|k| view.columns(&without.point, *k)).collect();
        let (score, rows) = without.score_columns(view, &joined(&columns));
        let evidence = score.evidence(rows, count) - 2.0 * (tried(&*view.study, wave) as f64).ln();
        if best.as_ref().is_none_or(|best| evidence > best.evidence) {
            best = Some(Pair { smooth, wave, frequency, evidence });
        }
    }
    Ok(best)
}

/// The set with a pair, if it passes what any candidate must.
fn passed(
    view: &mut View,
    rest: Vec<usize>,
    pair: &Pair,
    significance: f64,
) -> Result<Option<Vec<usize>>, DiagnoseError> {
    view.set_frequency(pair.wave, pair.frequency);
    let noises = view.noises();
    let first = rest.len();
    let beside = [rest, pair.smooth.into_iter().collect()].concat();
    let set = [beside.clone(), vec![pair.wave]].concat();
    // In the noise that both leave: without them, what they explain would pass for slow noise.
    view.adapt(&set)?;
    let fit = Fit::settle(view, &beside)?;
    let tested = view.study.candidates().len();
    let reason = reason_against(view, &fit, pair.wave, tested, significance)?;
    view.take_noises(noises);
    let is_in = reason.is_none() && reason_of_blocks(view, &set, first).is_none();
    Ok(is_in.then_some(set))
}
