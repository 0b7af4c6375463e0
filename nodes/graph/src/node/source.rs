//! The scale and the tracer node: what a driver gives, at its pace.
//!
//! Place in the flow: the start of the graph. A recording is played at a fixed rate or with its own timing; stamps
//! stay those of the recording. What a live driver gives goes on as it comes; to a scale reading are added the covariates
//! that other boxes say, and what the stream itself tells of the motion.

use super::remarks;
use super::sensors::Sensors;
use super::traffic::{Trouble, send};
use super::{NodeContext, NodeError, NodeSummary, links};
use crate::driver::{self, DriverError};
use crate::launch::{Pace, Source};
use crate::link::Link;
use crate::step::DerivedMotion;
use abbe_msgs::{Message, ScaleReading, Stamp, TracerReading};
use abbe_runtime::Shutdown;
use std::time::{Duration, Instant};

pub(super) fn scale(context: &NodeContext) -> Result<NodeSummary, NodeError> {
    let source = source(context, context.launch.scale.as_ref())?;
    let (config, base, machine) = (&source.driver, &context.base, &context.machine);
    let shutdown = &context.shutdown;
    let mut driver = match source.repeat_from {
        Some(sequence) => driver::open_scale_again(config, base, machine, shutdown, sequence)?,
        None => driver::open_scale(config, base, machine, shutdown)?,
    };
    let (sensors, mut found) = Sensors::open(context)?;
    found.extend(of_driver(driver.link()));
    links::report(context, found)?;
    let mut motion = context.launch.motion.map(|motion| DerivedMotion::new(motion.settings()));
    let next = || driver.next_reading();
    play::<ScaleReading>(context, source.pace, next, |reading, summary| {
        sensors.join(reading, summary);
        for refused in motion.iter_mut().flat_map(|motion| motion.fill(reading)) {
            summary.troubles.note(Trouble::Covariate, format!("what the motion tells was left out: {refused}"));
        }
    })
}

pub(super) fn tracer(context: &NodeContext) -> Result<NodeSummary, NodeError> {
    let source = source(context, context.launch.tracer.as_ref())?;
    let mut driver = driver::open_tracer(&source.driver, &context.base, &context.machine, &context.shutdown)?;
    links::report(context, of_driver(driver.link()).into_iter().collect())?;
    play::<TracerReading>(context, source.pace, || driver.next_reading(), |_, _| {})
}

fn of_driver(link: Option<Link>) -> Option<(String, Link)> {
    Some(("driver".to_owned(), link?))
}

fn source<'a>(context: &NodeContext, source: Option<&'a Source>) -> Result<&'a Source, NodeError> {
    source.ok_or(NodeError::Incomplete { node: context.name.name(), part: "a driver for it" })
}

fn play<M: Message>(
    context: &NodeContext,
    pace: Pace,
    mut next: impl FnMut() -> Result<Option<M>, DriverError>,
    mut complete: impl FnMut(&mut M, &mut NodeSummary),
) -> Result<NodeSummary, NodeError> {
    let mut summary = context.summary();
    let mut publisher = context.publisher::<M>()?;
    let mut schedule: Option<Schedule> = None;
    let mut given = 0;
    loop {
        let Some(mut sample) = usable(&mut next, &mut summary)? else {
            // A live driver gives up its wait when it is told to stop.
            summary.recording_ended = !context.shutdown.requested();
            break;
        };
        let schedule = schedule.get_or_insert_with(|| Schedule::new(pace, sample.stamp()));
        if schedule.wait_for(given, sample.stamp(), &context.shutdown) {
            break;
        }
        complete(&mut sample, &mut summary);
        send(publisher.as_mut(), &sample, &mut summary);
        given += 1;
    }
    if let Some(schedule) = &schedule {
        summary.figures.insert(STARTED.to_owned(), schedule.started_s);
    }
    remarks::figures(&mut summary, &[]);
    summary.dropped = publisher.dropped();
    context.shutdown.sleep(LINGER);
    Ok(summary)
}

/// The next reading that can be a sample; one that cannot is told and passed over.
fn usable<M>(
    next: &mut impl FnMut() -> Result<Option<M>, DriverError>,
    summary: &mut NodeSummary,
) -> Result<Option<M>, DriverError> {
    loop {
        match next() {
            Err(error) if error.is_of_one_reading() => {
                summary.malformed += 1;
                summary.troubles.note(Trouble::Malformed, error);
            }
            other => return other,
        }
    }
}

/// Gives those that take the time to find what was sent, and what is queued to leave, before the publisher goes: over shared
/// memory, a taker that has not looked since the publisher came finds nothing once it is gone.
const LINGER: Duration = Duration::from_millis(200);

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
            Pace::AsTheyCome => 0.0,
            Pace::TimeFactor(factor) => (stamp.to_nanos() - self.first.to_nanos()) as f64 * 1e-9 / factor,
        };
        let due = self.start + Duration::try_from_secs_f64(due_s.max(0.0)).unwrap_or(Duration::MAX);
        let remaining = due.saturating_duration_since(Instant::now());
        if remaining.is_zero() { shutdown.requested() } else { shutdown.sleep(remaining) }
    }
}
