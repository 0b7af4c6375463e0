//! Keeps of what was found only what predicts blocks that the search did not see.
//!
//! Place in the flow: after the searches without a part of the data and the one with all. Where all that was found does not bring the
//! error down, the weakest goes, and what is left is judged in the same parts; being one of several tries, it must be the surer. What is then
//! no better than chance beside the rest, in the noise that is left, goes as well, and the rest is judged again.

use super::candidate::Study;
use super::fit::Fit;
use super::nested::{Parts, SURE};
use super::outcome::{HeldOutRms, Look, Unseen};
use super::placing::{Placed, tried};
use super::search::Found;
use super::significance::probability;
use super::view::View;
use crate::error::DiagnoseError;
use crate::explanation::Explanation;
use std::collections::BTreeSet;

/// Why what chance explains is not claimed.
const BY_CHANCE: &str = "beside all else that was found, chance explains it";
/// Blocks of which one less may be too few for a search: with three or four cycles of five targets, a table that is there has as many
/// figures as readings that are left to tell its noise.
const FEW: usize = 4;
/// Why what does not predict is not claimed.
const UNCONFIRMED: &str = "it fits, but searches that do not see a block predict it no better";

/// Takes back, the least likely first, what chance explains beside all the rest: it came in beside other things, when the noise was another.
/// Whether there was any. It was chosen among many then; now it is one, and held against the significance as it is, if it surely predicts: where
/// that is not sure, either, it must stand out from all that were tried.
pub(super) fn beyond_chance(
    study: &mut dyn Study,
    (rows, left_out): (usize, &BTreeSet<usize>),
    found: &mut Found,
    (unseen, parts): (&mut Unseen, &Parts),
    significance: f64,
) -> Result<bool, DiagnoseError> {
    let known = found.refused.len();
    let mut view = View::new(study, rows, |row| !left_out.contains(&row));
    loop {
        view.adapt(&found.set)?;
        let p_value = if unseen.is_sure == Some(false) { p_beside } else { by_chance };
        let of = |k: &usize| Ok((*k, p_value(&view, &found.set, *k)?.1));
        let each = found.set.iter().map(of).collect::<Result<Vec<(usize, f64)>, DiagnoseError>>()?;
        let likeliest = each.into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((out, _)) = likeliest.filter(|(_, p_value)| *p_value > significance) else { break };
        found.set.retain(|k| *k != out);
        found.refused.push((out, BY_CHANCE));
    }
    if found.refused.len() == known {
        return Ok(false);
    }
    let judged = Placed::around(&mut *view.study, &found.set, |study| parts.of(study, &found.set, SURE));
    if let Some((before, after, is_sure)) = judged {
        (unseen.before, unseen.after, unseen.is_sure) = (Some(before), Some(after), Some(is_sure));
        unseen.chosen_on_all = false;
    }
    Ok(true)
}

/// The fit without one of a set, and the probability that chance explains as much of what it leaves.
fn by_chance(view: &View, set: &[usize], candidate: usize) -> Result<(Fit, f64), DiagnoseError> {
    let without = Fit::without(view, set, candidate)?;
    let p_value = probability(view, &without, &view.columns(&without.point, candidate))?;
    Ok((without, p_value))
}

/// The same for all that were tried.
pub(super) fn p_beside(view: &View, set: &[usize], candidate: usize) -> Result<(Fit, f64), DiagnoseError> {
    let (without, p_value) = by_chance(view, set, candidate)?;
    let trials = view.study.candidates().len().saturating_mul(tried(&*view.study, candidate));
    Ok((without, (p_value * trials as f64).min(1.0)))
}

