//! Noise correlated in the order of measurement: its model, its likelihood, and columns freed of it.
//!
//! Place in the flow: every study whitens the rows of one axis or component here. Model: unit variance of which a share
//! is slow, e^(-gap) correlated (an autoregression of first order, sampled at any gaps), the rest white; gaps in steps
//! between neighbours. Restricted likelihood (Patterson & Thompson 1971) and whitening are those of identification
//! ([`abbe_identify::correlation`]); here all descriptions that the data leave open are weighed against each other, since
//! few cycles leave many. Before the data, white noise is as likely as all slow noise together: a grid of slow noise does
//! not become likelier by having more points. No units.

use super::filters::Gaps;
use abbe_identify::correlation::{Correlation, Fitted, Sequence, Whitener};
use abbe_identify::{in_parallel, symmetric_eigen};
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};

/// Correlations over one step and slow shares that are weighed against each other. Near 1 the shares are dense: a drift of many
/// times the scatter, which is slow noise before it is found, leaves a white part of some thousandths, and without it each step of the
/// scatter would have to be a step of the drift.
const RHO: [f64; 9] = [0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 0.98, 0.995];
/// Each share with the width that it stands for; all of the variance, an autoregression as such, has one of its own.
const SHARE: [(f64, f64); 8] =
    [(0.25, 1.0), (0.5, 1.0), (0.75, 0.8), (0.9, 0.4), (0.97, 0.2), (0.99, 0.1), (0.997, 0.1), (1.0, 1.0)];
/// Probability, before the data, that noise is white.
const WHITE: f64 = 0.5;
/// Degrees of freedom below which a correlation cannot be estimated.
const FEWEST: usize = 10;
/// Weight below which a description of the noise is left out.
const NEGLIGIBLE: f64 = 1e-5;
/// Figures of a matrix from which descriptions of the noise go on several threads.
const ON_THREADS: usize = 4000;
/// Shortest gap, in steps: rows of one instant are two readings all the same.
const SHORTEST: f64 = 0.05;

/// How noise is correlated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Theta {
    /// Correlation of the slow part over one step.
    pub(super) rho: f64,
    /// Share of the variance that is slow.
    pub(super) share: f64,
}

impl Theta {
    pub(super) const WHITE: Theta = Theta { rho: 0.0, share: 0.0 };

    fn correlation(self) -> Correlation {
        // White noise has no length; any does for a share of nothing.
        let length = if self.rho > 0.0 { -self.rho.ln().recip() } else { 1.0 };
        Correlation { share: self.share, length, group_share: 0.0 }
    }

    /// Correlation of neighbouring rows.
    pub(super) fn neighbours(self) -> f64 {
        self.rho * self.share
    }
}

/// What frees columns of correlation: rows in order, each with the steps since the one before (the first is not read).
/// White rows need nothing.
#[derive(Debug, Clone)]
pub(super) struct Filter(Option<Whitener>);

impl Filter {
    pub(super) fn new(theta: Theta, gaps: &[f64]) -> Filter {
        if theta == Theta::WHITE {
            return Filter(None);
        }
        let mut place = 0.0;
        let mut along = |gap: &f64| {
            place += gap.max(SHORTEST);
            place
        };
        let places: Vec<f64> = gaps.iter().map(&mut along).collect();
        let rows: Vec<usize> = (0..gaps.len()).collect();
        let sequence = Sequence::new(&[rows], |row| places[row], |_| 0);
        Filter(Some(Whitener::new(&sequence, &theta.correlation(), &vec![1.0; gaps.len()])))
    }

    /// Whitens every column.
    pub(super) fn whitened(&self, mut columns: Mat<f64>) -> Mat<f64> {
        if let Some(whitener) = &self.0 {
            whitener.apply_to_columns(&mut columns);
        }
        columns
    }

    fn log_determinant(&self) -> f64 {
        self.0.as_ref().map_or(0.0, Whitener::log_determinant)
    }
}

