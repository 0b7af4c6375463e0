//! The text of the `.msg` files, which bags embed so that any reader can decode them.
//!
//! Place in the flow: `msg/` and `msg_standard/` -> schemas of the bag writer, and the tests that
//! hold the Rust types to them.

use std::fmt::Write as _;

macro_rules! definitions {
    ($($folder:literal $package:literal $name:literal;)*) => {
        &[$((
            concat!($package, "/msg/", $name),
            include_str!(concat!("../", $folder, "/", $name, ".msg")),
        ),)*]
    };
}

/// Full name and text of every message, ours first.
pub const DEFINITIONS: &[(&str, &str)] = definitions! {
    "msg" "abbe_msgs" "ScaleReading";
    "msg" "abbe_msgs" "TracerReading";
    "msg" "abbe_msgs" "CorrectedCoordinates";
    "msg" "abbe_msgs" "RangeResidual";
    "msg_standard/builtin_interfaces" "builtin_interfaces" "Time";
    "msg_standard/builtin_interfaces" "builtin_interfaces" "Duration";
    "msg_standard/std_msgs" "std_msgs" "Header";
    "msg_standard/std_msgs" "std_msgs" "String";
    "msg_standard/std_msgs" "std_msgs" "ColorRGBA";
    "msg_standard/std_msgs" "std_msgs" "Float64";
    "msg_standard/geometry_msgs" "geometry_msgs" "Point";
    "msg_standard/geometry_msgs" "geometry_msgs" "PointStamped";
    "msg_standard/geometry_msgs" "geometry_msgs" "Vector3";
    "msg_standard/geometry_msgs" "geometry_msgs" "Quaternion";
    "msg_standard/geometry_msgs" "geometry_msgs" "Pose";
    "msg_standard/geometry_msgs" "geometry_msgs" "Transform";
    "msg_standard/geometry_msgs" "geometry_msgs" "TransformStamped";
    "msg_standard/tf2_msgs" "tf2_msgs" "TFMessage";
    "msg_standard/rosgraph_msgs" "rosgraph_msgs" "Clock";
    "msg_standard/sensor_msgs" "sensor_msgs" "JointState";
    "msg_standard/sensor_msgs" "sensor_msgs" "Range";
    "msg_standard/sensor_msgs" "sensor_msgs" "Temperature";
    "msg_standard/sensor_msgs" "sensor_msgs" "FluidPressure";
    "msg_standard/sensor_msgs" "sensor_msgs" "RelativeHumidity";
    "msg_standard/sensor_msgs" "sensor_msgs" "CompressedImage";
    "msg_standard/visualization_msgs" "visualization_msgs" "UVCoordinate";
    "msg_standard/visualization_msgs" "visualization_msgs" "MeshFile";
    "msg_standard/visualization_msgs" "visualization_msgs" "Marker";
    "msg_standard/visualization_msgs" "visualization_msgs" "MarkerArray";
    "msg_standard/lifecycle_msgs" "lifecycle_msgs" "State";
    "msg_standard/lifecycle_msgs" "lifecycle_msgs" "Transition";
    "msg_standard/lifecycle_msgs" "lifecycle_msgs" "TransitionEvent";
    "msg_standard/rcl_interfaces" "rcl_interfaces" "Log";
    "msg_standard/diagnostic_msgs" "diagnostic_msgs" "KeyValue";
    "msg_standard/diagnostic_msgs" "diagnostic_msgs" "DiagnosticStatus";
    "msg_standard/diagnostic_msgs" "diagnostic_msgs" "DiagnosticArray";
};

/// One field of a message as its `.msg` file declares it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field {
    /// Name of the field.
    pub name: String,
    /// A primitive such as `float64`, or the full name of a message.
    pub kind: String,
    /// How many of them.
    pub count: Count,
}

/// How many values a field holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Count {
    /// One value.
    One,
    /// This many, without a length on the wire.
    Fixed(usize),
    /// Any number, with a length on the wire.
    Sequence,
}

/// Text of one `.msg` file by the full name of the message.
#[must_use]
pub fn text(ros_type: &str) -> Option<&'static str> {
    DEFINITIONS.iter().find(|(name, _)| *name == ros_type).map(|(_, text)| *text)
}

/// The `ros2msg` schema of a message: its text, then that of every message inside it, as rosbag2
/// writes it. `None` when the message is not one of this crate's.
#[must_use]
pub fn schema(ros_type: &str) -> Option<String> {
    let mut names = vec![ros_type.to_owned()];
    let mut schema = String::new();
    let mut next = 0;
    while let Some(name) = names.get(next).cloned() {
        let text = text(&name)?;
        if next > 0 {
            let short = name.replace("/msg/", "/");
            // Writing to a String cannot fail.
            let _ = write!(schema, "\n{}\nMSG: {short}\n", "=".repeat(80));
        }
        schema += text;
        for field in fields(&name)? {
            if field.kind.contains('/') && !names.contains(&field.kind) {
                names.push(field.kind);
            }
        }
        next += 1;
    }
    Some(schema)
}

/// The fields of a message in the order of its `.msg` file; constants are left out.
#[must_use]
pub fn fields(ros_type: &str) -> Option<Vec<Field>> {
    let (package, _) = ros_type.split_once('/')?;
    text(ros_type)?
        .lines()
        .map(|line| line.split('#').next().unwrap_or("").trim())
        .filter(|line| !line.is_empty() && !line.contains('='))
        .map(|line| field(package, line))
        .collect()
}

fn field(package: &str, line: &str) -> Option<Field> {
    let mut words = line.split_whitespace();
    let (declared, name) = (words.next()?, words.next()?);
    let (kind, count) = match declared.split_once('[') {
        None => (declared, Count::One),
        Some((kind, "]")) => (kind, Count::Sequence),
        Some((kind, size)) => (kind, Count::Fixed(size.strip_suffix(']')?.parse().ok()?)),
    };
    let kind = if kind.starts_with(char::is_uppercase) {
        format!("{package}/msg/{kind}")
    } else {
        match kind.split_once('/') {
            Some((other_package, name)) => format!("{other_package}/msg/{name}"),
            None => kind.to_owned(),
        }
    };
    Some(Field { name: name.to_owned(), kind, count })
}
