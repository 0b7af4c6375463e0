//! Laws of a training, on small fields and short trainings.

use super::*;
use crate::config::{Method, Optimiser, SplitKind};
use crate::simulated::{Character, SimulatedField, random_points_m};
use abbe_field::{MeasuredField, POSITION};
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

fn field(character: Character, count: usize, seed: u64) -> Samples {
    SimulatedField::new(character, seed).measured(random_points_m(count, seed + 100), seed + 200).unwrap()
}

fn quick(method: Method) -> Config {
    let mut config = Config { method, seed: 5, ..Config::default() };
    config.network.width = 16;
    config.network.heads = 2;
    config.perceptron.width = 16;
    config.optimiser = Optimiser { epochs: 4, learning_rate: 5e-3, ..Optimiser::default() };
    config.split.folds = 3;
    config
}

fn go_on(_: &Progress) -> Go {
    Go::On
}

#[test]
fn data_become_a_model_that_predicts_them_with_evidence() {
    let field = field(Character::Smooth, 160, 1);
    let config = quick(Method::Recommended);
    let mut told = Vec::new();
    let trained = train(&field, &config, &Device::cpu(), None, &mut |p| {
        assert!(p.training_loss.is_finite() && p.best_validation_loss <= p.validation_loss);
        told.push((p.kind, p.member, p.epoch));
        Go::On
    });
    let Trained { model, record, state, held_out } = trained.unwrap();
    assert_eq!(held_out.len(), 160);
    assert_eq!((told.len(), state.runs.len(), record.curves.len()), (3 * 3 * 4, 9, 9));
    assert!(record.complete && !record.flattering && record.points == 160);
    let methods: Vec<&str> = record.held_out.iter().map(|h| h.method.as_str()).collect();
    assert_eq!(methods, ["zero", "kriging", "network", "kriging-network", "perceptron-kriging"]);
    let of = |name: &str| record.held_out.iter().find(|h| h.method == name).unwrap();
    assert!(of("kriging").scores.mse_um2 < of("zero").scores.mse_um2 / 2.0, "{record:?}");
    assert!((0.85..=1.0).contains(&of("kriging").coverage_95.unwrap()), "{record:?}");
    // What is recommended is what was made, and it says what the field is between the points.
    assert_eq!(record.recommendation.method, model.kind().name());
    let truth = SimulatedField::new(Character::Smooth, 1);
    let at = random_points_m(50, 9);
    let square = |f: &dyn Fn(&Vector3<f64>) -> Vector3<f64>| at.iter().map(|p| f(p).norm_squared()).sum::<f64>();
    let error = square(&|p| model.predict(p.as_slice()).residual_m - truth.residual_m(p));
    assert!(error < 0.1 * square(&|p| truth.residual_m(p)), "{error}");
}

#[test]
fn a_stopped_training_goes_on_to_the_same_bits() {
    for method in [Method::KrigingNetwork, Method::PerceptronKriging] {
        goes_on_to_the_same_bits(method);
    }
}

fn goes_on_to_the_same_bits(method: Method) {
    let (field, config) = (field(Character::Sharp, 110, 2), quick(method));
    let whole = train(&field, &config, &Device::cpu(), None, &mut go_on).unwrap();
    let mut epochs = 0;
    let stopped = train(&field, &config, &Device::cpu(), None, &mut |_| {
        epochs += 1;
        if epochs == 6 { Go::Stop } else { Go::On }
    });
    let stopped = stopped.unwrap();
    assert!(!stopped.record.complete && stopped.state.runs.len() == 2);
    // What it has is usable.
    assert!(stopped.model.predict(&[0.4, 0.3, 0.3]).inside);
    let resumed = train(&field, &config, &Device::cpu(), Some(stopped.state), &mut go_on).unwrap();
    assert_eq!(resumed.record, whole.record);
    assert_eq!(resumed.model.to_record(), whole.model.to_record());
}

#[test]
fn training_repeats_bit_for_bit_and_another_seed_differs() {
    let (field, config) = (field(Character::Smooth, 110, 3), quick(Method::Network));
    let [first, second] =
        [(); 2].map(|()| train(&field, &config, &Device::cpu(), None, &mut go_on).unwrap().model.to_record());
    assert_eq!(first, second);
    let other = Config { seed: 6, ..config };
    assert_ne!(train(&field, &other, &Device::cpu(), None, &mut go_on).unwrap().model.to_record(), first);
}

#[test]
fn where_nothing_is_to_be_learnt_zero_is_recommended() {
    // Noise alone.
    for seed in 4..7 {
        let points = random_points_m(120, seed);
        let clean = SimulatedField::new(Character::Noisy, 5);
        let noisy = clean.measured(points.clone(), seed + 3).unwrap();
        let only = points.iter().zip(noisy.errors_m()).map(|(p, r)| r - clean.residual_m(p)).collect();
        let field = Samples::from(&MeasuredField::new(points, only, None).unwrap());
        let trained = train(&field, &quick(Method::Kriging), &Device::cpu(), None, &mut go_on).unwrap();
        assert_eq!(trained.record.recommendation.method, ZERO, "{}", trained.record.recommendation.why);
    }
}

