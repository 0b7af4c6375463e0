//! What the network sees of a target: one token for each vertex of its cell.
//!
//! Place in the flow: vertices and their residuals (m) in, normalised tokens out; the same function in training and live.
//! Token i = (w_i (r_i − r̄)/s, (p_i − p_t)/a), with w_i = exp(−‖p_i − p_t‖/(2σ²)) as printed in eq. 15 (norm not squared),
//! the norm in spacings a. p are the scaled inputs: the position, or up to [`MOST_NEIGHBOURED`] of any kind. r̄ and s are mean and standard deviation of the residuals, component by component.

use super::config::NetworkConfig;
use crate::neighbourhood::{VERTICES, Vertices};
use nalgebra::Vector3;

/// Inputs of a network on the neighbourhood at most: eight neighbours tell little in more directions, and so many go into the
/// registers.
pub const MOST_NEIGHBOURED: usize = 4;
/// Numbers of a residual.
const RESIDUAL: usize = 3;

/// One token: weighted residual, relative inputs; what is left over is zero.
pub type Token = [f32; RESIDUAL + MOST_NEIGHBOURED];

/// Numbers of a token of so many inputs.
pub fn token_size(inputs: usize) -> usize {
    RESIDUAL + inputs
}

/// Brings residuals and distances to the order of one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Normaliser {
    /// Mean of the residuals (m).
    pub mean_m: Vector3<f64>,
    /// Their standard deviation (m), above zero.
    pub scale_m: Vector3<f64>,
    /// Spacing of the calibrated points in scaled inputs (m for positions), above zero.
    pub spacing_m: f64,
}

impl Normaliser {
    /// A residual (m) in units of the network.
    pub fn normalise(&self, residual_m: &Vector3<f64>) -> Vector3<f64> {
        (residual_m - self.mean_m).component_div(&self.scale_m)
    }

    /// Back to metres.
    pub fn restore(&self, output: &Vector3<f64>) -> Vector3<f64> {
        output.component_mul(&self.scale_m) + self.mean_m
    }
}

/// Tokens of a target; it and the calibrated `points`, one after the other, in scaled inputs; `normalised` are the residuals of all
/// calibrated points after [`Normaliser::normalise`].
pub fn tokens(
    config: &NetworkConfig,
    normaliser: &Normaliser,
    target: &[f64],
    vertices: &Vertices,
    points: &[f64],
    normalised: &[Vector3<f64>],
) -> [Token; VERTICES] {
    let size = target.len();
    vertices.index.map(|index| {
        let (mut token, mut relative) = ([0.0; RESIDUAL + MOST_NEIGHBOURED], [0.0; MOST_NEIGHBOURED]);
        for (relative, (at, target)) in relative.iter_mut().zip(points[index * size..].iter().zip(target)) {
            *relative = (at - target) / normaliser.spacing_m;
        }
        let distance = relative.iter().map(|d| d * d).sum::<f64>().sqrt();
        let weight = if config.weighting { (-distance / (2.0 * config.sigma * config.sigma)).exp() } else { 1.0 };
        for (part, residual) in token.iter_mut().zip((normalised[index] * weight).iter()) {
            *part = *residual as f32;
        }
        for (part, relative) in token[RESIDUAL..].iter_mut().zip(relative).filter(|_| config.position) {
            *part = relative as f32;
        }
        token
    })
}
