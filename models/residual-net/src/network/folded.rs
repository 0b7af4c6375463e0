//! The same network with its matrices multiplied out: what runs live.
//!
//! Place in the flow: made once when a model is loaded, evaluated for every sample. As printed the network has no
//! nonlinearity but the softmax, so everything between tokens and softmax, and between softmax and residual, is one matrix
//! each. With the token extended by a one, f = (token, 1), and E = (embedding; bias):
//!
//! - scores of head h: f_iᵀ B_h f_j with B_h = E W_q^h (E W_k^h)ᵀ / √d_k, 7 × 7 for a token of 6;
//! - residual = c + Σ_h Σ_i M_hi Σ_j a_hij f_j with M_hi = (E W_v^h W_o^h W_i)ᵀ, 3 × 7, W_i the output layer's part for token i.
//!
//! That is some 6,000 multiplications instead of 140,000 at a width of 64, in single precision; products are formed in double
//! precision when folding. It also shows what the width buys: B_h has rank 7 at most.

use super::config::NetworkConfig;
use super::parameters::{Layout, Parameters};
use super::tokens::{Token, token_size};
use crate::exponential::exp_f32;
use crate::neighbourhood::VERTICES;
use crate::registers::{Loops, wide};
use nalgebra::{DMatrix, DMatrixView, Vector3};

/// Length of an extended token, and of a row of vertices.
const LANES: usize = 8;

type Square = [[f32; LANES]; LANES];

/// One head, multiplied out; rows and columns beyond the extended token are zero.
#[derive(Debug, Clone, PartialEq)]
struct Head {
    /// B, `[token of the query][token of the key]`.
    score: Square,
    /// M, `[vertex][component of the residual][token]`.
    output: [[[f32; LANES]; 3]; VERTICES],
}

/// A network ready to be evaluated.
#[derive(Debug, Clone, PartialEq)]
pub struct Folded {
    heads: Vec<Head>,
    constant: [f32; 3],
    attention: bool,
    /// Numbers of a token.
    token: usize,
}

impl Folded {
    /// Multiplies the matrices out.
    pub fn new(config: &NetworkConfig, parameters: &Parameters) -> Folded {
        let (d, head_width) = (config.width, config.head_width());
        let (layout, token) = (Layout::new(d, parameters.inputs()), token_size(parameters.inputs()));
        let values: Vec<f64> = parameters.values().iter().map(|v| f64::from(*v)).collect();
        let matrix = |range: &std::ops::Range<usize>, rows: usize| {
            DMatrixView::from_slice(&values[range.clone()], range.len() / rows, rows).transpose()
        };
        // E is its matrix followed by its bias in the parameters as well.
        let embedding = matrix(&(layout.embedding.start..layout.embedding_bias.end), token + 1);
        let output = matrix(&layout.output, VERTICES * d);
        let query = &embedding * matrix(&layout.query, d);
        let key = &embedding * matrix(&layout.key, d);
        let value = &embedding * matrix(&layout.value, d);
        let mixing = matrix(&layout.mixing, d);
        let of_head = |head: usize| {
            let columns = head * head_width;
            let (query, key) = (query.columns(columns, head_width), key.columns(columns, head_width));
            let score = query * key.transpose() / (head_width as f64).sqrt();
            let value = value.columns(columns, head_width) * mixing.rows(columns, head_width);
            let output = std::array::from_fn(|vertex| lanes3(&(&value * output.rows(vertex * d, d)).transpose()));
            Head { score: square(&score), output }
        };
        let mixing_bias = matrix(&layout.mixing_bias, 1);
        let mut constant = matrix(&layout.output_bias, 1);
        for vertex in 0..VERTICES {
            constant += &mixing_bias * output.rows(vertex * d, d);
        }
        Folded {
            heads: (0..config.heads).map(of_head).collect(),
            constant: std::array::from_fn(|k| constant[k] as f32),
            attention: config.attention,
            token,
        }
    }

    /// Output of the network in its own units.
    pub fn evaluate(&self, tokens: &[Token; VERTICES]) -> Vector3<f64> {
        wide((self, tokens))
    }
}

impl Loops for (&Folded, &[Token; VERTICES]) {
    type Output = Vector3<f64>;

