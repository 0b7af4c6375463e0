//! Shapes to look at, as RViz and Foxglove draw them.
//!
//! Place in the flow: made by a node's gateway of corrected samples. Metres in the frame of the header; colours from 0
//! to 1. The parts of a marker that nothing here uses (textures, meshes) are there because they are on the wire.

use serde::{Deserialize, Serialize};

use super::{Header, Point, Quaternion, Vector3};
use crate::RosType;

/// A span of time: `sec + nanosec / 1e9`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Duration {
    /// Whole seconds.
    pub sec: i32,
    /// Nanoseconds, below one second.
    pub nanosec: u32,
}

impl RosType for Duration {
    const ROS_TYPE: &'static str = "builtin_interfaces/msg/Duration";
}

/// A colour.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct ColorRgba {
    /// Red.
    pub r: f32,
    /// Green.
    pub g: f32,
    /// Blue.
    pub b: f32,
    /// 1 is opaque.
    pub a: f32,
}

impl RosType for ColorRgba {
    const ROS_TYPE: &'static str = "std_msgs/msg/ColorRGBA";
}

/// Position and orientation.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Metres.
    pub position: Point,
    /// Orientation.
    pub orientation: Quaternion,
}

impl RosType for Pose {
    const ROS_TYPE: &'static str = "geometry_msgs/msg/Pose";
}

/// A compressed picture; here always empty.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CompressedImage {
    /// Instant and frame.
    pub header: Header,
    /// How it is compressed.
    pub format: String,
    /// Its bytes.
    pub data: Vec<u8>,
}

impl RosType for CompressedImage {
    const ROS_TYPE: &'static str = "sensor_msgs/msg/CompressedImage";
}

/// A place in a texture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct UvCoordinate {
    /// Along it.
    pub u: f32,
    /// Across it.
    pub v: f32,
}

impl RosType for UvCoordinate {
    const ROS_TYPE: &'static str = "visualization_msgs/msg/UVCoordinate";
}

/// A mesh as a file; here always empty.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MeshFile {
    /// Its name.
    pub filename: String,
    /// Its bytes.
    pub data: Vec<u8>,
}

impl RosType for MeshFile {
    const ROS_TYPE: &'static str = "visualization_msgs/msg/MeshFile";
}

/// A shape.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Marker {
    /// Instant and frame.
    pub header: Header,
    /// With `id` the name of the shape.
    pub ns: String,
    /// Its number under that name.
    pub id: i32,
    /// [`Marker::ARROW`], `LINE_LIST` or `TEXT_VIEW_FACING`.
    #[serde(rename = "type")]
    pub kind: i32,
    /// [`Marker::ADD`] or `DELETE`.
    pub action: i32,
    /// Where it stands.
    pub pose: Pose,
    /// How large it is (m), by kind.
    pub scale: Vector3,
    /// Its colour.
    pub color: ColorRgba,
    /// How long it is shown; zero is for ever.
    pub lifetime: Duration,
    /// Whether it moves with its frame.
    pub frame_locked: bool,
    /// Of an arrow, its ends; of a list of lines, theirs by twos (m).
    pub points: Vec<Point>,
    /// A colour a point, or none.
    pub colors: Vec<ColorRgba>,
    /// Unused.
    pub texture_resource: String,
    /// Unused.
    pub texture: CompressedImage,
    /// Unused.
    pub uv_coordinates: Vec<UvCoordinate>,
    /// Of a text, its words.
    pub text: String,
    /// Unused.
    pub mesh_resource: String,
    /// Unused.
    pub mesh_file: MeshFile,
    /// Unused.
    pub mesh_use_embedded_materials: bool,
}

impl Marker {
    /// An arrow from the first of its points to the second.
    pub const ARROW: i32 = 0;
    /// A line between each two of its points.
    pub const LINE_LIST: i32 = 5;
    /// Words that face who looks.
    pub const TEXT_VIEW_FACING: i32 = 9;
    /// Shown, or changed.
    pub const ADD: i32 = 0;
    /// Shown no more.
    pub const DELETE: i32 = 2;

    /// A shape of this instant and frame that is still to be made.
    #[must_use]
    pub fn new(header: Header) -> Self {
        Self { header, ..Self::default() }
    }
}

impl RosType for Marker {
    const ROS_TYPE: &'static str = "visualization_msgs/msg/Marker";
}

/// Several shapes.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct MarkerArray {
    /// The shapes.
    pub markers: Vec<Marker>,
}

impl RosType for MarkerArray {
    const ROS_TYPE: &'static str = "visualization_msgs/msg/MarkerArray";
}
