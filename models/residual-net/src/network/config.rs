//! Sizes and switches of the network.
//!
//! Place in the flow: from a training configuration into training, artifact and forward pass. The switches are the
//! ablations: what does the network lose without one of its parts?

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Widths above this are refused: the network would have more parameters than a campaign has readings.
const LARGEST_WIDTH: usize = 1024;

/// Configuration of the network. Sizes and σ are not printed in the paper.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NetworkConfig {
    /// Length of an embedded token, d_model.
    pub width: usize,
    /// Attention heads; they divide the width.
    pub heads: usize,
    /// σ of eq. 15. Distances are counted in spacings of the calibrated points, so σ has no unit: with the spacing a and the
    /// distance d (m), w = exp(−(d/a)/(2σ²)).
    pub sigma: f64,
    /// Self-attention; without it each token keeps its own value (Z = V).
    pub attention: bool,
    /// Weights of eq. 15; without them w = 1.
    pub weighting: bool,
    /// Position of each vertex relative to the target, in spacings; without it zeros.
    pub position: bool,
}

impl Default for NetworkConfig {
    fn default() -> NetworkConfig {
        NetworkConfig { width: 64, heads: 4, sigma: 1.0, attention: true, weighting: true, position: true }
    }
}

/// A configuration that no network can be made of.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ConfigError {
    /// Width out of range.
    #[error("width is {0}; give 1 to {LARGEST_WIDTH}")]
    Width(usize),
    /// Heads do not divide the width.
    #[error("heads is {heads}, which does not divide the width {width}")]
    Heads {
        /// Heads.
        heads: usize,
        /// Width.
        width: usize,
    },
    /// σ is not above zero.
    #[error("sigma is {0}; give a number above zero, in spacings of the calibrated points")]
    Sigma(f64),
}

impl NetworkConfig {
    /// Refuses sizes that do not fit each other.
    pub fn check(&self) -> Result<(), ConfigError> {
        if self.width == 0 || self.width > LARGEST_WIDTH {
            return Err(ConfigError::Width(self.width));
        }
        if self.heads == 0 || !self.width.is_multiple_of(self.heads) {
            return Err(ConfigError::Heads { heads: self.heads, width: self.width });
        }
        if !(self.sigma.is_finite() && self.sigma > 0.0) {
            return Err(ConfigError::Sigma(self.sigma));
        }
        Ok(())
    }

    /// Length of a head's queries and keys, d_k.
    pub fn head_width(&self) -> usize {
        self.width / self.heads
    }
}
