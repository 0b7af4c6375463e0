//! What a study answers: what the search finds, and what of it predicts.
//!
//! Place in the flow: between the search and the words ([`super::assemble`]). Rows that are gross errors go out, the search runs on all
//! others, it is judged on blocks that it does not see, and what does not predict is taken back. What bends with a quantity fits more than what
//! goes straight with it, and runs off beyond what it was fitted to: so straight forms are asked as well, and the answer is theirs where they
//! predict better.

use super::candidate::{Forms, Study};
use super::confirm::{beyond_chance, confirmed};
use super::judge::judge;
use super::nested::{Parts, SURE, unseen};
use super::outcome::{HeldOutRms, Look, Unseen};
use super::outliers::{Outliers, outliers};
use super::placing::{Placed, beside_rejected};
use super::search::{Found, Observe, StudyOptions, search};
use super::view::View;
use crate::error::DiagnoseError;
use std::collections::BTreeSet;

/// Why a study that was stopped is not judged.
const STOPPED: &str = "the study was stopped before parts of the data were left out";
/// Searches on all rows at most: each may show other rows to be gross.
const SEARCHES: usize = 3;
/// Error on data that a search did not see, over what its fit leaves of those that it saw, from which a form is said to run off.
const RUNS_OFF: f64 = 1.2;
/// How sure the second of two tries must be.
const SURER: f64 = 1.0 - (1.0 - SURE) / 2.0;

/// What a search found and what predicts of it.
pub(super) struct Answer {
    pub(super) found: Found,
    pub(super) gross: Outliers,
    pub(super) unseen: Unseen,
    /// What fits and does not predict.
    pub(super) unconfirmed: Vec<Look>,
    parts: Parts,
}

impl Answer {
    /// The answer of all forms, or of the straight ones. `first` are the gross rows before anything was found.
    pub(super) fn of(
        study: &mut dyn Study,
        given: (usize, &Outliers),
        options: &StudyOptions,
        observe: &mut Observe,
    ) -> Result<Answer, DiagnoseError> {
        let answer = Answer::of_forms(study, given, options, observe)?;
        if answer.found.is_stopped || !study.offer(Forms::Straight) {
            return Ok(answer);
        }
        let is_asked = answer.is_bent(study) && answer.runs_off(study, given.0)?;
        let answer = if is_asked { answer.or_straight(study, given, options, observe) } else { Ok(answer) };
        study.offer(Forms::All);
        answer
    }

    /// The answer of the forms that the study offers.
    fn of_forms(
        study: &mut dyn Study,
        (rows, first): (usize, &Outliers),
        options: &StudyOptions,
        observe: &mut Observe,
    ) -> Result<Answer, DiagnoseError> {
        let (mut found, gross) = searched(study, rows, first.clone(), options, observe)?;
        let (mut unseen, parts) = judged(study, (rows, first), &mut found, options, observe)?;
        let left_out = gross.rows(study);
        let mut unconfirmed = Vec::new();
        loop {
            unconfirmed.extend(confirmed(study, &mut found, &mut unseen, &parts));
            if !beyond_chance(study, (rows, &left_out), &mut found, (&mut unseen, &parts), options.significance)? {
                break;
            }
        }
        let unconfirmed = unconfirmed.iter().map(|own| own.look(found.set.is_empty())).collect();
        Ok(Answer { found, gross, unseen, parts, unconfirmed })
    }

    /// Whether it rests on forms that are not offered now, or on nothing although something fits.
    fn is_bent(&self, study: &dyn Study) -> bool {
        let set = &self.found.set;
        if set.is_empty() { !self.unconfirmed.is_empty() } else { set.iter().any(|k| !study.is_offered(*k)) }
    }

    /// Whether it predicts much worse than it fits, or not at all.
    fn runs_off(&self, study: &mut dyn Study, rows: usize) -> Result<bool, DiagnoseError> {
        let Some(after) = self.unseen.after.as_ref().filter(|_| !self.found.set.is_empty()) else { return Ok(true) };
        let left_out = self.gross.rows(study);
        let mut view = View::new(study, rows, |row| !left_out.contains(&row));
        let fit = view.adapt(&self.found.set)?;
        Ok(after.rms_um > RUNS_OFF * judge(&view, &fit).rms_um)
    }

