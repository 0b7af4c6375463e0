//! A managed node tells of its states: `lifecycle_msgs`.
//!
//! Place in the flow: made by the gateway of a node whose state changes, and in the answers of its services.

use serde::{Deserialize, Serialize};

use crate::RosType;

/// A state of a managed node.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct State {
    /// Number of the state.
    pub id: u8,
    /// Its name.
    pub label: String,
}

impl RosType for State {
    const ROS_TYPE: &'static str = "lifecycle_msgs/msg/State";
}

/// A way from one state to another.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Transition {
    /// Number of the transition.
    pub id: u8,
    /// Its name.
    pub label: String,
}

impl RosType for Transition {
    const ROS_TYPE: &'static str = "lifecycle_msgs/msg/Transition";
}

/// A node goes from one state to another.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TransitionEvent {
    /// When (ns since 1970).
    pub timestamp: u64,
    /// How.
    pub transition: Transition,
    /// From where.
    pub start_state: State,
    /// To where.
    pub goal_state: State,
}

impl RosType for TransitionEvent {
    const ROS_TYPE: &'static str = "lifecycle_msgs/msg/TransitionEvent";
}
