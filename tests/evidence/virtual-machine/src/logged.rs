//! What is logged beside every simulated reading.
//!
//! Place in the flow: columns of campaigns and points, and what effects may ask for. In the unit of the names.

use crate::environment::SENSOR_NAMES;

/// Names of the motion's covariates; those of the sensors follow, see [`covariate_names`].
const MOTION_NAMES: [&str; 8] =
    ["dir_x", "dir_y", "dir_z", "speed_mm_s", "acc_x_mm_s2", "acc_y_mm_s2", "acc_z_mm_s2", "load_kg"];

/// Names of the covariates in the order of [`crate::SimulatedReading::covariates`].
pub fn covariate_names() -> impl Iterator<Item = &'static str> {
    MOTION_NAMES.into_iter().chain(SENSOR_NAMES)
}
