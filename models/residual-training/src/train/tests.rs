//! Laws of a training, on small fields and short trainings.

use super::*;
use crate::config::{Method, Optimiser, SplitKind};
use crate::simulated::{Character, SimulatedField, random_points_m};
use nalgebra::Vector3;

fn field(character: Character, count: usize, seed: u64) -> MeasuredField {
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
    let error = square(&|p| model.predict(p).residual_m - truth.residual_m(p));
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
    assert!(stopped.model.predict(&Vector3::new(0.4, 0.3, 0.3)).inside);
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
        let field = MeasuredField::new(points, only, None).unwrap();
        let trained = train(&field, &quick(Method::Kriging), &Device::cpu(), None, &mut go_on).unwrap();
        assert_eq!(trained.record.recommendation.method, ZERO, "{}", trained.record.recommendation.why);
    }
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
    let in_um = MeasuredField::new(data.points_m().to_vec(), in_um, None).unwrap();
    assert!(matches!(
        train(&in_um, &config, &Device::cpu(), None, &mut go_on),
        Err(TrainingError::Model(ModelError::Unit { .. }))
    ));
}
