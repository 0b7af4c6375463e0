//! Do 95 % intervals hold 95 % in regions where nothing was measured?
//!
//! Place in the flow: simulated residuals of every character; a fifth of the volume, in blocks, is kept from the training
//! altogether and predicted by the model that comes out. What counts is the measured value within ±1.96 of the deviations that
//! the model states, and the share over all fields and seeds. Networks take longer: of them the folds that training itself
//! holds out count as well, each with the factors found on the others, which is four times as many points.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)] // a preparation that fails fails its test

use abbe_field::Samples;
use abbe_residual_net::NORMAL_95;
use abbe_residual_training::simulated::{Character, SimulatedField, random_points_m};
use abbe_residual_training::{Config, Device, Go, Method, Split, folds, train};

/// Measured points of a field.
const POINTS: usize = 320;
/// Seeds of kriging, which is quick, and of the networks.
const SEEDS: u64 = 3;
const NETWORK_SEEDS: u64 = 1;
/// First seed of fields with a further input, by which nothing was chosen, and their number: each is four fields, learnt twice.
const FIRST_INPUT_SEED: u64 = 100;
const INPUT_SEEDS: u64 = 1;
/// Squared error with an input that is noise over that without, at most: blocks of a dozen fields err by more than that from seed to
/// seed.
const NO_HARM: f64 = 1.05;
/// What is asked for: 95 ± 3 %.
const TOLERANCE: f64 = 0.03;
/// A single seed a character holds a third of the points of kriging's test, in blocks that err together. Over four seeds the
/// networks hold 96.1, 95.3 and 94.1 %.
const NETWORK_TOLERANCE: f64 = 0.05;

/// Of one field: components of points kept from the training within their interval, all of them, and the share within on the
/// folds that the training held out.
fn within(character: Character, method: Method, seed: u64) -> (usize, usize, f64) {
    let points = random_points_m(POINTS, 10 + seed);
    let field = SimulatedField::new(character, 40 + seed).measured(points, 70 + seed).unwrap();
    let split = Split { blocks_per_axis: 3, ..Split::default() };
    let fold = folds(&field.places(), &split, 100 + seed);
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
        let predicted = model.predict(field.point(k));
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

/// Points at so many places, each with a temperature of its own between 18 and 22 °C on which the field depends by `factor`, and the
/// same by their position alone.
fn warm(character: Character, seed: u64, factor: fn(f64) -> f64) -> (Samples, Samples) {
    let points = random_points_m(POINTS, 510 + seed);
    let temp_c: Vec<f64> =
        (0..POINTS).map(|k| 18.0 + 4.0 * (k as f64 * 0.618_034 + seed as f64 * 0.37).fract()).collect();
    let field = SimulatedField::new(character, 540 + seed);
    let all = field.measured_with(&points, ("temp_air_c", &temp_c), factor, 570 + seed).unwrap();
    let at = points.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
    let names = ["x_m", "y_m", "z_m"].map(str::to_owned).to_vec();
    let alone = Samples::new(names, at, all.errors_m().to_vec(), None).unwrap();
    (all, alone)
}

/// Of points kept from the training in blocks of space: mean squared error (µm²) and share of components within their interval.
fn kept(samples: &Samples, method: Method, seed: u64) -> (f64, f64) {
    let split = Split { blocks_per_axis: 3, ..Split::default() };
    let fold = folds(&samples.places(), &split, 600 + seed);
    let of = |held: bool| (0..POINTS).filter(|k| (fold[*k] == 0) == held).collect::<Vec<_>>();
    let mut config = Config { method, seed, split, ..Config::default() };
    config.optimiser.epochs = 10;
    config.optimiser.learning_rate = 5e-3;
    let trained = train(&samples.part(&of(false)).unwrap(), &config, &Device::cpu(), None, &mut |_| Go::On).unwrap();
    let (mut square, mut within, mut count) = (0.0, 0.0, 0.0);
    for k in of(true) {
        let predicted = trained.model.predict(samples.point(k));
        for axis in 0..3 {
            let error = predicted.residual_m[axis] - samples.errors_m()[k][axis];
            square += error * error * 1e12;
            within += f64::from(u8::from(error.abs() <= NORMAL_95 * predicted.covariance_m2[(axis, axis)].sqrt()));
            count += 1.0;
        }
    }
    (square / count, within / count)
}

/// Mean over seeds of what [`kept`] gives with all inputs, and with the position alone.
fn with_and_without(method: Method, seeds: u64, factor: fn(f64) -> f64) -> [(f64, f64); 2] {
    let mut sums = [(0.0, 0.0); 2];
    for (character, seed) in
        Character::ALL.into_iter().flat_map(|c| (0..seeds).map(move |seed| (c, FIRST_INPUT_SEED + seed)))
    {
        let (all, alone) = warm(character, seed, factor);
        let found = [kept(&all, method, seed), kept(&alone, method, seed)];
        println!("{method:?} {} {seed}: {found:.3?}", character.name());
        for (sum, found) in sums.iter_mut().zip(found) {
            *sum = (sum.0 + found.0, sum.1 + found.1);
        }
    }
    let count = seeds as f64 * Character::ALL.len() as f64;
    sums.map(|(square, within)| (square / count, within / count))
}

#[test]
fn with_an_input_that_acts_the_error_falls_and_intervals_hold_95_percent() {
    let [(with, within), (without, _)] = with_and_without(Method::Kriging, INPUT_SEEDS, |temp_c| temp_c - 20.0);
    println!("acts: {without:.3} → {with:.3} um2, within {within:.3}");
    assert!(with < 0.7 * without, "{without} {with}");
    assert!((within - 0.95).abs() <= TOLERANCE, "{within}");
    let [(with, within), (without, _)] =
        with_and_without(Method::PerceptronKriging, NETWORK_SEEDS, |temp_c| temp_c - 20.0);
    println!("acts, networks: {without:.3} → {with:.3} um2, within {within:.3}");
    assert!(with < 0.9 * without && (within - 0.95).abs() <= NETWORK_TOLERANCE, "{without} {with} {within}");
}

#[test]
fn an_input_that_is_noise_does_no_harm_and_intervals_hold_95_percent() {
    let [(with, within), (without, within_alone)] = with_and_without(Method::Kriging, INPUT_SEEDS, |_| 1.0);
    println!("noise: {without:.4} → {with:.4} um2, within {within_alone:.3} → {within:.3}");
    assert!(with < NO_HARM * without, "{without} {with}");
    assert!((within - 0.95).abs() <= TOLERANCE, "{within}");
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