/// A smooth field of which measurements scatter by `scatter_m` and declare `declared_m`: the model, and its largest error and
/// least deviation (m) at points between.
fn declared(scatter_m: f64, declared_m: f64) -> (Trained, f64, f64) {
    let simulated = SimulatedField::new(Character::Smooth, 3);
    let points = random_points_m(200, 4);
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut noise = || Vector3::from_fn(|_, _| random.sample::<f64, _>(StandardNormal) * scatter_m);
    let measured = points.iter().map(|p| simulated.residual_m(p) + noise()).collect();
    let u_m = Some(vec![Vector3::repeat(declared_m); 200]);
    let field = Samples::from(&MeasuredField::new(points, measured, u_m).unwrap());
    let trained = train(&field, &quick(Method::Kriging), &Device::cpu(), None, &mut go_on).unwrap();
    let (mut error_m, mut least_m) = (0.0_f64, f64::INFINITY);
    for at in random_points_m(60, 6) {
        let found = trained.model.predict(at.as_slice());
        error_m = error_m.max((found.residual_m - simulated.residual_m(&at)).amax());
        least_m = least_m.min(found.covariance_m2.diagonal().min().sqrt());
    }
    (trained, error_m, least_m)
}

#[test]
fn what_is_declared_and_does_not_scatter_is_common_to_all_and_stays_in_the_uncertainty() {
    let (honest, ..) = declared(0.1e-6, 0.1e-6);
    assert!(honest.record.declared_seen.unwrap().iter().all(|seen| *seen > 0.7), "{:?}", honest.record.declared_seen);
    let (cautious, error_m, least_m) = declared(0.1e-6, 1e-6);
    let seen = cautious.record.declared_seen.unwrap();
    assert!(seen.iter().all(|seen| (0.05..0.2).contains(seen)), "{seen:?}");
    assert!(least_m > 0.98e-6 && error_m < 1.96 * least_m, "{least_m} {error_m}");
}

#[test]
fn what_neighbours_do_not_share_beyond_what_is_declared_stays_in_the_uncertainty() {
    let (trained, _, least_m) = declared(0.5e-6, 0.1e-6);
    assert!(trained.record.unshared_um.iter().all(|um| (0.35..0.7).contains(um)), "{:?}", trained.record.unshared_um);
    assert!(least_m > 0.35e-6, "{least_m}");
}

#[test]
fn points_that_cannot_be_held_out_are_refused_with_a_way_out() {
    let refused = |field: &Samples| train(field, &quick(Method::Kriging), &Device::cpu(), None, &mut go_on).err();
    assert_eq!(refused(&field(Character::Smooth, 12, 1)), Some(TrainingError::Few(12)));
    let far = |k: usize| if k.is_multiple_of(2) { Vector3::zeros() } else { Vector3::repeat(3.0) };
    let points: Vec<_> = random_points_m(60, 2).into_iter().enumerate().map(|(k, p)| p * 0.1 + far(k)).collect();
    let clusters = SimulatedField::new(Character::Smooth, 2).measured(points, 3).unwrap();
    let error = refused(&clusters).unwrap();
    assert!(
        matches!(error, TrainingError::Folds { points: 60, occupied: 2, folds: 3, remedy: Some(_), .. }),
        "{error:?}"
    );
    // Blocks of a twentieth of the volume do not divide the two clusters, only single points do.
    let says = error.to_string();
    assert!(says.contains("folds = 3 and kind = \"random\"") && says.contains("more parts of space"), "{says}");
}

#[test]
fn a_random_split_is_labelled_as_flattering() {
    let mut config = quick(Method::Kriging);
    config.split.kind = SplitKind::Random;
    assert!(
        train(&field(Character::Smooth, 100, 6), &config, &Device::cpu(), None, &mut go_on).unwrap().record.flattering
    );
}

