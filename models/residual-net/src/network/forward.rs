//! The network as printed, in double precision and plain loops: what the folded form and burn's are held to.
//!
//! Place in the flow: tests and the benchmark; live runs [`super::folded`]. Equations 16-19: Q = X W_q, K = X W_k,
//! V = X W_v, Z = softmax(Q Kᵀ/√d_k) V for each head, Y = concat(Z) W_o + b_o, residual = flatten(Y) W + b.

use super::config::NetworkConfig;
use super::parameters::{Layout, Parameters};
use super::tokens::{Token, token_size};
use crate::neighbourhood::VERTICES;
use nalgebra::Vector3;

/// Output of the network in its own units.
pub fn forward(config: &NetworkConfig, parameters: &Parameters, tokens: &[Token; VERTICES]) -> Vector3<f64> {
    let d = config.width;
    let (layout, size) = (Layout::new(d, parameters.inputs()), token_size(parameters.inputs()));
    let part = |range: &std::ops::Range<usize>| -> Vec<f64> {
        parameters.values()[range.clone()].iter().map(|v| f64::from(*v)).collect()
    };
    let input: Vec<f64> = tokens.iter().flat_map(|token| &token[..size]).map(|v| f64::from(*v)).collect();
    let mut embedded = times(&input, &part(&layout.embedding), size, d);
    add_bias(&mut embedded, &part(&layout.embedding_bias));
    let values = times(&embedded, &part(&layout.value), d, d);
    let heads = if config.attention {
        let queries = times(&embedded, &part(&layout.query), d, d);
        let keys = times(&embedded, &part(&layout.key), d, d);
        attend(config, &queries, &keys, &values)
    } else {
        values
    };
    let mut mixed = times(&heads, &part(&layout.mixing), d, d);
    add_bias(&mut mixed, &part(&layout.mixing_bias));
    let mut output = times(&mixed, &part(&layout.output), VERTICES * d, 3);
    add_bias(&mut output, &part(&layout.output_bias));
    Vector3::from_column_slice(&output)
}

/// Eq. 17 and 18: all heads side by side.
fn attend(config: &NetworkConfig, queries: &[f64], keys: &[f64], values: &[f64]) -> Vec<f64> {
    let (d, head_width) = (config.width, config.head_width());
    let mut result = vec![0.0; VERTICES * d];
    for head in 0..config.heads {
        let columns = head * head_width..(head + 1) * head_width;
        for i in 0..VERTICES {
            let score = |j: usize| {
                let product: f64 = columns.clone().map(|c| queries[i * d + c] * keys[j * d + c]).sum();
                product / (head_width as f64).sqrt()
            };
            let scores: [f64; VERTICES] = std::array::from_fn(score);
            let largest = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let powers = scores.map(|s| (s - largest).exp());
            let sum: f64 = powers.iter().sum();
            for c in columns.clone() {
                result[i * d + c] = (0..VERTICES).map(|j| powers[j] / sum * values[j * d + c]).sum();
            }
        }
    }
    result
}

/// Rows of `inputs` numbers times a matrix `[inputs, outputs]`.
fn times(rows: &[f64], matrix: &[f64], inputs: usize, outputs: usize) -> Vec<f64> {
    let row = |row: &[f64]| -> Vec<f64> {
        (0..outputs).map(|o| row.iter().enumerate().map(|(i, x)| x * matrix[i * outputs + o]).sum()).collect()
    };
    rows.chunks_exact(inputs).flat_map(row).collect()
}

fn add_bias(rows: &mut [f64], bias: &[f64]) {
    rows.chunks_exact_mut(bias.len()).for_each(|row| row.iter_mut().zip(bias).for_each(|(x, b)| *x += b));
}
