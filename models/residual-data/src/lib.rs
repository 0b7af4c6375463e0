//! Residual vectors: what a model leaves unexplained at measured points, from whatever was measured there.
//!
//! Place in the flow: model and campaign (SI, machine frame) in; at each point the residual, actual − corrected (m),
//! with its covariance (m²) out, for training of a residual field. A point that several stations saw has its residual
//! by multilateration ([`shared_points`]); where stations measured different points, each range only tells the
//! component along its line of sight, and the vector field is estimated from all of them ([`from_ranges`]); points whose
//! actual position is known need neither ([`from_known_points`]). Pure numerics.

mod error;
mod evidence;
mod known_points;
mod network;
mod problem;
mod ranges;
mod search;
mod shared;

pub use error::ResidualError;
pub use evidence::FieldPrior;
pub use known_points::from_known_points;
pub use ranges::{FromRanges, Options, Progress, from_ranges};
pub use shared::{Frame, SharedPoints, shared_points};

use nalgebra::{Matrix3, Vector3};

/// What a model leaves unexplained at one measured point.
#[derive(Debug, Clone, PartialEq)]
pub struct PointResidual {
    /// Row of the data that this point stands for (the first where there are several).
    pub row: usize,
    /// Corrected position (m, machine frame).
    pub point_m: Vector3<f64>,
    /// Actual − corrected (m, machine frame).
    pub residual_m: Vector3<f64>,
    /// Its covariance (m²); `None` where nobody knows it.
    pub covariance_m2: Option<Matrix3<f64>>,
}