    #[inline(always)]
    fn run(self) -> Vector3<f64> {
        let (network, tokens) = self;
        let mut extended: Square = [[0.0; LANES]; VERTICES];
        for (row, token) in extended.iter_mut().zip(tokens) {
            row[..token.len()].copy_from_slice(token);
            row[network.token] = 1.0;
        }
        let keys = transpose(&extended);
        let mut sums = [[0.0_f32; LANES]; 3];
        for head in &network.heads {
            let seen = if network.attention {
                product(&softmax(&product(&product(&extended, &head.score), &keys)), &extended)
            } else {
                extended
            };
            for vertex in 0..VERTICES {
                for (sum, row) in sums.iter_mut().zip(&head.output[vertex]) {
                    for lane in 0..LANES {
                        sum[lane] += row[lane] * seen[vertex][lane];
                    }
                }
            }
        }
        Vector3::from_fn(|k, _| f64::from(network.constant[k] + sums[k].iter().sum::<f32>()))
    }
}

#[inline(always)]
fn product(left: &Square, right: &Square) -> Square {
    let mut result = [[0.0; LANES]; LANES];
    for (row, out) in left.iter().zip(&mut result) {
        for (factor, other) in row.iter().zip(right) {
            for lane in 0..LANES {
                out[lane] += factor * other[lane];
            }
        }
    }
    result
}

#[inline(always)]
fn transpose(matrix: &Square) -> Square {
    std::array::from_fn(|i| std::array::from_fn(|j| matrix[j][i]))
}

/// Softmax of each row.
#[inline(always)]
fn softmax(scores: &Square) -> Square {
    let mut result = *scores;
    for row in &mut result {
        let largest = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        for value in row.iter_mut() {
            *value = exp_f32(*value - largest);
        }
        let scale = 1.0 / row.iter().sum::<f32>();
        row.iter_mut().for_each(|value| *value *= scale);
    }
    result
}

fn square(matrix: &DMatrix<f64>) -> Square {
    std::array::from_fn(|i| std::array::from_fn(|j| matrix.get((i, j)).map_or(0.0, |v| *v as f32)))
}

fn lanes3(matrix: &DMatrix<f64>) -> [[f32; LANES]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| matrix.get((i, j)).map_or(0.0, |v| *v as f32)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::forward::forward;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Single precision through some hundred additions.
    const TOLERANCE: f64 = 3e-6;

    fn random_network(config: &NetworkConfig, inputs: usize, seed: u64) -> Parameters {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let values = (0..Layout::new(config.width, inputs).len()).map(|_| random.random::<f32>() * 0.6 - 0.3).collect();
        Parameters::new(config, inputs, values).unwrap()
    }

    fn random_tokens(inputs: usize, seed: u64) -> [Token; VERTICES] {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut number = |k: usize| if k < token_size(inputs) { random.random::<f32>() * 2.0 - 1.0 } else { 0.0 };
        std::array::from_fn(|_| std::array::from_fn(&mut number))
    }

    #[test]
    fn the_folded_network_is_the_printed_one() {
        let sizes = [(64, 4), (64, 1), (12, 3), (1, 1), (130, 13)];
        for (case, (width, heads)) in sizes.into_iter().enumerate() {
            for (attention, inputs) in [(true, 3), (false, 3), (true, 4), (true, 1)] {
                let config = NetworkConfig { width, heads, attention, ..NetworkConfig::default() };
                let parameters = random_network(&config, inputs, case as u64);
                let folded = Folded::new(&config, &parameters);
                for seed in 0..20 {
                    let tokens = random_tokens(inputs, seed);
                    let (found, expected) = (folded.evaluate(&tokens), forward(&config, &parameters, &tokens));
                    assert_eq!(found, (&folded, &tokens).run());
                    let error = (found - expected).norm() / expected.norm();
                    assert!(error < TOLERANCE, "width {width}, heads {heads}: {error}");
                }
            }
        }
    }

    #[test]
    fn the_order_of_the_vertices_and_their_values_matter() {
        let config = NetworkConfig::default();
        let folded = Folded::new(&config, &random_network(&config, 3, 1));
        let tokens = random_tokens(3, 2);
        let mut swapped = tokens;
        swapped.swap(0, 5);
        assert!((folded.evaluate(&tokens) - folded.evaluate(&swapped)).norm() > 1e-3);
        let mut changed = tokens;
        changed[3][1] += 0.1;
        assert!((folded.evaluate(&tokens) - folded.evaluate(&changed)).norm() > 1e-4);
    }
}
