//! Names of the topics, relative to the machine's namespace, and of the services, relative to their node.
//!
//! Place in the flow: every node and tool that opens one takes its name from here; `docs/src/reference/live.md` lists
//! them with types, quality of service, frames and units.

/// `abbe_msgs/ScaleReading` from the scale node.
pub const SCALE_READING: &str = "scale/reading";
/// `sensor_msgs/JointState` beside it.
pub const JOINT_STATE: &str = "scale/joint_states";
/// `abbe_msgs/TracerReading` from the tracer node.
pub const TRACER_READING: &str = "tracer/reading";
/// `abbe_msgs/CorrectedCoordinates` after geometry and effects, from the geometric node.
pub const GEOMETRIC: &str = "geometric/corrected";
/// `abbe_msgs/CorrectedCoordinates` after everything, from the residual node: the one to subscribe to.
pub const CORRECTED: &str = "corrected";
/// `geometry_msgs/PointStamped` beside it, for valid samples only.
pub const CORRECTED_POINT: &str = "corrected_point";
/// `abbe_msgs/RangeResidual` from the monitor node.
pub const RANGE_RESIDUAL: &str = "monitor/range_residual";
/// `std_srvs/Trigger` of the geometric and the monitor node: load the model file now.
pub const RELOAD_MODEL: &str = "~/reload_model";
/// `std_srvs/Trigger` of the monitor node: start a diagnosis.
pub const DIAGNOSE: &str = "~/diagnose";
