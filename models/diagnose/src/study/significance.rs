//! How probable an effect is by chance when neither the size of the noise nor its correlation is known.
//!
//! Place in the flow: the gate of the search, and the intervals of what it finds. Given a correlation the F test of the
//! generalised least-squares fit is exact for Gaussian noise, with as few blocks as one likes. What the correlation may be
//! is weighed by its restricted likelihood, and probabilities and variances are means over it (as posterior predictive
//! ones are, Meng 1994): where few rows leave a slow drift of the noise open, a slow effect has to beat it. That judges by the
//! noise of the fit without the effect, which for a drift of many times the scatter is slow because it holds the drift. So
//! both sides are also compared with all descriptions of the noise weighed on each: a straight line with white scatter is far
//! likelier than slow noise that happens to go straight. The ratio of likelihoods counts with a reserve, since slow noise
//! makes it larger than χ². The lesser of the two probabilities is taken.

use super::fit::Fit;
use super::series::{Filter, Theta, gain, independent};
use super::together::score_together;
use super::view::View;
use crate::error::DiagnoseError;
use crate::linear::{Linear, joined, picked};
use crate::score::{score, score_of};
use abbe_identify::in_parallel;
use abbe_measurement::chance::beyond;
use faer::Mat;
use statrs::distribution::ChiSquared;
use std::borrow::Cow;

/// Combinations drawn where several chains, each with its own correlation, take part.
const DRAWS: usize = 24;

/// Reserve on twice the log ratio of likelihoods.
const INFLATED: f64 = 1.6;

/// A description of the noise of some chains, with its weight.
type Draw = (Vec<Theta>, f64);

/// Probability that columns (not whitened) explain as much by chance.
pub(super) fn probability(view: &View, fit: &Fit, columns: &Mat<f64>) -> Result<f64, DiagnoseError> {
    probability_beside(view, fit, &Mat::zeros(columns.nrows(), 0), columns)
}

/// The same where a fit has further columns (not whitened).
pub(super) fn probability_beside(
    view: &View,
    fit: &Fit,
    further: &Mat<f64>,
    columns: &Mat<f64>,
) -> Result<f64, DiagnoseError> {
    let chains = view.touched(columns);
    if view.chains().is_empty() {
        if further.ncols() == 0 {
            return Ok(fit.score_columns(view, columns).0.p_value);
        }
        let beside = fit.with_columns(view.whitened(further).as_ref())?;
        let projected = beside.project(view.whitened(columns).as_ref());
        return Ok(score(&projected, beside.chi2(), beside.degrees()).p_value);
    }
    let own = |matrix: &Mat<f64>| -> Vec<Mat<f64>> { chains.iter().map(|k| of_chain(view, *k, matrix)).collect() };
    let rows = Mat::from_fn(fit.raw_residuals.len(), 1, |i, _| fit.raw_residuals[i]);
    let (base, rows, columns) = (own(&joined(&[fit.raw_columns.clone(), further.clone()])), own(&rows), own(columns));
    let mut first = 0;
    let mut next = |part: &Mat<f64>| {
        first += part.nrows();
        (first - part.nrows()..first).collect::<Vec<usize>>()
    };
    let each: Vec<Vec<usize>> = rows.iter().map(&mut next).collect();
    let one = |(thetas, weight): &Draw| {
        let filter =
            |(k, theta): (&usize, &Theta)| (view.chains()[*k].gaps.filter(*theta), view.chains()[*k].noise.sigma);
        let filters: Vec<(Cow<Filter>, f64)> = chains.iter().zip(thetas).map(filter).collect();
        let whiten = |parts: &[Mat<f64>]| stacked(parts, &filters);
        let base = independent(&whiten(&base));
        let rows = whiten(&rows);
        let linear = match base.ncols() {
            0 => return Err(DiagnoseError::Singular),
            _ => Linear::least_squares(base, rows.col_as_slice(0))?.0,
        };
        let columns = whiten(&columns);
        let found = match chains.len() {
            1 => score_of(&linear, columns.as_ref()),
            _ => score_together(&linear, &each, &columns),
        };
        Ok(weight * found.p_value)
    };
    let sum = in_parallel(&draws(view, &chains), one).into_iter().sum::<Result<f64, DiagnoseError>>()?;
    let mut by_likelihood = (0.0, 0);
    for (k, ((base, rows), columns)) in chains.iter().zip(base.iter().zip(&rows).zip(&columns)) {
        let observed: Vec<f64> = (0..rows.nrows()).map(|i| rows[(i, 0)]).collect();
        let (gain, new) = gain(&view.chains()[*k].gaps, base, columns, &observed);
        by_likelihood = (by_likelihood.0 + gain, by_likelihood.1 + new);
    }
    let (gain, new) = by_likelihood;
    let p_value = ChiSquared::new(new.max(1) as f64).map_or(1.0, |chi2| beyond(&chi2, gain / INFLATED));
    Ok(sum.min(p_value).min(1.0))
}

