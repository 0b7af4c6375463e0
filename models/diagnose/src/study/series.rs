//! Noise that hangs together in the order of measurement: its model, its likelihood, and columns freed of it.
//!
//! Place in the flow: every study whitens the rows of one axis or component here. Model: unit variance of which a share
//! is slow, e^(-gap) correlated (an autoregression of first order, sampled at any gaps), the rest white; gaps in steps
//! between neighbours. Restricted likelihood (Patterson & Thompson 1971): the fit's own columns are projected out, so
//! that a rich model does not make the correlation look smaller. Whitening by the innovations of the Kalman filter
//! (Harvey 1989, 3.4), linear in the rows. No units.

use abbe_identify::symmetric_eigen;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};

/// Correlations over one step and slow shares that are weighed against each other.
const RHO: [f64; 9] = [0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 0.98, 0.995];
const SHARE: [f64; 4] = [0.25, 0.5, 0.75, 1.0];
/// Degrees of freedom below which a correlation cannot be estimated.
const FEWEST: usize = 10;
/// Log likelihood by which correlated noise must beat white noise to be taken as the best description.
const BETTER: f64 = 1.0;
/// Weight below which a description of the noise is left out.
const NEGLIGIBLE: f64 = 1e-5;
/// Shortest gap, in steps: rows of one instant are two readings all the same.
const SHORTEST: f64 = 0.05;

/// How noise hangs together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Theta {
    /// Correlation of the slow part over one step.
    pub(super) rho: f64,
    /// Share of the variance that is slow.
    pub(super) share: f64,
}

impl Theta {
    pub(super) const WHITE: Theta = Theta { rho: 0.0, share: 0.0 };

    /// Correlation of neighbouring rows.
    pub(super) fn neighbours(self) -> f64 {
        self.rho * self.share
    }
}

/// The filter that frees columns of correlation.
#[derive(Debug, Clone)]
pub(super) struct Filter {
    decay: Vec<f64>,
    gain: Vec<f64>,
    /// 1 over the deviation of each innovation.
    weight: Vec<f64>,
    log_det: f64,
}

impl Filter {
    /// For rows in order, each with the steps since the one before (the first is not read).
    pub(super) fn new(theta: Theta, gaps: &[f64]) -> Filter {
        let mut filter = Filter { decay: Vec::new(), gain: Vec::new(), weight: Vec::new(), log_det: 0.0 };
        let mut after = 0.0;
        for (k, gap) in gaps.iter().enumerate() {
            let decay = if k == 0 { 0.0 } else { theta.rho.powf(gap.max(SHORTEST)) };
            let slow = decay * decay * after + theta.share * (1.0 - decay * decay);
            let variance = slow + 1.0 - theta.share;
            let gain = slow / variance;
            after = slow * (1.0 - gain);
            filter.decay.push(decay);
            filter.gain.push(gain);
            filter.weight.push(variance.sqrt().recip());
            filter.log_det += variance.ln();
        }
        filter
    }

    /// Innovations over their deviation, in place.
    pub(super) fn whiten(&self, column: &mut [f64]) {
        let mut state = 0.0;
        for (k, value) in column.iter_mut().enumerate() {
            let expected = self.decay[k] * state;
            let innovation = *value - expected;
            state = expected + self.gain[k] * innovation;
            *value = innovation * self.weight[k];
        }
    }

