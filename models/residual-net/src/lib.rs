//! The residual network as it runs, live and offline: what geometry leaves, predicted from measured residuals nearby.
//!
//! Place in the flow: trained parameters and calibrated points in ([`ResidualModel`]), residual of any point (m, machine
//! frame, actual − corrected so far) with its covariance out. A point is a list of inputs: the position, or whatever was named. No framework: plain loops, the same bits everywhere.
//!
//! The calibrated points are the lattice. A target is any other point: in training, a measured point that is taken out
//! of the lattice together with what lies around it, so that no target ever sees itself.
//!
//! The simplest model, kriging alone, on residuals at the points of a grid, and what it says between them:
//!
//! ```
//! use abbe_field::kriging::{Kernel, Noise, KrigingOptions, Trend, fitted};
//! use abbe_field::{MeasuredField, Samples};
//! use abbe_residual_net::{Calibration, ResidualMethod, Kriging, Parts, ResidualModel};
//! use nalgebra::Vector3;
//!
//! let bent = |p: &Vector3<f64>| Vector3::new((3.0 * p.y).sin(), (2.0 * p.x).cos(), (p.x + 2.0 * p.z).sin()) * 1e-6;
//! let grid = |k: i32| Vector3::new(f64::from(k % 4), f64::from(k / 4 % 4), f64::from(k / 16)) * 0.2;
//! let points_m: Vec<_> = (0..64).map(grid).collect();
//! let residuals_m = points_m.iter().map(bent).collect();
//! let field = Samples::from(&MeasuredField::new(points_m, residuals_m, None)?);
//!
//! let options = KrigingOptions { kernel: Kernel::Matern52, trend: Trend::Constant, noise: Noise::Fitted };
//! let fit = fitted(&field, &options)?;
//! let kriging = Kriging::from_fit(&fit, options.kernel, &field, &Vector3::repeat(1.0)).expect("points apart");
//! let model = ResidualModel::new(Parts {
//!     kind: ResidualMethod::Kriging,
//!     field,
//!     scale: vec![1.0; 3],
//!     kriging,
//!     ensemble: None,
//!     trend: None,
//!     calibration: Calibration::none(),
//! })?;
//! let at = Vector3::new(0.3, 0.25, 0.1);
//! let predicted = model.predict(at.as_slice());
//! assert!(predicted.inside && (predicted.residual_m - bent(&at)).norm() < 0.1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod calibrated_points;
mod calibration;
mod exponential;
mod kind;
mod kriging;
mod model;
mod neighbourhood;
pub mod network;
pub mod record;
mod registers;
mod supporting_planes;
mod trend;

pub use calibrated_points::CalibratedPoints;
pub use calibration::{Calibration, NORMAL_95};
pub use kind::ResidualMethod;
pub use kriging::{Component, Kriging, KrigingMean};
pub use model::{Apart, At, Ensemble, ModelError, Parts, ResidualModel, check_units};
pub use neighbourhood::{Neighbourhood, VERTICES, Vertices, spacing};
pub use trend::{Place, PositionEnsemble, Trend, TrendError, place, place_box};
