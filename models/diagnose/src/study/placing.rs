//! Where steps are set while a study searches, what the choice costs, and what it leaves open.
//!
//! Place in the flow: beside the search. Candidates are those of [`super::step`]. A step whose place the data choose is set to the
//! place that explains most, and pays for all places that were tried, in its probability as in its evidence.

use super::candidate::Study;
use super::fit::Fit;
use super::outliers::{Outliers, outliers};
use super::scored::{COMPARABLE, Scored};
use super::view::View;
use crate::error::DiagnoseError;
use abbe_identify::in_parallel;
use faer::Mat;
use std::collections::{BTreeMap, BTreeSet};

/// Evidence within which a step and a drift are one: of two cycles, either is the difference. The drift is taken, which more cycles
/// would show as well.
const SAME: f64 = 1e-3;

/// Number of choices of which a candidate is one: by so much more often it is found by chance.
pub(super) fn tried(study: &dyn Study, candidate: usize) -> usize {
    study.choices(candidate, &study.steps_after(candidate)).max(1.0) as usize
}

/// What a search found, with the frequencies and places that it took.
#[derive(Debug, Default)]
pub(super) struct Placed(Vec<(usize, Option<f64>, Vec<usize>)>);

impl Placed {
    pub(super) fn of(study: &dyn Study, set: &[usize]) -> Placed {
        let free = |k: usize| if study.places(k).is_empty() { Vec::new() } else { study.steps_after(k) };
        Placed(set.iter().map(|k| (*k, study.frequency(*k).map(|(own, _)| own), free(*k))).collect())
    }

    /// What `work` gives, which may set candidates elsewhere; afterwards these are set as before.
    pub(super) fn around<T>(study: &mut dyn Study, set: &[usize], work: impl FnOnce(&mut dyn Study) -> T) -> T {
        let placed = Placed::of(study, set);
        let given = work(study);
        placed.take(study);
        given
    }

    pub(super) fn set(&self) -> impl Iterator<Item = usize> {
        self.0.iter().map(|(candidate, ..)| *candidate)
    }

    /// Takes them again, and forgets all others.
    pub(super) fn take(&self, study: &mut dyn Study) {
        study.reset();
        for (candidate, frequency, places) in &self.0 {
            frequency.iter().for_each(|frequency| study.set_frequency(*candidate, *frequency));
            if !places.is_empty() {
                study.set_places(*candidate, places);
            }
        }
    }
}

/// Whether a candidate is a step, or several.
pub(super) fn is_step(study: &dyn Study, candidate: usize) -> bool {
    !study.steps_after(candidate).is_empty()
}

/// Choices among which steps between so many blocks were made; 1 for other candidates.
pub(super) fn between(study: &dyn Study, candidate: usize) -> usize {
    let steps = study.steps_after(candidate).len();
    (1..=steps).map(|k| study.blocks().len() as f64 / k as f64).product::<f64>().ceil() as usize
}

/// Steps of one family and one number.
fn key(study: &dyn Study, candidate: usize) -> (String, usize) {
    (study.candidates()[candidate].family.clone(), study.steps_after(candidate).len())
}

/// Sets the first free candidate of each chain to its best place beside a fit, and prices what was chosen among places; those
/// behind it wait and are not scored. What is `kept` stays where it is.
pub(super) fn placed(view: &mut View, fit: &Fit, kept: &[usize], all: &mut Vec<Scored>) {
    let tested = all.len();
    let is_free = |view: &View, k: usize| !view.study.places(k).is_empty() && !kept.contains(&k);
    let mut seen = BTreeSet::new();
    all.retain(|scored| !is_free(view, scored.candidate) || seen.insert(key(&*view.study, scored.candidate)));
    let free: Vec<usize> = all.iter().map(|scored| scored.candidate).filter(|k| is_free(view, *k)).collect();
    let best = in_parallel(&free, |k| view.best_places(fit, *k));
    for (candidate, places) in free.iter().zip(best) {
        places.into_iter().for_each(|places| view.set_places(*candidate, &places));
    }
    for scored in all.iter_mut().filter(|scored| !view.study.places(scored.candidate).is_empty()) {
        if free.contains(&scored.candidate) {
            let (score, rows) = fit.score(view, scored.candidate);
            scored.evidence = score.evidence(rows, tested);
            scored.score = score;
        }
        let tried = tried(&*view.study, scored.candidate) as f64;
        scored.evidence -= 2.0 * tried.ln();
        scored.score.p_value = (scored.score.p_value * tried).min(1.0);
    }
}

