//! What an instrument sees: tracer campaigns and the uncertainty of their ranges, spheres, probes, guideways.
//!
//! Place in the flow: files and bags are read into a [`campaign::Campaign`]; identification, the monitor and
//! the simulator share that one form. Pure data and numerics: no file, no clock, no ROS.

pub mod alignment;
pub mod campaign;
pub mod correspondence;
pub mod growing_station;
pub mod guideway;
pub mod instrument;
mod least_squares;
pub mod motion;
pub mod multilateration;
pub mod network;
pub mod probe_pose;
pub mod robust;
pub mod sphere;
pub mod standstill;
pub mod station_start;
pub mod steady_mean;
pub mod subset;
pub mod tracker;
