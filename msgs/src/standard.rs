//! The standard ROS 2 messages that are published beside this project's own, so that RViz,
//! PlotJuggler and Foxglove work at once.
//!
//! Place in the flow: made from samples right before they leave for DDS or a bag; never read back
//! by a node. Fields in the order of `msg_standard/`, units SI, frames in `header.frame_id`.

mod frames;
mod from_samples;
mod lifecycle;
mod log;
mod markers;
mod sensors;

use serde::{Deserialize, Serialize};

pub use frames::{Quaternion, TfMessage, Transform, TransformStamped, Vector3};
pub use lifecycle::{State, Transition, TransitionEvent};
pub use log::Log;
pub use markers::{ColorRgba, CompressedImage, Duration, Marker, MarkerArray, MeshFile, Pose, UvCoordinate};
pub use sensors::{Float64, FluidPressure, Range, RelativeHumidity, Temperature};

use crate::{MessageError, RosType, Stamp};

/// An instant: `sec + nanosec / 1e9`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Time {
    /// Whole seconds, rounded down.
    pub sec: i32,
    /// Nanoseconds after `sec`, below one second.
    pub nanosec: u32,
}

impl Time {
    /// The checked stamp of this time.
    ///
    /// # Errors
    /// When `nanosec` is a second or more.
    pub fn to_stamp(self) -> Result<Stamp, MessageError> {
        Stamp::new(self.sec, self.nanosec)
    }
}

impl From<Stamp> for Time {
    fn from(stamp: Stamp) -> Self {
        Self { sec: stamp.sec(), nanosec: stamp.nanosec() }
    }
}

impl RosType for Time {
    const ROS_TYPE: &'static str = "builtin_interfaces/msg/Time";
}

/// Stamp and frame of a message.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// Instant the data belongs to.
    pub stamp: Time,
    /// Frame the data is in.
    pub frame_id: String,
}

impl Header {
    /// The header of this instant and frame.
    #[must_use]
    pub fn new(stamp: Stamp, frame_id: &str) -> Self {
        Self { stamp: stamp.into(), frame_id: frame_id.to_owned() }
    }
}

impl RosType for Header {
    const ROS_TYPE: &'static str = "std_msgs/msg/Header";
}

/// The time that nodes with `use_sim_time` go by.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Clock {
    /// The time.
    pub clock: Time,
}

impl RosType for Clock {
    const ROS_TYPE: &'static str = "rosgraph_msgs/msg/Clock";
}

/// A text.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Text {
    /// The text.
    pub data: String,
}

impl RosType for Text {
    const ROS_TYPE: &'static str = "std_msgs/msg/String";
}

/// A position in metres.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// X in metres.
    pub x: f64,
    /// Y in metres.
    pub y: f64,
    /// Z in metres.
    pub z: f64,
}

impl RosType for Point {
    const ROS_TYPE: &'static str = "geometry_msgs/msg/Point";
}

/// A position in metres with stamp and frame.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct PointStamped {
    /// Instant and frame.
    pub header: Header,
    /// Position in metres.
    pub point: Point,
}

impl RosType for PointStamped {
    const ROS_TYPE: &'static str = "geometry_msgs/msg/PointStamped";
}

/// Positions of named joints: metres for linear axes, radians for rotary ones.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct JointState {
    /// Instant of latching.
    pub header: Header,
    /// Names of the axes.
    pub name: Vec<String>,
    /// Positions in metres or radians.
    pub position: Vec<f64>,
    /// Velocities in m/s or rad/s; empty when unknown.
    pub velocity: Vec<f64>,
    /// Efforts in N or N m; empty when unknown.
    pub effort: Vec<f64>,
}

impl RosType for JointState {
    const ROS_TYPE: &'static str = "sensor_msgs/msg/JointState";
}

/// A named value of a diagnostic status, as text.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeyValue {
    /// Name, with the unit as suffix.
    pub key: String,
    /// Value as text.
    pub value: String,
}

impl RosType for KeyValue {
    const ROS_TYPE: &'static str = "diagnostic_msgs/msg/KeyValue";
}

/// Health of one component.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiagnosticStatus {
    /// [`DiagnosticStatus::OK`], `WARN`, `ERROR` or `STALE`.
    pub level: u8,
    /// Name of the component.
    pub name: String,
    /// What is the matter.
    pub message: String,
    /// Name of the hardware.
    pub hardware_id: String,
    /// Figures behind the level.
    pub values: Vec<KeyValue>,
}

impl DiagnosticStatus {
    /// All is well.
    pub const OK: u8 = 0;
    /// Works, but someone should look.
    pub const WARN: u8 = 1;
    /// Does not work.
    pub const ERROR: u8 = 2;
    /// No news for too long.
    pub const STALE: u8 = 3;
}

impl RosType for DiagnosticStatus {
    const ROS_TYPE: &'static str = "diagnostic_msgs/msg/DiagnosticStatus";
}

/// Health of several components, for `/diagnostics`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiagnosticArray {
    /// Instant of the judgement.
    pub header: Header,
    /// One entry a component.
    pub status: Vec<DiagnosticStatus>,
}

impl RosType for DiagnosticArray {
    const ROS_TYPE: &'static str = "diagnostic_msgs/msg/DiagnosticArray";
}