/// Leaves of the steps of a family only those that explain nearly as much as the best of them: where that one is refused, a step
/// at another place is not what happened. Puts them behind what is the same.
pub(super) fn best_placed(view: &View, passing: &mut Vec<Scored>) {
    let mut most: BTreeMap<(String, usize), f64> = BTreeMap::new();
    for scored in passing.iter().filter(|scored| is_step(&*view.study, scored.candidate)) {
        let own = most.entry(key(&*view.study, scored.candidate)).or_insert(scored.evidence);
        *own = own.max(scored.evidence);
    }
    let is_near = |scored: &Scored| {
        most.get(&key(&*view.study, scored.candidate)).is_none_or(|most| most - scored.evidence < COMPARABLE)
    };
    passing.retain(is_near);
    let value = |scored: &Scored| scored.evidence - if is_step(&*view.study, scored.candidate) { SAME } else { 0.0 };
    passing.sort_by(|a, b| value(b).total_cmp(&value(a)));
}

/// The set with steps that were found together as steps of their own, where there are candidates for these.
pub(super) fn single(view: &mut View, set: &[usize]) -> Vec<usize> {
    let mut all: Vec<usize> = Vec::with_capacity(set.len());
    for candidate in set {
        let study = &*view.study;
        let places = study.steps_after(*candidate);
        if places.len() < 2 {
            all.push(*candidate);
            continue;
        }
        let family = study.candidates()[*candidate].family.clone();
        let is_own = |k: &usize| study.candidates()[*k].family == family && study.steps_after(*k).len() == 1;
        let own: Vec<usize> = (0..study.candidates().len()).filter(is_own).collect();
        let (mut free, likely): (Vec<usize>, Vec<usize>) = own.into_iter().partition(|k| !study.places(*k).is_empty());
        free.retain(|k| !set.contains(k) && !all.contains(k));
        let mut free = free.into_iter();
        let one = |place: &usize| match likely.iter().find(|k| study.steps_after(**k) == [*place]) {
            Some(likely) => Some((*likely, None)),
            None => free.next().map(|free| (free, Some(*place))),
        };
        let parts: Option<Vec<(usize, Option<usize>)>> = places.iter().map(one).collect();
        match parts.filter(|parts| parts.iter().all(|(k, _)| !set.contains(k) && !all.contains(k))) {
            None => all.push(*candidate),
            Some(parts) => {
                for (k, place) in parts {
                    place.into_iter().for_each(|place| view.set_places(k, &[place]));
                    all.push(k);
                }
            }
        }
    }
    all
}

/// The set with its steps where they explain most beside all the rest: a place that was found while other effects were missing may
/// be off by what these did. Nothing where there is no step.
pub(super) fn moved(view: &mut View, set: &[usize]) -> Result<Option<Vec<usize>>, DiagnoseError> {
    let mut set = set.to_vec();
    let steps: Vec<usize> = (0..set.len()).filter(|k| view.study.steps_after(set[*k]).len() == 1).collect();
    for k in &steps {
        let own = set[*k];
        let rest: Vec<usize> = set.iter().copied().filter(|other| *other != own).collect();
        let without = Fit::settle(view, &rest)?;
        let evidence = |view: &View, candidate: usize| {
            let (score, rows) = without.score(view, candidate);
            score.evidence(rows, tried(&*view.study, candidate))
        };
        let study = &*view.study;
        let is_likely = |other: &usize| {
            key(study, *other) == key(study, own) && !rest.contains(other) && study.places(*other).is_empty()
        };
        let likely: Vec<usize> = (0..study.candidates().len()).filter(is_likely).collect();
        let free = free_of_its_family(study, &set, own);
        let mut best = (own, evidence(view, own));
        if let Some(free) = free {
            view.place(&without, free);
            let there = (free, evidence(view, free));
            best = if free == own { there } else { better(best, there) };
        }
        set[*k] = likely.into_iter().fold(best, |best, other| better(best, (other, evidence(view, other)))).0;
    }
    Ok((!steps.is_empty()).then_some(set))
}