/// Standard uncertainties of all parameters of a fit, with what the noise's correlation leaves open.
pub(super) fn uncertainties(view: &mut View, fit: &Fit) -> Result<Vec<Vec<f64>>, DiagnoseError> {
    let all: Vec<usize> = (0..view.chains().len()).collect();
    let own: Vec<Vec<f64>> = fit.added.iter().map(|fitted| fitted.u.clone()).collect();
    if all.is_empty() || !view.study.is_linear() {
        return Ok(own);
    }
    let set = fit.set();
    let kept = view.noises();
    let mut sums: Vec<Vec<f64>> = own.iter().map(|u| vec![0.0; u.len()]).collect();
    let mut problem = None;
    for (thetas, weight) in draws(view, &all) {
        for (k, theta) in thetas.iter().enumerate() {
            view.set_noise(k, super::series::Noise { theta: *theta, ..kept[k].clone() });
        }
        match Fit::settle(view, &set) {
            Ok(drawn) => add_squares(&mut sums, fit, &drawn, weight),
            Err(error) => problem = Some(error),
        }
    }
    view.take_noises(kept);
    match problem {
        Some(error) => Err(error),
        None => Ok(sums.into_iter().map(|sum| sum.into_iter().map(f64::sqrt).collect()).collect()),
    }
}

fn add_squares(sums: &mut [Vec<f64>], fit: &Fit, drawn: &Fit, weight: f64) {
    for ((sum, drawn), own) in sums.iter_mut().zip(&drawn.added).zip(&fit.added) {
        for (j, sum) in sum.iter_mut().enumerate() {
            *sum += weight * (drawn.u[j].powi(2) + (drawn.values[j] - own.values[j]).powi(2));
        }
    }
}

/// All descriptions of one chain's noise; of several, combinations at equal steps of each one's distribution, in an order
/// of its own.
fn draws(view: &View, chains: &[usize]) -> Vec<Draw> {
    if let [one] = chains {
        return view.chains()[*one].noise.weighed.iter().map(|w| (vec![w.theta], w.weight)).collect();
    }
    let weighed = |k: &usize| &view.chains()[*k].noise.weighed;
    if chains.iter().all(|k| weighed(k).len() == 1) {
        return vec![(chains.iter().map(|k| weighed(k)[0].theta).collect(), 1.0)];
    }
    let draw = |n: usize| {
        let one = |(place, k): (usize, &usize)| at(weighed(k), ((n * STRIDES[place % STRIDES.len()]) % DRAWS) as f64);
        (chains.iter().enumerate().map(one).collect(), 1.0 / DRAWS as f64)
    };
    (0..DRAWS).map(draw).collect()
}

/// Strides without a common divisor with the number of draws.
const STRIDES: [usize; 6] = [1, 5, 7, 11, 13, 17];

fn at(weighed: &[super::series::Weighed], step: f64) -> Theta {
    let mut sum = 0.0;
    for w in weighed {
        sum += w.weight;
        if sum >= (step + 0.5) / DRAWS as f64 {
            return w.theta;
        }
    }
    weighed.last().map_or(Theta::WHITE, |w| w.theta)
}

fn of_chain(view: &View, chain: usize, matrix: &Mat<f64>) -> Mat<f64> {
    picked(matrix.as_ref(), &view.chains()[chain].rows)
}

fn stacked(parts: &[Mat<f64>], filters: &[(Cow<Filter>, f64)]) -> Mat<f64> {
    let rows = parts.iter().map(Mat::nrows).sum();
    let mut all = Mat::zeros(rows, parts.first().map_or(0, Mat::ncols));
    let mut first = 0;
    for (part, (filter, sigma)) in parts.iter().zip(filters) {
        let whitened = filter.whitened(part.clone());
        for j in 0..part.ncols() {
            let own = &mut all.col_as_slice_mut(j)[first..first + part.nrows()];
            own.iter_mut().zip(whitened.col_as_slice(j)).for_each(|(own, value)| *own = value / sigma);
        }
        first += part.nrows();
    }
    all
}
