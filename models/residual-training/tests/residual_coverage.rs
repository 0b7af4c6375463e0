//! Do 95 % intervals hold 95 % in regions where nothing was measured?
//!
//! Place in the flow: simulated residuals of every character; a fifth of the volume, in blocks, is kept from the training
//! altogether and predicted by the model that comes out. What counts is the measured value within ±1.96 deviations of field
//! and measurement, and the share over all fields and seeds.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)] // a preparation that fails fails its test

use abbe_residual_net::NORMAL_95;
use abbe_residual_training::simulated::{Character, SimulatedField, random_points_m};
use abbe_residual_training::{Config, Go, Method, Split, folds, train};

/// Measured points of a field.
const POINTS: usize = 320;
/// Seeds of kriging, which is quick, and of the networks.
const SEEDS: u64 = 6;
const NETWORK_SEEDS: u64 = 1;
/// What is asked for: 95 ± 3 %.
const TOLERANCE: f64 = 0.03;
/// A single seed a character holds a third of the points of kriging's test, in blocks that err together.
const NETWORK_TOLERANCE: f64 = 0.05;

/// Components of held-out points within their interval, and all of them.
fn within(character: Character, method: Method, seed: u64) -> (usize, usize) {
    let points = random_points_m(POINTS, 10 + seed);
    let field = SimulatedField::new(character, 40 + seed).measured(points, 70 + seed).unwrap();
    let split = Split { blocks_per_axis: 3, ..Split::default() };
    let fold = folds(field.points_m(), &split, 100 + seed);
    let of = |held: bool| (0..POINTS).filter(|k| (fold[*k] == 0) == held).collect::<Vec<_>>();
    let mut config = Config { method, seed, split, ..Config::default() };
    config.network.width = 16;
    config.optimiser.epochs = 10;
    config.optimiser.learning_rate = 5e-3;
    let model = train(&field.part(&of(false)).unwrap(), &config, None, &mut |_| Go::On).unwrap().model;
    let scale = model.parts().calibration.scale;
    let mut within = 0;
    for k in of(true) {
        let predicted = model.predict(&field.points_m()[k]);
        let noise_m2 = model.parts().kriging.components.each_ref().map(|c| c.noise_m * c.noise_m);
        for axis in 0..3 {
            let variance = predicted.covariance_m2[(axis, axis)] + noise_m2[axis] * scale[axis] * scale[axis];
            let error = predicted.residual_m[axis] - field.errors_m()[k][axis];
            within += usize::from(error.abs() <= NORMAL_95 * variance.sqrt());
        }
    }
    (within, 3 * of(true).len())
}

fn share(method: Method, seeds: u64) -> f64 {
    let (mut held, mut all) = (0, 0);
    for character in Character::ALL {
        let (mut own, mut of) = (0, 0);
        for seed in 0..seeds {
            let (within, components) = within(character, method, seed);
            own += within;
            of += components;
        }
        println!("{method:?} {}: {:.3} of {of}", character.name(), own as f64 / of as f64);
        held += own;
        all += of;
    }
    held as f64 / all as f64
}

#[test]
fn intervals_of_95_percent_hold_95_percent_in_blocks_that_were_held_out() {
    let share = share(Method::Kriging, SEEDS);
    assert!((share - 0.95).abs() <= TOLERANCE, "{share}");
}

#[test]
fn intervals_of_networks_hold_95_percent_in_blocks_that_were_held_out() {
    for method in [Method::Network, Method::KrigingNetwork, Method::PerceptronKriging] {
        let share = share(method, NETWORK_SEEDS);
        assert!((share - 0.95).abs() <= NETWORK_TOLERANCE, "{method:?}: {share}");
    }
}
