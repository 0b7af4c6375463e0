//! When each reading of a source is due, and which present instant it has.
//!
//! Place in the flow: in the loop of the scale and the tracer node.

use super::{NodeContext, NodeError};
use crate::launch::{Pace, Source, Stamps};
use crate::present::Present;
use abbe_msgs::Stamp;
use abbe_runtime::ros::Clock;
use abbe_runtime::{Shutdown, agree};
use std::time::{Duration, Instant};

/// How often it is looked what time it is on `/clock`.
const LOOK_EVERY: Duration = Duration::from_millis(2);
/// An agreement older than this is of another launch (ns).
const OLDEST_NS: i64 = 3_600_000_000_000;

/// When each sample is due.
pub(super) struct Schedule {
    pace: Pace,
    start: Instant,
    started_s: f64,
    first: Stamp,
    clock: Clock,
    present: Option<Present>,
}

impl Schedule {
    /// Begins with this reading; `None` where the node is told to stop before it knows the time.
    pub(super) fn begin(
        context: &NodeContext,
        source: &Source,
        first: Stamp,
        sequence: u64,
    ) -> Result<Option<Schedule>, NodeError> {
        let (pace, clock) = (source.pace, context.clock());
        let mut schedule =
            Schedule { pace, start: Instant::now(), started_s: monotonic_s(), first, clock, present: None };
        if context.launch.stamps == Stamps::Recorded || source.driver.is_live() {
            return Ok(Some(schedule));
        }
        let Some(at_ns) = schedule.now_ns(&context.shutdown)? else { return Ok(None) };
        let is_simulated = schedule.clock.is_simulated();
        let own = Present { at_ns, recorded_ns: first.to_nanos(), sequence, pace, is_simulated };
        let present = agreed(context, own)?;
        if let Some(problem) = present.problem(pace, is_simulated) {
            return Err(NodeError::Present(problem));
        }
        let ago_ns = at_ns - present.at_ns;
        if !(-OLDEST_NS..=OLDEST_NS).contains(&ago_ns) {
            let problem =
                "the sources of this run agreed about the time an hour ago and more; start the whole launch again";
            return Err(NodeError::Present(problem.to_owned()));
        }
        let ago = Duration::from_nanos(ago_ns.max(0).unsigned_abs());
        schedule.start = schedule.start.checked_sub(ago).unwrap_or(schedule.start);
        schedule.started_s -= ago.as_secs_f64();
        schedule.present = Some(present);
        Ok(Some(schedule))
    }

    /// What is due first was due then, in seconds of the host's monotonic clock.
    pub(super) fn started_s(&self) -> f64 {
        self.started_s
    }

    /// The present stamp of a reading, where it gets one.
    pub(super) fn present_stamp(&self, recorded: Stamp, sequence: u64) -> Result<Option<Stamp>, NodeError> {
        Ok(self.present.as_ref().map(|present| present.stamp(recorded, sequence)).transpose()?)
    }

    /// Sleeps until sample `number` is due; true when told to stop.
    pub(super) fn wait_for(&self, number: u64, recorded: Stamp, now: Option<Stamp>, shutdown: &Shutdown) -> bool {
        if let (Some(now), true) = (now, self.clock.is_simulated()) {
            return self.wait_on_clock(now, shutdown);
        }
        let due_s = match (&self.present, now, self.pace) {
            (Some(present), Some(now), _) => (now.to_nanos() - present.at_ns) as f64 * 1e-9,
            (_, _, Pace::RateHz(rate)) => number as f64 / rate,
            (_, _, Pace::AsTheyCome) => 0.0,
            (_, _, Pace::TimeFactor(factor)) => (recorded.to_nanos() - self.first.to_nanos()) as f64 * 1e-9 / factor,
        };
        let due = Duration::try_from_secs_f64(due_s.max(0.0)).unwrap_or(Duration::MAX);
        let remaining = due.saturating_sub(self.start.elapsed());
        if remaining.is_zero() { shutdown.requested() } else { shutdown.sleep(remaining) }
    }

    /// The same by `/clock`, which may stand, or go at another pace than the host's.
    fn wait_on_clock(&self, due: Stamp, shutdown: &Shutdown) -> bool {
        let is_due = || self.clock.now_ns().is_some_and(|now_ns| now_ns >= i128::from(due.to_nanos()));
        while !is_due() {
            if shutdown.sleep(LOOK_EVERY) {
                return true;
            }
        }
        shutdown.requested()
    }

    /// The time now, waiting for `/clock` where that is the one to go by; `None` when told to stop.
    fn now_ns(&self, shutdown: &Shutdown) -> Result<Option<i64>, NodeError> {
        loop {
            if let Some(now_ns) = self.clock.now_ns() {
                return i64::try_from(now_ns)
                    .map(Some)
                    .map_err(|_| NodeError::Present("the clock is beyond what a stamp can hold; set it".to_owned()));
            }
            if !self.clock.is_simulated() {
                return Err(NodeError::Present("the system clock is before 1970; set it".to_owned()));
            }
            if shutdown.sleep(LOOK_EVERY) {
                return Ok(None);
            }
        }
    }
}

/// What the first source of this launch said; a source without a run has nobody to agree with.
fn agreed(context: &NodeContext, own: Present) -> Result<Present, NodeError> {
    let Some(run) = &context.whole_run else { return Ok(own) };
    let wrong = |error: String| NodeError::Present(format!("scale and tracer cannot agree about the time: {error}"));
    let word = serde_json::to_string(&own).map_err(|error| wrong(error.to_string()))?;
    // A later launch of the same name is another; one by hand has no launcher.
    let subject = format!("played.{}", context.launcher_pid.unwrap_or_default());
    let said = agree(run, &subject, &word).map_err(|error| wrong(error.to_string()))?;
    serde_json::from_str(&said).map_err(|error| wrong(error.to_string()))
}

/// Seconds of the host's monotonic clock, the same for all processes; for figures, never for data.
pub fn monotonic_s() -> f64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
}
