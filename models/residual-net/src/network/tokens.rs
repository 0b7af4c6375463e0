//! What the network sees of a target: one token for each vertex of its cell.
//!
//! Place in the flow: vertices and their residuals (m) in, normalised tokens out; the same function in training and live.
//! Token i = (w_i (r_i − r̄)/s, (p_i − p_t)/a), with w_i = exp(−‖p_i − p_t‖/(2σ²)) as printed in eq. 15 (norm not squared),
//! the norm in spacings a. r̄ and s are mean and standard deviation of the residuals, component by component.

use super::config::NetworkConfig;
use crate::neighbourhood::{VERTICES, Vertices};
use nalgebra::Vector3;

/// Numbers of a token: weighted residual, relative position.
pub const TOKEN_SIZE: usize = 6;

/// One token.
pub type Token = [f32; TOKEN_SIZE];

/// Brings residuals and distances to the order of one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Normaliser {
    /// Mean of the residuals (m).
    pub mean_m: Vector3<f64>,
    /// Their standard deviation (m), above zero.
    pub scale_m: Vector3<f64>,
    /// Spacing of the calibrated points (m), above zero.
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

/// Tokens of a target (m, machine frame); `normalised` are the residuals of all calibrated points after
/// [`Normaliser::normalise`].
pub fn tokens(
    config: &NetworkConfig,
    normaliser: &Normaliser,
    target_m: &Vector3<f64>,
    vertices: &Vertices,
    points_m: &[Vector3<f64>],
    normalised: &[Vector3<f64>],
) -> [Token; VERTICES] {
    vertices.index.map(|index| {
        let relative = (points_m[index] - target_m) / normaliser.spacing_m;
        let weight =
            if config.weighting { (-relative.norm() / (2.0 * config.sigma * config.sigma)).exp() } else { 1.0 };
        let residual = normalised[index] * weight;
        let position = if config.position { relative } else { Vector3::zeros() };
        [residual.x, residual.y, residual.z, position.x, position.y, position.z].map(|value| value as f32)
    })
}
