//! Laws of training, on a small network and a field that it can learn.

use super::*;
use crate::perceptron::Perceptron;

fn examples() -> Examples {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut view = |count: usize| {
        let mut view = View::default();
        for _ in 0..count {
            let x: [f32; 3] = std::array::from_fn(|_| random.random_range(-1.0..1.0));
            view.inputs.extend(x);
            view.outputs.extend([x[0] * x[1], (2.0 * x[2]).sin(), x[0] - 0.5]);
        }
        view
    };
    Examples { training: vec![view(200)], validation: view(60) }
}

fn optimiser(epochs: usize) -> Optimiser {
    Optimiser { epochs, learning_rate: 1e-2, ..Optimiser::default() }
}

#[test]
fn what_can_be_learnt_is_learnt_and_the_best_epoch_is_kept() {
    let (network, examples, optimiser) = (Perceptron::plain(24), examples(), optimiser(60));
    let training = Training::new(&network, &examples, &optimiser, 7, &Device::cpu()).unwrap();
    let mut run = training.start().unwrap();
    while !run.is_over(&optimiser) {
        training.epoch(&mut run).unwrap();
    }
    let best = run.best_loss();
    assert!(best < 0.02 && best < run.validation_loss[0] / 10.0, "{best}");
    assert_eq!(best, run.validation_loss.iter().copied().fold(f64::INFINITY, f64::min));
    assert!((training.loss(&run.best, &examples.validation).unwrap() - best).abs() < 1e-12);
}

#[test]
fn going_on_from_a_written_state_ends_in_the_same_bits() {
    let (network, examples, optimiser) = (Perceptron::plain(16), examples(), optimiser(6));
    let training = Training::new(&network, &examples, &optimiser, 3, &Device::cpu()).unwrap();
    let mut whole = training.start().unwrap();
    (0..6).for_each(|_| training.epoch(&mut whole).unwrap());
    let mut first = training.start().unwrap();
    (0..2).for_each(|_| training.epoch(&mut first).unwrap());
    // Everything that lives on is in the state: a training made anew goes on from it.
    let again = Training::new(&network, &examples, &optimiser, 3, &Device::cpu()).unwrap();
    let mut resumed = first.clone();
    (0..4).for_each(|_| again.epoch(&mut resumed).unwrap());
    assert_eq!(resumed, whole);
    assert_ne!(first.parameters, whole.parameters);
}

#[test]
fn training_ends_after_the_patience_without_a_better_loss() {
    let optimiser = Optimiser { patience: 3, ..Optimiser::default() };
    let run = |epochs: usize, best_epoch| Run { training_loss: vec![1.0; epochs], best_epoch, ..Run::default() };
    assert!(!run(0, 0).is_over(&optimiser));
    assert!(!run(4, 2).is_over(&optimiser));
    assert!(run(5, 2).is_over(&optimiser));
    assert!(run(100, 99).is_over(&optimiser));
}

#[test]
fn val_pytorch_adam_makes_the_same_steps() {
    // torch.optim.Adam, lr 0.1, on the loss 0.5 * sum(c * p^2), c = (1, 10), p = (1, 1), three steps in single precision:
    // gradient c * p each step. Worked out by the recursion of Kingma & Ba with epsilon 1e-8.
    let device = Device::cpu();
    let device = device.burn();
    let adam = AdamConfig::new().with_epsilon(ADAM_EPSILON).build();
    let mut p = Tensor::<1>::from_data(TensorData::new(vec![1.0_f32, 1.0], [2]), device);
    let mut state = None;
    let (mut expected, mut m, mut v) = ([1.0_f64, 1.0], [0.0; 2], [0.0; 2]);
    for step in 1..=3 {
        let gradient = p.clone() * Tensor::<1>::from_data(TensorData::new(vec![1.0_f32, 10.0], [2]), device);
        (p, state) = adam.step(0.1, p, gradient, state);
        for k in 0..2 {
            let g = [1.0, 10.0][k] * expected[k];
            m[k] = 0.9 * m[k] + 0.1 * g;
            v[k] = 0.999 * v[k] + 0.001 * g * g;
            let (m, v) = (m[k] / (1.0 - 0.9_f64.powi(step)), v[k] / (1.0 - 0.999_f64.powi(step)));
            expected[k] -= 0.1 * m / (v.sqrt() + 1e-8);
        }
    }
    let found = numbers(p).unwrap();
    for k in 0..2 {
        assert!((f64::from(found[k]) - expected[k]).abs() < 1e-5, "{found:?} {expected:?}");
    }
}

#[test]
fn a_state_that_does_not_fit_and_a_loss_that_is_no_number_are_refused() {
    let (network, mut examples, optimiser) = (Perceptron::plain(8), examples(), optimiser(3));
    let training = Training::new(&network, &examples, &optimiser, 1, &Device::cpu()).unwrap();
    let mut run = training.start().unwrap();
    run.moments[0].pop();
    assert_eq!(training.epoch(&mut run), Err(OptimiseError::State));
    examples.training[0].outputs[4] = f32::NAN;
    let training = Training::new(&network, &examples, &optimiser, 1, &Device::cpu()).unwrap();
    assert_eq!(training.epoch(&mut training.start().unwrap()), Err(OptimiseError::Diverged { epoch: 0 }));
    examples.validation = View::default();
    assert!(Training::new(&network, &examples, &optimiser, 1, &Device::cpu()).is_err());
}
