//! Network on the inputs, the position above all: residual blocks of dense layers, as it runs live.
//!
//! Place in the flow: parameters from training, a place in ±1 over the box of the calibrated points in, residual in units of the
//! network out. It knows no neighbours, so it can bend where they cannot follow: at an edge that cuts the volume. Layers: linear,
//! then blocks x + W₂ relu(W₁ x + b₁) + b₂ (He 2016), linear. Parameters of a layer are its matrix, row by row `[inputs, outputs]`, and
//! its bias; the layers follow each other.

use crate::registers::{Loops, wide};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Numbers of a residual.
const OUTPUTS: usize = 3;
/// Widest layer: what a prediction works in stands on the stack.
const WIDEST: usize = 128;
/// Blocks at most.
const MOST_BLOCKS: usize = 16;
/// Rows are padded to a multiple of this: as many sums as stay in vector registers while the inputs pass by.
const LANES: usize = 32;

/// Sizes of the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PositionConfig {
    /// Features of a hidden layer.
    pub width: usize,
    /// Residual blocks of two layers.
    pub blocks: usize,
}

impl Default for PositionConfig {
    fn default() -> PositionConfig {
        PositionConfig { width: 32, blocks: 3 }
    }
}

/// Sizes that make no network.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PositionConfigError {
    /// Width out of range.
    #[error("width is {0}; give 1 to {WIDEST}")]
    Width(usize),
    /// Blocks out of range.
    #[error("blocks is {0}; give 1 to {MOST_BLOCKS}")]
    Blocks(usize),
}

impl PositionConfig {
    /// Refuses sizes out of range.
    pub fn check(&self) -> Result<(), PositionConfigError> {
        if self.width == 0 || self.width > WIDEST {
            return Err(PositionConfigError::Width(self.width));
        }
        if self.blocks == 0 || self.blocks > MOST_BLOCKS {
            return Err(PositionConfigError::Blocks(self.blocks));
        }
        Ok(())
    }

    /// Inputs and outputs of each layer of a network on so many inputs.
    pub fn layers(&self, inputs: usize) -> impl Iterator<Item = [usize; 2]> + use<> {
        let hidden = std::iter::repeat_n([self.width; 2], 2 * self.blocks);
        std::iter::once([inputs, self.width]).chain(hidden).chain([[self.width, OUTPUTS]])
    }

    /// Number of parameters.
    pub fn parameters(&self, inputs: usize) -> usize {
        self.layers(inputs).map(|[inputs, outputs]| (inputs + 1) * outputs).sum()
    }
}

/// A network ready to be evaluated.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionNetwork {
    layers: Vec<Layer>,
}

#[derive(Debug, Clone, PartialEq)]
struct Layer {
    /// Rows, one an input, padded.
    matrix: Vec<f32>,
    /// Padded.
    bias: Vec<f32>,
}

impl PositionNetwork {
    /// Of a checked configuration and as many parameters as it has.
    pub(crate) fn new(config: &PositionConfig, inputs: usize, parameters: &[f32]) -> PositionNetwork {
        let mut rest = parameters;
        let mut layer = |[inputs, outputs]: [usize; 2]| {
            let (own, after) = rest.split_at((inputs + 1) * outputs);
            rest = after;
            let padded = outputs.next_multiple_of(LANES);
            let row = |row: &[f32]| (0..padded).map(|k| row.get(k).copied().unwrap_or(0.0)).collect::<Vec<f32>>();
            let mut rows = own.chunks_exact(outputs).map(row);
            let matrix = rows.by_ref().take(inputs).flatten().collect();
            Layer { matrix, bias: rows.flatten().collect() }
        };
        PositionNetwork { layers: config.layers(inputs).map(&mut layer).collect() }
    }

    /// Output in units of the network at a place in ±1.
    pub fn evaluate(&self, place: &[f32]) -> Vector3<f64> {
        wide((self, place))
    }
}

impl Loops for (&PositionNetwork, &[f32]) {
    type Output = Vector3<f64>;

