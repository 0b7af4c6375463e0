//! Networks that map a position, or whatever inputs, to a residual: what the paper compares with.
//!
//! Place in the flow: rivals in [`crate::compare()`]. Input: inputs in ±1 over the box of the points; output: normalised residual.
//!
//! | network | layers |
//! |---|---|
//! | plain | two hidden layers, tanh |
//! | residual | linear layer, then blocks x + W₂ relu(W₁ x) (He 2016), linear layer; Yang 2023 calibrates a manipulator with one |
//! | belief | hidden layers with sigmoid, started from restricted Boltzmann machines ([`crate::belief`]; Wang 2022) |

use crate::optimise::{Network, OUTPUTS};
use abbe_residual_net::network::PositionConfig;
use burn::tensor::Tensor;
use burn::tensor::activation::{relu, sigmoid, tanh};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// Coordinates of a position.
pub(crate) const POSITION: usize = 3;

/// How hidden layers are connected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Plain,
    Residual,
    Sigmoid,
}

/// A network of dense layers on inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Perceptron {
    form: Form,
    /// Inputs and outputs of each layer.
    layers: Vec<[usize; 2]>,
    /// Parameters to start from, where they are not drawn.
    start: Option<Vec<f32>>,
}

impl Perceptron {
    /// Two hidden layers of this width.
    pub fn plain(width: usize) -> Perceptron {
        Perceptron { form: Form::Plain, layers: vec![[POSITION, width], [width, width], [width, OUTPUTS]], start: None }
    }

    /// Residual blocks on so many inputs: what a model with a trend runs live.
    pub fn residual(config: &PositionConfig, inputs: usize) -> Perceptron {
        Perceptron { form: Form::Residual, layers: config.layers(inputs).collect(), start: None }
    }

    /// Sigmoid layers of these widths, started from given parameters of the hidden layers; the output layer is drawn.
    pub(crate) fn belief(widths: &[usize], start: Vec<f32>) -> Perceptron {
        let inputs = std::iter::once(POSITION).chain(widths.iter().copied());
        let outputs = widths.iter().copied().chain([OUTPUTS]);
        let layers = inputs.zip(outputs).map(|(i, o)| [i, o]).collect();
        Perceptron { form: Form::Sigmoid, layers, start: Some(start) }
    }

    /// Number of parameters.
    pub fn parameters(&self) -> usize {
        self.layers.iter().map(|[inputs, outputs]| (inputs + 1) * outputs).sum()
    }
}

impl Network for Perceptron {
    fn input_size(&self) -> usize {
        self.layers[0][0]
    }

    /// Uniform in ±1/√(inputs), as PyTorch initialises linear layers.
    fn initial(&self, random: &mut ChaCha8Rng) -> Vec<f32> {
        let mut values = Vec::with_capacity(self.parameters());
        for [inputs, outputs] in &self.layers {
            let bound = 1.0 / (*inputs as f32).sqrt();
            values.extend((0..(inputs + 1) * outputs).map(|_| random.random_range(-bound..bound)));
        }
        if let Some(start) = &self.start {
            values[..start.len()].copy_from_slice(start);
        }
        values
    }

    fn forward(&self, parameters: &Tensor<1>, inputs: Tensor<2>) -> Tensor<2> {
        let mut place = 0;
        let mut layer = |x: Tensor<2>, number: usize| {
            let [inputs, outputs] = self.layers[number];
            let matrix = parameters.clone().narrow(0, place, inputs * outputs).reshape([inputs, outputs]);
            place += inputs * outputs;
            let bias = parameters.clone().narrow(0, place, outputs).reshape([1, outputs]);
            place += outputs;
            x.matmul(matrix) + bias
        };
        let last = self.layers.len() - 1;
        let mut x = layer(inputs, 0);
        match self.form {
            Form::Plain => {
                for number in 1..=last {
                    x = layer(tanh(x), number);
                }
                x
            }
            Form::Sigmoid => {
                for number in 1..=last {
                    x = layer(sigmoid(x), number);
                }
                x
            }
            Form::Residual => {
                for number in (1..last).step_by(2) {
                    let hidden = relu(layer(x.clone(), number));
                    x = x + layer(hidden, number + 1);
                }
                layer(x, last)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::Device;
    use crate::optimise::outputs;
    use abbe_residual_net::{PositionEnsemble, Trend};
    use nalgebra::Vector3;
    use rand::SeedableRng;

    /// Relative difference of single-precision sums in different order.
    const TOLERANCE: f64 = 1e-5;

    #[test]
    fn val_burn_forward_pass_of_residual_blocks_is_the_live_one() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        for (width, blocks, inputs) in [(32, 3, 3), (64, 2, 3), (13, 1, 7)] {
            let config = PositionConfig { width, blocks };
            let network = Perceptron::residual(&config, inputs);
            let values = network.initial(&mut random);
            let (low, high) = (vec![-1.0; inputs], vec![1.0; inputs]);
            let (mean_m, scale_m, members) = (Vector3::zeros(), Vector3::repeat(1.0), vec![values.clone()]);
            let trend = Trend::new(PositionEnsemble { config, low, high, mean_m, scale_m, members }).unwrap();
            for _ in 0..40 {
                let at: Vec<f64> = (0..inputs).map(|_| random.random_range(-1.0..1.0)).collect();
                let place = trend.parts().place(&at);
                let output = outputs(&network, &values, &place[..inputs], &Device::cpu()).unwrap();
                let burn = Vector3::from_fn(|k, _| f64::from(output[k]));
                assert!((burn - trend.at(&at)).norm() < TOLERANCE * burn.norm(), "{burn} {}", trend.at(&at));
            }
        }
    }
}
