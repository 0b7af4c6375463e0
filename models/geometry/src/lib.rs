//! Chain of linear axes as data, error functions, effects, and the one function that corrects a coordinate.
//!
//! Place in the flow: `identify` fills a [`model::MachineModel`]; the live nodes, `abbe correct` and the monitor
//! evaluate it through [`correct::correct`] and nothing else. Everything here is SI (m, rad) in the machine
//! frame; error = actual − indicated. Pure numerics: no file, no clock, no ROS.
//!
//! A spline of nine intervals over a stroke of 0.8 m, with what its coefficients do to the error at a scale reading:
//!
//! ```
//! use abbe_geometry::error_function::{Basis, Closure, FunctionKind};
//!
//! let basis = Basis::new(FunctionKind::BSpline { intervals: 9 }, Closure::Origin, 0.0, 0.8)?;
//! let coefficients_m: Vec<f64> = (0..basis.len()).map(|k| 1e-6 * k as f64).collect();
//! let error_m = basis.at(0.4).dot(&coefficients_m);
//! assert!(basis.at(0.0).dot(&coefficients_m).abs() < 1e-15, "errors are zero at the lower end of the stroke");
//! assert!(error_m > 0.0 && error_m < 12e-6);
//! # Ok::<(), abbe_geometry::error_function::BasisError>(())
//! ```

pub mod axis;
pub mod between_nodes;
pub mod by_place;
pub mod chain;
pub mod correct;
mod doubt;
pub mod effects;
pub mod error_function;
mod lagged;
pub mod layout;
#[cfg(test)]
mod logged;
pub mod machine;
pub mod mixture;
pub mod model;
mod model_error;
mod packed;
pub mod predict;
pub mod residual_field;
pub mod rotation;
pub mod sampled;
pub mod seen;
mod sensitivity;
mod travelled;
pub mod unseen_expansion;
mod usual;
pub mod volumetric;

pub use axis::{Axis, ErrorId};
pub use nalgebra::{Matrix3, Vector3};