    #[inline(always)]
    fn run(self) -> Vector3<f64> {
        let (network, place) = self;
        let [first, hidden @ .., last] = network.layers.as_slice() else { return Vector3::zeros() };
        let (mut x, mut inner, mut step) = ([0.0; WIDEST], [0.0; WIDEST], [0.0; WIDEST]);
        let width = first.apply(place, &mut x);
        for block in hidden.chunks_exact(2) {
            block[0].apply(&x[..width], &mut inner);
            inner[..width].iter_mut().for_each(|value| *value = value.max(0.0));
            block[1].apply(&inner[..width], &mut step);
            x[..width].iter_mut().zip(&step).for_each(|(x, step)| *x += step);
        }
        last.apply(&x[..width], &mut inner);
        Vector3::from_fn(|k, _| f64::from(inner[k]))
    }
}

impl Layer {
    /// y = x W + b for the inputs that the matrix has rows for; gives the padded length of y.
    #[inline(always)]
    fn apply(&self, x: &[f32], y: &mut [f32; WIDEST]) -> usize {
        let padded = self.bias.len();
        for (start, y) in (0..padded).step_by(LANES).zip(y.chunks_exact_mut(LANES)) {
            let mut sums = [0.0; LANES];
            sums.copy_from_slice(&self.bias[start..start + LANES]);
            for (row, factor) in self.matrix.chunks_exact(padded).zip(x) {
                let row = &row[start..start + LANES];
                for lane in 0..LANES {
                    sums[lane] += factor * row[lane];
                }
            }
            y.copy_from_slice(&sums);
        }
        padded
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Single precision through some hundred additions.
    const TOLERANCE: f64 = 3e-6;

    /// The network as printed, in double precision.
    fn printed(config: &PositionConfig, parameters: &[f32], place: &[f32]) -> Vector3<f64> {
        let mut at = 0;
        let mut layer = |x: &[f64], [inputs, outputs]: [usize; 2]| -> Vec<f64> {
            let weight = |i: usize, o: usize| f64::from(parameters[at + i * outputs + o]);
            let y = (0..outputs).map(|o| (0..inputs).map(|i| x[i] * weight(i, o)).sum::<f64>() + weight(inputs, o));
            let y = y.collect();
            at += (inputs + 1) * outputs;
            y
        };
        let layers: Vec<_> = config.layers(place.len()).collect();
        let mut x = layer(&place.iter().map(|p| f64::from(*p)).collect::<Vec<_>>(), layers[0]);
        for block in layers[1..layers.len() - 1].chunks_exact(2) {
            let hidden: Vec<f64> = layer(&x, block[0]).into_iter().map(|v| v.max(0.0)).collect();
            x = x.iter().zip(layer(&hidden, block[1])).map(|(x, step)| x + step).collect();
        }
        Vector3::from_column_slice(&layer(&x, layers[layers.len() - 1]))
    }

    #[test]
    fn loops_in_registers_give_the_printed_network() {
        for (width, blocks, inputs) in [(64, 3, 3), (32, 3, 3), (5, 1, 6), (1, 2, 3), (128, 16, 16)] {
            let config = PositionConfig { width, blocks };
            let mut random = ChaCha8Rng::seed_from_u64(width as u64);
            let bound = 1.0 / (width as f32).sqrt();
            let parameters: Vec<f32> =
                (0..config.parameters(inputs)).map(|_| random.random_range(-bound..bound)).collect();
            let network = PositionNetwork::new(&config, inputs, &parameters);
            for _ in 0..20 {
                let place: Vec<f32> = (0..inputs).map(|_| random.random_range(-1.0..1.0)).collect();
                let (found, expected) = (network.evaluate(&place), printed(&config, &parameters, &place));
                assert_eq!(found, (&network, place.as_slice()).run());
                assert!(
                    (found - expected).norm() < TOLERANCE * expected.norm().max(1.0),
                    "{width}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn sizes_out_of_range_are_refused() {
        for (width, blocks) in [(0, 3), (129, 3), (32, 0), (32, 17)] {
            assert!(PositionConfig { width, blocks }.check().is_err(), "{width} {blocks}");
        }
        assert_eq!(PositionConfig::default().check(), Ok(()));
    }
}
