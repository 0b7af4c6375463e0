//! The search: the effect with the most evidence goes in, everything is fitted again, until nothing passes.
//!
//! Place in the flow: [`crate::diagnose()`] starts it from the model's own effects. In each round named effects, periods,
//! runs, finer error functions and the look without candidates compete; a named effect goes before an empirical term
//! unless the latter explains far more. What was fitted must pass [`crate::gate`]; what does not, or cannot be fitted, is
//! set aside with the reason and the next best is tried. After each addition, terms that the new one made superfluous go
//! out again.

use crate::aliased_period::{self, OpenWave};
use crate::candidates::{Candidate, Round, proposals, refined, score_all};
use crate::context::Context;
use crate::error::DiagnoseError;
use crate::gate;
use crate::look::{self, Variable};
use crate::options::{DiagnoseOptions, Progress};
use crate::periodic::Periodogram;
use crate::same_claim::{has, is_variant};
use crate::score::Score;
use crate::step::Step;
use crate::{exchange, jumps, lags, order, periodic, runs, scale_steps, serial, within_stations, worth};
use abbe_geometry::ErrorId;
use abbe_geometry::effects::known;
use abbe_geometry::machine::Machine;
use abbe_identify::{
    EffectTerm, Identified, IdentifyError, Noise, RangeCorrelation, identify_with, minus_two_log_likelihood_on,
};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Share of what the best free dependence explains that a named effect must explain to go before it.
const EXPLAINS: f64 = 0.6;
/// Share of the best effect's reduction from which finer error functions go first.
const AS_WELL: f64 = 0.5;
/// Share of the blocked mean square that finer error functions must save.
const MATERIAL: f64 = 0.1;
/// Rounds at most.
const MAX_ROUNDS: usize = 10;
/// Candidates set aside in one round after which it ends: each costs a fit, and what ranks below explains less.
const MAX_TRIED: usize = 8;

/// What stays the same during a search.
pub(crate) struct Search<'a> {
    pub(crate) instrument: RangeUncertainty,
    pub(crate) campaign: &'a Campaign,
    pub(crate) options: &'a DiagnoseOptions,
    pub(crate) context: Context,
    pub(crate) variables: Vec<Variable>,
    /// Of the threads that look for periods; each takes one and brings it back.
    periodograms: Mutex<Vec<Periodogram>>,
}

/// How far a search has come.
#[derive(Clone)]
pub(crate) struct State<'a> {
    pub(crate) machine: Machine,
    pub(crate) terms: Vec<EffectTerm>,
    pub(crate) fit: Identified,
    pub(crate) steps: Vec<Step>,
    /// Finer error functions were tried and have no more evidence than these.
    pub(crate) order_settled: bool,
    /// Terms that others made superfluous: not tried again, nor with other figures.
    pub(crate) refused: Vec<EffectTerm>,
    /// Terms that could not be fitted beside what the model has now, or did not pass the gate: not tried again until it has changed.
    pub(crate) set_aside: Vec<EffectTerm>,
    /// Waves whose period the data do not tell.
    pub(crate) open_waves: Vec<OpenWave>,
    /// All that was found was given up again.
    withdrawn: bool,
    /// What was logged goes by another clock: nothing that follows it is taken.
    pub(crate) distrusts_log: bool,
    /// The rows of `fit`.
    pub(crate) round: Round<'a>,
    /// Named candidates of the last round, where it looked at `round` as it is.
    pub(crate) named: Option<Vec<Candidate>>,
}

