//! The passes over the campaign: linearise, solve, weigh, until nothing moves.
//!
//! Place in the flow: the one entry point of this crate. Large campaigns are first solved on a part of the readings, where
//! the fineness of the splines is decided too, so that the full passes start next to the solution.

use crate::comparison;
use crate::design::{Estimate, Setup};
use crate::error::IdentifyError;
use crate::identified::Identified;
use crate::linear::NotPositiveDefinite;
use crate::normal::{NormalEquations, accumulate, accumulate_whitened, residuals};
use crate::observability::{self, Observability};
use crate::options::{IdentifyOptions, Noise, OrderChoice, Progress};
use crate::order;
use crate::plausibility;
use crate::range_correlation::RangeCorrelation;
use crate::range_noise::Asked;
use crate::robust;
use crate::smoothing::{self, Smoothness, Solution};
use crate::station_start::StationStart;
use crate::term::{self, EffectTerm};
use crate::unseen_expansion::unseen_expansions;
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::layout::{Layout, Locals, centre_of};
use abbe_geometry::machine::Machine;
use abbe_geometry::model::Station;
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use abbe_measurement::subset::spread_by_group;

/// Step, in units of the parameters' uncertainty, that counts as settled.
pub(crate) const SETTLED: f64 = 5e-3;
/// Distance from the point of linearisation (m, rad) up to which it still holds: what the rows leave out is a sum of
/// products of two such changes with levers of about a metre: 1e-9 m if all of them added up, 1e-12 m for one pair.
const LINEAR: f64 = 1e-6;
/// Passes in which the data choose the smoothness: afterwards the rows change too little to tell, and a
/// smoothness that follows every pass would keep the parameters moving.
const SMOOTHING_PASSES: usize = 3;
/// Passes in which robust weights follow the residuals: afterwards a few readings at the edge of rejection can only go in
/// and out by turns, and each turn moves what they determine.
pub(crate) const WEIGHING_PASSES: usize = 15;
/// Share of the splines' coefficients that counts as nearly all of them.
pub(crate) const SATURATED: f64 = 0.9;
/// Share of one spline's coefficients from which it is as good as free.
const FREE: f64 = 0.98;
/// χ² per degree of freedom from which a single free spline may be what the fit lacks; effects beyond geometry also
/// raise it, but finer splines do not lower that, and each trial costs a fit.
const MISFIT: f64 = 10.0;
/// Finer splines tried at most: four thirds as many intervals each time.
pub(crate) const MAX_REFINEMENTS: usize = 4;
/// Readings an unknown must have before finer splines are tried.
const READINGS_PER_UNKNOWN: usize = 4;
/// Readings above which the first fits use a part of the campaign.
const LARGE: usize = 60_000;
/// Readings up to which passes share their basis functions, some 600 bytes each.
const SHARED: usize = 20_000;

