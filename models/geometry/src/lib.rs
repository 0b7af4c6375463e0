//! Chain of linear axes as data, error functions, effects, and the one function that corrects a coordinate.
//!
//! Place in the flow: `identify` fills a [`model::MachineModel`]; the live nodes, `abbe correct` and the monitor
//! evaluate it through [`correct::correct`] and nothing else. Everything here is SI (m, rad) in the machine
//! frame; error = actual − indicated. Pure numerics: no file, no clock, no ROS.

pub mod axis;
pub mod between_nodes;
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
pub mod predict;
pub mod residual_field;
pub mod rotation;
pub mod sampled;
pub mod seen;
mod sensitivity;
mod travelled;
pub mod volumetric;

pub use axis::{Axis, ErrorId};
pub use nalgebra::{Matrix3, Vector3};
