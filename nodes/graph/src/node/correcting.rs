//! The geometric and the residual node: one sample in, one sample out, on one thread.
//!
//! Place in the flow: the correcting path. Nothing here waits for a subscriber, for the network or for a file:
//! transports hand samples on without waiting, and the standard message goes out on a thread of its own.

use super::{LOOK_UP, NodeContext, NodeError, NodeSummary, take};
use crate::launch::NodeName;
use crate::step::{GeometricStep, ResidualStep};
use crate::topics;
use abbe_msgs::standard::{DiagnosticStatus, PointStamped};
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, Message, ScaleReading};
use abbe_runtime::ros::{self, Diagnostics, QueuedPublisher};
use std::num::NonZeroUsize;
use std::time::{Duration, Instant};

/// Standard messages waiting to be published.
const QUEUE: NonZeroUsize = NonZeroUsize::MIN.saturating_add(1023);
/// Durations kept for the figures at the end.
const KEPT_DURATIONS: usize = 65_536;
/// How often a node reports its health.
const REPORT_EVERY: Duration = Duration::from_secs(1);

pub(super) fn geometric(context: &NodeContext) -> Result<NodeSummary, NodeError> {
    let step = GeometricStep::new(context.model()?, context.launch.max_covariate_age_s);
    pump::<ScaleReading>(context, NodeName::Scale, |reading| step.correct(reading), |_| {})
}

pub(super) fn residual(context: &NodeContext) -> Result<NodeSummary, NodeError> {
    let step = ResidualStep::default();
    let points: Option<QueuedPublisher<PointStamped>> = match &context.ros {
        Some(node) => Some(node.publisher(topics::CORRECTED_POINT, &ros::stream_qos(QUEUE), QUEUE)?),
        None => None,
    };
    pump::<CorrectedCoordinates>(
        context,
        NodeName::Geometric,
        |sample| step.correct(sample),
        |corrected| {
            if let (Some(publisher), Some(point)) = (&points, PointStamped::from_corrected(corrected)) {
                publisher.publish(point);
            }
        },
    )
}

/// Takes, corrects, gives; counts what each status says.
fn pump<M: Message>(
    context: &NodeContext,
    from: NodeName,
    correct: impl Fn(&M) -> CorrectedCoordinates,
    beside: impl Fn(&CorrectedCoordinates),
) -> Result<NodeSummary, NodeError> {
    let mut summary = NodeSummary { node: context.name.name().to_owned(), ..NodeSummary::default() };
    let mut statuses = [0_u64; CorrectionStatus::ALL.len()];
    let health = context.ros.as_ref().map(|node| node.diagnostics(&context.machine.machine.name)).transpose()?;
    let mut publisher = context.publisher::<CorrectedCoordinates>()?;
    let mut subscriber = context.subscriber::<M>(from)?;
    let mut reported = Instant::now();
    let mut durations = Durations::default();
    loop {
        let stopping = context.shutdown.requested();
        let patience = if stopping { Duration::ZERO } else { LOOK_UP };
        match take(subscriber.as_mut(), patience, &mut summary)? {
            Some(sample) => {
                let since = Instant::now();
                let corrected = correct(&sample);
                durations.push(since.elapsed());
                publisher.send(&corrected)?;
                beside(&corrected);
                statuses[corrected.status as usize] += 1;
                summary.sent += 1;
            }
            None if stopping => break,
            None => {}
        }
        if reported.elapsed() >= REPORT_EVERY {
            reported = Instant::now();
            report(health.as_ref(), &summary, subscriber.lost(), &statuses)?;
        }
    }
    (summary.lost, summary.dropped) = (subscriber.lost(), publisher.dropped());
    for (status, count) in CorrectionStatus::ALL.iter().zip(statuses) {
        summary.figures.insert(status.name().to_lowercase(), count as f64);
    }
    durations.figures(&mut summary);
    Ok(summary)
}

/// How long the last corrections took.
#[derive(Default)]
struct Durations {
    last: std::collections::VecDeque<Duration>,
}

impl Durations {
    fn push(&mut self, duration: Duration) {
        if self.last.len() == KEPT_DURATIONS {
            self.last.pop_front();
        }
        self.last.push_back(duration);
    }

    fn figures(&self, summary: &mut NodeSummary) {
        let mut sorted: Vec<Duration> = self.last.iter().copied().collect();
        sorted.sort_unstable();
        for (name, share) in [("correct_p50_us", 0.5), ("correct_p99_us", 0.99)] {
            let place = ((sorted.len() as f64 * share) as usize).min(sorted.len().saturating_sub(1));
            if let Some(duration) = sorted.get(place) {
                summary.figures.insert(name.to_owned(), duration.as_secs_f64() * 1e6);
            }
        }
    }
}

fn report(
    health: Option<&Diagnostics>,
    summary: &NodeSummary,
    lost: u64,
    statuses: &[u64; CorrectionStatus::ALL.len()],
) -> Result<(), NodeError> {
    let Some(health) = health else { return Ok(()) };
    let uncorrected = statuses[CorrectionStatus::Rejected as usize] + statuses[CorrectionStatus::NoModel as usize];
    let (level, message) = match (uncorrected, lost) {
        (0, 0) => (DiagnosticStatus::OK, "correcting"),
        (0, _) => (DiagnosticStatus::WARN, "samples were lost on the way here"),
        _ => (DiagnosticStatus::WARN, "some samples were not corrected"),
    };
    let counts = CorrectionStatus::ALL.iter().zip(statuses).map(|(status, count)| (status.name(), count.to_string()));
    let figures = [("received", summary.received.to_string()), ("lost", lost.to_string())];
    health.report("correction", level, message, figures.into_iter().chain(counts))?;
    Ok(())
}