/// Steps between neighbours: time over its median step where times tell the order, else one.
pub(super) fn steps(times: Vec<f64>) -> Vec<f64> {
    let steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mut sorted = steps.clone();
    sorted.sort_by(f64::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let tells = steps.iter().all(|step| *step > 0.0);
    std::iter::once(1.0).chain(steps.into_iter().map(|step| if tells { step / median } else { 1.0 })).collect()
}

/// One description of the noise and how likely the data make it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Weighed {
    pub(super) theta: Theta,
    /// Posterior weight; all sum to 1.
    pub(super) weight: f64,
}

/// What rows say of their noise.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Noise {
    /// The description used for the fit.
    pub(super) theta: Theta,
    /// Standard deviation of one row.
    pub(super) sigma: f64,
    /// All that the data leave open, from white to slow.
    pub(super) weighed: Vec<Weighed>,
    /// Degrees of freedom that it rests on.
    pub(super) degrees: usize,
}

impl Noise {
    /// White noise of one unit.
    pub(super) fn white() -> Noise {
        let weighed = vec![Weighed { theta: Theta::WHITE, weight: 1.0 }];
        Noise { theta: Theta::WHITE, sigma: 1.0, weighed, degrees: 0 }
    }

    /// Whether the rows were too few to look for a correlation.
    pub(super) fn is_assumed_white(&self) -> bool {
        self.degrees < FEWEST
    }

    /// Quantile of the correlation of neighbours.
    pub(super) fn neighbours_at(&self, probability: f64) -> f64 {
        let mut sorted: Vec<(f64, f64)> = self.weighed.iter().map(|w| (w.theta.neighbours(), w.weight)).collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut sum = 0.0;
        for (value, weight) in &sorted {
            sum += weight;
            if sum >= probability {
                return *value;
            }
        }
        sorted.last().map_or(0.0, |(value, _)| *value)
    }
}

/// All descriptions of the noise, with the logarithm of their probability before the data.
fn descriptions() -> impl Iterator<Item = (Theta, f64)> {
    let all: f64 = SHARE.iter().map(|(_, width)| width).sum::<f64>() * RHO.len() as f64;
    let of_share = move |(share, width): (f64, f64)| {
        RHO.into_iter().map(move |rho| (Theta { rho, share }, ((1.0 - WHITE) * width / all).ln()))
    };
    std::iter::once((Theta::WHITE, WHITE.ln())).chain(SHARE.into_iter().flat_map(of_share))
}

/// Place of a description among all; their number for one that is none of them.
pub(super) fn place_of(theta: Option<Theta>) -> usize {
    descriptions().take_while(|(own, _)| Some(*own) != theta).count()
}

/// A figure of every description of the noise that has one, with the logarithm of its probability before the data: on several
/// threads where the work is worth them.
fn of_each<R: Send>(work: usize, of: impl Fn(Theta) -> Option<R> + Sync) -> Vec<(Theta, f64, R)> {
    let all: Vec<(Theta, f64)> = descriptions().collect();
    let one = |(theta, prior): &(Theta, f64)| Some((*theta, *prior, of(*theta)?));
    match work < ON_THREADS {
        true => all.iter().filter_map(one).collect(),
        false => in_parallel(&all, one).into_iter().flatten().collect(),
    }
}

