//! Frames for `/tf` and `/tf_static`: where one stands in another.
//!
//! Place in the flow: made by a node's gateway, of samples or of the machine file. Metres; orientations of length 1.

use serde::{Deserialize, Serialize};

use super::Header;
use crate::{RosType, Stamp};

/// A direction with a length.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Vector3 {
    /// X.
    pub x: f64,
    /// Y.
    pub y: f64,
    /// Z.
    pub z: f64,
}

impl RosType for Vector3 {
    const ROS_TYPE: &'static str = "geometry_msgs/msg/Vector3";
}

impl From<[f64; 3]> for Vector3 {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}

/// An orientation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Quaternion {
    /// X.
    pub x: f64,
    /// Y.
    pub y: f64,
    /// Z.
    pub z: f64,
    /// W.
    pub w: f64,
}

impl Default for Quaternion {
    /// Not turned.
    fn default() -> Self {
        Self { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }
    }
}

impl RosType for Quaternion {
    const ROS_TYPE: &'static str = "geometry_msgs/msg/Quaternion";
}

/// From one frame to another.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Transform {
    /// Metres.
    pub translation: Vector3,
    /// Orientation.
    pub rotation: Quaternion,
}

impl RosType for Transform {
    const ROS_TYPE: &'static str = "geometry_msgs/msg/Transform";
}

/// Where the frame `child_frame_id` stands in the frame of the header.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TransformStamped {
    /// Instant, and the frame that the other stands in.
    pub header: Header,
    /// The other frame.
    pub child_frame_id: String,
    /// Where it stands.
    pub transform: Transform,
}

impl TransformStamped {
    /// A frame that is moved and not turned (m).
    #[must_use]
    pub fn at(stamp: Stamp, frame_id: &str, child_frame_id: &str, translation_m: [f64; 3]) -> Self {
        let transform = Transform { translation: translation_m.into(), rotation: Quaternion::default() };
        Self { header: Header::new(stamp, frame_id), child_frame_id: child_frame_id.to_owned(), transform }
    }
}

impl RosType for TransformStamped {
    const ROS_TYPE: &'static str = "geometry_msgs/msg/TransformStamped";
}

/// Several frames.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TfMessage {
    /// The frames.
    pub transforms: Vec<TransformStamped>,
}

impl RosType for TfMessage {
    const ROS_TYPE: &'static str = "tf2_msgs/msg/TFMessage";
}
