//! Residual vectors: what a model leaves unexplained at measured points, from whatever was measured there.
//!
//! Place in the flow: model and campaign (SI, machine frame) in; at each point the residual, actual − corrected (m),
//! with its covariance (m²) out, for training of a residual field. A point that several stations saw has its residual
//! by multilateration ([`shared_points`]); where stations measured different points, each range only tells the
//! component along its line of sight, and the vector field is estimated from all of them ([`from_ranges`]); points whose
//! actual position is known need neither ([`from_known_points`]). Pure numerics.
//!
//! A grid of corrected points, where another instrument says they are in a frame of its own, and what is left of each:
//!
//! ```
//! use abbe_residual_data::from_known_points;
//! use nalgebra::{Rotation3, Vector3};
//!
//! let grid = |k: i32| Vector3::new(f64::from(k % 3), f64::from(k / 3 % 3), f64::from(k / 9)) * 0.3;
//! let corrected_m: Vec<_> = (0..27).map(grid).collect();
//! let mut actual_m = corrected_m.clone();
//! // In the middle the tip stands 2 µm higher than the model says.
//! actual_m[13].z += 2e-6;
//! let turned = Rotation3::from_euler_angles(0.3, -0.2, 1.1);
//! let in_reference_m: Vec<_> = actual_m.iter().map(|p| turned * p + Vector3::new(1.0, 2.0, 3.0)).collect();
//! let left = from_known_points(&corrected_m, &in_reference_m, Some(Vector3::repeat(0.3e-6)))?;
//! // One of 27 points: the frame takes as little of it.
//! assert!((left[13].residual_m.z - 2e-6).abs() < 0.1e-6);
//! assert!(left[0].residual_m.norm() < 0.1e-6 && left[0].covariance_m2.is_some());
//! # Ok::<(), abbe_residual_data::ResidualError>(())
//! ```

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
pub use ranges::{FromRanges, Progress, RangeOptions, from_ranges};
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