    /// This answer, or that of the straight forms, which the study offers now, where they surely predict: as the second of two tries, and better
    /// than this one.
    fn or_straight(
        mut self,
        study: &mut dyn Study,
        given: (usize, &Outliers),
        options: &StudyOptions,
        observe: &mut Observe,
    ) -> Result<Answer, DiagnoseError> {
        let all: Vec<usize> = (0..study.candidates().len()).collect();
        let placed = Placed::of(study, &all);
        let straight = match Answer::of_forms(study, given, options, observe) {
            Ok(answer) if !answer.found.is_stopped => answer,
            // What was found and judged is not lost with the question of what goes straight.
            Ok(_) | Err(DiagnoseError::Stopped) if !self.found.set.is_empty() => {
                placed.take(study);
                self.found.is_stopped = true;
                return Ok(self);
            }
            Ok(_) => return Err(DiagnoseError::Stopped),
            Err(error) => return Err(error),
        };
        let is_better = Placed::around(study, &all, |study| straight.is_better(&self, study));
        if !is_better {
            placed.take(study);
            return Ok(self);
        }
        let instead = straight.instead_of(&self, study).filter(|_| !self.found.set.is_empty());
        let unconfirmed = [instead.into_iter().collect(), self.unconfirmed, straight.unconfirmed].concat();
        let refused = [self.found.refused, straight.found.refused].concat();
        let found = Found { considered: self.found.considered, refused, ..straight.found };
        Ok(Answer { found, unconfirmed, ..straight })
    }

    /// Whether the error surely comes down by it, as the second of two tries, and further than by another answer, with what each of its searches
    /// found and with what is left of it. On average: of two that predict, the one in plainer words needs no proof.
    fn is_better(&self, other: &Answer, study: &mut dyn Study) -> bool {
        if self.found.set.is_empty() {
            return false;
        }
        let Some((before, after, is_sure)) = self.parts.of(study, &self.found.set, SURER) else { return false };
        if !is_sure || after.rms_um >= before.rms_um {
            return false;
        }
        if other.found.set.is_empty() {
            return true;
        }
        let beats = |judged: Option<HeldOutRms>| judged.is_some_and(|other| after.rms_um < other.rms_um);
        self.parts.count() == other.parts.count()
            && beats(other.parts.of_searches(study))
            && beats(other.parts.of(study, &other.found.set, SURE).map(|(_, after, _)| after))
    }

    /// That it stands in place of another answer.
    fn instead_of(&self, other: &Answer, study: &dyn Study) -> Option<Look> {
        let (own, others) = (self.unseen.after.as_ref()?, other.unseen.after.as_ref()?);
        let names: Vec<&str> = other.found.set.iter().map(|k| study.candidates()[*k].name.as_str()).collect();
        let says = format!(
            "{} fits more, but what goes straight predicts better: on blocks that a search does not see, {:.3} µm are left by it, and {:.3} by \
             what is claimed",
            names.join("; "),
            others.rms_um,
            own.rms_um
        );
        Some(Look { what: "what bends".to_owned(), says, is_noise: None })
    }
}

/// The judgement on blocks that the search did not see; where it is stopped, what was found stays, unjudged.
fn judged(
    study: &mut dyn Study,
    (rows, first): (usize, &Outliers),
    found: &mut Found,
    options: &StudyOptions,
    observe: &mut Observe,
) -> Result<(Unseen, Parts), DiagnoseError> {
    let gross = first.rows(study);
    let not_judged = |gross| {
        let because = STOPPED.to_owned();
        (Unseen { missing_because: Some(because), ..Unseen::default() }, Parts::none(rows, gross))
    };
    if found.is_stopped {
        return Ok(not_judged(gross));
    }
    let all: Vec<usize> = (0..study.candidates().len()).collect();
    match Placed::around(study, &all, |study| unseen(study, rows, &gross, options, observe)) {
        Err(DiagnoseError::Stopped) if !found.set.is_empty() => {
            found.is_stopped = true;
            Ok(not_judged(gross))
        }
        judged => judged,
    }
}

/// What the search finds on all rows but the gross ones, and these.
fn searched(
    study: &mut dyn Study,
    rows: usize,
    mut gross: Outliers,
    options: &StudyOptions,
    observe: &mut Observe,
) -> Result<(Found, Outliers), DiagnoseError> {
    let mut seen: Vec<BTreeSet<usize>> = Vec::new();
    let mut last: Option<(Placed, Found, Outliers)> = None;
    loop {
        study.reset();
        let left_out = gross.rows(study);
        let mut view = View::new(study, rows, |row| !left_out.contains(&row));
        let found = match (search(&mut view, options, None, observe), last) {
            // One that was done is worth more than part of another.
            (Err(DiagnoseError::Stopped) | Ok(Found { is_stopped: true, .. }), Some((placed, found, gross))) => {
                let (placed, found): (Placed, Found) = (placed, found);
                placed.take(study);
                return Ok((Found { is_stopped: true, ..found }, gross));
            }
            (found, _) => found?,
        };
        seen.push(left_out);
        if found.is_stopped {
            return Ok((found, gross));
        }
        let next = outliers(study, &found.set, |_| true)?;
        let next = beside_rejected(study, &found.set, next)?;
        if seen.contains(&next.rows(study)) || seen.len() == SEARCHES {
            return Ok((found, gross));
        }
        let all: Vec<usize> = (0..study.candidates().len()).collect();
        last = Some((Placed::of(study, &all), found, gross));
        gross = next;
    }
}
