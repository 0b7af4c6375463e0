//! The scale and the tracer node: what a driver gives, at its pace.
//!
//! Place in the flow: the start of the graph. A recording is played at a fixed rate or with its own timing; stamps
//! stay those of the recording.

use super::{NodeContext, NodeError, NodeSummary};
use crate::driver::{self, DriverError};
use crate::launch::{Pace, Source};
use crate::topics;
use abbe_msgs::standard::JointState;
use abbe_msgs::{Message, ScaleReading, Stamp, TracerReading};
use abbe_runtime::Shutdown;
use abbe_runtime::ros::{self, QueuedPublisher};
use std::num::NonZeroUsize;
use std::time::{Duration, Instant};

/// Standard messages waiting to be published.
const QUEUE: NonZeroUsize = NonZeroUsize::MIN.saturating_add(1023);

pub(super) fn scale(context: &NodeContext) -> Result<NodeSummary, NodeError> {
    let source = source(context, context.launch.scale.as_ref())?;
    let mut driver = driver::open_scale(&source.driver, &context.base, &context.machine)?;
    let joints: Option<QueuedPublisher<JointState>> = match &context.ros {
        Some(node) => Some(node.publisher(topics::JOINT_STATE, &ros::stream_qos(QUEUE), QUEUE)?),
        None => None,
    };
    play::<ScaleReading>(
        context,
        source.pace,
        || driver.next_reading(),
        |reading| {
            if let Some(publisher) = &joints {
                publisher.publish(JointState::from_scales(reading, ["x", "y", "z"]));
            }
        },
    )
}

pub(super) fn tracer(context: &NodeContext) -> Result<NodeSummary, NodeError> {
    let source = source(context, context.launch.tracer.as_ref())?;
    let mut driver = driver::open_tracer(&source.driver, &context.base, &context.machine)?;
    play::<TracerReading>(context, source.pace, || driver.next_reading(), |_| {})
}

fn source<'a>(context: &NodeContext, source: Option<&'a Source>) -> Result<&'a Source, NodeError> {
    source.ok_or(NodeError::Incomplete { node: context.name.name(), part: "a driver for it" })
}

fn play<M: Message>(
    context: &NodeContext,
    pace: Pace,
    mut next: impl FnMut() -> Result<Option<M>, DriverError>,
    beside: impl Fn(&M),
) -> Result<NodeSummary, NodeError> {
    let mut summary = NodeSummary { node: context.name.name().to_owned(), ..NodeSummary::default() };
    let mut publisher = context.publisher::<M>()?;
    let mut schedule: Option<Schedule> = None;
    while let Some(sample) = next()? {
        let schedule = schedule.get_or_insert_with(|| Schedule::new(pace, sample.stamp()));
        if schedule.wait_for(summary.sent, sample.stamp(), &context.shutdown) {
            break;
        }
        publisher.send(&sample)?;
        beside(&sample);
        summary.sent += 1;
    }
    if let Some(schedule) = &schedule {
        summary.figures.insert(STARTED.to_owned(), schedule.started_s);
    }
    summary.dropped = publisher.dropped();
    linger(context);
    Ok(summary)
}

/// Gives what is queued the time to leave before the publisher goes.
fn linger(context: &NodeContext) {
    if context.ros.is_some() {
        context.shutdown.sleep(Duration::from_millis(200));
    }
}

/// Figure of a source's summary: when its first sample was due, in seconds of the host's monotonic clock.
pub const STARTED: &str = "started_monotonic_s";

/// Seconds of the host's monotonic clock, the same for all processes; for figures, never for data.
pub fn monotonic_s() -> f64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
}

/// When each sample is due.
struct Schedule {
    pace: Pace,
    start: Instant,
    started_s: f64,
    first: Stamp,
}

impl Schedule {
    fn new(pace: Pace, first: Stamp) -> Schedule {
        Schedule { pace, start: Instant::now(), started_s: monotonic_s(), first }
    }

    /// Sleeps until sample `number` is due; true when told to stop.
    fn wait_for(&self, number: u64, stamp: Stamp, shutdown: &Shutdown) -> bool {
        let due_s = match self.pace {
            Pace::RateHz(rate) => number as f64 / rate,
            Pace::TimeFactor(factor) => (stamp.to_nanos() - self.first.to_nanos()) as f64 * 1e-9 / factor,
        };
        let due = self.start + Duration::try_from_secs_f64(due_s.max(0.0)).unwrap_or(Duration::MAX);
        let remaining = due.saturating_duration_since(Instant::now());
        if remaining.is_zero() { shutdown.requested() } else { shutdown.sleep(remaining) }
    }
}
