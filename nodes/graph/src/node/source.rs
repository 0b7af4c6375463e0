//! The scale and the tracer node: what a driver gives, at its pace.
//!
//! Place in the flow: the start of the graph. A recording is played at a fixed rate or with its own timing; stamps
//! are those of the recording, or with `stamps = "now"` the present instants that belong to them. What a live driver gives
//! goes on as it comes; to a scale reading are added the covariates that other boxes say, and what the stream itself tells
//! of the motion.

use super::realtime::OnPath;
use super::remarks;
use super::schedule::Schedule;
use super::sensors::Sensors;
use super::traffic::{Trouble, send};
use super::{NodeContext, NodeError, NodeSummary, links};
use crate::driver::{self, DriverConfig, DriverError};
use crate::launch::Source;
use crate::link::Link;
use crate::present;
use crate::step::{DerivedLags, DerivedMotion};
use crate::way::Way;
use abbe_msgs::{Message, ScaleReading, Stamp, TracerReading};
use std::time::Duration;

pub(super) fn scale(context: &NodeContext) -> Result<NodeSummary, NodeError> {
    let source = source(context, context.launch.scale.as_ref())?;
    let (config, base, machine) = (&source.driver, &context.base, &context.machine);
    let shutdown = &context.shutdown;
    let mut driver = match source.repeat_from {
        Some(sequence) => driver::open_scale_again(config, base, machine, shutdown, sequence)?,
        None => driver::open_scale(config, base, machine, shutdown, context.ros.as_ref())?,
    };
    let (sensors, mut found) = Sensors::open(context)?;
    let link = driver.link();
    let mut way = Way::new(link.clone());
    found.extend(of_driver(link.clone()));
    links::report(context, found)?;
    let mut motion = context.launch.motion.map(|motion| DerivedMotion::new(motion.settings()));
    let mut lags = DerivedLags::new(&context.launch.lagged);
    let next = || driver.next_reading();
    // What a bag says of the time is of another clock than that of the campaign a model was made from.
    let tells_time = !matches!(source.driver, DriverConfig::Bag { .. });
    let played = play::<ScaleReading>(context, source, next, |reading, now, summary| {
        sensors.join(reading, summary);
        if way.is_broken_before(reading, summary.malformed) {
            motion.iter_mut().for_each(DerivedMotion::forget);
            lags.forget_motion();
        }
        for refused in motion.iter_mut().flat_map(|motion| motion.fill(reading)) {
            summary.troubles.note(Trouble::Covariate, format!("what the motion tells was left out: {refused}"));
        }
        for refused in lags.fill(reading) {
            summary.troubles.note(Trouble::Covariate, format!("a lagged covariate was left out: {refused}"));
        }
        if let Some(now) = now {
            let refused = tells_time.then(|| present::keep_recorded(reading)).and_then(Result::err);
            if let Some(refused) = refused {
                summary.troubles.note(Trouble::Covariate, format!("the recorded instant was left out: {refused}"));
            }
            reading.stamp = now;
        }
    });
    Ok(with_lost(played?, link.as_ref()))
}

pub(super) fn tracer(context: &NodeContext) -> Result<NodeSummary, NodeError> {
    let source = source(context, context.launch.tracer.as_ref())?;
    let mut driver =
        driver::open_tracer(&source.driver, &context.base, &context.machine, &context.shutdown, context.ros.as_ref())?;
    let link = driver.link();
    links::report(context, of_driver(link.clone()).into_iter().collect())?;
    let played = play::<TracerReading>(
        context,
        source,
        || driver.next_reading(),
        |reading, now, _| {
            reading.stamp = now.unwrap_or(reading.stamp);
        },
    );
    Ok(with_lost(played?, link.as_ref()))
}

/// What its driver knows to be lost is lost before the node took it.
fn with_lost(summary: NodeSummary, link: Option<&Link>) -> NodeSummary {
    NodeSummary { lost: link.map_or(0, |link| link.status().missed), ..summary }
}

fn of_driver(link: Option<Link>) -> Option<(String, Link)> {
    Some(("driver".to_owned(), link?))
}

fn source<'a>(context: &NodeContext, source: Option<&'a Source>) -> Result<&'a Source, NodeError> {
    source.ok_or(NodeError::Incomplete { node: context.name.name(), part: "a driver for it" })
}

fn play<M: Message>(
    context: &NodeContext,
    source: &Source,
    mut next: impl FnMut() -> Result<Option<M>, DriverError>,
    mut complete: impl FnMut(&mut M, Option<Stamp>, &mut NodeSummary),
) -> Result<NodeSummary, NodeError> {
    let mut summary = context.summary();
    let mut publisher = context.publisher::<M>()?;
    let mut schedule: Option<Schedule> = None;
    let mut given = 0;
    let mut realtime = OnPath::enter(context)?;
    context.lifecycle.opened();
    // A recording begins when the node is activated first. From then on it goes on as a machine does, whoever listens.
    if !source.driver.is_live() && context.lifecycle.await_active(&context.shutdown) {
        return Ok(summary);
    }
    let mut withheld = 0_u64;
    loop {
        realtime.breathe();
        let Some(mut sample) = usable(&mut next, &mut summary)? else {
            // A live driver gives up its wait when it is told to stop.
            summary.recording_ended = !context.shutdown.requested();
            break;
        };
        let schedule = match &mut schedule {
            Some(schedule) => schedule,
            None => {
                let Some(first) = Schedule::begin(context, source, sample.stamp(), sample.sequence())? else { break };
                schedule.insert(first)
            }
        };
        let now = schedule.present_stamp(sample.stamp(), sample.sequence())?;
        if schedule.has_passed(now) && !context.shutdown.requested() {
            continue;
        }
        if schedule.wait_for(given, sample.stamp(), now, &context.shutdown) {
            break;
        }
        complete(&mut sample, now, &mut summary);
        if context.lifecycle.is_active() {
            send(publisher.as_mut(), &sample, &mut summary);
        } else {
            withheld += 1;
        }
        given += 1;
    }
    if let Some(schedule) = &schedule {
        summary.figures.insert(STARTED.to_owned(), schedule.started_s());
    }
    summary.figures.insert("withheld".to_owned(), withheld as f64);
    remarks::figures(&mut summary, &[]);
    realtime.figures(&mut summary);
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
