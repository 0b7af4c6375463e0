//! The place for a residual field: what is left after geometry and effects, learnt from data.
//!
//! Place in the flow: the residual node and `abbe correct` add it after the geometric part through
//! [`crate::correct::add_residual`]. Any field (network, kriging, table) implements this trait.

use nalgebra::{Matrix3, Vector3};

/// What a residual field says about one point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResidualPrediction {
    /// Residual error (actual − corrected so far) at tip or reflector (m, machine frame).
    pub residual_m: Vector3<f64>,
    /// Its covariance (m²).
    pub covariance_m2: Matrix3<f64>,
    /// False where the point lies outside what the field was made from.
    pub inside: bool,
}

/// A residual field over the working volume.
pub trait ResidualField: Send + Sync {
    /// Residual at a geometrically corrected point (m, machine frame).
    fn predict(&self, point_in_machine_m: &Vector3<f64>) -> ResidualPrediction;

    /// SHA-256 of the artifact the field was loaded from.
    fn sha256(&self) -> [u8; 32];
}
