//! Trainable parameters as one array, and where each matrix stands in it.
//!
//! Place in the flow: training hands them over, the artifact keeps them, the forward pass reads them. Matrices are
//! row-major `[inputs, outputs]`, a token is a row: y = x W + b. With d the width and F the size of a token, in this order:
//!
//! | part | shape | equation |
//! |---|---|---|
//! | `embedding` | F × d | linear layer before eq. 16 |
//! | `embedding_bias` | d | |
//! | `query`, `key`, `value` | d × d each; head h owns columns h·d_k .. (h+1)·d_k | 16 |
//! | `mixing`, W_o | d × d | 19 |
//! | `mixing_bias`, b_o | d | 19 |
//! | `output` | 8·d × 3, tokens one after the other | output layer |
//! | `output_bias` | 3 | |

use super::config::NetworkConfig;
use super::tokens::token_size;
use crate::neighbourhood::VERTICES;
use std::ops::Range;
use thiserror::Error;

/// Where each matrix stands.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    /// Linear layer, F × d.
    pub embedding: Range<usize>,
    /// Its bias, d.
    pub embedding_bias: Range<usize>,
    /// Queries of all heads, d × d.
    pub query: Range<usize>,
    /// Keys, d × d.
    pub key: Range<usize>,
    /// Values, d × d.
    pub value: Range<usize>,
    /// W_o, d × d.
    pub mixing: Range<usize>,
    /// b_o, d.
    pub mixing_bias: Range<usize>,
    /// Output layer, 8·d × 3.
    pub output: Range<usize>,
    /// Its bias, 3.
    pub output_bias: Range<usize>,
}

impl Layout {
    /// Layout of a network of this width on so many inputs.
    pub fn new(width: usize, inputs: usize) -> Layout {
        let mut end = 0;
        let mut next = |length: usize| {
            let start = end;
            end += length;
            start..end
        };
        Layout {
            embedding: next(token_size(inputs) * width),
            embedding_bias: next(width),
            query: next(width * width),
            key: next(width * width),
            value: next(width * width),
            mixing: next(width * width),
            mixing_bias: next(width),
            output: next(VERTICES * width * 3),
            output_bias: next(3),
        }
    }

    /// Number of parameters.
    pub fn len(&self) -> usize {
        self.output_bias.end
    }

    /// Never: every network has parameters.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Parameters that do not fit the network.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ParametersError {
    /// Too few or too many.
    #[error("{found} parameters, but a network of width {width} has {expected}; the file is from another layout")]
    Length {
        /// Number found.
        found: usize,
        /// Number that fits.
        expected: usize,
        /// Width of the network.
        width: usize,
    },
    /// A number that is none.
    #[error("parameter {0} is not a finite number; train again")]
    NotFinite(usize),
}

/// Checked parameters of one network.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    inputs: usize,
    values: Vec<f32>,
}

impl Parameters {
    /// Parameters in the order of [`Layout`], of a network on so many inputs.
    pub fn new(config: &NetworkConfig, inputs: usize, values: Vec<f32>) -> Result<Parameters, ParametersError> {
        let expected = Layout::new(config.width, inputs).len();
        if values.len() != expected {
            return Err(ParametersError::Length { found: values.len(), expected, width: config.width });
        }
        match values.iter().position(|v| !v.is_finite()) {
            Some(index) => Err(ParametersError::NotFinite(index)),
            None => Ok(Parameters { inputs, values }),
        }
    }

    /// Inputs of the network.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// All of them.
    pub fn values(&self) -> &[f32] {
        &self.values
    }
}