/// Identifies all errors, stations and dead paths of a campaign.
///
/// `observe` sees each pass and returns false to stop. Errors name what is wrong with the plan or the data; a
/// rank-deficient or unsettled fit is an error, never a model. Where the data use up nearly every coefficient that
/// the machine file's splines offer, finer splines are tried and kept if the evidence is better.
pub fn identify(
    machine: &Machine,
    instrument: RangeUncertainty,
    campaign: &Campaign,
    options: &IdentifyOptions,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Identified, IdentifyError> {
    let fit = identify_with(machine, instrument, campaign, &[], options, observe)?;
    let unseen = unseen_expansions(&fit, instrument, campaign, &|_| true);
    Ok(Identified { model: fit.model.with_unseen_expansions(unseen)?, ..fit })
}

/// The same with effects beyond geometry, whose parameters are found together with everything else.
///
/// Each parameter has a weak prior: zero, with the effect's plausible size as standard deviation. Where the data tell
/// of it that is nothing; where they do not, its uncertainty says so instead of the fit failing.
pub fn identify_with(
    machine: &Machine,
    instrument: RangeUncertainty,
    campaign: &Campaign,
    terms: &[EffectTerm],
    options: &IdentifyOptions,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Identified, IdentifyError> {
    term::check(terms, campaign)?;
    plausibility::check_readings(machine, campaign)?;
    let stations = plausibility::place_stations(campaign, options.absolute_range)?;
    let mut inputs = Inputs { instrument, terms, options, observe };
    let Some(part) = part_of(campaign) else {
        return inputs.with_refined_splines(machine, campaign, &stations);
    };
    // Neighbours in a part are none in the campaign.
    let white = IdentifyOptions { noise: Noise::Given(None), ..*options };
    let of_part = Inputs { options: &white, observe: &mut *inputs.observe, ..inputs };
    let found = { of_part }.with_refined_splines(machine, &part, &stations)?;
    let parts = found.model.parts();
    let effects = parts.effects.iter().flat_map(|fitted| &fitted.parameters);
    let start: Vec<f64> = parts.coefficients.iter().chain(effects).copied().collect();
    match inputs.once(&parts.machine, campaign, &stations_of(&found), &start) {
        // The part may have asked for splines that the whole does not settle with.
        Err(problem) if problem != IdentifyError::Stopped && parts.machine != *machine => {
            let mut as_given = inputs.once(machine, campaign, &stations, &[])?;
            as_given.evidence.refinement_given_up = Some(problem.to_string());
            Ok(as_given)
        }
        other => other.map(|mut whole| {
            whole.evidence.refinement_given_up = found.evidence.refinement_given_up.clone();
            whole
        }),
    }
}

/// What stays the same from fit to fit.
struct Inputs<'a> {
    instrument: RangeUncertainty,
    terms: &'a [EffectTerm],
    options: &'a IdentifyOptions,
    observe: &'a mut dyn FnMut(Progress) -> bool,
}

impl Inputs<'_> {
    /// Fits, and tries finer splines while they are used up and the evidence is better. Both are compared on the weights of
    /// the coarser fit, and where the finer one comes to nothing, the coarser one stands and says so.
    fn with_refined_splines(
        &mut self,
        machine: &Machine,
        campaign: &Campaign,
        stations: &[StationStart],
    ) -> Result<Identified, IdentifyError> {
        let mut best = self.once(machine, campaign, stations, &[])?;
        for _ in 0..MAX_REFINEMENTS {
            let Some(finer) = refined(machine, &best) else { break };
            if self.options.order == OrderChoice::Fixed
                || best.evidence.unknowns * READINGS_PER_UNKNOWN > campaign.readings.len()
            {
                break;
            }
            match self.finer_if_likelier(&finer, campaign, &best) {
                Ok(Some(next)) => best = next,
                Ok(None) => break,
                Err(IdentifyError::Stopped) => return Err(IdentifyError::Stopped),
                Err(problem) => {
                    best.evidence.refinement_given_up = Some(problem.to_string());
                    break;
                }
            }
        }
        Ok(best)
    }

    /// The fit with finer splines, where it is likelier on the same weights.
    fn finer_if_likelier(
        &mut self,
        finer: &Machine,
        campaign: &Campaign,
        best: &Identified,
    ) -> Result<Option<Identified>, IdentifyError> {
        let next = self.once(finer, campaign, &stations_of(best), &[])?;
        let likelihood =
            |fit: &Identified| comparison::minus_two_log_likelihood_on(fit, self.instrument, campaign, &best.weights);
        Ok((likelihood(&next)? < likelihood(best)?).then_some(next))
    }

    /// One fit, from these stations, coefficients and effect parameters (none: all zero).
    fn once(
        &mut self,
        machine: &Machine,
        campaign: &Campaign,
        stations: &[StationStart],
        start: &[f64],
    ) -> Result<Identified, IdentifyError> {
        let layout = Layout::new(machine, centre_of(campaign.readings.iter().map(|r| r.offset_m)))?;
        let setup = Setup { machine, layout: &layout, instrument: self.instrument, terms: self.terms };
        let options = self.options;
        let mut fit = Fit::new(setup, campaign, stations, options, &mut *self.observe);
        if campaign.readings.len() < fit.free.len() {
            return Err(IdentifyError::TooFewReadings { readings: campaign.readings.len(), unknowns: fit.free.len() });
        }
        fit.parameters.iter_mut().zip(start).for_each(|(parameter, start)| *parameter = *start);
        let mut settled = fit.settle()?;
        if options.noise == Noise::Estimated {
            fit.correlation = fit.correlation_left(&settled);
            if fit.correlation.is_some() {
                settled = fit.settle()?;
            }
        }
        fit.finish(settled)
    }
}