    /// The same for every column.
    pub(super) fn whitened(&self, mut columns: Mat<f64>) -> Mat<f64> {
        for column in columns.col_iter_mut() {
            if let Some(slice) = column.try_as_col_major_mut() {
                self.whiten(slice.as_slice_mut());
            }
        }
        columns
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

/// Weighs all descriptions of the noise by their restricted likelihood, for rows in order.
pub(super) fn noise(gaps: &[f64], columns: &Mat<f64>, rows: &[f64]) -> Noise {
    let columns = independent(columns);
    let degrees = rows.len().saturating_sub(columns.ncols());
    let sigma = |theta: Theta| likelihood(theta, gaps, &columns, rows);
    let Some((white, white_sigma)) = sigma(Theta::WHITE) else { return Noise { degrees, ..Noise::white() } };
    if degrees < FEWEST {
        return Noise { sigma: white_sigma, degrees, ..Noise::white() };
    }
    let mut all = vec![(Theta::WHITE, white, white_sigma)];
    for share in SHARE {
        for rho in RHO {
            let theta = Theta { rho, share };
            all.extend(sigma(theta).map(|(value, sigma)| (theta, value, sigma)));
        }
    }
    let best = all.iter().copied().fold(all[0], |a, b| if b.1 > a.1 { b } else { a });
    let chosen = if best.1 - white < BETTER { all[0] } else { best };
    let total: f64 = all.iter().map(|(_, value, _)| (value - best.1).exp()).sum();
    let weighed = all.iter().map(|(theta, value, _)| Weighed { theta: *theta, weight: (value - best.1).exp() / total });
    let mut weighed: Vec<Weighed> = weighed.filter(|w| w.weight > NEGLIGIBLE).collect();
    let kept: f64 = weighed.iter().map(|w| w.weight).sum();
    weighed.iter_mut().for_each(|w| w.weight /= kept);
    weighed.sort_by(|a, b| a.theta.neighbours().total_cmp(&b.theta.neighbours()));
    Noise { theta: chosen.0, sigma: chosen.2, weighed, degrees }
}

/// Restricted log likelihood, and the deviation that makes it largest.
fn likelihood(theta: Theta, gaps: &[f64], columns: &Mat<f64>, rows: &[f64]) -> Option<(f64, f64)> {
    let filter = Filter::new(theta, gaps);
    let columns = filter.whitened(columns.clone());
    let mut rows = rows.to_vec();
    let before: f64 = rows.iter().map(|r| r * r).sum();
    filter.whiten(&mut rows);
    let degrees = rows.len() as f64 - columns.ncols() as f64;
    let all: f64 = rows.iter().map(|r| r * r).sum();
    let (left, log_gram) = match columns.ncols() {
        0 => (all, 0.0),
        count => {
            let gram = columns.transpose() * &columns;
            let llt = Llt::new(gram.as_ref(), Side::Lower).ok()?;
            let right = columns.transpose() * crate::linear::column(&rows);
            let solved = llt.solve(&right);
            let explained: f64 = (0..count).map(|k| solved[(k, 0)] * right[(k, 0)]).sum();
            let factor = llt.L();
            (all - explained, (0..count).map(|k| 2.0 * factor[(k, k)].ln()).sum())
        }
    };
    if degrees < 1.0 {
        return None;
    }
    // What rounding leaves of data without any noise.
    let variance = (left / degrees).max(1e-24 * before).max(f64::MIN_POSITIVE);
    Some((-0.5 * (filter.log_det + log_gram + degrees * variance.ln()), variance.sqrt()))
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

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn normal(generator: &mut ChaCha8Rng) -> f64 {
        let (a, b): (f64, f64) = (generator.random(), generator.random());
        (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    }

    /// Covariance of the model written out.
    fn covariance(theta: Theta, gaps: &[f64]) -> Mat<f64> {
        let at = |k: usize| gaps[..=k].iter().sum::<f64>();
        Mat::from_fn(gaps.len(), gaps.len(), |i, j| {
            let slow = theta.share * theta.rho.powf((at(i) - at(j)).abs());
            if i == j { 1.0 } else { slow }
        })
    }

    #[test]
    fn innovations_are_white_and_their_variances_make_the_determinant() {
        let gaps = [1.0, 1.0, 0.4, 3.0, 1.0, 2.0];
        for theta in [Theta { rho: 0.9, share: 1.0 }, Theta { rho: 0.7, share: 0.4 }, Theta::WHITE] {
            let filter = Filter::new(theta, &gaps);
            let whitener = filter.whitened(Mat::identity(gaps.len(), gaps.len()));
            let product = &whitener * covariance(theta, &gaps) * whitener.transpose();
            for i in 0..gaps.len() {
                for j in 0..gaps.len() {
                    assert!((product[(i, j)] - f64::from(u8::from(i == j))).abs() < 1e-12, "{product:?}");
                }
            }
            let determinant = covariance(theta, &gaps).determinant();
            assert!((filter.log_det - determinant.ln()).abs() < 1e-12);
        }
    }

    #[test]
    fn the_correlation_of_rows_is_found_beside_a_trend() {
        for (rho, low, high) in [(0.0_f64, 0.0, 0.15), (0.5, 0.35, 0.65), (0.9, 0.8, 0.96)] {
            let mut generator = ChaCha8Rng::seed_from_u64(3);
            let (mut state, count) = (normal(&mut generator), 400);
            let rows: Vec<f64> = (0..count)
                .map(|k| {
                    state = rho * state + (1.0 - rho * rho).sqrt() * normal(&mut generator);
                    5.0 + 0.02 * k as f64 + 2.0 * state
                })
                .collect();
            let trend = Mat::from_fn(count, 2, |k, j| if j == 0 { 1.0 } else { k as f64 });
            let found = noise(&vec![1.0; count], &trend, &rows);
            let (least, middle, most) =
                (found.neighbours_at(0.025), found.neighbours_at(0.5), found.neighbours_at(0.975));
            assert!(
                (low..=high).contains(&middle) && least <= rho && rho <= most + 0.1,
                "{rho}: {least} {middle} {most}"
            );
            assert!((found.sigma / 2.0 - 1.0).abs() < 0.35, "{rho}: {}", found.sigma);
        }
    }
}
