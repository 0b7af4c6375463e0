//! The neighbourhood attention network on `burn`, for training.
//!
//! Place in the flow: parameters as one vector in the order of [`Layout`], tokens of a batch `[batch, 8 · F]` in, normalised
//! residuals `[batch, 3]` out. Held to the plain forward pass of `abbe_residual_net` by a test. Liang 2025 eq. 16-19.

use crate::optimise::Network;
use abbe_residual_net::VERTICES;
use abbe_residual_net::network::{Layout, NetworkConfig, token_size};
use burn::tensor::Tensor;
use burn::tensor::activation::softmax;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use std::ops::Range;

/// The network of a configuration.
#[derive(Debug, Clone, Copy)]
pub struct Attention {
    /// Sizes and switches.
    pub config: NetworkConfig,
    /// Inputs of a point.
    pub inputs: usize,
    /// Whether the output layer starts at zero: a network on kriging begins as kriging, and stays it if no step is better.
    pub starts_at_zero: bool,
}

impl Network for Attention {
    fn input_size(&self) -> usize {
        VERTICES * token_size(self.inputs)
    }

    /// Uniform in ±1/√(inputs), as PyTorch initialises linear layers.
    fn initial(&self, random: &mut ChaCha8Rng) -> Vec<f32> {
        let d = self.config.width;
        let (layout, token) = (Layout::new(d, self.inputs), token_size(self.inputs));
        let mut values = vec![0.0; layout.len()];
        let mut fill = |range: &Range<usize>, inputs: usize| {
            let bound = 1.0 / (inputs as f32).sqrt();
            values[range.clone()].iter_mut().for_each(|v| *v = random.random_range(-bound..bound));
        };
        fill(&layout.embedding, token);
        fill(&layout.embedding_bias, token);
        for square in [&layout.query, &layout.key, &layout.value, &layout.mixing, &layout.mixing_bias] {
            fill(square, d);
        }
        if !self.starts_at_zero {
            fill(&layout.output, VERTICES * d);
            fill(&layout.output_bias, VERTICES * d);
        }
        values
    }

    fn forward(&self, parameters: &Tensor<1>, inputs: Tensor<2>) -> Tensor<2> {
        let [batch, _] = inputs.dims();
        let (d, heads, head_width) = (self.config.width, self.config.heads, self.config.head_width());
        let (layout, token) = (Layout::new(d, self.inputs), token_size(self.inputs));
        let matrix = |range: &Range<usize>, rows: usize| -> Tensor<2> {
            parameters.clone().slice([range.clone()]).reshape([rows, range.len() / rows])
        };
        let split =
            |rows: Tensor<2>| -> Tensor<4> { rows.reshape([batch, VERTICES, heads, head_width]).swap_dims(1, 2) };
        let tokens = inputs.reshape([batch * VERTICES, token]);
        let embedded = tokens.matmul(matrix(&layout.embedding, token)) + matrix(&layout.embedding_bias, 1);
        let values = embedded.clone().matmul(matrix(&layout.value, d));
        let mixed = if self.config.attention {
            let queries = split(embedded.clone().matmul(matrix(&layout.query, d)));
            let keys = split(embedded.matmul(matrix(&layout.key, d)));
            let scores = queries.matmul(keys.swap_dims(2, 3)) / (head_width as f64).sqrt();
            softmax(scores, 3).matmul(split(values)).swap_dims(1, 2).reshape([batch * VERTICES, d])
        } else {
            values
        };
        let mixed = mixed.matmul(matrix(&layout.mixing, d)) + matrix(&layout.mixing_bias, 1);
        mixed.reshape([batch, VERTICES * d]).matmul(matrix(&layout.output, VERTICES * d))
            + matrix(&layout.output_bias, 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::Device;
    use abbe_residual_net::network::forward::forward;
    use abbe_residual_net::network::{Folded, Parameters, Token};
    use burn::tensor::TensorData;
    use rand::SeedableRng;

    /// Relative difference of single-precision sums in different order.
    const TOLERANCE: f64 = 1e-5;

    #[test]
    fn val_burn_forward_pass_is_the_plain_one_and_the_folded_one() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let cases = [(64, 4, true, 3), (64, 4, false, 3), (24, 3, true, 4), (128, 8, true, 3), (12, 2, true, 2)];
        for (width, heads, attention, inputs) in cases {
            let config = NetworkConfig { width, heads, attention, ..NetworkConfig::default() };
            let network = Attention { config, inputs, starts_at_zero: false };
            let values = network.initial(&mut random);
            let size = token_size(inputs);
            let mut number = |k: usize| if k < size { random.random_range(-2.0..2.0) } else { 0.0 };
            let mut tokens = |_| -> [Token; VERTICES] { std::array::from_fn(|_| std::array::from_fn(&mut number)) };
            let examples: Vec<[Token; VERTICES]> = (0..40).map(&mut tokens).collect();
            let device = Device::cpu();
            let device = device.burn();
            let flat: Vec<f32> = examples.iter().flatten().flat_map(|token| &token[..size]).copied().collect();
            let batch = Tensor::from_data(TensorData::new(flat, [40, network.input_size()]), device);
            let length = values.len();
            let tensor = Tensor::from_data(TensorData::new(values.clone(), [length]), device);
            let outputs: Vec<f32> = network.forward(&tensor, batch).into_data().try_to_vec().unwrap();
            let parameters = Parameters::new(&config, inputs, values).unwrap();
            let folded = Folded::new(&config, &parameters);
            for (example, output) in examples.iter().zip(outputs.chunks_exact(3)) {
                let burn = nalgebra::Vector3::from_fn(|k, _| f64::from(output[k]));
                let plain = forward(&config, &parameters, example);
                assert!((burn - plain).norm() < TOLERANCE * plain.norm(), "{burn} {plain}");
                let live = folded.evaluate(example);
                assert!((burn - live).norm() < TOLERANCE * burn.norm(), "{burn} {live}");
            }
        }
    }
}
