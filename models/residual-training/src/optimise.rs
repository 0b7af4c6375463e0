//! Training of any network whose parameters are one vector: epochs of Adam, early stopping, best so far.
//!
//! Place in the flow: examples in, parameters and loss curves out; [`Run`] is all that a stopped training needs to go on
//! and end in the same bits. What is random in an epoch is seeded by its number, so an epoch depends on nothing but the
//! state before it. Loss: mean of the squared components, in units of the network. Adam as in PyTorch (β 0.9 and 0.999,
//! ε 1e-8; Kingma & Ba 2015), the step itself by `burn`.

use crate::config::Optimiser;
use crate::device::Device;
use burn::optim::{Adam, AdamConfig, AdamState, AdaptiveMomentumState, Optimizer as _};
use burn::tensor::{Tensor, TensorData};
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Numbers of a residual.
pub(crate) const OUTPUTS: usize = 3;
/// PyTorch's ε; that of `burn` is 1e-5.
const ADAM_EPSILON: f32 = 1e-8;

/// A network whose parameters are one vector.
pub trait Network {
    /// Numbers of an input.
    fn input_size(&self) -> usize;
    /// Parameters before the first step.
    fn initial(&self, random: &mut ChaCha8Rng) -> Vec<f32>;
    /// Outputs `[batch, 3]` of inputs `[batch, input_size]`.
    fn forward(&self, parameters: &Tensor<1>, inputs: Tensor<2>) -> Tensor<2>;
}

/// One way to look at the same targets.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct View {
    /// Inputs, one example after the other.
    pub inputs: Vec<f32>,
    /// Expected outputs, three an example.
    pub outputs: Vec<f32>,
}

/// Examples to learn from, and examples that say when to stop.
#[derive(Debug, Clone, PartialEq)]
pub struct Examples {
    /// Views of the same targets; each epoch takes one of them at random for each target.
    pub training: Vec<View>,
    /// Targets that the parameters never learn from.
    pub validation: View,
}

/// State of a training after some epoch: plain numbers.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Run {
    /// Parameters now.
    pub parameters: Vec<f32>,
    /// Adam's first and second moments.
    pub moments: [Vec<f32>; 2],
    /// Steps made.
    pub steps: usize,
    /// Parameters of the best epoch.
    pub best: Vec<f32>,
    /// Epochs after which these were found; 0 if no step was better than none.
    pub best_epoch: usize,
    /// Training loss of each epoch, in units of the network squared.
    pub training_loss: Vec<f64>,
    /// Validation loss before the first epoch and after each.
    pub validation_loss: Vec<f64>,
}

impl Run {
    /// Epochs done.
    pub fn epochs(&self) -> usize {
        self.training_loss.len()
    }

    /// Best validation loss; infinite for a state that is none.
    pub fn best_loss(&self) -> f64 {
        self.validation_loss.get(self.best_epoch).copied().unwrap_or(f64::INFINITY)
    }

    /// Whether nothing is left to do.
    pub fn is_over(&self, optimiser: &Optimiser) -> bool {
        self.epochs() >= optimiser.epochs || self.epochs() >= self.best_epoch + optimiser.patience
    }

    fn fits(&self, parameters: usize) -> bool {
        let lists = [&self.parameters, &self.moments[0], &self.moments[1], &self.best];
        lists.iter().all(|list| list.len() == parameters && list.iter().all(|v| v.is_finite()))
            && self.validation_loss.len() == self.epochs() + 1
            && self.best_epoch <= self.epochs()
    }
}

/// Why a training cannot go on.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum OptimiseError {
    /// The loss is no number any more.
    #[error("epoch {epoch}: the loss is no longer a finite number; lower the learning rate")]
    Diverged {
        /// Epoch, from 0.
        epoch: usize,
    },
    /// A state of another training.
    #[error("the state to go on from belongs to another network or is damaged; start the training anew")]
    State,
    /// Nothing to learn from, or nothing to validate by.
    #[error("a fold without points: too few points for so many folds")]
    NoExamples,
    /// The framework failed.
    #[error("burn: {0}")]
    Framework(String),
}

/// Trains on.
pub struct Training<'a, N: Network> {
    network: &'a N,
    examples: &'a Examples,
    optimiser: &'a Optimiser,
    seed: u64,
    adam: Adam,
    device: Device,
}

