//! What a search decided, step by step, for the record.
//!
//! Place in the flow: [`crate::search`] and what follows it write them down; the diagnosis reads which term went in when, and why others stay out.

use crate::aliased_period::Period;
use crate::candidates::Candidate;
use crate::context::takes_its_time;
use crate::gate::Verdict;
use crate::named::named;
use crate::same_claim::{DESCRIPTION, has, is_variant, read_the_same};
use crate::search::State;
use abbe_geometry::effects::{Shape, known};
use abbe_identify::EffectTerm;

/// Words for what stands in the uncertainty.
pub(crate) const HELD: &str = "it corrects nothing, and stands in U";

/// A candidate that explains the residual but stays out of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct SetAside {
    /// Name in the registry.
    pub name: String,
    /// Name for readers.
    pub title: &'static str,
    /// Its shape.
    pub shape: Shape,
    /// Why it stays out.
    pub because: String,
}

/// One thing that a round decided.
#[derive(Debug, Clone)]
pub(crate) enum Step {
    /// A term went in.
    Added {
        /// What went in.
        term: EffectTerm,
        /// Its score.
        candidate: Box<Candidate>,
        /// Others that explain nearly as much.
        rivals: Vec<Candidate>,
        /// Probability by chance, corrected for the number of tests.
        p_corrected: f64,
        /// How it predicts what it was not fitted to.
        verdict: Verdict,
    },
    /// A candidate was tried and stays out.
    SetAside {
        /// Which.
        term: EffectTerm,
        /// Name for readers.
        title: &'static str,
        /// Why.
        because: String,
        /// It is there, and costs more than it is worth.
        is_costly: bool,
    },
    /// A term went out: the others explain what it did.
    Removed { term: EffectTerm },
    /// Error functions got more coefficients.
    Enriched {
        /// The error function that needed them most.
        because: String,
    },
    /// Something that the search could not do.
    Noted(String),
}

impl Step {
    /// A term that goes out again, or stays out, and why.
    pub(crate) fn set_aside(term: EffectTerm, because: String) -> Step {
        Step::set_aside_for(term, (because, false))
    }

    /// The same, of one that is there and costs more than it is worth where it is so.
    pub(crate) fn set_aside_for(term: EffectTerm, (because, is_costly): (String, bool)) -> Step {
        let title = known(term.effect.name()).map_or("an effect", |known| known.title);
        Step::SetAside { term, title, because, is_costly }
    }

    /// What was decided, for readers.
    pub(crate) fn words(&self) -> String {
        match self {
            Step::Added { candidate, rivals, p_corrected, .. } => {
                let also: Vec<String> = rivals.iter().map(|r| named(r.known.name, &r.term.shape)).collect();
                let also =
                    if also.is_empty() { String::new() } else { format!("; nearly as good: {}", also.join(", ")) };
                // Below the smallest double a probability reads as zero, which it is not.
                let p = if *p_corrected > 0.0 { format!("p = {p_corrected:.1e}") } else { "p below 1e-300".to_owned() };
                format!("added {} at {p}{also}", named(candidate.known.title, &candidate.term.shape))
            }
            Step::Removed { term } => {
                format!("removed {}: the others explain what it did", named(term.effect.name(), &term.shape))
            }
            Step::SetAside { term, title, because, .. } => {
                format!("set aside {}: {because}", named(title, &term.shape))
            }
            Step::Noted(words) => words.clone(),
            Step::Enriched { because } => format!("gave the error functions more coefficients: {because} needed them"),
        }
    }
}

/// How a term went in.
pub(crate) struct Addition<'a> {
    pub(crate) candidate: &'a Candidate,
    pub(crate) rivals: &'a [Candidate],
    pub(crate) p_corrected: f64,
    pub(crate) verdict: &'a Verdict,
}

/// How a term went in; `None` of what the model had before.
pub(crate) fn added<'s>(state: &'s State, own: &EffectTerm) -> Option<Addition<'s>> {
    state.steps.iter().rev().find_map(|step| match step {
        Step::Added { term, candidate, rivals, p_corrected, verdict } if has(std::slice::from_ref(own), term) => {
            Some(Addition { candidate, rivals, p_corrected: *p_corrected, verdict })
        }
        _ => None,
    })
}

impl State<'_> {
    /// The candidate, if the places that were read tell its period; a wave whose period is open is set aside.
    pub(crate) fn told(&mut self, period: Period) -> Option<Candidate> {
        match period {
            Period::Told(candidate) => Some(candidate),
            Period::Open(wave) => {
                self.set_aside.push(wave.term.clone());
                self.steps.push(Step::set_aside(wave.term.clone(), wave.because()));
                // Whenever the model has changed, it is looked at anew.
                self.open_waves.retain(|known| !known.is(&wave));
                self.open_waves.push(wave);
                None
            }
        }
    }

    /// Terms that went in and are still there, with their evidence then, over as many rows.
    pub(crate) fn added(&self, rows: usize) -> impl Iterator<Item = (&EffectTerm, f64)> {
        self.steps.iter().filter_map(move |step| match step {
            Step::Added { term, candidate, .. } if has(&self.terms, term) => Some((term, candidate.evidence(rows))),
            _ => None,
        })
    }

    /// Whether the search refused a course in time and did not let in another form of it: all that is slow looks the same, but it is there. What
    /// was too costly has its own place in the uncertainty.
    pub(crate) fn has_course_set_aside(&self) -> bool {
        let is_in = |term: &EffectTerm| self.terms.iter().any(|own| is_variant(own, term));
        self.steps.iter().any(|step| {
            matches!(step, Step::SetAside { term, is_costly: false, .. } if takes_its_time(term) && !is_in(term))
        })
    }

    /// Effects with a cause that the search refused and did not let in.
    pub(crate) fn causes_set_aside(&self) -> impl Iterator<Item = &EffectTerm> {
        self.steps.iter().filter_map(|step| match step {
            Step::SetAside { term, .. } if term.effect.name() != DESCRIPTION && !has(&self.terms, term) => Some(term),
            _ => None,
        })
    }

    /// What the search refused for good reason and did not let in later, the last reason of each; `held` stand in the uncertainty.
    pub(crate) fn set_aside(&self, held: &[EffectTerm]) -> Vec<SetAside> {
        let mut all: Vec<SetAside> = Vec::new();
        for step in &self.steps {
            if let Step::SetAside { term, title, because, is_costly } = step {
                let (name, shape) = (term.effect.name().to_owned(), term.shape.clone());
                all.retain(|known| known.name != name || known.shape != shape);
                let is_held = *is_costly && held.iter().any(|other| read_the_same(other, term));
                let because = if is_held { format!("{because}; {HELD}") } else { because.clone() };
                all.push(SetAside { name, title, shape, because });
            }
        }
        let is_in = |s: &SetAside| self.terms.iter().any(|t| t.effect.name() == s.name && t.shape == s.shape);
        all.retain(|known| !is_in(known));
        all
    }
}
