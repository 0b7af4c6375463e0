//! Courses that return: what switches on and off beside the machine, and is logged nowhere.
//!
//! Place in the flow: one of the courses of [`super`]. An air conditioning, a chiller, a door: of all periods the one is taken with which the
//! motions of the tip explain most, Σ |Σ w r exp(2πift)|² over the motions, w what each does to a range. Its price is the number of
//! periods. Harmonics beyond the second are left to the noise. Times in s.

use super::courses::{Course, about_mean};
use super::motions::{Motions, Places};
use crate::candidates::Round;
use crate::columns::range;
use abbe_identify::in_parallel;
use abbe_measurement::campaign::Campaign;
use std::f64::consts::TAU;

/// Cycles in the campaign from which what comes back is one. A slow course that heat takes looks like five of them.
const FEWEST: f64 = 6.0;
/// Lines that a cycle lasts at least: what comes back with the lines is a matter of the place.
const LINES: f64 = 4.0;
/// Frequencies between two that a campaign tells apart.
const FINER: usize = 4;
/// Weight of the second harmonic beside the first.
const SECOND: f64 = 0.5;

/// What a cycle is called: `cycles of 25.0 min`.
fn named(period_s: f64) -> String {
    match period_s {
        seconds if seconds < 100.0 => format!("cycles of {seconds:.0} s"),
        seconds if seconds < 6000.0 => format!("cycles of {:.1} min", seconds / 60.0),
        seconds => format!("cycles of {:.1} h", seconds / 3600.0),
    }
}

/// The cycle with which motions of the tip explain most of what is left: cosine and sine of the period, and of half of it. `None` where the
/// campaign is too short for any.
pub(super) fn strongest(round: &Round, places: &Places, campaign: &Campaign, used: &[usize]) -> Option<Course> {
    let time_s = |k: usize| campaign.readings[k].time_s;
    let (first_s, last_s) = range(used.iter().map(|k| time_s(*k)));
    let (duration_s, most) = (last_s - first_s, campaign.lines.len() as f64 / LINES);
    if duration_s <= 0.0 || most <= FEWEST {
        return None;
    }
    let weighted = weighted(round, places, used);
    let steps = ((most - FEWEST) * FINER as f64) as usize;
    let cycles: Vec<f64> = (0..=steps).map(|k| FEWEST + k as f64 / FINER as f64).collect();
    let turns = |cycles: f64, k: usize| TAU * cycles * (time_s(k) - first_s) / duration_s;
    let powers = in_parallel(&cycles, |cycles| {
        let phases: Vec<(f64, f64)> = used.iter().map(|k| turns(*cycles, *k).sin_cos()).collect();
        weighted.iter().map(|values| power(values, &phases)).sum::<f64>()
    });
    let (best, _) = cycles.iter().zip(powers).max_by(|a, b| a.1.total_cmp(&b.1))?;
    let part = |harmonic: f64, weight: f64, of: fn(f64) -> f64| {
        let values = (0..campaign.readings.len()).map(|k| weight * of(turns(best * harmonic, k)));
        about_mean(values.collect(), used)
    };
    let harmonics = [(1.0, 1.0), (2.0, SECOND)];
    let parts = harmonics.into_iter().flat_map(|(n, weight)| [part(n, weight, f64::cos), part(n, weight, f64::sin)]);
    let tried = FINER as f64 * (most - FEWEST);
    Some(Course { follows: named(duration_s / best), parts: parts.collect(), tried, returns: true })
}

/// Of each motion of the tip, what it does to the ranges used, times what is left of them.
fn weighted(round: &Round, places: &Places, used: &[usize]) -> Vec<Vec<f64>> {
    let residuals = round.rows.weighted(round.free.residuals());
    let of = |(d, form, size_m): &(usize, usize, f64)| {
        let at = |k: &usize| round.rows.rays[*k].direction[*d] * size_m * places.forms[*k][*form] * residuals[*k];
        used.iter().map(at).collect()
    };
    Motions::quadratic(places).0.iter().map(of).collect()
}

/// |Σ v exp(iφ)|².
fn power(values: &[f64], phases: &[(f64, f64)]) -> f64 {
    let sums = values.iter().zip(phases).fold((0.0, 0.0), |sums, (v, (s, c))| (sums.0 + v * s, sums.1 + v * c));
    sums.0 * sums.0 + sums.1 * sums.1
}
