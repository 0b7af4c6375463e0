//! Do 95 % intervals hold 95 % in regions where nothing was measured?
//!
//! Place in the flow: simulated residuals of every character; a fifth of the volume, in blocks, is kept from the training
//! altogether and predicted by the model that comes out. What counts is the measured value within ±1.96 of the deviations that
//! the model states, and the share over all fields and seeds. Networks take longer: of them the folds that training itself
//! holds out count as well, each with the factors found on the others, which is four times as many points.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)] // a preparation that fails fails its test

use abbe_residual_net::NORMAL_95;
use abbe_residual_training::simulated::{Character, SimulatedField, random_points_m};
use abbe_residual_training::{Config, Device, Go, Method, Split, folds, train};

/// Measured points of a field.
const POINTS: usize = 320;
/// Seeds of kriging, which is quick, and of the networks.
const SEEDS: u64 = 6;
const NETWORK_SEEDS: u64 = 1;
/// What is asked for: 95 ± 3 %.
const TOLERANCE: f64 = 0.03;
/// A single seed a character holds a sixth of the points of kriging's test, in blocks that err together. Over four seeds the
/// networks hold 96.1, 95.3 and 94.1 %.
const NETWORK_TOLERANCE: f64 = 0.05;

/// Of one field: components of points kept from the training within their interval, all of them, and the share within on the
/// folds that the training held out.
fn within(character: Character, method: Method, seed: u64) -> (usize, usize, f64) {
    let points = random_points_m(POINTS, 10 + seed);
    let field = SimulatedField::new(character, 40 + seed).measured(points, 70 + seed).unwrap();
    let split = Split { blocks_per_axis: 3, ..Split::default() };
    let fold = folds(field.points_m(), &split, 100 + seed);
    let of = |held: bool| (0..POINTS).filter(|k| (fold[*k] == 0) == held).collect::<Vec<_>>();
    let mut config = Config { method, seed, split, ..Config::default() };
    config.network.width = 16;
    config.optimiser.epochs = 10;
    config.optimiser.learning_rate = 5e-3;
    let trained = train(&field.part(&of(false)).unwrap(), &config, &Device::cpu(), None, &mut |_| Go::On).unwrap();
    let model = trained.model;
    let own = trained.record.held_out.iter().find(|held| held.method == model.kind().name()).unwrap();
    let mut within = 0;
    for k in of(true) {
        let predicted = model.predict(&field.points_m()[k]);
        for axis in 0..3 {
            let variance = predicted.covariance_m2[(axis, axis)];
            let error = predicted.residual_m[axis] - field.errors_m()[k][axis];
            within += usize::from(error.abs() <= NORMAL_95 * variance.sqrt());
        }
    }
    (within, 3 * of(true).len(), own.coverage_95.unwrap())
}

/// Share of kept points within their intervals, and of points on held-out folds.
fn shares(method: Method, seeds: u64) -> (f64, f64) {
    let (mut held, mut all, mut folds) = (0, 0, 0.0);
    for character in Character::ALL {
        let (mut own, mut of) = (0, 0);
        for seed in 0..seeds {
            let (within, components, on_folds) = within(character, method, seed);
            own += within;
            of += components;
            folds += on_folds / (seeds as f64 * Character::ALL.len() as f64);
        }
        println!("{method:?} {}: {:.3} of {of}", character.name(), own as f64 / of as f64);
        held += own;
        all += of;
    }
    (held as f64 / all as f64, folds)
}

#[test]
fn intervals_of_95_percent_hold_95_percent_in_blocks_that_were_held_out() {
    let (kept, folds) = shares(Method::Kriging, SEEDS);
    assert!((kept - 0.95).abs() <= TOLERANCE && (folds - 0.95).abs() <= TOLERANCE, "{kept} {folds}");
}

#[test]
fn intervals_of_networks_hold_95_percent_in_blocks_that_were_held_out() {
    for method in [Method::Network, Method::KrigingNetwork, Method::PerceptronKriging] {
        let (kept, folds) = shares(method, NETWORK_SEEDS);
        assert!((kept - 0.95).abs() <= NETWORK_TOLERANCE, "{method:?}: {kept}");
        assert!((folds - 0.95).abs() <= TOLERANCE, "{method:?} on folds: {folds}");
    }
}
