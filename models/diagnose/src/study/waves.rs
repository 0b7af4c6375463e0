//! Waves whose period the data choose, from the whole band of periods that an axis may have.
//!
//! Place in the flow: beside the search and, once more, after it. Targets far apart show a short wave as a long one (an alias):
//! the pitch of a screw is a few millimetres, targets are some tens apart. At irregular targets the aliases differ a little from
//! the wave itself. So the whole band is tried wherever a period is chosen, and periods that go nearly as well are named
//! (Lomb 1976; VanderPlas 2018 on aliases of irregular samples). A wave follows the position alone: all rows of a position go through
//! the products once, and a frequency costs next to nothing.

use super::candidate::Band;
use super::fit::Fit;
use super::scored::COMPARABLE;
use super::view::View;
use crate::error::DiagnoseError;
use crate::linear::Projected;
use crate::peak::peak;
use crate::score::{OfTwo, gain_of_two};
use abbe_identify::dot;
use faer::Mat;
use std::f64::consts::TAU;

/// Peaks of the scan whose tops are found, and the share of the highest from which they are: between two steps of the scan a peak
/// loses a tenth at most.
const PEAKS: usize = 24;
const NEARLY: f64 = 0.8;
/// Frequencies of which products are taken at once.
const TOGETHER: usize = 64;
/// Worth within which two waves are the same at all targets: the slower is taken.
const SAME: f64 = 1e-3;

/// What a fit without a wave leaves to all waves of its band.
struct Left {
    band: Band,
    /// Of one column for each position.
    each: Projected,
    chi2: f64,
    degrees: f64,
}

/// A frequency (1/m) at which a wave is worth more than beside it, and what it is worth.
#[derive(Debug, Clone, Copy)]
struct Peak {
    frequency: f64,
    worth: f64,
}

impl Left {
    /// `None` where a candidate has no band.
    fn new(view: &View, fit: &Fit, candidate: usize) -> Option<Left> {
        let chain = view.chain_of(candidate)?;
        let band = view.study.band(candidate, view.rows_of_study(chain))?;
        let mut at = Mat::zeros(band.place_of.len(), band.places_m.len());
        band.place_of.iter().enumerate().for_each(|(row, place)| at[(row, *place)] = 1.0);
        let part = fit.part(view, &[chain]);
        let each = part.project(view.whitened_in(chain, at).as_ref());
        Some(Left { band, each, chi2: part.chi2, degrees: part.degrees })
    }

    /// Gain of twice the log likelihood, less the price of the choice: among so many waves that the positions do not resolve, one goes
    /// by chance.
    fn worth(&self, frequency: f64) -> f64 {
        self.gain(frequency) - self.price(frequency)
    }

    fn price(&self, frequency: f64) -> f64 {
        2.0 * self.band.choices(frequency).ln()
    }

    fn gain(&self, frequency: f64) -> f64 {
        self.gains(frequency, 1)[0]
    }

    /// The gain at so many frequencies from this one on, a step of the scan apart: products of all of them are taken at once.
    fn gains(&self, first: f64, count: usize) -> Vec<f64> {
        let places_m = &self.band.places_m;
        // Sines, then cosines; each turns on from the one before.
        let mut waves = Mat::zeros(places_m.len(), 2 * count);
        for (row, place_m) in places_m.iter().enumerate() {
            let (mut sine, mut cosine) = (TAU * place_m * first).sin_cos();
            let (s, c) = (TAU * place_m * self.band.step).sin_cos();
            for k in 0..count {
                (waves[(row, k)], waves[(row, count + k)]) = (sine, cosine);
                (sine, cosine) = (sine * c + cosine * s, cosine * c - sine * s);
            }
        }
        let reached = [&self.each.alone, &self.each.left].map(|square| square * &waves);
        let gain = |k: usize| {
            let own = [k, count + k];
            let [sine, cosine] = own.map(|column| waves.col_as_slice(column));
            let gradient = [sine, cosine].map(|wave| dot(wave, &self.each.gradient));
            let [alone, left] = [&reached[0], &reached[1]].map(|reached| {
                let [of_sine, of_cosine] = own.map(|column| reached.col_as_slice(column));
                OfTwo { diagonal: [dot(sine, of_sine), dot(cosine, of_cosine)], beside: dot(cosine, of_sine) }
            });
            gain_of_two(gradient, alone, left, self.chi2, self.degrees)
        };
        (0..count).map(gain).collect()
    }

