//! The recorder node: every topic it has an edge from, into one rosbag2-readable bag.
//!
//! Place in the flow: beside the correcting path. The log time of a message is its stamp, so a recording says when
//! things were measured and replay depends on nothing else. A sample that no bag can hold (stamped before 1970: log times
//! are unsigned) is left out, counted and told; it never ends the node. Nor does a disk that is full or fails.

use super::recording::{Record, Recording, Status};
use super::{LOOK_UP, NodeContext, NodeError, NodeSummary, take};
use crate::launch::NodeName;
use crate::record::log_time_ns;
use abbe_msgs::standard::DiagnosticStatus;
use abbe_msgs::{CorrectedCoordinates, Message, RangeResidual, ScaleReading, TracerReading, cdr};
use abbe_runtime::Subscribe;
use abbe_runtime::ros::Diagnostics;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How often the node reports its health.
const REPORT_EVERY: Duration = Duration::from_secs(1);

pub(super) fn run(context: &NodeContext) -> Result<NodeSummary, NodeError> {
    let part = "a bag to record to";
    let config = context.launch.record.as_ref().ok_or(NodeError::Incomplete { node: context.name.name(), part })?;
    let recording = Recording::start_beside(&context.base.join(&config.bag), config)?.map_err(NodeError::Thread)?;
    let mut tracks = match Tracks::open(context) {
        Ok(tracks) => tracks,
        Err(error) => {
            recording.finish_unless_empty()?;
            return Err(error);
        }
    };
    let health = context.ros.as_ref().map(|node| node.diagnostics(&context.machine.machine.name));
    let mut summary = context.summary();
    let mut tape = Tape { recording, refused: 0 };
    let mut withheld = 0_u64;
    let mut reported = Instant::now();
    context.lifecycle.opened();
    loop {
        let stopping = context.shutdown.requested();
        let before = (summary.received, summary.malformed);
        let mut into = if context.lifecycle.is_active() { Some(&mut tape) } else { None };
        tracks.drain(into.as_deref_mut(), &mut summary);
        withheld += if into.is_none() { summary.received - before.0 } else { 0 };
        if let Some(health) = health.as_ref().filter(|_| reported.elapsed() >= REPORT_EVERY) {
            reported = Instant::now();
            report(health, &tape.recording.status(), tape.refused);
        }
        if (summary.received, summary.malformed) == before {
            if stopping {
                break;
            }
            context.shutdown.sleep(LOOK_UP.min(Duration::from_millis(5)));
        }
    }
    summary.lost = tracks.lost();
    let Tape { recording, refused } = tape;
    let status = if summary.received == 0 { recording.finish_unless_empty()? } else { recording.finish()? };
    (summary.sent, summary.dropped) = (status.recorded, status.unrecorded);
    let figures = [
        ("stamps_refused", refused as f64),
        ("withheld", withheld as f64),
        ("files", status.files as f64),
        ("longest_sync_ms", status.longest_sync.as_secs_f64() * 1e3),
    ];
    summary.figures.extend(figures.map(|(name, value)| (name.to_owned(), value)));
    Ok(summary)
}

/// Where samples go, and how many could not.
pub(crate) struct Tape {
    pub(crate) recording: Recording,
    pub(crate) refused: u64,
}

impl Tape {
    pub(crate) fn record<M: Message>(&mut self, topic: &Arc<str>, sample: &M) {
        let encoded = log_time_ns(sample).map_err(|error| error.to_string()).and_then(|log_time_ns| {
            let cdr = cdr::encode(&sample.to_ros()).map_err(|error| error.to_string())?;
            Ok(Record { topic: Arc::clone(topic), ros_type: M::ROS_TYPE, cdr, log_time_ns })
        });
        match encoded {
            Ok(record) => self.recording.push(record),
            Err(reason) => {
                self.refused += 1;
                if self.refused.is_power_of_two() {
                    tracing::warn!(topic = &**topic, refused = self.refused, "sample is not recorded: {reason}");
                }
            }
        }
    }
}

/// All that can be recorded.
struct Tracks {
    scale: Track<ScaleReading>,
    tracer: Track<TracerReading>,
    geometric: Track<CorrectedCoordinates>,
    residual: Track<CorrectedCoordinates>,
    monitor: Track<RangeResidual>,
}

impl Tracks {
    fn open(context: &NodeContext) -> Result<Tracks, NodeError> {
        Ok(Tracks {
            scale: Track::open(context, NodeName::Scale)?,
            tracer: Track::open(context, NodeName::Tracer)?,
            geometric: Track::open(context, NodeName::Geometric)?,
            residual: Track::open(context, NodeName::Residual)?,
            monitor: Track::open(context, NodeName::Monitor)?,
        })
    }

    fn drain(&mut self, mut tape: Option<&mut Tape>, summary: &mut NodeSummary) {
        self.scale.drain(tape.as_deref_mut(), summary);
        self.tracer.drain(tape.as_deref_mut(), summary);
        self.geometric.drain(tape.as_deref_mut(), summary);
        self.residual.drain(tape.as_deref_mut(), summary);
        self.monitor.drain(tape, summary);
    }

    fn lost(&self) -> u64 {
        self.scale.lost() + self.tracer.lost() + self.geometric.lost() + self.residual.lost() + self.monitor.lost()
    }
}

/// One recorded topic.
struct Track<M: Message> {
    topic: Arc<str>,
    subscriber: Option<Box<dyn Subscribe<M>>>,
}

impl<M: Message> Track<M> {
    fn open(context: &NodeContext, from: NodeName) -> Result<Track<M>, NodeError> {
        let topic = format!("/{}/{}", context.launch.namespace.trim_matches('/'), from.topic().unwrap_or_default());
        let recorded = context.launch.takes_over(context.name.name(), from).is_some();
        let subscriber = if recorded { Some(context.subscriber(from)?) } else { None };
        Ok(Track { topic: topic.into(), subscriber })
    }

    /// Records what has come; without a tape it is taken and passed over.
    fn drain(&mut self, mut tape: Option<&mut Tape>, summary: &mut NodeSummary) {
        let Some(subscriber) = self.subscriber.as_mut() else { return };
        while let Some(sample) = take(subscriber.as_mut(), Duration::ZERO, summary) {
            if let Some(tape) = &mut tape {
                tape.record(&self.topic, &sample);
            }
        }
    }

    fn lost(&self) -> u64 {
        self.subscriber.as_ref().map_or(0, |s| s.lost())
    }
}

fn report(health: &Diagnostics, status: &Status, refused: u64) {
    let (level, message) = match &status.stopped {
        Some(reason) => (DiagnosticStatus::ERROR, format!("recording has stopped: {reason}")),
        None if status.is_low => (DiagnosticStatus::WARN, "little space is left, recording stops soon".to_owned()),
        None if status.unrecorded > 0 => (DiagnosticStatus::WARN, "the disk is too slow for what comes".to_owned()),
        None if refused > 0 => {
            (DiagnosticStatus::WARN, "samples with stamps that no bag can hold are not recorded".to_owned())
        }
        None => (DiagnosticStatus::OK, "recording".to_owned()),
    };
    let free = status.free_bytes.map_or("unknown".to_owned(), |bytes| (bytes >> 20).to_string());
    let figures = [
        ("recorded", status.recorded.to_string()),
        ("not recorded", status.unrecorded.to_string()),
        ("stamps refused", refused.to_string()),
        ("files", status.files.to_string()),
        ("free (MiB)", free),
        ("longest wait for the disk (ms)", format!("{:.1}", status.longest_sync.as_secs_f64() * 1e3)),
    ];
    health.report("recording", level, &message, figures);
}
