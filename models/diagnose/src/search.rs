//! The search: the effect with the most evidence goes in, everything is fitted again, until nothing passes.
//!
//! Place in the flow: [`crate::diagnose()`] starts it from the model's own effects. In each round named effects, periods,
//! runs, finer error functions and the look without candidates compete; a named effect goes before an empirical term
//! unless the latter explains far more. After each addition, terms that the new one made superfluous go out again.

use crate::candidates::{Candidate, Round, proposals, refined, score_all};
use crate::context::Context;
use crate::error::DiagnoseError;
use crate::linear::Linear;
use crate::look::{self, Variable};
use crate::options::{Options, Progress};
use crate::periodic::Periodogram;
use crate::score::Score;
use crate::{judge, order, periodic, runs};
use abbe_geometry::ErrorId;
use abbe_geometry::effects::{ShapeValue, known};
use abbe_geometry::machine::Machine;
use abbe_identify::{EffectTerm, Identified, IdentifyError, Rows, identify_with};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

/// Share of what the best free dependence explains that a named effect must explain to go before it.
const EXPLAINS: f64 = 0.6;
/// Share of the best effect's reduction from which finer error functions go first.
const AS_WELL: f64 = 0.5;
/// Share of the blocked mean square that finer error functions must save.
const MATERIAL: f64 = 0.1;
/// Rounds at most.
const MAX_ROUNDS: usize = 10;

/// What stays the same during a search.
pub(crate) struct Search<'a> {
    pub(crate) instrument: RangeUncertainty,
    pub(crate) campaign: &'a Campaign,
    pub(crate) options: &'a Options,
    pub(crate) context: Context,
    pub(crate) variables: Vec<Variable>,
    periodogram: RefCell<Periodogram>,
}

/// How far a search has come.
pub(crate) struct State<'a> {
    pub(crate) machine: Machine,
    pub(crate) terms: Vec<EffectTerm>,
    pub(crate) fit: Identified,
    pub(crate) steps: Vec<Step>,
    /// Finer error functions were tried and have no more evidence than these.
    pub(crate) order_settled: bool,
    /// Terms whose fit did not settle or that others made superfluous: not tried again.
    pub(crate) refused: Vec<EffectTerm>,
    /// The rows of `fit` as they are, where the last round looked at them so, with its named candidates.
    pub(crate) looked_at: Option<(Rc<Round<'a>>, Vec<Candidate>)>,
}

impl State<'_> {
    fn is_refused(&self, term: &EffectTerm) -> bool {
        has(&self.refused, term)
    }
}

/// One thing that a round decided.
#[derive(Debug, Clone)]
pub(crate) enum Step {
    /// A term went in.
    Added { term: EffectTerm, candidate: Box<Candidate>, rivals: Vec<Candidate>, p_corrected: f64 },
    /// A term went out: the others explain what it did.
    Removed { term: EffectTerm },
    /// Error functions got more coefficients.
    Enriched {
        /// The error function that needed them most.
        because: String,
    },
}

/// What a round proposes.
enum Proposal {
    Named(Candidate),
    Free(Candidate),
    Order(ErrorId),
    Nothing,
}