/// Takes back what was found where searches that do not see a block predict it no better. Where it is not sure that the error comes down,
/// as much of it stays as surely brings it down, else what has a name; descriptions are worth nothing but what they predict.
pub(super) fn confirmed(
    study: &mut dyn Study,
    found: &mut Found,
    unseen: &mut Unseen,
    parts: &Parts,
) -> Option<Unconfirmed> {
    let (before, after) = (unseen.before?, unseen.after?);
    if found.set.is_empty() {
        // What searches on parts found is not in the answer, so that their error is not that of the answer.
        unseen.after = Some(before);
        return None;
    }
    let is_named = |k: &usize| study.candidates()[*k].kind == Explanation::Attributed;
    let named: Vec<usize> = found.set.iter().copied().filter(is_named).collect();
    let gains = after.rms_um < before.rms_um;
    if gains && (unseen.is_sure == Some(true) || named.len() == found.set.len()) {
        return None;
    }
    let kept = Placed::around(study, &found.set, |study| {
        surely(study, &found.set, parts).or_else(|| likely(study, named, parts))
    });
    let is_searched = kept.is_some();
    let kept = kept.or_else(|| Placed::around(study, &found.set, |study| chosen(study, &found.set, parts)));
    unseen.chosen_on_all = !is_searched && kept.is_some();
    let (set, judged) = kept.unwrap_or_else(|| (Vec::new(), (before, before, false)));
    let (kept, dropped): (Vec<usize>, Vec<usize>) = found.set.iter().partition(|k| set.contains(k));
    let names = dropped.iter().map(|k| study.candidates()[*k].name.clone()).collect();
    let unconfirmed = Unconfirmed { names, rms_um: (before.rms_um, after.rms_um) };
    found.set = kept;
    found.refused.extend(dropped.into_iter().map(|k| (k, UNCONFIRMED)));
    let (before, after, is_sure) = judged;
    (unseen.before, unseen.after, unseen.is_sure) = (Some(before), Some(after), Some(is_sure));
    Some(unconfirmed)
}

/// What fits and goes, with the errors without and with all that fitted.
pub(super) struct Unconfirmed {
    names: Vec<String>,
    rms_um: (f64, f64),
}

impl Unconfirmed {
    /// In words, once it is known whether anything is claimed.
    pub(super) fn look(&self, is_alone: bool) -> Look {
        let (before_um, after_um) = self.rms_um;
        let beside = if is_alone { "" } else { " beside what is claimed" };
        if before_um == after_um {
            let says = format!(
                "{} fits{beside}, but searches that do not see a block find none of it: too few blocks are left then, or it is no more \
                 than chance",
                self.names.join("; ")
            );
            return Look { what: "what the search found".to_owned(), says, is_noise: Some(false) };
        }
        // A mean may come down by a few blocks, while others get worse.
        let predicts = if after_um < before_um { "predicts too few blocks to be believed" } else { "does not predict" };
        let says = format!(
            "{} fits{beside}, but {predicts}: on blocks that a search does not see, the error goes from {before_um:.3} to \
             {after_um:.3} µm with all that fits",
            self.names.join("; ")
        );
        Look { what: "what the search found".to_owned(), says, is_noise: Some(false) }
    }
}

/// Part of what was found, with the errors before and after and whether they come down surely.
type Kept = (Vec<usize>, (HeldOutRms, HeldOutRms, bool));

/// The most of the first found that surely predict.
fn surely(study: &mut dyn Study, set: &[usize], parts: &Parts) -> Option<Kept> {
    most(set, 1..set.len(), |set, probability| parts.of(study, set, probability))
}

/// The most of the first of a set that surely predict, of so many tries.
fn most(
    set: &[usize],
    counts: std::ops::Range<usize>,
    mut judge: impl FnMut(&[usize], f64) -> Option<(HeldOutRms, HeldOutRms, bool)>,
) -> Option<Kept> {
    let one_of_several = 1.0 - (1.0 - SURE) / set.len() as f64;
    counts.rev().find_map(|count| {
        let judged = judge(&set[..count], one_of_several)?;
        (judged.2 && judged.1.rms_um < judged.0.rms_um).then(|| (set[..count].to_vec(), judged))
    })
}

/// Where a search without one of few blocks has too little left to find anything: the most of the first found that, fitted without each
/// block, surely predicts it. Only forms that choose no period and no place: such a choice would have seen the block.
fn chosen(study: &mut dyn Study, set: &[usize], parts: &Parts) -> Option<Kept> {
    if parts.count() > FEW {
        return None;
    }
    let is_free = |k: &usize| tried(&*study, *k) == 1 && study.frequency(*k).is_none();
    let free: Vec<usize> = set.iter().copied().take_while(is_free).collect();
    most(&free, 1..free.len() + 1, |set, probability| parts.of_chosen(study, set, probability))
}

/// What has a name, where it brings the error down.
fn likely(study: &mut dyn Study, named: Vec<usize>, parts: &Parts) -> Option<Kept> {
    let judged = if named.is_empty() { None } else { parts.of(study, &named, SURE) }?;
    (judged.1.rms_um < judged.0.rms_um).then_some((named, judged))
}
