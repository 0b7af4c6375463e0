//! The 95 % intervals of corrected coordinates hold 95 % of the truth.
//!
//! Place in the flow: many simulated machines, each with a campaign of its own, are identified; the corrected
//! coordinates of random points are compared with where the reflector really was, in the machine frame. Points of
//! one machine share its frame and its error functions, so machines, not points, make the statistics.

#![allow(clippy::unwrap_used, clippy::panic)] // a preparation that fails fails its test

mod common;

use abbe_geometry::{Matrix3, Vector3};
use abbe_identify::Options;
use abbe_virtual_machine::TruthRecipe;
use common::{Case, INSTRUMENT, SPLINE};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Machines: the share covered by one varies by 4 %, so that the mean of 80 is known to 0.5 %.
const MACHINES: u64 = 120;
/// Points of each machine.
const POINTS: usize = 150;
/// Quantile of the normal distribution for 95 %.
const QUANTILE: f64 = 1.96;

/// Share of the coordinates inside their interval, by axis.
#[derive(Debug, Clone, Copy, Default)]
struct Covered {
    /// Where the reflector went, repeatability included: what a user of the machine sees.
    one_reading: [f64; 3],
    /// Where it goes on average, without repeatability in the interval: the model's own uncertainty.
    model_alone: [f64; 3],
    /// Mean square of the model's error in units of its uncertainty.
    model_square: [f64; 3],
}

fn covered(seed: u64) -> Covered {
    let truth = TruthRecipe { seed, ..TruthRecipe::default() }.bridge_xyz().unwrap();
    let case = Case::case_like(truth, SPLINE, seed + 500);
    let found = case.identify(&Options::default());
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut generator) };
    let mut share = Covered::default();
    let repeatability = Vector3::from(INSTRUMENT.repeatability_m);
    for (error_m, correction) in case.verify(&found.model, POINTS) {
        let full = correction.covariance_m2.unwrap();
        let model = full - Matrix3::from_diagonal(&repeatability.component_mul(&repeatability));
        let stopped_m = repeatability.component_mul(&Vector3::from_fn(|_, _| normal()));
        for d in 0..3 {
            let inside = |error_m: f64, variance: f64| f64::from(error_m.abs() <= QUANTILE * variance.sqrt());
            share.one_reading[d] += inside(error_m[d] - stopped_m[d], full[(d, d)]) / POINTS as f64;
            share.model_alone[d] += inside(error_m[d], model[(d, d)]) / POINTS as f64;
            share.model_square[d] += error_m[d].powi(2) / model[(d, d)] / POINTS as f64;
        }
    }
    share
}

/// Runs all machines on the threads there are; the order of the results is that of the seeds.
fn all_machines() -> Vec<Covered> {
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get()) as u64;
    let mut results: Vec<(u64, Covered)> = std::thread::scope(|scope| {
        let work =
            |first: u64| (first..=MACHINES).step_by(threads as usize).map(|seed| (seed, covered(seed))).collect();
        let handles: Vec<_> = (1..=threads).map(|first| scope.spawn(move || -> Vec<_> { work(first) })).collect();
        handles.into_iter().flat_map(|handle| handle.join().unwrap()).collect()
    });
    results.sort_by_key(|(seed, _)| *seed);
    results.into_iter().map(|(_, covered)| covered).collect()
}

/// Mean and standard deviation of the mean.
fn mean(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    (mean, (values.map(|v| (v - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt())
}

#[test]
fn the_95_per_cent_intervals_hold_95_per_cent_of_the_points_in_each_axis() {
    let all = all_machines();
    let mut shares = Vec::new();
    for d in 0..3 {
        let (seen, u_seen) = mean(all.iter().map(|c| c.one_reading[d]));
        let (alone, u_alone) = mean(all.iter().map(|c| c.model_alone[d]));
        let (square, u_square) = mean(all.iter().map(|c| c.model_square[d]));
        let axis = ['X', 'Y', 'Z'][d];
        println!(
            "{axis}: one reading {:.1} ± {:.1} %, model alone {:.1} ± {:.1} %, mean square {square:.2} ± {u_square:.2}",
            seen * 1e2,
            u_seen * 1e2,
            alone * 1e2,
            u_alone * 1e2
        );
        shares.push((axis, seen, alone));
    }
    for (axis, seen, alone) in shares {
        assert!((seen - 0.95).abs() <= 0.02, "{axis}: {seen:.4} of one reading's points");
        assert!((alone - 0.95).abs() <= 0.02, "{axis}: {alone:.4} of the model's points");
    }
}