    /// What waves are worth at each step of the scan.
    fn scan(&self) -> Vec<f64> {
        let Band { low, high, step, .. } = self.band;
        let count = ((high - low) / step).floor() as usize;
        let frequency = |k: usize| low + k as f64 * step;
        let starts = (0..=count).step_by(TOGETHER);
        let gains = starts.flat_map(|k| self.gains(frequency(k), TOGETHER.min(count + 1 - k)));
        gains.enumerate().map(|(k, gain)| gain - self.price(frequency(k))).collect()
    }

    /// The highest peaks, highest first, of equal ones the slower.
    fn peaks(&self) -> Vec<Peak> {
        let Band { low, step, .. } = self.band;
        let worth = self.scan();
        let most = worth.iter().copied().fold(0.0, f64::max);
        let beside = |k: usize| {
            let (before, after) = (k.checked_sub(1).map(|k| worth[k]), worth.get(k + 1).copied());
            before.into_iter().chain(after).fold(f64::NEG_INFINITY, f64::max)
        };
        let is_peak = |k: &usize| worth[*k] >= beside(*k) && worth[*k] >= NEARLY * most - COMPARABLE;
        let mut places: Vec<usize> = (0..worth.len()).filter(is_peak).collect();
        places.sort_by(|a, b| worth[*b].total_cmp(&worth[*a]));
        let top = |k: usize| {
            let own = low + k as f64 * step;
            let frequency = peak(((own - step).max(low), own + step), |frequency| self.gain(frequency));
            Peak { frequency, worth: self.worth(frequency) }
        };
        let mut peaks: Vec<Peak> = places.into_iter().take(PEAKS).map(top).collect();
        peaks.sort_by(|a, b| b.worth.total_cmp(&a.worth));
        let Some(most) = peaks.first().map(|peak| peak.worth) else { return peaks };
        let same = peaks.partition_point(|peak| most - peak.worth <= SAME);
        peaks[..same].sort_by(|a, b| a.frequency.total_cmp(&b.frequency));
        peaks
    }
}

/// The frequency of its band at which a wave is worth most beside a fit without it; `None` where it has no band.
pub(super) fn best(view: &View, fit: &Fit, candidate: usize) -> Option<f64> {
    Left::new(view, fit, candidate)?.peaks().first().map(|peak| peak.frequency)
}

/// Takes the best frequency of each wave of a set beside all the rest: one that was found while other effects were missing may be
/// the alias that went best with these.
pub(super) fn tuned(view: &mut View, set: &[usize]) -> Result<bool, DiagnoseError> {
    let waves: Vec<usize> = set.iter().copied().filter(|k| view.study.frequency(*k).is_some()).collect();
    for own in &waves {
        let without = Fit::without(view, set, *own)?;
        view.refine(&without, *own);
    }
    Ok(!waves.is_empty())
}

/// Tells the study which other waves go nearly as well as each that was found, within odds of 20 to 1.
pub(super) fn tell_aliases(view: &mut View, set: &[usize]) -> Result<(), DiagnoseError> {
    for wave in set {
        let Some((frequency, _)) = view.study.frequency(*wave) else { continue };
        let without = Fit::without(view, set, *wave)?;
        let Some(left) = Left::new(view, &without, *wave) else { continue };
        let own = left.worth(frequency);
        let is_other =
            |peak: &Peak| own - peak.worth < COMPARABLE && (peak.frequency - frequency).abs() > left.band.resolution;
        let aliases = left.peaks().into_iter().filter(is_other).map(|peak| peak.frequency).collect();
        view.study.set_aliases(*wave, aliases);
    }
    Ok(())
}
