//! What sensors of others publish: numbers, distances, temperatures, pressures, humidities.
//!
//! Place in the flow: taken by a gateway under the driver `ros`, and made into samples there. Units as ROS 2 has them.

use serde::{Deserialize, Serialize};

use super::Header;
use crate::RosType;

/// A number.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Float64 {
    /// The number.
    pub data: f64,
}

impl RosType for Float64 {
    const ROS_TYPE: &'static str = "std_msgs/msg/Float64";
}

/// A distance.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Range {
    /// Instant, and frame of the sensor.
    pub header: Header,
    /// Kind of the sensor.
    pub radiation_type: u8,
    /// Angle within which something was found (rad).
    pub field_of_view: f32,
    /// Shortest distance that it measures (m).
    pub min_range: f32,
    /// Longest distance that it measures (m).
    pub max_range: f32,
    /// Distance (m).
    pub range: f32,
    /// Variance (m²); 0 is unknown.
    pub variance: f32,
}

impl RosType for Range {
    const ROS_TYPE: &'static str = "sensor_msgs/msg/Range";
}

/// A temperature.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Temperature {
    /// Instant and frame.
    pub header: Header,
    /// Degrees Celsius.
    pub temperature: f64,
    /// Variance; 0 is unknown.
    pub variance: f64,
}

impl RosType for Temperature {
    const ROS_TYPE: &'static str = "sensor_msgs/msg/Temperature";
}

/// A pressure.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FluidPressure {
    /// Instant and frame.
    pub header: Header,
    /// Pascal.
    pub fluid_pressure: f64,
    /// Variance; 0 is unknown.
    pub variance: f64,
}

impl RosType for FluidPressure {
    const ROS_TYPE: &'static str = "sensor_msgs/msg/FluidPressure";
}

/// A relative humidity.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RelativeHumidity {
    /// Instant and frame.
    pub header: Header,
    /// From 0 to 1.
    pub relative_humidity: f64,
    /// Variance; 0 is unknown.
    pub variance: f64,
}

impl RosType for RelativeHumidity {
    const ROS_TYPE: &'static str = "sensor_msgs/msg/RelativeHumidity";
}
