//! Noise of a campaign's ranges, correlated along lines or over whole stations.
//!
//! Place in the flow: [`crate::solve`] fits with white noise first. Where the residuals say more, the likeliest correlation is
//! estimated beside all that the fit explains ([`crate::correlation`]), the rows are whitened by it and the fit settles
//! again. Where they do not, nothing is different. Candidates are the order of measurement and the time, along each line
//! and over all lines of a station, with an offset of each line where the data ask for it.

use crate::correlation::{Fitted, Sequence};
use crate::design::{Estimate, Row, Setup, places};
use crate::identified::{Ended, Identified};
use crate::range_correlation::{Along, By, RangeCorrelation, sequence};
use crate::rows::parameters_of;
use crate::smoothing::Smoothness;
use crate::term::EffectTerm;
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use faer::Mat;
use std::collections::BTreeMap;

/// Readings that the parameters of the noise are estimated from: they are then known to some hundredths.
const READINGS: usize = 2000;
/// Readings that a first look takes.
const GLANCED: usize = 1000;
/// Lines in a run of neighbouring ones that are taken or left together.
const RUN: usize = 4;

/// Orders in which noise may be correlated, the simplest first.
const ORDERS: [(Along, By); 4] =
    [(Along::Line, By::Order), (Along::Station, By::Order), (Along::Line, By::Time), (Along::Station, By::Time)];

/// How the noise is correlated that a fit with white noise leaves, where it is shown.
pub fn correlation_left(
    fit: &Identified,
    instrument: RangeUncertainty,
    campaign: &Campaign,
) -> Option<RangeCorrelation> {
    let parts = fit.model.parts();
    let terms: Vec<EffectTerm> = parts.effects.iter().map(EffectTerm::of).collect();
    let setup = Setup { machine: &parts.machine, layout: fit.model.layout(), instrument, terms: &terms };
    let parameters = parameters_of(&fit.model);
    let Ended { free, smoothness, noise_factor } = &fit.ended;
    let estimate = Estimate::new(setup, campaign, &parameters);
    Asked { estimate, weights: &fit.weights, free, smoothness, noise_factor: *noise_factor }.correlation()
}

/// A settled fit, of whose noise the correlation is asked.
pub(crate) struct Asked<'a> {
    pub(crate) estimate: Estimate<'a>,
    pub(crate) weights: &'a [f64],
    pub(crate) free: &'a [usize],
    pub(crate) smoothness: &'a Smoothness,
    /// χ² per degree of freedom at which the smoothness was chosen.
    pub(crate) noise_factor: f64,
}

impl Asked<'_> {
    /// The likeliest correlation where it is shown.
    pub(crate) fn correlation(&self) -> Option<RangeCorrelation> {
        let campaign = self.estimate.campaign;
        let few = some(campaign, GLANCED);
        let line = sequence(campaign, &few, ORDERS[0]);
        if !self.of(&few, |fitted| fitted.hints_at_correlation(&line)) {
            return None;
        }
        let readings = some(campaign, READINGS);
        let sequences: Vec<Sequence> = ORDERS.iter().map(|order| sequence(campaign, &readings, *order)).collect();
        let found = self.of(&readings, |fitted| fitted.correlation(&sequences))?;
        let (along, by) = ORDERS[found.sequence];
        Some(RangeCorrelation { noise: found.correlation, along, by, gain: found.gain })
    }

    /// What is asked of the fit's rows of these readings.
    fn of<T>(&self, readings: &[usize], ask: impl FnOnce(&Fitted) -> T) -> T {
        let (design, residuals) = self.rows(readings);
        let weights: Vec<f64> = readings.iter().map(|k| self.weights[*k]).collect();
        let (prior, proper) = self.smoothness.precision(self.free, self.noise_factor);
        ask(&Fitted {
            design: design.as_ref(),
            residuals: &residuals,
            weights: &weights,
            prior: prior.as_ref(),
            improper: self.free.len().saturating_sub(proper),
        })
    }

    /// Partials by the free parameters and residuals of these readings, divided by their uncertainty.
    fn rows(&self, readings: &[usize]) -> (Mat<f64>, Vec<f64>) {
        let place = places(self.free, self.estimate.parameters.len());
        let mut design = Mat::zeros(readings.len(), self.free.len());
        let mut row = Row::new();
        let residual = |(k, reading): (usize, &usize)| {
            self.estimate.row(*reading, &mut row);
            let u_m = self.estimate.setup.u_m(&row.ray);
            row.entries(&place).for_each(|(column, value)| design[(k, column)] = value / u_m);
            row.residual_m / u_m
        };
        let residuals = readings.iter().enumerate().map(residual).collect();
        (design, residuals)
    }
}

/// All readings of a campaign of at most so many; of a larger one about as many, those of runs of neighbouring lines, spread over each station.
fn some(campaign: &Campaign, most: usize) -> Vec<usize> {
    let all = campaign.readings.len();
    if all <= most {
        return (0..all).collect();
    }
    // Number of each line among those of its station, in the order of measurement.
    let mut numbers: BTreeMap<(u32, u32), usize> = BTreeMap::new();
    let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
    for reading in &campaign.readings {
        numbers.entry((reading.station, reading.line)).or_insert_with(|| {
            let count = counts.entry(reading.station).or_default();
            *count += 1;
            *count - 1
        });
    }
    let share = most as f64 / all as f64;
    let is_in = |k: &usize| {
        let reading = &campaign.readings[*k];
        let run = numbers.get(&(reading.station, reading.line)).map_or(0, |number| number / RUN) as f64;
        // The first run of each station, and then each that the share comes to.
        ((run + 1.0) * share).ceil() > (run * share).ceil() || run == 0.0
    };
    (0..all).filter(is_in).collect()
}