impl<'a> State<'a> {
    /// A search that has not begun.
    pub(crate) fn new(fit: Identified, round: Round<'a>, terms: Vec<EffectTerm>) -> State<'a> {
        State {
            machine: fit.model.parts().machine.clone(),
            terms,
            fit,
            steps: Vec::new(),
            order_settled: false,
            refused: Vec::new(),
            set_aside: Vec::new(),
            open_waves: Vec::new(),
            withdrawn: false,
            distrusts_log: false,
            round,
            named: None,
        }
    }

    /// Goes back to the fit and terms that the search began with. What it did stays to be read.
    pub(crate) fn withdraw(&mut self, (fit, round, terms): (Identified, Round<'a>, Vec<EffectTerm>), because: &str) {
        self.machine = fit.model.parts().machine.clone();
        (self.fit, self.round, self.terms) = (fit, round, terms);
        self.named = None;
        self.withdrawn = true;
        self.steps.push(Step::Noted(format!("nothing is adopted: {because}")));
    }

    /// Terms that the model did not have before.
    pub(crate) fn beside(&self, base: &[EffectTerm]) -> Vec<EffectTerm> {
        self.terms.iter().filter(|term| !has(base, term)).cloned().collect()
    }

    /// Whether the term, or the same with other figures, is in the model or was refused.
    fn is_out(&self, term: &EffectTerm) -> bool {
        has(&self.terms, term) || self.is_refused(term)
    }

    /// Whether the term, or the same with other figures, was refused beside what the model has.
    fn is_refused(&self, term: &EffectTerm) -> bool {
        self.refused.iter().chain(&self.set_aside).any(|refused| is_variant(refused, term))
    }

    /// Whether error functions got more coefficients.
    pub(crate) fn is_enriched(&self) -> bool {
        !self.withdrawn && self.steps.iter().any(|step| matches!(step, Step::Enriched { .. }))
    }
}

/// What a round proposes.
enum Proposal {
    Named(Candidate),
    Free(Candidate),
    Order(ErrorId),
    Nothing,
}

impl<'a> Search<'a> {
    pub(crate) fn new(
        instrument: RangeUncertainty,
        campaign: &'a Campaign,
        options: &'a DiagnoseOptions,
    ) -> Search<'a> {
        let context = Context::new(campaign);
        let variables = look::variables(campaign, &context);
        Search { instrument, campaign, options, context, variables, periodograms: Mutex::default() }
    }

    /// Fits these terms. Where the data leave directions of a term open, it is fitted once more with these believed to be
    /// up to three times as large as what the data tell of the term: open directions are those in which the term looks like
    /// the machine (a wrong holder like a turned ram), and must not take from it what they please. What stays open shows in
    /// the uncertainty of both.
    pub(crate) fn fit(
        &self,
        machine: &Machine,
        terms: &[EffectTerm],
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<Identified, DiagnoseError> {
        self.fit_under(machine, terms, None, observe)
    }

    /// The same under noise correlated so; `None` for white.
    pub(crate) fn fit_under(
        &self,
        machine: &Machine,
        terms: &[EffectTerm],
        noise: Option<RangeCorrelation>,
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<Identified, DiagnoseError> {
        let fit = self.fit_as_believed(machine, terms, noise, observe)?;
        let shares = crate::wald::told(&fit);
        if shares.iter().all(Option::is_none) {
            return Ok(fit);
        }
        let term = |(term, share): (&EffectTerm, &Option<f64>)| match share {
            Some(share) => term.clone().believed(*share),
            None => term.clone(),
        };
        let terms: Vec<EffectTerm> = terms.iter().zip(&shares).map(term).collect();
        match self.fit_as_believed(machine, &terms, noise, observe) {
            Err(DiagnoseError::Identify(_)) => Ok(fit),
            other => other,
        }
    }

    fn fit_as_believed(
        &self,
        machine: &Machine,
        terms: &[EffectTerm],
        noise: Option<RangeCorrelation>,
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<Identified, DiagnoseError> {
        let mut observe =
            |p: abbe_identify::Progress| observe(Progress::Fitting { pass: p.pass, effects: terms.len() });
        let options = abbe_identify::IdentifyOptions { noise: Noise::Given(noise), ..self.options.identify };
        match identify_with(machine, self.instrument, self.campaign, terms, &options, &mut observe) {
            Err(IdentifyError::Stopped) => Err(DiagnoseError::Stopped),
            other => Ok(other?),
        }
    }

    /// The rows of a fit.
    pub(crate) fn round(&self, fit: &Identified) -> Result<Round<'a>, DiagnoseError> {
        Round::new(fit, self.instrument, self.campaign)
    }

    /// A fit of these terms and its rows, or why there is none. Only a stop by the observer is an error.
    pub(crate) fn attempt(
        &self,
        machine: &Machine,
        terms: &[EffectTerm],
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<Result<(Identified, Round<'a>), String>, DiagnoseError> {
        self.attempt_under(machine, terms, None, observe)
    }

    /// The same under noise correlated so; `None` for white.
    pub(crate) fn attempt_under(
        &self,
        machine: &Machine,
        terms: &[EffectTerm],
        noise: Option<RangeCorrelation>,
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<Result<(Identified, Round<'a>), String>, DiagnoseError> {
        let fit = self.fit_under(machine, terms, noise, observe);
        match fit.and_then(|fit| self.round(&fit).map(|round| (fit, round))) {
            Ok(fitted) => Ok(Ok(fitted)),
            Err(DiagnoseError::Stopped) => Err(DiagnoseError::Stopped),
            Err(problem) => Ok(Err(problem.to_string())),
        }
    }

    /// Runs rounds from a fit of these terms until nothing passes; `first` are the rows of that fit.
    pub(crate) fn run(
        &self,
        fit: Identified,
        first: Round<'a>,
        terms: Vec<EffectTerm>,
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<State<'a>, DiagnoseError> {
        let (base, first_chi2_per_dof) = (terms.clone(), fit.evidence.chi2_per_dof);
        let mut state = State::new(fit, first, terms);
        for number in 0..MAX_ROUNDS {
            if !observe(Progress::Scoring { round: number + 1, effects: state.terms.len() }) {
                return Err(DiagnoseError::Stopped);
            }
            let (round, as_it_is) = self.round_without_misfit(&state)?;
            let all = self.named(&round, &state.machine)?;
            let found_in = (&state.machine, self.campaign);
            let named = lags::with_late(&round, found_in, self.that_show(&round, &all), self.options.least_evidence)?;
            if !self.advance(&mut state, &round, &named, observe)? && !exchange::one(self, &mut state, &base, observe)?
            {
                state.named = as_it_is.then_some(all);
                break;
            }
        }
        serial::hold(self, &mut state, (&base, first_chi2_per_dof), observe)?;
        Ok(state)
    }

    /// One round; false where nothing passed. Candidates that fail are set aside and the next best is tried.
    pub(crate) fn advance(
        &self,
        state: &mut State<'a>,
        round: &Round<'a>,
        named: &[Candidate],
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<bool, DiagnoseError> {
        let looked = OnceCell::new();
        let finer = self.finer(round, state)?;
        for _ in 0..MAX_TRIED {
            let (candidate, tests) = match self.propose(round, state, (named, &looked), finer.as_ref())? {
                Proposal::Nothing => return Ok(false),
                Proposal::Order(id) => return self.refine(state, id, observe).map(|()| true),
                Proposal::Named(candidate) => {
                    let refined = refined(round, &state.machine, candidate)?;
                    let found_in = (&state.machine, self.campaign);
                    (lags::apart(round, found_in, refined, self.options.least_evidence)?, tests(named))
                }
                Proposal::Free(candidate) => (candidate.clone(), candidate.trials),
            };
            let candidate = lags::refined(round, (&state.machine, self.campaign), candidate)?;
            let period = aliased_period::period(round, (&state.machine, self.campaign), candidate)?;
            let Some(candidate) = state.told(period) else { continue };
            let rivals = self.rivals(round, named, &candidate);
            if self.add(state, candidate, rivals, tests, observe)? {
                return Ok(true);
            }
        }
        state
            .steps
            .push(Step::Noted(format!("{MAX_TRIED} candidates in a row were set aside; the search ended there")));
        Ok(false)
    }

    /// Tries finer error functions; they stay if they have more evidence over the same readings and predict lines left out
    /// better by more than a tenth of the noise. A misfit below that is not worth twice the coefficients, whose uncertainty
    /// every corrected point would carry; it is kept from passing for an effect by [`Search::round_without_misfit`].
    fn refine(
        &self,
        state: &mut State<'a>,
        id: ErrorId,
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<(), DiagnoseError> {
        state.order_settled = true;
        let machine = order::enriched(&state.machine);
        let (richer, round) = match self.attempt(&machine, &state.terms, observe)? {
            Ok(fitted) => fitted,
            Err(problem) => {
                state.steps.push(Step::Noted(format!("finer error functions cannot be fitted: {problem}")));
                return Ok(());
            }
        };
        let verdict = gate::judge(&state.round, &round, self.campaign, &[]);
        let is_material =
            verdict.judged.first().is_some_and(|lines| lines.after.powi(2) < (1.0 - MATERIAL) * lines.before.powi(2));
        if let Some(because) = verdict.refused.filter(|_| is_material) {
            state.steps.push(Step::Noted(format!("finer error functions stay out: {because}")));
        } else if is_material
            && self.gain_alike(&state.fit, &richer).is_ok_and(|gain| gain > self.options.least_evidence)
        {
            state.order_settled = false;
            state.machine = richer.model.parts().machine.clone();
            (state.fit, state.round) = (richer, round);
            state.set_aside.clear();
            state.steps.push(Step::Enriched { because: id.name() });
        }
        Ok(())
    }

    /// Twice the log likelihood that the second fit gains with the weights of the first: each fit's own figure leaves out
    /// what that fit rejects, and whoever rejects more would win.
    pub(crate) fn gain_alike(&self, first: &Identified, second: &Identified) -> Result<f64, DiagnoseError> {
        let likelihood =
            |fit: &Identified| minus_two_log_likelihood_on(fit, self.instrument, self.campaign, &first.weights);
        Ok(likelihood(first)? - likelihood(second)?)
    }

    /// The rows of the fit; once the order is settled, with what finer error functions would still explain taken out of
    /// what candidates are tested against. Also whether nothing had to be taken out.
    fn round_without_misfit(&self, state: &State<'a>) -> Result<(Round<'a>, bool), DiagnoseError> {
        let mut round = state.round.clone();
        if !state.order_settled {
            return Ok((round, true));
        }
        let misfit = order::refinements(&round, &state.machine)?.into_iter();
        let misfit: Vec<_> = misfit.filter(|(_, score, _)| self.shows(score)).map(|(_, _, columns)| columns).collect();
        if misfit.is_empty() {
            return Ok((round, true));
        }
        round.free = Arc::new(round.linear.widened(&misfit, round.used)?);
        Ok((round, false))
    }

    /// Whether the refinement of an error function is significant among all of them.
    fn shows(&self, score: &Score) -> bool {
        score.p_value * ErrorId::COUNT as f64 <= self.options.significance
    }

    /// Fits a candidate with all the rest and lets it in if the gate does; false where it was set aside.
    fn add(
        &self,
        state: &mut State<'a>,
        candidate: Candidate,
        rivals: Vec<Candidate>,
        tests: usize,
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<bool, DiagnoseError> {
        let p_corrected = (candidate.score.p_value * tests as f64).min(1.0);
        let term = candidate.term.clone();
        let terms: Vec<EffectTerm> = state.terms.iter().chain([&term]).cloned().collect();
        let fitted = match self.attempt(&state.machine, &terms, observe)? {
            Ok((fit, round)) => {
                let own = std::slice::from_ref(&term);
                let verdict = gate::judge(&state.round, &round, self.campaign, own);
                let costs =
                    || worth::refusal(own, &state.fit.model, &fit.model, self.campaign).map(|words| (words, true));
                let untold = match fit.model.parts().effects.last() {
                    Some(fitted) => within_stations::refusal(self, (&state.fit, &state.round), fitted)?,
                    None => None,
                };
                let [refused, untold] = [verdict.refused.clone(), untold].map(|why| why.map(|words| (words, false)));
                refused.or_else(costs).or(untold).map_or(Ok((fit, round, verdict)), Err)
            }
            Err(problem) => Err((format!("it cannot be fitted: {problem}"), false)),
        };
        match fitted {
            Ok((fit, round, verdict)) => {
                (state.fit, state.round, state.terms) = (fit, round, terms);
                state.set_aside.clear();
                state.steps.push(Step::Added { term, candidate: Box::new(candidate), rivals, p_corrected, verdict });
                self.prune(state, observe)?;
                Ok(true)
            }
            Err(why) => {
                state.set_aside.push(term.clone());
                state.steps.push(Step::set_aside_for(term, why));
                Ok(false)
            }
        }
    }

    /// Named candidates: registered shapes, the best period of each axis, the line that stands out most.
    pub(crate) fn named(&self, round: &Round, machine: &Machine) -> Result<Vec<Candidate>, DiagnoseError> {
        let mut named = score_all(round, proposals(machine, &self.context)?)?;
        let mut periodogram = self.periodograms().pop().unwrap_or_default();
        named.extend(periodic::candidates(round, machine, self.campaign, &mut periodogram)?);
        self.periodograms().push(periodogram);
        named.extend(runs::candidate(round, machine, self.campaign)?);
        named.extend(jumps::candidates(round, machine, self.campaign)?);
        named.extend(scale_steps::candidates(round, machine, self.campaign)?);
        Ok(named)
    }

    fn periodograms(&self) -> MutexGuard<'_, Vec<Periodogram>> {
        self.periodograms.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Those whose essential parameters the data show.
    pub(crate) fn that_show(&self, round: &Round, named: &[Candidate]) -> Vec<Candidate> {
        let shows = |c: &&Candidate| c.essential_evidence(round.used) > self.options.least_evidence;
        named.iter().filter(shows).cloned().collect()
    }

    fn propose(
        &self,
        round: &Round,
        state: &State,
        (named, looked): (&[Candidate], &OnceCell<Vec<Candidate>>),
        finer: Option<&(ErrorId, Score)>,
    ) -> Result<Proposal, DiagnoseError> {
        let rows = round.used;
        let tests = tests(named);
        let finer = finer.filter(|(_, score)| !self.is_abrupt(named, state, (score, rows, tests)));
        let best = named.iter().filter(|c| !state.is_out(&c.term)).fold(None::<&Candidate>, |best, c| match best {
            Some(other) if !c.better_than(other, rows) => Some(other),
            _ => Some(c),
        });
        let best = best.filter(|c| self.passes(c.score.p_value, tests, c.evidence(rows)));
        let open = || named.iter().filter(|c| !state.is_out(&c.term));
        let best = best.map(|best| lags::logged_instead(best, open()));
        let best = best.map(|best| lags::logged_side_instead(best, open(), (rows, self.options.least_evidence)));
        if let Some(best) = best.filter(|best| is_ahead_of_all(round, best, finer)) {
            return Ok(Proposal::Named(best.clone()));
        }
        if looked.get().is_none() {
            let _ = looked.set(self.look(round, &state.machine)?);
        }
        let free = self.empirical(round, state, looked.get().map_or(&[], Vec::as_slice))?;
        let reduction = best.map_or(0.0, |c| c.score.reduction).max(free.as_ref().map_or(0.0, |f| f.score.reduction));
        // Finer splines cost nothing where they are not needed, so they need no price; but what an effect explains far
        // better is the effect's.
        if let Some((id, score)) = finer
            && score.reduction > AS_WELL * reduction
        {
            return Ok(Proposal::Order(*id));
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

    /// Whether what an error function lacks is abrupt: what no coefficients follow explains as much as finer splines, which round it off, and
    /// whose misfit is taken out of all candidates then. What happened once does so also where the gate has set it aside.
    fn is_abrupt(&self, named: &[Candidate], state: &State, (finer, rows, tests): (&Score, usize, usize)) -> bool {
        named.iter().any(|c| {
            let (effect, is_there) = (&c.term.effect, has(&state.terms, &c.term));
            let is_open = effect.is_abrupt() && !state.is_out(&c.term) || effect.happens_once() && !is_there;
            is_open && c.score.reduction >= finer.reduction && self.passes(c.score.p_value, tests, c.evidence(rows))
        })
    }

    /// The error function that most surely needs finer splines; `None` once the order is settled.
    fn finer(&self, round: &Round, state: &State) -> Result<Option<(ErrorId, Score)>, DiagnoseError> {
        if state.order_settled {
            return Ok(None);
        }
        let finer = order::refinements(round, &state.machine)?.into_iter().map(|(id, score, _)| (id, score));
        let finer = finer.filter(|(_, score)| self.shows(score));
        Ok(finer.min_by(|a, b| a.1.p_value.total_cmp(&b.1.p_value)))
    }

    /// Significant after correction for the number of tests, and worth its parameters.
    fn passes(&self, p_value: f64, tests: usize, evidence: f64) -> bool {
        p_value * tests as f64 <= self.options.significance && evidence > self.options.least_evidence
    }

    /// Empirical terms: of the findings of the look and of the same quantities turning a joint.
    pub(crate) fn look(&self, round: &Round, machine: &Machine) -> Result<Vec<Candidate>, DiagnoseError> {
        let passing = look::look(round, &self.variables, self.options.least_evidence).into_iter().filter(|finding| {
            self.passes(finding.score.p_value, finding.trials, finding.score.evidence(round.used, finding.trials))
        });
        let acting = passing.flat_map(|finding| {
            finding.acting(&self.variables).into_iter().map(move |shape| (shape, finding.trials)).collect::<Vec<_>>()
        });
        self.described(round, machine, acting.collect())
    }

    /// The best of these that was not refused, in the form that the data pay for.
    pub(crate) fn empirical(
        &self,
        round: &Round,
        state: &State,
        looked: &[Candidate],
    ) -> Result<Option<Candidate>, DiagnoseError> {
        let best = |candidates: &[Candidate]| {
            let open = candidates.iter().filter(|c| !state.is_out(&c.term)).cloned();
            open.reduce(|best, c| if c.better_than(&best, round.used) { c } else { best })
        };
        let Some(found) = best(looked) else { return Ok(None) };
        let forms = look::forms(&found.term.shape).into_iter().map(|shape| (shape, found.trials)).collect();
        let best = best(&self.described(round, &state.machine, forms)?);
        Ok(best.filter(|c| self.passes(c.score.p_value, c.trials, c.evidence(round.used))))
    }

    /// Empirical shapes (and the trials that led to each), scored.
    fn described(
        &self,
        round: &Round,
        machine: &Machine,
        shapes: Vec<(abbe_geometry::effects::Shape, usize)>,
    ) -> Result<Vec<Candidate>, DiagnoseError> {
        let known = known("empirical").ok_or(DiagnoseError::Singular)?;
        // A shape whose terms all belong to the error functions is none.
        let term = |(shape, trials)| Some((known, EffectTerm::new(known.name, shape, machine).ok()?, trials));
        score_all(round, shapes.into_iter().filter_map(term).collect())
    }

    /// Other effects that explain nearly as much as the chosen one.
    fn rivals(&self, round: &Round, named: &[Candidate], chosen: &Candidate) -> Vec<Candidate> {
        let limit = chosen.evidence(round.used) - self.options.rival_margin;
        let mut rivals: Vec<Candidate> = Vec::new();
        for candidate in named.iter().filter(|c| c.evidence(round.used) > limit && !is_variant(&c.term, &chosen.term)) {
            match rivals.iter_mut().find(|r| r.known.name == candidate.known.name) {
                Some(rival) if candidate.better_than(rival, round.used) => *rival = candidate.clone(),
                Some(_) => {}
                None => rivals.push(candidate.clone()),
            }
        }
        rivals
    }

    /// Takes out terms that no longer earn their parameters, the weakest first. One without which there is no fit stays.
    fn prune(&self, state: &mut State<'a>, observe: &mut dyn FnMut(Progress) -> bool) -> Result<(), DiagnoseError> {
        while state.terms.len() > 1 {
            let Some(weakest) = self.weakest(state)? else { break };
            let mut rest = state.terms.clone();
            let term = rest.remove(weakest);
            match self.attempt(&state.machine, &rest, observe)? {
                Ok((fit, round)) => (state.fit, state.round, state.terms) = (fit, round, rest),
                Err(problem) => {
                    let name = term.effect.name();
                    state.steps.push(Step::Noted(format!("{name} stays: there is no fit without it: {problem}")));
                    break;
                }
            }
            state.refused.push(term.clone());
            state.steps.push(Step::Removed { term });
        }
        Ok(())
    }

    /// The term whose parameters, or those of them that make it what it is, are jointly closest to zero, if it does not earn them
    /// (Wald test).
    fn weakest(&self, state: &State) -> Result<Option<usize>, DiagnoseError> {
        let rows = state.fit.weights.iter().filter(|w| **w > 0.0).count();
        let mut weakest: Option<(usize, f64)> = None;
        let walds = crate::wald::of_terms(&state.fit).into_iter().zip(crate::wald::of_essential(&state.fit));
        for (index, (wald, essential)) in walds.enumerate() {
            let earned = [Some(wald), essential].into_iter().flatten().map(|wald| wald.earned(rows));
            let earned = earned.fold(f64::INFINITY, f64::min);
            if earned < 0.0 && weakest.is_none_or(|(_, other)| earned < other) {
                weakest = Some((index, earned));
            }
        }
        Ok(weakest.map(|(index, _)| index))
    }
}

/// Whether a named effect goes first whatever a look would find: no dependence explains more than the whole sum of squares. A look costs
/// as much as all named effects together.
fn is_ahead_of_all(round: &Round, named: &Candidate, finer: Option<&(ErrorId, Score)>) -> bool {
    named.score.reduction >= EXPLAINS * round.free.chi2()
        && finer.is_none_or(|(_, score)| score.reduction <= AS_WELL * named.score.reduction)
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
