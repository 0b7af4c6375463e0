//! Parameters that few points leave open: a sample of all that explain them.
//!
//! Place in the flow: from the likeliest parameters of a component to members of about equal weight, over which
//! [`super::averaged`] averages. Importance sampling, twice: first about the maximum with the curvature there, then about the mean
//! and covariance of what that found, both with Student's t, whose tails reach where the posterior is not normal. What is
//! drawn is thinned systematically. Seeded: the same points give the same members.
//! Source: Robert & Casella 2004, Monte Carlo Statistical Methods, ch. 14.3 (population Monte Carlo).

use super::likelihood::{Data, Scaled};
use super::prior;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{ChiSquared, Distribution, StandardNormal};

/// Draws of each of the two rounds.
const DRAWS: usize = 256;
/// Members that stand for all draws.
const MEMBERS: usize = 32;
/// Degrees of freedom of the density drawn from: tails heavy enough for any posterior here.
const FREEDOM: f64 = 4.0;
/// Step of the logarithms by which the gradient is differenced.
const STEP: f64 = 0.03;
/// Least curvature of half −2 ln: a deviation of two in the logarithm, wider than the prior.
const LEAST_CURVATURE: f64 = 0.25;
/// Least variance of a logarithm in the second round.
const LEAST_VARIANCE: f64 = 1e-4;
const SEED: u64 = 20_040_914;

/// A set of parameters and its share.
pub(super) type Member = (Scaled, f64);

/// −2 ln of the posterior density, without constants, and its gradient.
pub(super) fn minus_two_log(data: &Data, logarithms: &[f64]) -> Option<(f64, Vec<f64>)> {
    let (value, gradient) = data.minus_two_log(logarithms).ok()?;
    let (more, slopes) = prior::minus_two_log(logarithms, data.size);
    Some((value + more, gradient.iter().zip(slopes).map(|(a, b)| a + b).collect()))
}

/// Members about the likeliest logarithms; that one alone where nothing else can be evaluated.
pub(super) fn members(data: &Data, likeliest: &[f64], bounds: &[(f64, f64)]) -> Vec<Member> {
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut about = About::maximum(data, likeliest, bounds);
    let mut drawn = Vec::new();
    for _ in 0..2 {
        drawn = about.draw(data, bounds, &mut random);
        match About::moments(&drawn) {
            Some(next) => about = next,
            None => break,
        }
    }
    let thinned = thinned(&drawn, data.size);
    if thinned.is_empty() { vec![(Scaled::from_logarithms(likeliest, data.size), 1.0)] } else { thinned }
}

/// A draw and its weight, which sum to one.
type Drawn = (DVector<f64>, f64);

/// Density that is drawn from.
struct About {
    middle: DVector<f64>,
    /// Square root of the covariance.
    root: DMatrix<f64>,
}

impl About {
    fn maximum(data: &Data, likeliest: &[f64], bounds: &[(f64, f64)]) -> About {
        let size = likeliest.len();
        let slope = |k: usize, by: f64| {
            let mut there = likeliest.to_vec();
            there[k] = (there[k] + by).clamp(bounds[k].0, bounds[k].1);
            let moved = there[k];
            minus_two_log(data, &there).map(|(_, gradient)| (moved, gradient))
        };
        let mut curvature = DMatrix::identity(size, size) * LEAST_CURVATURE;
        for k in 0..size {
            let (Some((low, below)), Some((high, above))) = (slope(k, -STEP), slope(k, STEP)) else { continue };
            for j in 0..size {
                // Half −2 ln is what a normal density has the inverse covariance of.
                curvature[(k, j)] = 0.5 * (above[j] - below[j]) / (high - low);
            }
        }
        let symmetric = (&curvature + curvature.transpose()) * 0.5;
        let eigen = SymmetricEigen::new(symmetric);
        let deviations = eigen.eigenvalues.map(|value| value.max(LEAST_CURVATURE).sqrt().recip());
        About {
            middle: DVector::from_column_slice(likeliest),
            root: &eigen.eigenvectors * DMatrix::from_diagonal(&deviations),
        }
    }

    /// Mean and covariance of draws; `None` where there are none.
    fn moments(drawn: &[Drawn]) -> Option<About> {
        let size = drawn.first()?.0.len();
        let middle: DVector<f64> = drawn.iter().map(|(at, weight)| at * *weight).sum();
        let mut covariance = DMatrix::identity(size, size) * LEAST_VARIANCE;
        for (at, weight) in drawn {
            let off = at - &middle;
            covariance += &off * off.transpose() * *weight;
        }
        let eigen = SymmetricEigen::new(covariance);
        let deviations = eigen.eigenvalues.map(|value| value.max(LEAST_VARIANCE).sqrt());
        Some(About { middle, root: &eigen.eigenvectors * DMatrix::from_diagonal(&deviations) })
    }

    fn draw(&self, data: &Data, bounds: &[(f64, f64)], random: &mut ChaCha8Rng) -> Vec<Drawn> {
        let size = self.middle.len();
        let Ok(chi_squared) = ChiSquared::new(FREEDOM) else { return Vec::new() };
        let mut drawn = Vec::new();
        for _ in 0..DRAWS {
            let white = DVector::from_fn(size, |_, _| StandardNormal.sample(random));
            let stretch = (chi_squared.sample(random) / FREEDOM).sqrt().recip();
            let white: DVector<f64> = white * stretch;
            let at = &self.middle + &self.root * &white;
            let is_within = at.iter().zip(bounds).all(|(v, (lower, upper))| v >= lower && v <= upper);
            // Beyond the bounds, and where a covariance cannot be factored, there is no field.
            let Some(posterior) = is_within.then(|| value(data, at.as_slice())).flatten() else { continue };
            let density = -0.5 * (FREEDOM + size as f64) * (1.0 + white.norm_squared() / FREEDOM).ln();
            drawn.push((at, -0.5 * posterior - density));
        }
        let most = drawn.iter().fold(f64::NEG_INFINITY, |most, (_, log)| most.max(*log));
        let sum: f64 = drawn.iter().map(|(_, log)| (log - most).exp()).sum();
        drawn.into_iter().map(|(at, log)| (at, (log - most).exp() / sum)).collect()
    }
}

fn value(data: &Data, logarithms: &[f64]) -> Option<f64> {
    let factored = data.factored(&Scaled::from_logarithms(logarithms, data.size)).ok()?;
    Some(factored.minus_two_log + prior::minus_two_log(logarithms, data.size).0)
}

/// Every draw as often as its weight is passed by even steps.
fn thinned(drawn: &[Drawn], size: usize) -> Vec<Member> {
    let mut members = Vec::new();
    let (mut sum, mut passed) = (0.0, 0);
    for (at, weight) in drawn {
        sum += weight * MEMBERS as f64;
        let times = (passed..MEMBERS).take_while(|step| *step as f64 + 0.5 < sum).count();
        passed += times;
        if times > 0 {
            members.push((Scaled::from_logarithms(at.as_slice(), size), times as f64));
        }
    }
    members.into_iter().map(|(scaled, times)| (scaled, times / passed as f64)).collect()
}
