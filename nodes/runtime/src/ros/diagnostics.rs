//! The health of a node on `/diagnostics`, as `rqt_robot_monitor` and Foxglove show it.
//!
//! Place in the flow: a node reports once a second or when its state changes; published on a thread
//! of its own. Stamps are those of the system clock; one that a ROS 2 stamp cannot hold (before 1970, after
//! 2038) is told with each report, which then carries the stamp zero: no node ends because of its clock.

use std::num::NonZeroUsize;
use std::time::{Duration, SystemTime, SystemTimeError, UNIX_EPOCH};

use abbe_msgs::standard::{DiagnosticArray, DiagnosticStatus, Header, KeyValue};
use abbe_msgs::{MessageError, Stamp};

use super::{NodeIdentity, QueuedPublisher, RosError, RosNode, diagnostics_qos};

const TOPIC: &str = "/diagnostics";

/// Reports waiting to be published; older ones say nothing any more.
const DEPTH: NonZeroUsize = NonZeroUsize::MIN.saturating_add(15);

/// Publishes the health of one node.
pub struct Diagnostics {
    publish: Box<dyn Fn(DiagnosticArray) + Send + Sync>,
    name: String,
    hardware_id: String,
}

impl Diagnostics {
    pub(super) fn open(node: &RosNode, hardware_id: &str) -> Result<Self, RosError> {
        let publisher: QueuedPublisher<DiagnosticArray> = node.publisher(TOPIC, &diagnostics_qos(), DEPTH)?;
        let publish = Box::new(move |report| publisher.publish(report));
        Ok(Self::over(publish, node.identity(), hardware_id))
    }

    /// Reports that `publish` publishes.
    pub(crate) fn over(
        publish: Box<dyn Fn(DiagnosticArray) + Send + Sync>,
        node: &NodeIdentity,
        hardware_id: &str,
    ) -> Self {
        let name = node.qualified().trim_start_matches('/').into();
        Self { publish, name, hardware_id: hardware_id.into() }
    }

    /// Reports `level` (of [`DiagnosticStatus`]) of a `component` of the node, with figures.
    pub fn report<'a>(
        &self,
        component: &str,
        level: u8,
        message: &str,
        figures: impl IntoIterator<Item = (&'a str, String)>,
    ) -> Result<(), MessageError> {
        let (stamp, clock) = stamp_of(SystemTime::now().duration_since(UNIX_EPOCH));
        let figures = figures.into_iter().map(|(key, value)| KeyValue { key: key.into(), value });
        let mut status = DiagnosticStatus {
            level,
            name: format!("{}: {component}", self.name),
            message: message.into(),
            hardware_id: self.hardware_id.clone(),
            values: figures.collect(),
        };
        if let Some(problem) = clock {
            status.level = level.max(DiagnosticStatus::WARN);
            status.message = format!("{message}; {problem}");
        }
        (self.publish)(DiagnosticArray { header: Header::new(stamp, ""), status: vec![status] });
        Ok(())
    }
}

/// The stamp of a clock's reading, and what is wrong with it. Zero is what ROS 2 takes for no time at all.
fn stamp_of(since_epoch: Result<Duration, SystemTimeError>) -> (Stamp, Option<&'static str>) {
    let before = "the system clock is before 1970, which a ROS 2 program cannot use: set it (reports carry stamp 0)";
    let after =
        "the system clock is after 19 January 2038, which a ROS 2 stamp cannot hold: set it (reports carry stamp 0)";
    let Ok(since) = since_epoch else { return (Stamp::default(), Some(before)) };
    let nanos = i64::try_from(since.as_nanos()).map(Stamp::from_nanos);
    match nanos {
        Ok(Ok(stamp)) => (stamp, None),
        _ => (Stamp::default(), Some(after)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn regress_any_clock_gives_a_stamp_and_a_wrong_one_is_told(seconds: i64, nanos in 0_u32..1_000_000_000) {
            let offset = Duration::new(seconds.unsigned_abs(), nanos);
            let clock = if seconds < 0 { UNIX_EPOCH.checked_sub(offset) } else { UNIX_EPOCH.checked_add(offset) };
            let Some(clock) = clock else { return Ok(()) };
            let (stamp, problem) = stamp_of(clock.duration_since(UNIX_EPOCH));
            let fits = (0..=i64::from(i32::MAX)).contains(&seconds);
            prop_assert_eq!(problem.is_none(), fits);
            let expected = if fits { seconds * 1_000_000_000 + i64::from(nanos) } else { 0 };
            prop_assert_eq!(stamp.to_nanos(), expected);
        }
    }

    #[test]
    fn the_bounds_of_a_stamp_are_told_on_both_sides() {
        let at = |clock: SystemTime| stamp_of(clock.duration_since(UNIX_EPOCH));
        let last = UNIX_EPOCH + Duration::new(i32::MAX.unsigned_abs().into(), 999_999_999);
        assert_eq!(at(UNIX_EPOCH), (Stamp::default(), None));
        assert!(at(last).1.is_none());
        assert!(at(last + Duration::from_nanos(1)).1.is_some_and(|problem| problem.contains("2038")));
        assert!(at(UNIX_EPOCH - Duration::from_nanos(1)).1.is_some_and(|problem| problem.contains("1970")));
    }
}