fn stations_of(fit: &Identified) -> Vec<StationStart> {
    let of = |s: &Station| StationStart { position_m: s.position_m, dead_path_m: s.dead_path_m };
    fit.model.parts().stations.iter().map(of).collect()
}

/// As many readings of each station of a large campaign, spread over it; `None` for one that is not large.
fn part_of(campaign: &Campaign) -> Option<Campaign> {
    if campaign.readings.len() <= LARGE {
        return None;
    }
    let share = (LARGE / 2 / campaign.stations.len()).max(1);
    Some(campaign.part(&spread_by_group(campaign.readings.iter().map(|r| r.station), |_| share)))
}

/// The machine with finer splines, where the fit uses up nearly all coefficients of those it has, or fits badly with
/// one of them used up.
fn refined(machine: &Machine, fit: &Identified) -> Option<Machine> {
    let penalised = || fit.evidence.errors.iter().filter(|e| e.penalty.is_some());
    let offered: usize = penalised().map(|e| e.coefficients).sum();
    let used: f64 = penalised().map(|e| e.effective).sum();
    let one_is_free = penalised().any(|e| e.effective > FREE * e.coefficients as f64);
    let lacks = used > SATURATED * offered as f64 || (one_is_free && fit.evidence.chi2_per_dof > MISFIT);
    if offered == 0 || !lacks {
        return None;
    }
    let mut finer = machine.clone();
    finer.kinds = fit.model.parts().machine.kinds.map(|kind| kind.map(finer_kind));
    Some(finer)
}

/// A spline with the next finer intervals; other kinds as they are.
pub(crate) fn finer_kind(kind: FunctionKind) -> FunctionKind {
    match kind {
        FunctionKind::BSpline { intervals } => FunctionKind::BSpline { intervals: (intervals * 4).div_ceil(3) },
        other => other,
    }
}

/// State of the passes.
pub(crate) struct Fit<'a> {
    pub(crate) setup: Setup<'a>,
    pub(crate) campaign: &'a Campaign,
    pub(crate) options: &'a IdentifyOptions,
    pub(crate) observe: &'a mut dyn FnMut(Progress) -> bool,
    pub(crate) parameters: Vec<f64>,
    /// Basis functions at each reading, the same in every pass; of a large campaign they are found anew, and take no memory.
    locals: Vec<Locals>,
    pub(crate) free: Vec<usize>,
    pub(crate) smoothness: Smoothness,
    /// How the noise is correlated, as far as it is known.
    pub(crate) correlation: Option<RangeCorrelation>,
    pub(crate) observability: Option<Observability>,
    pub(crate) passes: usize,
    pub(crate) order_chosen: bool,
    /// χ² per degree of freedom at which the smoothness was chosen.
    pub(crate) noise_factor: f64,
}

/// Normal equations, where they were linearised and with which weights.
pub(crate) struct Linearised {
    pub(crate) normal: NormalEquations,
    at: Vec<f64>,
    pub(crate) weights: Vec<f64>,
}

