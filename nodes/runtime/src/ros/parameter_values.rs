//! Values of parameters while a node runs, and `/parameter_events`.
//!
//! Place in the flow: under [`super::parameter_services`], which has checked every value. The DDS library has the values that a node began with.
//! It would tell of changes as transient local, so that whoever joins later hears of old ones as if they were new; ROS 2
//! tells of them as volatile (`rclcpp::ParameterEventsQoS`: reliable, the last 1000). So what is set stays here, and is told from here.

use std::collections::BTreeMap;
use std::sync::Mutex;

use ros2_client::parameters::raw;
use ros2_client::{MessageTypeName, Node, ParameterValue, Publisher};

use super::endpoint::{dds_name, endpoint_error};
use super::qos::parameter_events_qos;
use super::{NodeIdentity, RosError};
use crate::lock::lock;

const TOPIC: &str = "/parameter_events";

/// What was set.
pub(super) struct Values {
    changed: Mutex<BTreeMap<String, ParameterValue>>,
    events: Publisher<raw::ParameterEvent>,
    /// Full name of the node.
    node: String,
}

impl Values {
    /// Of a node that has just been made.
    pub(super) fn open(node: &mut Node, identity: &NodeIdentity) -> Result<Self, RosError> {
        let (qos, kind) = (parameter_events_qos(), MessageTypeName::new("rcl_interfaces", "ParameterEvent"));
        let failed = |source| endpoint_error("publisher of", TOPIC, source);
        let topic = node.create_topic(&dds_name(TOPIC)?, kind, &qos).map_err(failed)?;
        let events = node.create_publisher(&topic, Some(qos)).map_err(failed)?;
        Ok(Self { changed: Mutex::default(), events, node: identity.qualified() })
    }

    /// The value of a parameter now.
    pub(super) fn get(&self, node: &Mutex<Node>, name: &str) -> Option<ParameterValue> {
        let changed = lock(&self.changed).get(name).cloned();
        changed.or_else(|| lock(node).get_parameter(name))
    }

    /// Sets these together, and tells of it.
    pub(super) fn set(&self, node: &Mutex<Node>, parameters: Vec<raw::Parameter>) {
        let mut changed = lock(&self.changed);
        for parameter in &parameters {
            changed.insert(parameter.name.clone(), parameter.value.clone().into());
        }
        drop(changed);
        let event = raw::ParameterEvent {
            stamp: lock(node).time_now_not_simulated().into(),
            node: self.node.clone(),
            new_parameters: Vec::new(),
            changed_parameters: parameters,
            deleted_parameters: Vec::new(),
        };
        if let Err(error) = self.events.publish(event) {
            tracing::warn!(%error, "a change of parameters is not told on {TOPIC}");
        }
    }
}
