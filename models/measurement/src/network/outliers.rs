//! Gross errors of a network: what contradicts the rest.
//!
//! Place in the flow: after each least squares. A residual v over its own standard deviation, w = v / (u √r) with the
//! redundancy r = 1 − (variance of the prediction) / u², is standard normal, and leaving that sighting out lowers χ² by w².
//! Only the largest are judged in a round, since they spoil their neighbours'. Where two sightings of a point explain as much, as
//! always where four stations saw it, nothing tells which one is wrong: the point goes, not one of them. Two gross errors of one
//! point can look like one of a third sighting. A point therefore keeps as many checks as it lost sightings, what is left of it must
//! agree closely, and it goes otherwise.
//! Source: Baarda 1968.

use super::blocks::{Blocks, EACH, by_station};
use super::{NetworkError, Search};
use crate::robust;
use nalgebra::{DMatrix, Vector4};

/// Standardised residual from which a sighting contradicts the rest: 6e-7 of normal ones do.
const LIMIT: f64 = 5.0;
/// The same for what is left of a point that lost a sighting, where one check is left and where there are more: 5 and 1 of 100 points
/// go whose rest is right. A second gross error may hide there, which is likelier than among points that nothing spoke against.
const LIMITS_OF_THE_REST: [f64; 2] = [2.0, 3.0];
/// Share of the round's largest from which another is judged in the same round.
const ALIKE: f64 = 0.5;
/// Gain in χ² by which the best explanation must beat the next: 90 times as likely.
const CLEAR: f64 = 9.0;
/// Redundancy below which nothing checks a sighting.
const LEAST_REDUNDANCY: f64 = 0.01;

/// What is left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    Sighting(usize),
    Point(usize),
}

/// What contradicts the rest in this round.
pub(super) fn find(search: &Search) -> Result<Vec<Verdict>, NetworkError> {
    let by_point = standardised(search)?;
    let sizes: Vec<f64> = by_point.iter().flat_map(|(_, list)| list).map(|(_, w)| w.abs()).collect();
    let largest = sizes.iter().copied().fold(0.0, f64::max);
    // An effect that lengths and stations share widens the band instead of throwing half the points away.
    let scale = robust::scale(&sizes).max(1.0);
    let limit = (LIMIT * scale).max(ALIKE * largest);
    let judged = by_point.iter().filter_map(|(point, list)| judge(search, *point, list, limit, scale));
    let judged: Vec<Verdict> = judged.collect();
    if !judged.is_empty() {
        return Ok(judged);
    }
    // Only now: gross errors of others no longer spoil what is left.
    let doubtful = by_point.iter().filter(|(point, list)| is_doubtful(search, *point, list, scale));
    Ok(doubtful.map(|(point, _)| Verdict::Point(*point)).collect())
}

/// Whether a point lost sightings and what is left of it does not agree closely.
fn is_doubtful(search: &Search, point: usize, list: &[(usize, f64)], scale: f64) -> bool {
    let [one, more] = LIMITS_OF_THE_REST;
    let limit = if search.checks(point) > 1 { more } else { one };
    search.lost(point) > 0 && list.iter().any(|(_, w)| w.abs() > limit * scale)
}

/// What is wrong with a point, if its worst sighting is beyond the limit.
fn judge(search: &Search, point: usize, list: &[(usize, f64)], limit: f64, scale: f64) -> Option<Verdict> {
    let (worst, w) = list.iter().copied().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
    if w.abs() <= limit {
        return None;
    }
    let next = list.iter().filter(|(k, _)| *k != worst).map(|(_, w)| w * w).fold(0.0, f64::max);
    let stays_checked = search.checks(point) > search.lost(point) + 1;
    let is_clear = w * w - next > CLEAR * scale * scale && stays_checked;
    Some(if is_clear { Verdict::Sighting(worst) } else { Verdict::Point(point) })
}

/// Sightings of a point with their standardised residuals.
type OfPoint = (usize, Vec<(usize, f64)>);

/// Standardised residuals of the sightings that something checks, by point.
fn standardised(search: &Search) -> Result<Vec<OfPoint>, NetworkError> {
    let blocks = Blocks::new(search);
    let reduced = blocks.reduced(0.0)?;
    let covariance = blocks.station_covariance(&reduced)?;
    let mut all = Vec::with_capacity(blocks.points.len());
    for (block, inverse) in blocks.points.iter().zip(&reduced.inverses) {
        let gains: Vec<_> = block.gains(inverse).collect();
        let stations: Vec<usize> = gains.iter().map(|(station, _)| *station).collect();
        let own = local(&covariance, &stations);
        let mut list = Vec::with_capacity(stations.len());
        for k in search.sights(block.point) {
            let (residual_m, ray) = search.row(k);
            let s = &search.sightings[k];
            let mut of_stations = nalgebra::DVector::zeros(EACH * stations.len());
            for (place, (station, gain)) in gains.iter().enumerate() {
                let direct = if *station == s.station { by_station(&ray) } else { Vector4::zeros() };
                of_stations.fixed_rows_mut::<EACH>(EACH * place).copy_from(&(gain * ray + direct));
            }
            let predicted = ray.dot(&(inverse * ray)) + of_stations.dot(&(&own * &of_stations));
            let redundancy = 1.0 - predicted / (s.u_m * s.u_m);
            if redundancy > LEAST_REDUNDANCY {
                list.push((k, residual_m / (s.u_m * redundancy.sqrt())));
            }
        }
        all.push((block.point, list));
    }
    Ok(all)
}

/// Covariance of a few stations.
fn local(covariance: &DMatrix<f64>, stations: &[usize]) -> DMatrix<f64> {
    let place = |k: usize| EACH * stations[k / EACH] + k % EACH;
    let size = EACH * stations.len();
    DMatrix::from_fn(size, size, |i, j| covariance[(place(i), place(j))])
}