impl Linearised {
    /// Other weights at the same point, of white noise.
    fn reweigh(&mut self, setup: Setup, campaign: &Campaign, weights: Vec<f64>) {
        let change: Vec<f64> = weights.iter().zip(&self.weights).map(|(now, then)| now - then).collect();
        if change.iter().any(|change| *change != 0.0) {
            self.normal.absorb(&accumulate(&Estimate::new(setup, campaign, &self.at), &change));
        }
        self.weights = weights;
    }
}

/// Outcome of the passes.
pub(crate) struct Settled {
    pub(crate) solution: Solution,
    pub(crate) residuals: Vec<(f64, f64)>,
    pub(crate) weights: Vec<f64>,
    pub(crate) scale: f64,
    pub(crate) largest_step: f64,
}

impl<'a> Fit<'a> {
    pub(crate) fn new(
        setup: Setup<'a>,
        campaign: &'a Campaign,
        stations: &[StationStart],
        options: &'a IdentifyOptions,
        observe: &'a mut dyn FnMut(Progress) -> bool,
    ) -> Fit<'a> {
        let mut parameters = vec![0.0; setup.machine_parameters()];
        let mut free: Vec<usize> = (0..parameters.len()).collect();
        for station in stations {
            let first = parameters.len();
            parameters.extend(station.position_m.iter().chain([&station.dead_path_m]));
            free.extend(first..parameters.len());
        }
        let readings = if campaign.readings.len() <= SHARED { campaign.readings.as_slice() } else { &[] };
        let locals = readings.iter().map(|reading| setup.layout.locals(reading.reading_m)).collect();
        let mut smoothness =
            if options.order == OrderChoice::Evidence { Smoothness::new(setup.layout) } else { Smoothness::default() };
        smoothness.priors = setup.priors_with(stations.len(), options.absolute_range);
        Fit {
            setup,
            campaign,
            options,
            observe,
            parameters,
            locals,
            free,
            smoothness,
            correlation: match options.noise {
                Noise::Estimated => None,
                Noise::Given(correlation) => correlation,
            },
            observability: None,
            passes: 0,
            order_chosen: options.order == OrderChoice::Fixed,
            noise_factor: 1.0,
        }
    }

    pub(crate) fn estimate(&self) -> Estimate<'_> {
        Estimate::new(self.setup, self.campaign, &self.parameters).sharing(&self.locals)
    }

    /// Passes over the readings until the parameters settle.
    ///
    /// The first steps are of many micrometres and need rows of their own; later ones are of nanometres, and then only
    /// the readings whose weight changed are summed again.
    fn settle(&mut self) -> Result<Settled, IdentifyError> {
        let (weights, _) = self.weigh(&residuals(&self.estimate()));
        let mut linear = self.linearise(weights);
        if self.observability.is_none() {
            let of_plan =
                observability::check(&self.estimate(), self.campaign, &linear.normal, self.options.absolute_range);
            self.observability = Some(of_plan?);
        }
        let mut largest_step = f64::INFINITY;
        for pass in 0..self.options.max_passes {
            self.passes += 1;
            let solution = self.solve(&linear, pass < SMOOTHING_PASSES).map_err(|_| IdentifyError::Singular)?;
            largest_step = self.step(&solution);
            let residuals = residuals(&self.estimate());
            let (found, scale) = self.weigh(&residuals);
            let weights = if pass < WEIGHING_PASSES { found } else { linear.weights.clone() };
            let chi2_per_dof = solution.noise_factor;
            if !(self.observe)(Progress { pass: self.passes, largest_step, chi2_per_dof }) {
                return Err(IdentifyError::Stopped);
            }
            if largest_step < SETTLED {
                return Ok(Settled { solution, residuals, weights, scale, largest_step });
            }
            let moved = self.parameters.iter().zip(&linear.at).map(|(now, then)| (now - then).abs());
            let reweighed = self.correlation.is_some() && weights != linear.weights;
            if moved.fold(0.0, f64::max) > LINEAR || reweighed {
                linear = self.linearise(weights);
            } else if self.correlation.is_none() {
                linear.reweigh(self.setup, self.campaign, weights);
            }
        }
        Err(IdentifyError::NotConverged { passes: self.passes, largest_step })
    }

    pub(crate) fn linearise(&self, weights: Vec<f64>) -> Linearised {
        let normal = match &self.correlation {
            None => accumulate(&self.estimate(), &weights),
            Some(correlation) => {
                accumulate_whitened(&self.estimate(), &weights, &correlation.whitener(self.campaign, &weights))
            }
        };
        Linearised { normal, at: self.parameters.clone(), weights }
    }

    /// How the noise is correlated that the settled fit leaves, where it is shown.
    fn correlation_left(&self, settled: &Settled) -> Option<RangeCorrelation> {
        let asked = Asked {
            estimate: self.estimate(),
            weights: &settled.weights,
            free: &self.free,
            smoothness: &self.smoothness,
            noise_factor: self.noise_factor,
        };
        asked.correlation()
    }

    /// Solves one pass; the order of polynomials is decided once, after the first linearisation.
    pub(crate) fn solve(
        &mut self,
        linear: &Linearised,
        choose_smoothness: bool,
    ) -> Result<Solution, NotPositiveDefinite> {
        let (normal, at) = (&linear.normal, &linear.at);
        if !self.order_chosen && self.passes >= 2 {
            self.order_chosen = true;
            let used = linear.weights.iter().filter(|weight| **weight > 0.0).count();
            order::eliminate(self.setup.layout, (normal, used), at, &mut self.free, &mut self.smoothness)?;
        }
        let solution =
            smoothing::solve(normal, at, &self.free, &mut self.smoothness, self.noise_factor, choose_smoothness)?;
        if choose_smoothness {
            self.noise_factor = solution.noise_factor;
        }
        Ok(solution)
    }

    /// Takes the step; returns its largest component in units of the uncertainty.
    fn step(&mut self, solution: &Solution) -> f64 {
        let largest = solution.largest_step(&self.parameters, &self.free);
        self.parameters.clone_from(&solution.parameters);
        largest
    }

    fn weigh(&self, residuals: &[(f64, f64)]) -> (Vec<f64>, f64) {
        let standardised: Vec<f64> = residuals.iter().map(|(residual_m, u_m)| residual_m / u_m).collect();
        let scale = robust::scale(&standardised).max(f64::MIN_POSITIVE);
        let weights =
            if self.options.robust { robust::weights(&standardised, scale) } else { vec![1.0; residuals.len()] };
        (weights, scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_measurement::campaign::RangeReading;
    use std::collections::BTreeSet;

    /// 300,000 readings in lines of twenty points: every tenth of them would know two places of each line.
    #[test]
    fn regress_the_part_of_a_large_campaign_has_every_place_of_its_lines() {
        let reading = |k: usize| RangeReading {
            station: (k / 150_000) as u32,
            line: (k / 20) as u32,
            time_s: k as f64,
            reading_m: [(k % 20) as f64, 0.0, 0.0],
            offset_m: [0.0; 3],
            length_m: 0.0,
        };
        let stations = ["S1", "S2"].map(str::to_owned).to_vec();
        let lines = (0..15_000).map(|k| k.to_string()).collect();
        let campaign = Campaign { stations, lines, readings: (0..300_000).map(reading).collect(), covariates: vec![] };
        let part = part_of(&campaign).unwrap();
        for station in 0..2 {
            let own: Vec<&RangeReading> = part.readings.iter().filter(|r| r.station == station).collect();
            let places: BTreeSet<u64> = own.iter().map(|r| r.reading_m[0] as u64).collect();
            assert_eq!((own.len(), places.len()), (LARGE / 4, 20));
        }
        assert!(part_of(&part).is_none());
    }
}