#[test]
fn states_of_other_data_or_configurations_and_bad_input_are_refused() {
    let (data, config) = (field(Character::Smooth, 100, 7), quick(Method::Kriging));
    let state = train(&data, &config, &Device::cpu(), None, &mut go_on).unwrap().state;
    let other = Config { seed: 99, ..config.clone() };
    assert_eq!(
        train(&data, &other, &Device::cpu(), Some(state.clone()), &mut go_on).err(),
        Some(TrainingError::State("configuration"))
    );
    let others = field(Character::Smooth, 100, 8);
    assert_eq!(
        train(&others, &config, &Device::cpu(), Some(state), &mut go_on).err(),
        Some(TrainingError::State("set of residuals"))
    );
    let no_epochs = Config { optimiser: Optimiser { epochs: 0, ..Optimiser::default() }, ..config.clone() };
    assert!(matches!(train(&data, &no_epochs, &Device::cpu(), None, &mut go_on), Err(TrainingError::Config(_))));
    let in_um = data.errors_m().iter().map(|e| e * 1e6).collect();
    let in_um = data.with_errors(in_um).unwrap();
    assert!(matches!(
        train(&in_um, &config, &Device::cpu(), None, &mut go_on),
        Err(TrainingError::Model(ModelError::Unit { .. }))
    ));
}

/// Points with so many further inputs, on the first of which the field depends.
fn with_inputs(further: usize, seed: u64) -> (Samples, Samples) {
    let points = random_points_m(110, seed);
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let rows: Vec<Vec<f64>> =
        points.iter().map(|_| (0..further).map(|_| random.random_range(18.0..22.0)).collect()).collect();
    let simulated = SimulatedField::new(Character::Smooth, seed);
    let errors: Vec<_> = points.iter().zip(&rows).map(|(p, row)| simulated.residual_m(p) * (row[0] - 20.0)).collect();
    let names = POSITION.map(str::to_owned).into_iter().chain((0..further).map(|k| format!("temp_{k}_c"))).collect();
    let at = points.iter().zip(&rows).flat_map(|(p, row)| [p.as_slice(), row].concat()).collect();
    let alone = Samples::from(&MeasuredField::new(points, errors.clone(), None).unwrap());
    (Samples::new(names, at, errors, None).unwrap(), alone)
}

#[test]
fn every_kind_takes_further_inputs_and_is_judged_against_the_position_alone() {
    for method in [Method::Kriging, Method::Network, Method::KrigingNetwork, Method::PerceptronKriging] {
        let (all, alone) = with_inputs(1, 8);
        let trained = train_beside(&all, Some(&alone), &quick(method), &Device::cpu(), None, &mut go_on).unwrap();
        assert_eq!(trained.record.inputs, ["x_m", "y_m", "z_m", "temp_0_c"]);
        let methods: Vec<&str> = trained.record.held_out.iter().map(|h| h.method.as_str()).collect();
        assert_eq!(methods[..2], ["zero", "kriging (position alone)"], "{method:?}");
        assert_eq!(trained.model.covariates(), ["temp_0_c"]);
        let at = |temp_c: f64| trained.model.predict(&[0.4, 0.3, 0.3, temp_c]);
        assert!(at(20.0).inside && !at(25.0).inside, "{method:?}");
        if method != Method::Network {
            assert!((at(18.5).residual_m - at(21.5).residual_m).norm() > 1e-7, "{method:?}");
            assert!(trained.record.recommendation.method == trained.record.kind, "{:?}", trained.record.recommendation);
        }
    }
}

#[test]
fn more_inputs_than_a_network_on_the_neighbourhood_takes_are_refused_unless_another_kind_can_be_recommended() {
    let (all, _) = with_inputs(2, 9);
    let refused = train(&all, &quick(Method::Network), &Device::cpu(), None, &mut go_on).err().unwrap();
    assert!(refused.to_string().contains("4 inputs at most") && refused.to_string().contains("perceptron-kriging"));
    let trained = train(&all, &quick(Method::Recommended), &Device::cpu(), None, &mut go_on).unwrap();
    let methods: Vec<&str> = trained.record.held_out.iter().map(|h| h.method.as_str()).collect();
    assert_eq!(methods, ["zero", "kriging", "perceptron-kriging"]);
}

/// What a refusal names trains: fewer folds never did, and at 20 points nothing that it named.
#[test]
fn regress_the_split_that_a_refusal_names_trains() {
    let mut refused = 0;
    for count in 20..=30 {
        for seed in 0..4 {
            let few = field(Character::Smooth, count, 10 * seed + 1);
            let mut config = quick(Method::KrigingNetwork);
            config.optimiser.epochs = 1;
            config.split = Split::default();
            let with = |config: &Config| train(&few, config, &Device::cpu(), None, &mut go_on);
            let error = match with(&config) {
                Ok(_) => continue,
                Err(error) => error,
            };
            let TrainingError::Folds { remedy: Some(remedy), enough, .. } = error else { panic!("{count}: {error}") };
            // 27 points leave 15 of 5 folds of at most 6; 28 leave 16.
            assert_eq!(enough, 28);
            assert!(error.to_string().contains(&format!("folds = {}", remedy.folds)), "{error}");
            config.split = remedy;
            if let Err(error) = with(&config) {
                panic!("{count} {seed} {remedy:?}: {error}");
            }
            refused += 1;
        }
    }
    assert!(refused > 10, "{refused}");
}
