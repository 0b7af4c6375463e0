//! Lines of the log of a node: `rcl_interfaces/Log`.
//!
//! Place in the flow: made by the gateway of a node for `/rosout`.

use serde::{Deserialize, Serialize};

use super::Time;
use crate::RosType;

/// A line of a log.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Log {
    /// When.
    pub stamp: Time,
    /// How grave: one of the constants.
    pub level: u8,
    /// Name of the logger.
    pub name: String,
    /// What it says.
    pub msg: String,
    /// File of the source code.
    pub file: String,
    /// Function in it; empty where it is not known.
    pub function: String,
    /// Line in it.
    pub line: u32,
}

impl Log {
    /// Of use to who looks for a fault.
    pub const DEBUG: u8 = 10;
    /// What happens.
    pub const INFO: u8 = 20;
    /// What may go wrong.
    pub const WARN: u8 = 30;
    /// What went wrong.
    pub const ERROR: u8 = 40;
}

impl RosType for Log {
    const ROS_TYPE: &'static str = "rcl_interfaces/msg/Log";
}
