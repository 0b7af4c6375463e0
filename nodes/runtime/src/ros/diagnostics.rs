//! The health of a node on `/diagnostics`, as `rqt_robot_monitor` and Foxglove show it.
//!
//! Place in the flow: a node reports once a second or when its state changes; published on a thread
//! of its own. Stamps are those of the node's clock; one that a ROS 2 stamp cannot hold (before 1970, after
//! 2038), and a `/clock` that says nothing, is told with each report, which then carries the stamp zero: no node ends
//! because of its clock.

use std::num::NonZeroUsize;

use abbe_msgs::Stamp;
use abbe_msgs::standard::{DiagnosticArray, DiagnosticStatus, Header, KeyValue};

use super::{Clock, NodeIdentity, QueuedPublisher, RosError, RosNode, diagnostics_qos};

const TOPIC: &str = "/diagnostics";

/// Reports waiting to be published; older ones say nothing any more.
const DEPTH: NonZeroUsize = NonZeroUsize::MIN.saturating_add(15);

/// Publishes the health of one node.
pub struct Diagnostics {
    publish: Box<dyn Fn(DiagnosticArray) + Send + Sync>,
    name: String,
    hardware_id: String,
    clock: Clock,
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
        Self { publish, name, hardware_id: hardware_id.into(), clock: Clock::of_system() }
    }

    /// The same, with the stamps of another clock.
    pub(crate) fn by_clock(self, clock: Clock) -> Self {
        Self { clock, ..self }
    }

    /// Reports `level` (of [`DiagnosticStatus`]) of a `component` of the node, with figures.
    pub fn report<'a>(
        &self,
        component: &str,
        level: u8,
        message: &str,
        figures: impl IntoIterator<Item = (&'a str, String)>,
    ) {
        let (stamp, clock) = stamp_of(self.clock.now_ns(), self.clock.is_simulated());
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
    }
}

/// The stamp of a clock's reading, and what is wrong with it. Zero is what ROS 2 takes for no time at all.
fn stamp_of(now_ns: Option<i128>, is_simulated: bool) -> (Stamp, Option<&'static str>) {
    let silent = "use_sim_time is set, and no time has come on /clock: start what publishes it (reports carry stamp 0)";
    let before = "the system clock is before 1970, which a ROS 2 program cannot use: set it (reports carry stamp 0)";
    let after = "the clock is outside what a ROS 2 stamp can hold (to 19 January 2038): set it (reports carry stamp 0)";
    let Some(now_ns) = now_ns else {
        return (Stamp::default(), Some(if is_simulated { silent } else { before }));
    };
    match i64::try_from(now_ns).map(Stamp::from_nanos) {
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
        fn regress_any_clock_gives_a_stamp_and_a_wrong_one_is_told(seconds: i64, nanos in 0_i64..1_000_000_000) {
            let now_ns = i128::from(seconds) * 1_000_000_000 + i128::from(nanos);
            let (stamp, problem) = stamp_of(Some(now_ns), false);
            let fits = i32::try_from(seconds).is_ok();
            prop_assert_eq!(problem.is_none(), fits);
            let expected = if fits { seconds * 1_000_000_000 + nanos } else { 0 };
            prop_assert_eq!(stamp.to_nanos(), expected);
        }
    }

    #[test]
    fn the_bounds_of_a_stamp_and_a_clock_without_time_are_told() {
        let last = i128::from(i32::MAX) * 1_000_000_000 + 999_999_999;
        assert_eq!(stamp_of(Some(0), false), (Stamp::default(), None));
        assert!(stamp_of(Some(last), false).1.is_none());
        assert!(stamp_of(Some(last + 1), false).1.is_some_and(|problem| problem.contains("2038")));
        assert!(stamp_of(None, false).1.is_some_and(|problem| problem.contains("1970")));
        assert!(stamp_of(None, true).1.is_some_and(|problem| problem.contains("/clock")));
    }
}
