//! Keeps of what was found only what predicts blocks that the search did not see.
//!
//! Place in the flow: after the searches without a part of the data and the one with all. Where all that was found does not bring the
//! error down, the weakest goes, and what is left is judged in the same parts; being one of several tries, it must be the surer.

use super::candidate::Study;
use super::diagnosis::{HeldOutRms, Kind, Look, Unseen};
use super::nested::{Parts, SURE};
use super::placing::Placed;
use super::search::Found;

/// Why what does not predict is not claimed.
const UNCONFIRMED: &str = "it fits, but searches that do not see a block predict it no better";

/// Takes back what was found where searches that do not see a block predict it no better. Where it is not sure that the error comes down,
/// as much of it stays as surely brings it down, else what has a name; descriptions are worth nothing but what they predict.
pub(super) fn confirmed(study: &mut dyn Study, found: &mut Found, unseen: &mut Unseen, parts: &Parts) -> Option<Look> {
    let (before, after) = (unseen.before?, unseen.after?);
    if found.set.is_empty() {
        // What searches on parts found is not in the answer, so that their error is not that of the answer.
        unseen.after = Some(before);
        return None;
    }
    let is_named = |k: &usize| study.candidates()[*k].kind == Kind::Attributed;
    let named: Vec<usize> = found.set.iter().copied().filter(is_named).collect();
    let gains = after.rms_um < before.rms_um;
    if gains && (unseen.is_sure == Some(true) || named.len() == found.set.len()) {
        return None;
    }
    let placed = Placed::of(study, &found.set);
    let kept = surely(study, &found.set, parts).or_else(|| likely(study, named, parts));
    placed.take(study);
    let (set, judged) = kept.unwrap_or_else(|| (Vec::new(), (before, before, false)));
    let (kept, dropped): (Vec<usize>, Vec<usize>) = found.set.iter().partition(|k| set.contains(k));
    let names: Vec<&str> = dropped.iter().map(|k| study.candidates()[*k].name.as_str()).collect();
    let beside = if kept.is_empty() { "" } else { " beside what is claimed" };
    let says = format!(
        "{} fits{beside}, but does not predict: on blocks that a search does not see, the error goes from {:.3} to {:.3} um with all \
         that fits",
        names.join("; "),
        before.rms_um,
        after.rms_um
    );
    found.set = kept;
    found.refused.extend(dropped.into_iter().map(|k| (k, UNCONFIRMED)));
    let (before, after, is_sure) = judged;
    (unseen.before, unseen.after, unseen.is_sure) = (Some(before), Some(after), Some(is_sure));
    Some(Look { what: "what the search found".to_owned(), says, is_noise: Some(false) })
}

/// Part of what was found, with the errors before and after and whether they come down surely.
type Kept = (Vec<usize>, (HeldOutRms, HeldOutRms, bool));

/// The most of the first found that surely predict.
fn surely(study: &mut dyn Study, set: &[usize], parts: &Parts) -> Option<Kept> {
    let one_of_several = 1.0 - (1.0 - SURE) / set.len() as f64;
    (1..set.len()).rev().find_map(|count| {
        let judged = parts.of(study, &set[..count], one_of_several)?;
        (judged.2 && judged.1.rms_um < judged.0.rms_um).then(|| (set[..count].to_vec(), judged))
    })
}

/// What has a name, where it brings the error down.
fn likely(study: &mut dyn Study, named: Vec<usize>, parts: &Parts) -> Option<Kept> {
    let judged = if named.is_empty() { None } else { parts.of(study, &named, SURE) }?;
    (judged.1.rms_um < judged.0.rms_um).then_some((named, judged))
}