/// Weighs all descriptions of the noise by their restricted likelihood, for rows in order.
pub(super) fn noise(gaps: &Gaps, columns: &Mat<f64>, rows: &[f64]) -> Noise {
    let columns = independent(columns);
    let degrees = rows.len().saturating_sub(columns.ncols());
    let sigma = |theta: Theta| likelihood(theta, gaps, &columns, rows);
    let Some((_, white_sigma)) = sigma(Theta::WHITE) else { return Noise { degrees, ..Noise::white() } };
    if degrees < FEWEST {
        return Noise { sigma: white_sigma, degrees, ..Noise::white() };
    }
    let all = of_each(rows.len() * columns.ncols(), sigma);
    let all: Vec<(Theta, f64, f64)> =
        all.into_iter().map(|(theta, prior, (value, sigma))| (theta, value + prior, sigma)).collect();
    let most = all.iter().map(|(_, value, _)| *value).fold(f64::NEG_INFINITY, f64::max);
    let total: f64 = all.iter().map(|(_, value, _)| (value - most).exp()).sum();
    // The likeliest: what is nearly white is fitted as white, which costs little and hangs on no detail of the noise.
    let chosen = all.iter().copied().fold(all[0], |a, b| if b.1 > a.1 { b } else { a });
    let weighed = all.iter().map(|(theta, value, _)| Weighed { theta: *theta, weight: (value - most).exp() / total });
    let mut weighed: Vec<Weighed> = weighed.filter(|w| w.weight > NEGLIGIBLE).collect();
    let kept: f64 = weighed.iter().map(|w| w.weight).sum();
    weighed.iter_mut().for_each(|w| w.weight /= kept);
    weighed.sort_by(|a, b| a.theta.neighbours().total_cmp(&b.theta.neighbours()));
    Noise { theta: chosen.0, sigma: chosen.2, weighed, degrees }
}

/// Restricted log likelihood, and the deviation that makes it largest.
fn likelihood(theta: Theta, gaps: &Gaps, columns: &Mat<f64>, rows: &[f64]) -> Option<(f64, f64)> {
    if rows.len() <= columns.ncols() {
        return None;
    }
    let prior = Mat::zeros(columns.ncols(), columns.ncols());
    let fitted = Fitted {
        design: columns.as_ref(),
        residuals: rows,
        weights: &vec![1.0; rows.len()],
        prior: prior.as_ref(),
        improper: columns.ncols(),
    };
    let found = fitted.restricted(gaps.filter(theta).0.as_ref())?;
    Some((-0.5 * found.minus_two_log, found.noise_factor.sqrt()))
}

/// Gain of twice the log likelihood by further columns, all descriptions of the noise weighed on either side, and the number of
/// directions in which they are new.
pub(super) fn gain(gaps: &Gaps, base: &Mat<f64>, further: &Mat<f64>, rows: &[f64]) -> (f64, usize) {
    let mut both = Mat::zeros(base.nrows(), base.ncols() + further.ncols());
    both.as_mut().subcols_mut(0, base.ncols()).copy_from(base);
    both.as_mut().subcols_mut(base.ncols(), further.ncols()).copy_from(further);
    let (base, both) = (independent(base), independent(&both));
    let new = both.ncols().saturating_sub(base.ncols());
    if new == 0 || rows.len() <= both.ncols() {
        return (0.0, new);
    }
    // The base as combinations of all, so that only all are whitened.
    let inside = both.transpose() * &base;
    let values = of_each(rows.len() * both.ncols(), |theta| Some(profiles(theta, gaps, &both, &inside, rows)));
    let weighed = |of: fn(&Pair) -> Option<f64>| {
        let values: Vec<f64> = values.iter().filter_map(|(_, prior, pair)| Some(of(pair)? + prior)).collect();
        let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        most + values.iter().map(|value| (value - most).exp()).sum::<f64>().ln()
    };
    let gain = 2.0 * (weighed(|pair| pair.1) - weighed(|pair| pair.0));
    // Bartlett's factor: what few rows make too large.
    (gain.max(0.0) * (rows.len() - both.ncols()) as f64 / rows.len() as f64, new)
}

/// Log likelihoods beside some columns and beside more, where there are any.
type Pair = (Option<f64>, Option<f64>);