impl<'a> Search<'a> {
    pub(crate) fn new(instrument: RangeUncertainty, campaign: &'a Campaign, options: &'a Options) -> Search<'a> {
        let context = Context::new(campaign);
        let variables = look::variables(campaign, &context);
        let periodogram = RefCell::new(Periodogram::default());
        Search { instrument, campaign, options, context, variables, periodogram }
    }

    /// Fits these terms.
    pub(crate) fn fit(
        &self,
        machine: &Machine,
        terms: &[EffectTerm],
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<Identified, DiagnoseError> {
        let mut observe =
            |p: abbe_identify::Progress| observe(Progress::Fitting { pass: p.pass, effects: terms.len() });
        match identify_with(machine, self.instrument, self.campaign, terms, &self.options.identify, &mut observe) {
            Err(IdentifyError::Stopped) => Err(DiagnoseError::Stopped),
            other => Ok(other?),
        }
    }

    /// The rows of a fit.
    pub(crate) fn round(&self, fit: &Identified) -> Result<Round<'a>, DiagnoseError> {
        let rows = Rows::new(fit, self.instrument, self.campaign);
        let used = rows.whitening.iter().filter(|w| **w > 0.0).count();
        let linear = Linear::new(rows.jacobian.clone(), rows.residuals.clone(), rows.covariance.clone(), used)?;
        let free = linear.without_priors(used)?;
        Ok(Round { rows, linear, free, used })
    }

    /// Runs rounds from a fit of these terms until nothing passes; `first` are the rows of that fit.
    pub(crate) fn run(
        &self,
        fit: Identified,
        first: Rc<Round<'a>>,
        terms: Vec<EffectTerm>,
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<State<'a>, DiagnoseError> {
        let mut state = State {
            machine: fit.model.parts().machine.clone(),
            terms,
            fit,
            steps: Vec::new(),
            order_settled: false,
            refused: Vec::new(),
            looked_at: None,
        };
        let (mut round, mut as_it_is) = (first, true);
        for number in 0..MAX_ROUNDS {
            if number > 0 {
                (round, as_it_is) = self.round_without_misfit(&state)?;
            }
            if !observe(Progress::Scoring { round: number + 1, effects: state.terms.len() }) {
                return Err(DiagnoseError::Stopped);
            }
            let named = self.named(&round, &state.machine)?;
            if !self.advance(&mut state, &round, &named, observe)? {
                state.looked_at = as_it_is.then_some((round, named));
                break;
            }
        }
        Ok(state)
    }

    /// One round; false where nothing passed.
    fn advance(
        &self,
        state: &mut State,
        round: &Round,
        named: &[Candidate],
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<bool, DiagnoseError> {
        match self.propose(round, state, named)? {
            Proposal::Nothing => return Ok(false),
            Proposal::Order(id) => self.refine(state, round, id, observe)?,
            Proposal::Named(candidate) => {
                let candidate = refined(round, &state.machine, candidate)?;
                let (rivals, tests) = (self.rivals(round, named, &candidate), tests(named));
                self.add(state, candidate, rivals, tests, observe)?;
            }
            Proposal::Free(candidate) => {
                let (rivals, tests) = (self.rivals(round, named, &candidate), candidate.trials);
                self.add(state, candidate, rivals, tests, observe)?;
            }
        }
        Ok(true)
    }

    /// Tries finer error functions; they stay if they have more evidence and predict lines left out better by more than
    /// a tenth of the noise. A misfit below that is not worth twice the coefficients, whose uncertainty every corrected
    /// point would carry; it is kept from passing for an effect by [`Search::round_without_misfit`].
    fn refine(
        &self,
        state: &mut State,
        round: &Round,
        id: ErrorId,
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<(), DiagnoseError> {
        state.order_settled = true;
        let richer = match self.fit(&order::enriched(&state.machine), &state.terms, observe) {
            Err(DiagnoseError::Identify(_)) => return Ok(()),
            other => other?,
        };
        let likelihood = |fit: &Identified| fit.evidence.minus_two_log_likelihood;
        let square = |round: &Round| {
            let [(_, lines), ..] = judge::blocks(self.campaign, round);
            judge::blocked_rms(&round.linear, &lines).powi(2)
        };
        let is_material = square(&self.round(&richer)?) < (1.0 - MATERIAL) * square(round);
        if is_material && likelihood(&state.fit) - likelihood(&richer) > self.options.least_evidence {
            state.order_settled = false;
            state.fit = richer;
            state.machine = state.fit.model.parts().machine.clone();
            state.steps.push(Step::Enriched { because: id.name() });
        }
        Ok(())
    }

    /// The rows of a fit; once the order is settled, with what finer error functions would still explain taken out of
    /// what candidates are tested against. Also whether nothing had to be taken out.
    fn round_without_misfit(&self, state: &State) -> Result<(Rc<Round<'a>>, bool), DiagnoseError> {
        let mut round = self.round(&state.fit)?;
        let mut as_it_is = true;
        if state.order_settled {
            let misfit = order::refinements(&round, &state.machine)?.into_iter();
            let misfit: Vec<_> =
                misfit.filter(|(_, score, _)| self.shows(score)).map(|(_, _, columns)| columns).collect();
            if !misfit.is_empty() {
                as_it_is = false;
                round.free = round.linear.widened(&misfit, round.used)?;
            }
        }
        Ok((Rc::new(round), as_it_is))
    }

    /// Whether the refinement of an error function is significant among all of them.
    fn shows(&self, score: &Score) -> bool {
        score.p_value * ErrorId::COUNT as f64 <= self.options.significance
    }

    fn add(
        &self,
        state: &mut State,
        candidate: Candidate,
        rivals: Vec<Candidate>,
        tests: usize,
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<(), DiagnoseError> {
        let p_corrected = (candidate.score.p_value * tests as f64).min(1.0);
        let term = candidate.term.clone();
        let terms: Vec<EffectTerm> = state.terms.iter().chain([&term]).cloned().collect();
        match self.fit(&state.machine, &terms, observe) {
            Ok(fit) => (state.fit, state.terms) = (fit, terms),
            Err(DiagnoseError::Identify(_)) => {
                state.refused.push(term);
                return Ok(());
            }
            Err(other) => return Err(other),
        }
        state.steps.push(Step::Added { term, candidate: Box::new(candidate), rivals, p_corrected });
        self.prune(state, observe)
    }

    /// Named candidates: registered shapes, the best period of each axis, the line that stands out most.
    pub(crate) fn named(&self, round: &Round, machine: &Machine) -> Result<Vec<Candidate>, DiagnoseError> {
        let mut named = score_all(round, proposals(machine, &self.context)?)?;
        let mut periodogram = self.periodogram.borrow_mut();
        named.extend(periodic::candidates(round, machine, self.campaign, &mut periodogram)?);
        named.extend(runs::candidate(round, machine, self.campaign)?);
        Ok(named)
    }

    fn propose(&self, round: &Round, state: &State, named: &[Candidate]) -> Result<Proposal, DiagnoseError> {
        let rows = round.used;
        let tests = tests(named);
        let best =
            named.iter().filter(|c| !has(&state.terms, &c.term)).fold(None::<&Candidate>, |best, c| match best {
                Some(other) if !c.better_than(other, rows) => Some(other),
                _ => Some(c),
            });
        let best = best.filter(|c| self.passes(c.score.p_value, tests, c.evidence(rows)));
        let free = self.empirical(round, &state.machine)?.filter(|c| !state.is_refused(&c.term));
        let finer = if state.order_settled { Vec::new() } else { order::refinements(round, &state.machine)? };
        let finer = finer.into_iter().map(|(id, score, _)| (id, score)).filter(|(_, score)| self.shows(score));
        let finer = finer.min_by(|a, b| a.1.p_value.total_cmp(&b.1.p_value));
        let reduction = best.map_or(0.0, |c| c.score.reduction).max(free.as_ref().map_or(0.0, |f| f.score.reduction));
        // Finer splines cost nothing where they are not needed, so they need no price; but what an effect explains far
        // better is the effect's.
        if let Some((id, score)) = finer
            && score.reduction > AS_WELL * reduction
        {
            return Ok(Proposal::Order(id));
        }
        Ok(match (best, free) {
            (Some(named), Some(free)) if named.score.reduction < EXPLAINS * free.score.reduction => {
                Proposal::Free(free)
            }
            (Some(named), _) => Proposal::Named(named.clone()),
            (None, Some(free)) => Proposal::Free(free),
            (None, None) => Proposal::Nothing,
        })
    }

    /// Significant after correction for the number of tests, and worth its parameters.
    fn passes(&self, p_value: f64, tests: usize, evidence: f64) -> bool {
        p_value * tests as f64 <= self.options.significance && evidence > self.options.least_evidence
    }

    /// The best empirical term: of the findings of the look and of the same quantities turning a joint, in the form that
    /// the data pay for.
    fn empirical(&self, round: &Round, machine: &Machine) -> Result<Option<Candidate>, DiagnoseError> {
        let passing = look::look(round, &self.variables).into_iter().filter(|finding| {
            self.passes(finding.score.p_value, finding.trials, finding.score.evidence(round.used, finding.trials))
        });
        let acting = passing.flat_map(|finding| {
            finding.acting(&self.variables).into_iter().map(move |shape| (shape, finding.trials)).collect::<Vec<_>>()
        });
        let Some(best) = self.best_empirical(round, machine, acting.collect())? else { return Ok(None) };
        let forms = look::forms(&best.term.shape).into_iter().map(|shape| (shape, best.trials)).collect();
        let best = self.best_empirical(round, machine, forms)?;
        Ok(best.filter(|c| self.passes(c.score.p_value, c.trials, c.evidence(round.used))))
    }

    /// Of empirical shapes (and the trials that led to each) the one with most evidence.
    fn best_empirical(
        &self,
        round: &Round,
        machine: &Machine,
        shapes: Vec<(abbe_geometry::effects::Shape, usize)>,
    ) -> Result<Option<Candidate>, DiagnoseError> {
        let known = known("empirical").ok_or(DiagnoseError::Singular)?;
        // A shape whose terms all belong to the error functions is none.
        let term = |(shape, trials)| Some((known, EffectTerm::new(known.name, shape, machine).ok()?, trials));
        let scored = score_all(round, shapes.into_iter().filter_map(term).collect())?;
        Ok(scored.into_iter().reduce(|best, c| if c.better_than(&best, round.used) { c } else { best }))
    }

    /// Other effects that explain nearly as much as the chosen one.
    fn rivals(&self, round: &Round, named: &[Candidate], chosen: &Candidate) -> Vec<Candidate> {
        let limit = chosen.evidence(round.used) - self.options.rival_margin;
        let mut rivals: Vec<Candidate> = Vec::new();
        for candidate in named.iter().filter(|c| c.evidence(round.used) > limit && !is_variant(c, chosen)) {
            match rivals.iter_mut().find(|r| r.known.name == candidate.known.name) {
                Some(rival) if candidate.better_than(rival, round.used) => *rival = candidate.clone(),
                Some(_) => {}
                None => rivals.push(candidate.clone()),
            }
        }
        rivals
    }

    /// Takes out terms that no longer earn their parameters, the weakest first.
    fn prune(&self, state: &mut State, observe: &mut dyn FnMut(Progress) -> bool) -> Result<(), DiagnoseError> {
        while state.terms.len() > 1 {
            let Some(weakest) = self.weakest(state)? else { break };
            let term = state.terms.remove(weakest);
            state.fit = self.fit(&state.machine, &state.terms, observe)?;
            state.refused.push(term.clone());
            state.steps.push(Step::Removed { term });
        }
        Ok(())
    }

    /// The term whose parameters are jointly closest to zero, if it does not earn them (Wald test).
    fn weakest(&self, state: &State) -> Result<Option<usize>, DiagnoseError> {
        let rows = state.fit.weights.iter().filter(|w| **w > 0.0).count();
        let mut weakest: Option<(usize, f64)> = None;
        for (index, wald) in crate::wald::of_terms(&state.fit).into_iter().enumerate() {
            let earned = wald.statistic - wald.degrees as f64 * (rows.max(2) as f64).ln();
            if (earned < 0.0 || wald.degrees == 0) && weakest.is_none_or(|(_, other)| earned < other) {
                weakest = Some((index, earned));
            }
        }
        Ok(weakest.map(|(index, _)| index))
    }
}

/// Number of tests behind a list of candidates: each effect's shapes, those that a search went through among them.
fn tests(named: &[Candidate]) -> usize {
    let mut by_name: BTreeMap<&str, usize> = BTreeMap::new();
    for candidate in named {
        let trials = by_name.entry(candidate.known.name).or_default();
        *trials = candidate.trials.max(*trials);
    }
    by_name.values().sum::<usize>().max(1)
}

/// Whether a candidate is the chosen effect with other figures (degree, time constant): no rival but the same claim. With
/// another axis or sensor it is another claim.
fn is_variant(candidate: &Candidate, chosen: &Candidate) -> bool {
    let texts = |c: &Candidate| {
        c.term.shape.0.values().filter(|v| !matches!(v, ShapeValue::Number(_))).cloned().collect::<Vec<_>>()
    };
    candidate.known.name == chosen.known.name && texts(candidate) == texts(chosen)
}

fn has(terms: &[EffectTerm], term: &EffectTerm) -> bool {
    terms.iter().any(|other| other.effect.name() == term.effect.name() && other.shape == term.shape)
}
