//! What an instrument sees: tracer campaigns and the uncertainty of their ranges, positioning runs, residual vectors, spheres, probes,
//! guideways.
//!
//! Place in the flow: files and bags are read into a [`campaign::Campaign`]; identification, the monitor and
//! the simulator share that one form. Pure data and numerics: no file, no clock, no ROS.
//!
//! Points in a frame of their own beside a reference, and what no rotation and translation removes:
//!
//! ```
//! use abbe_measurement::alignment::aligned_residuals_m;
//! use nalgebra::{Rotation3, Vector3};
//!
//! let reference_m = [[0.0, 0.0, 0.0], [0.8, 0.0, 0.0], [0.0, 0.6, 0.0], [0.0, 0.0, 0.6]].map(Vector3::from);
//! let turned = Rotation3::from_euler_angles(0.3, -0.2, 1.1);
//! let mut points_m = reference_m.map(|p| turned * p + Vector3::new(1.0, 2.0, 3.0));
//! points_m[1] += turned * Vector3::new(4e-6, 0.0, 0.0);
//! let left_m = aligned_residuals_m(&points_m, &reference_m)?;
//! let rms_m = (left_m.iter().map(Vector3::norm_squared).sum::<f64>() / 4.0).sqrt();
//! assert!(rms_m > 0.5e-6 && rms_m < 4e-6);
//! # Ok::<(), abbe_measurement::alignment::AlignmentError>(())
//! ```

pub mod alignment;
pub mod campaign;
pub mod chance;
pub mod claim;
pub mod common_step;
pub mod correspondence;
pub mod growing_station;
pub mod guideway;
pub mod instrument;
mod least_squares;
pub mod motion;
pub mod multilateration;
pub mod network;
pub mod planned;
pub mod positioning;
pub mod probe_pose;
pub mod residual_vector;
pub mod robust;
pub mod sphere;
pub mod standstill;
pub mod station_start;
pub mod steady_mean;
pub mod subset;
pub mod tracker;