impl<'a, N: Network> Training<'a, N> {
    /// A training on these examples.
    pub fn new(
        network: &'a N,
        examples: &'a Examples,
        optimiser: &'a Optimiser,
        seed: u64,
        device: &Device,
    ) -> Result<Training<'a, N>, OptimiseError> {
        let is_empty = examples.training.iter().all(|view| view.outputs.is_empty());
        if is_empty || examples.validation.outputs.is_empty() {
            return Err(OptimiseError::NoExamples);
        }
        let adam = AdamConfig::new().with_epsilon(ADAM_EPSILON).build();
        Ok(Training { network, examples, optimiser, seed, adam, device: device.clone() })
    }

    /// The state before the first epoch.
    pub fn start(&self) -> Result<Run, OptimiseError> {
        let parameters = self.network.initial(&mut ChaCha8Rng::seed_from_u64(self.seed));
        let zeros = vec![0.0; parameters.len()];
        let validation_loss = vec![self.loss(&parameters, &self.examples.validation)?];
        let best = parameters.clone();
        Ok(Run { best, moments: [zeros.clone(), zeros], parameters, validation_loss, ..Run::default() })
    }

    /// One epoch on from `run`.
    pub fn epoch(&self, run: &mut Run) -> Result<(), OptimiseError> {
        let length = self.network.initial(&mut ChaCha8Rng::seed_from_u64(0)).len();
        if !run.fits(length) {
            return Err(OptimiseError::State);
        }
        let epoch = run.epochs();
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        random.set_stream(epoch as u64 + 1);
        let count = self.examples.training[0].outputs.len() / OUTPUTS;
        let mut order: Vec<(usize, usize)> =
            (0..count).map(|target| (target, random.random_range(0..self.examples.training.len()))).collect();
        order.shuffle(&mut random);
        let rate = self.optimiser.learning_rate * self.optimiser.decay.powi(epoch as i32);
        let mut parameters = self.vector(&run.parameters);
        let mut state = self.adam_state(run);
        let mut losses = Vec::new();
        for batch in order.chunks(self.optimiser.batch) {
            let (loss, next, next_state) = self.step(parameters, state, batch, rate)?;
            losses.push(loss);
            (parameters, state) = (next, next_state);
        }
        // Read at the end of the epoch: a graphics card would have to be waited for after each step.
        let losses = numbers(Tensor::cat(losses, 0))?;
        let sizes = order.chunks(self.optimiser.batch).map(|batch| batch.len() as f64);
        let sum = losses.iter().zip(sizes).map(|(loss, size)| f64::from(*loss) * size).sum::<f64>();
        run.steps += count.div_ceil(self.optimiser.batch);
        run.parameters = numbers(parameters)?;
        if let Some(AdamState { momentum }) = state {
            run.moments = [numbers(momentum.moment_1)?, numbers(momentum.moment_2)?];
        }
        let validation = self.loss(&run.parameters, &self.examples.validation)?;
        if !(sum.is_finite() && validation.is_finite()) {
            return Err(OptimiseError::Diverged { epoch });
        }
        if validation < run.best_loss() {
            run.best_epoch = epoch + 1;
            run.best.clone_from(&run.parameters);
        }
        run.training_loss.push(sum / count as f64);
        run.validation_loss.push(validation);
        Ok(())
    }

    fn vector(&self, values: &[f32]) -> Tensor<1> {
        Tensor::from_data(TensorData::new(values.to_vec(), [values.len()]), self.device.burn())
    }

    /// Adam's state; none before the first step.
    fn adam_state(&self, run: &Run) -> Option<AdamState<1>> {
        let [first, second] = run.moments.each_ref().map(|moment| self.vector(moment));
        (run.steps > 0).then(|| AdamState::new(AdaptiveMomentumState::new(run.steps, first, second)))
    }

    /// One step: loss before it, parameters and state after it.
    fn step(
        &self,
        parameters: Tensor<1>,
        state: Option<AdamState<1>>,
        batch: &[(usize, usize)],
        rate: f64,
    ) -> Result<(Tensor<1>, Tensor<1>, Option<AdamState<1>>), OptimiseError> {
        let width = self.network.input_size();
        let pick = |list: fn(&View) -> &Vec<f32>, size: usize| -> Vec<f32> {
            let one = |(target, view): &(usize, usize)| {
                list(&self.examples.training[*view])[target * size..(target + 1) * size].iter().copied()
            };
            batch.iter().flat_map(one).collect()
        };
        let device = self.device.burn().clone().autodiff();
        let matrix = |values: Vec<f32>, size: usize| -> Tensor<2> {
            Tensor::from_data(TensorData::new(values, [batch.len(), size]), &device)
        };
        let tracked: Tensor<1> = Tensor::from_inner(parameters.clone()).require_grad();
        let outputs = self.network.forward(&tracked, matrix(pick(|view| &view.inputs, width), width));
        let loss = (outputs - matrix(pick(|view| &view.outputs, OUTPUTS), OUTPUTS)).square().mean();
        let gradients = loss.backward();
        let gradient = tracked.grad(&gradients).ok_or_else(|| OptimiseError::Framework("no gradient".into()))?;
        let (next, next_state) = self.adam.step(rate, parameters, gradient, state);
        Ok((loss.inner(), next, next_state))
    }

    fn loss(&self, parameters: &[f32], view: &View) -> Result<f64, OptimiseError> {
        let outputs = outputs(self.network, parameters, &view.inputs, &self.device)?;
        let squares = outputs.iter().zip(&view.outputs).map(|(o, e)| f64::from(o - e).powi(2));
        Ok(squares.sum::<f64>() / outputs.len() as f64)
    }
}

/// Outputs of a network for many inputs.
pub fn outputs<N: Network>(
    network: &N,
    parameters: &[f32],
    inputs: &[f32],
    device: &Device,
) -> Result<Vec<f32>, OptimiseError> {
    let device = device.burn();
    let parameters = Tensor::from_data(TensorData::new(parameters.to_vec(), [parameters.len()]), device);
    let shape = [inputs.len() / network.input_size(), network.input_size()];
    numbers(network.forward(&parameters, Tensor::from_data(TensorData::new(inputs.to_vec(), shape), device)))
}

fn numbers<const D: usize>(tensor: Tensor<D>) -> Result<Vec<f32>, OptimiseError> {
    tensor.into_data().try_to_vec().map_err(|error| OptimiseError::Framework(format!("{error:?}")))
}

#[cfg(test)]
mod tests;