/// Log likelihood with the deviation at its best; not restricted, so that different columns can be compared: beside the
/// combinations `inside` of the columns, and beside all of them.
fn profiles(theta: Theta, gaps: &Gaps, columns: &Mat<f64>, inside: &Mat<f64>, rows: &[f64]) -> Pair {
    let filter = gaps.filter(theta);
    let before: f64 = rows.iter().map(|r| r * r).sum();
    let rows = filter.whitened(crate::linear::column(rows));
    let columns = filter.whitened(columns.clone());
    let (gram, right) = (columns.transpose() * &columns, columns.transpose() * &rows);
    let value = |gram: &Mat<f64>, right: &Mat<f64>| {
        let solved = Llt::new(gram.as_ref(), Side::Lower).ok()?.solve(right);
        let left = (rows.squared_norm_l2() - (right.transpose() * &solved)[(0, 0)]).max(1e-24 * before);
        let value = -0.5 * (rows.nrows() as f64 * left.max(f64::MIN_POSITIVE).ln() + filter.log_determinant());
        value.is_finite().then_some(value)
    };
    let (own, own_right) = (inside.transpose() * &gram * inside, inside.transpose() * &right);
    (value(&own, &own_right), value(&gram, &right))
}

/// Orthonormal combinations of the columns, without what depends on the others.
pub(super) fn independent(columns: &Mat<f64>) -> Mat<f64> {
    let count = columns.ncols();
    if count == 0 {
        return columns.clone();
    }
    let gram = columns.transpose() * columns;
    let scale: Vec<f64> =
        (0..count).map(|k| if gram[(k, k)] > 0.0 { gram[(k, k)].sqrt().recip() } else { 0.0 }).collect();
    let equal = Mat::from_fn(count, count, |i, j| gram[(i, j)] * scale[i] * scale[j]);
    let Some((values, vectors)) = symmetric_eigen(&equal) else { return Mat::zeros(columns.nrows(), 0) };
    let kept: Vec<usize> = (0..count).filter(|k| values[*k] > 1e-9).collect();
    let map = Mat::from_fn(count, kept.len(), |i, j| vectors[(i, kept[j])] * scale[i] / values[kept[j]].sqrt());
    columns * &map
}

/// What the columns leave of each column of values.
pub(super) fn left_by(columns: &Mat<f64>, values: &Mat<f64>) -> Mat<f64> {
    let basis = independent(columns);
    values - &basis * (basis.transpose() * values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::normal;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    /// Noise of 400 rows, beside a straight line.
    fn of_rows(rho: f64, seed: u64) -> Noise {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        let (mut state, count) = (normal(&mut generator), 400);
        let rows: Vec<f64> = (0..count)
            .map(|k| {
                state = rho * state + (1.0 - rho * rho).sqrt() * normal(&mut generator);
                5.0 + 0.02 * k as f64 + 2.0 * state
            })
            .collect();
        let trend = Mat::from_fn(count, 2, |k, j| if j == 0 { 1.0 } else { k as f64 });
        noise(&Gaps::new(vec![1.0; count]), &trend, &rows)
    }

    #[test]
    fn the_correlation_of_rows_is_found_beside_a_trend() {
        // Steps of the grid: how far an end of an interval may be off for that.
        const STEP: f64 = 0.05;
        for (rho, low, high) in [(0.0_f64, 0.0, 0.15), (0.5, 0.35, 0.65), (0.9, 0.8, 0.96)] {
            let found: Vec<Noise> = (0..20).map(|seed| of_rows(rho, seed)).collect();
            let middle: Vec<f64> = found.iter().map(|noise| noise.neighbours_at(0.5)).collect();
            let near = middle.iter().filter(|value| (low..=high).contains(*value)).count();
            assert!(near >= 18, "{rho}: {middle:?}");
            let holds =
                |noise: &&Noise| noise.neighbours_at(0.025) <= rho + STEP && rho <= noise.neighbours_at(0.975) + STEP;
            assert!(found.iter().filter(holds).count() >= 18, "{rho}");
            // A record of slow noise shows its deviation poorly: the middle one of twenty.
            let mut sigmas: Vec<f64> = found.iter().map(|noise| noise.sigma / 2.0).collect();
            sigmas.sort_by(f64::total_cmp);
            assert!((sigmas[10] - 1.0).abs() < 0.2, "{rho}: {sigmas:?}");
        }
    }
}
