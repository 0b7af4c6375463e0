//! The health of a node on `/diagnostics`, as `rqt_robot_monitor` and Foxglove show it.
//!
//! Place in the flow: a node reports once a second or when its state changes; published on a thread
//! of its own. Stamps are those of the system clock.

use std::num::NonZeroUsize;
use std::time::{SystemTime, UNIX_EPOCH};

use abbe_msgs::standard::{DiagnosticArray, DiagnosticStatus, Header, KeyValue};
use abbe_msgs::{MessageError, Stamp};

use super::{QueuedPublisher, RosError, RosNode, diagnostics_qos};

const TOPIC: &str = "/diagnostics";

/// Reports waiting to be published; older ones say nothing any more.
const DEPTH: NonZeroUsize = NonZeroUsize::MIN.saturating_add(15);

/// Publishes the health of one node.
pub struct Diagnostics {
    publisher: QueuedPublisher<DiagnosticArray>,
    name: String,
    hardware_id: String,
}

impl Diagnostics {
    pub(super) fn open(node: &RosNode, hardware_id: &str) -> Result<Self, RosError> {
        Ok(Self {
            publisher: node.publisher(TOPIC, &diagnostics_qos(), DEPTH)?,
            name: node.identity().qualified().trim_start_matches('/').into(),
            hardware_id: hardware_id.into(),
        })
    }

    /// Reports `level` (of [`DiagnosticStatus`]) of a `component` of the node, with figures.
    ///
    /// # Errors
    /// When the system clock is outside what a ROS 2 stamp can hold.
    pub fn report<'a>(
        &self,
        component: &str,
        level: u8,
        message: &str,
        figures: impl IntoIterator<Item = (&'a str, String)>,
    ) -> Result<(), MessageError> {
        let figures = figures.into_iter().map(|(key, value)| KeyValue { key: key.into(), value });
        let status = DiagnosticStatus {
            level,
            name: format!("{}: {component}", self.name),
            message: message.into(),
            hardware_id: self.hardware_id.clone(),
            values: figures.collect(),
        };
        self.publisher.publish(DiagnosticArray { header: Header::new(now()?, ""), status: vec![status] });
        Ok(())
    }
}

fn now() -> Result<Stamp, MessageError> {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    // A clock before 1970 is a clock without a battery: report its reading, the epoch.
    let nanos = since.map_or(0, |since| since.as_nanos());
    Stamp::from_nanos(i64::try_from(nanos).unwrap_or(i64::MAX))
}
