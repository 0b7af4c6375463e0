//! Names of the topics, relative to the machine's namespace, and of the services, relative to their node.
//!
//! Place in the flow: every node and tool that opens one takes its name from here; `docs/src/reference/live.md` lists
//! them with types, quality of service, frames and units.

/// `abbe_msgs/ScaleReading` from the scale node.
pub const SCALE_READING: &str = "scale/reading";
/// `sensor_msgs/JointState` beside it.
pub const JOINT_STATE: &str = "scale/joint_states";
/// `rosgraph_msgs/Clock` from the scale node, where it plays a recording and `publish_clock` asks for it.
pub const CLOCK: &str = "/clock";
/// `abbe_msgs/TracerReading` from the tracer node.
pub const TRACER_READING: &str = "tracer/reading";
/// `abbe_msgs/CorrectedCoordinates` after geometry and effects, from the geometric node.
pub const GEOMETRIC: &str = "geometric/corrected";
/// `abbe_msgs/CorrectedCoordinates` after everything, from the residual node: the one to subscribe to.
pub const CORRECTED: &str = "corrected";
/// `geometry_msgs/PointStamped` beside it, for valid samples only.
pub const CORRECTED_POINT: &str = "corrected_point";
/// `visualization_msgs/MarkerArray` beside it: working volume and error vector.
pub const MARKERS: &str = "markers";
/// `tf2_msgs/TFMessage` beside it: the moving parts of the machine, and the tip.
pub const FRAMES: &str = "/tf";
/// `tf2_msgs/TFMessage` from the residual node: table, reference point and stations.
pub const STATIC_FRAMES: &str = "/tf_static";
/// `std_msgs/String` from the residual node: the machine in URDF.
pub const ROBOT_DESCRIPTION: &str = "robot_description";
/// `abbe_msgs/RangeResidual` from the monitor node.
pub const RANGE_RESIDUAL: &str = "monitor/range_residual";
/// `std_srvs/Trigger` of the geometric and the monitor node: load the model file now.
pub const RELOAD_MODEL: &str = "~/reload_model";
/// `std_srvs/Trigger` of the monitor node: start a diagnosis.
pub const DIAGNOSE: &str = "~/diagnose";