fn better(one: (usize, f64), other: (usize, f64)) -> (usize, f64) {
    if other.1 > one.1 { other } else { one }
}

/// The candidate itself where it is free, else one of its family that waits.
fn free_of_its_family(study: &dyn Study, set: &[usize], own: usize) -> Option<usize> {
    let is_free = |k: &usize| key(study, *k) == key(study, own) && !study.places(*k).is_empty();
    let waits = |k: &usize| is_free(k) && !set.contains(k);
    Some(own).filter(is_free).or_else(|| (0..study.candidates().len()).find(waits))
}

/// Rows that stand apart, with each step on the other side of those that were rejected next to it where fewer are left then: rows
/// between a step and the place that it was given are off by the step, and are no accidents.
pub(super) fn beside_rejected(
    study: &mut dyn Study,
    set: &[usize],
    mut rejected: Outliers,
) -> Result<Outliers, DiagnoseError> {
    for own in set {
        let Some((chain, _)) = study.chain_columns(*own, &[]) else { continue };
        let places = study.steps_after(*own);
        let [before] = places[..] else { continue };
        let out = rejected.rows(study);
        let order = &study.chains()[chain].rows;
        let is_out = |row: &&usize| out.contains(*row);
        let (earlier, later) = order.split_at(before.min(order.len()));
        let earlier = before - earlier.iter().rev().take_while(is_out).count();
        let later = before + later.iter().take_while(is_out).count();
        for place in [earlier, later].into_iter().filter(|place| *place != before) {
            let Some(free) = free_of_its_family(study, set, *own) else { continue };
            if !study.places(free).contains(&place) {
                continue;
            }
            let was = study.steps_after(free);
            study.set_places(free, &[place]);
            let others = set.iter().map(|k| if k == own { free } else { *k }).collect::<Vec<_>>();
            let next = outliers(study, &others, |_| true)?;
            if next.rejected.len() < rejected.rejected.len() && next.too_many.len() <= rejected.too_many.len() {
                rejected = next;
            }
            study.set_places(free, &was);
        }
    }
    Ok(rejected)
}

/// Directions in rows of the study that a view does not hold, and of which nobody knows on which side of a step they lie: the rows
/// left out next to it, those before and those after it. A step between two cycles, one of which is left out, may as well be on its
/// other side.
pub(super) fn undecided(view: &View, set: &[usize], rows: &[usize]) -> Mat<f64> {
    let out: BTreeMap<usize, usize> = rows.iter().enumerate().map(|(i, row)| (*row, i)).collect();
    let mut directions: Vec<Vec<usize>> = Vec::new();
    for candidate in set.iter().filter(|k| is_step(&*view.study, **k)) {
        let Some((chain, _)) = view.study.chain_columns(*candidate, &[]) else { continue };
        let order = &view.study.chains()[chain].rows;
        let is_out = |row: &&usize| !view.holds(**row);
        let place = |row: &usize| out.get(row).copied();
        for before in view.study.steps_after(*candidate) {
            let (earlier, later) = order.split_at(before.min(order.len()));
            directions.push(earlier.iter().rev().take_while(is_out).filter_map(place).collect());
            directions.push(later.iter().take_while(is_out).filter_map(place).collect());
        }
    }
    directions.retain(|direction| !direction.is_empty());
    let mut columns = Mat::zeros(rows.len(), directions.len());
    for (j, direction) in directions.iter().enumerate() {
        direction.iter().for_each(|i| columns[(*i, j)] = 1.0);
    }
    columns
}
