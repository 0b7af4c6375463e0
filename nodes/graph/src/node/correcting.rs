//! The geometric and the residual node: one sample in, one sample out, on one thread.
//!
//! Place in the flow: the correcting path. Nothing here waits for a subscriber, for the network or for a file:
//! transports hand samples on without waiting, the standard message goes out on a thread of its own, and a new model is
//! read on another; the loop takes it between two samples, so that none is lost and none corrected by half of each.

use super::model::{ModelFeed, ResidualFeed};
use super::{LOOK_UP, NodeContext, NodeError, NodeSummary, take};
use crate::launch::NodeName;
use crate::step::{GeometricStep, ResidualStep};
use crate::topics;
use abbe_msgs::standard::{DiagnosticStatus, PointStamped};
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, Message, ScaleReading, Sha256};
use abbe_runtime::ros::{self, Diagnostics, QueuedPublisher};
use std::cell::Cell;
use std::num::NonZeroUsize;
use std::time::{Duration, Instant};

/// Standard messages waiting to be published.
const QUEUE: NonZeroUsize = NonZeroUsize::MIN.saturating_add(1023);
/// Durations kept for the figures at the end.
const KEPT_DURATIONS: usize = 65_536;
/// How often a node reports its health.
const REPORT_EVERY: Duration = Duration::from_secs(1);

/// What a correcting node does with its samples.
trait Stage<M> {
    /// Puts into use what has become ready since; called between two samples, and must not wait.
    fn refresh(&mut self) {}

    /// One sample in, one out.
    fn correct(&self, sample: &M) -> CorrectedCoordinates;

    /// What goes out beside it.
    fn beside(&self, _corrected: &CorrectedCoordinates) {}

    /// What it has to say of itself on `/diagnostics`.
    fn report(&self, _health: &Diagnostics) -> Result<(), NodeError> {
        Ok(())
    }

    /// Its figures for the summary.
    fn figures(&self, _summary: &mut NodeSummary) {}
}

struct Geometric {
    step: GeometricStep,
    models: ModelFeed,
}

impl Stage<ScaleReading> for Geometric {
    fn refresh(&mut self) {
        if let Some((model, sha256)) = self.models.newest() {
            self.step.put_in_use(model, sha256);
        }
    }

    fn correct(&self, reading: &ScaleReading) -> CorrectedCoordinates {
        self.step.correct(reading)
    }

    fn report(&self, health: &Diagnostics) -> Result<(), NodeError> {
        self.models.report(health, self.step.model_sha256())
    }

    fn figures(&self, summary: &mut NodeSummary) {
        self.models.figures(summary);
    }
}

struct Residual {
    step: ResidualStep,
    fields: ResidualFeed,
    points: Option<QueuedPublisher<PointStamped>>,
    without: Cell<Without>,
}

/// Corrected samples that no residual model belonged to.
#[derive(Debug, Clone, Copy, Default)]
struct Without {
    /// So many in all.
    samples: u64,
    /// Geometric model of the last sample, while it is one of them.
    model_sha256: Option<Sha256>,
}

impl Residual {
    /// What to tell while samples come from another geometric model than the residual model belongs to.
    fn warning(&self) -> Option<String> {
        let model = self.without.get().model_sha256.filter(|_| !self.step.residual_sha256().is_none())?;
        Some(format!(
            "samples pass without the residual: they are of model {model}, the residual model belongs to {}; train on the \
             residuals of the model in use",
            self.step.model_sha256()
        ))
    }
}

impl Stage<CorrectedCoordinates> for Residual {
    fn refresh(&mut self) {
        if let Some((field, _)) = self.fields.newest() {
            self.step.put_in_use(field);
        }
    }

    fn correct(&self, sample: &CorrectedCoordinates) -> CorrectedCoordinates {
        self.step.correct(sample)
    }

    fn beside(&self, corrected: &CorrectedCoordinates) {
        let before = self.without.get();
        let lacks = corrected.corrected_valid && corrected.residual_model_sha256.is_none();
        let model_sha256 = lacks.then_some(corrected.model_sha256);
        self.without.set(Without { samples: before.samples + u64::from(lacks), model_sha256 });
        if lacks
            && before.model_sha256 != model_sha256
            && let Some(warning) = self.warning()
        {
            tracing::warn!("{warning}");
        }
        if let (Some(publisher), Some(point)) = (&self.points, PointStamped::from_corrected(corrected)) {
            publisher.publish(point);
        }
    }

    fn report(&self, health: &Diagnostics) -> Result<(), NodeError> {
        self.fields.report_with(health, self.step.residual_sha256(), self.warning().as_deref())
    }

    fn figures(&self, summary: &mut NodeSummary) {
        self.fields.figures(summary);
        summary.figures.insert("without_residual".to_owned(), self.without.get().samples as f64);
    }
}

pub(super) fn geometric(context: &NodeContext) -> Result<NodeSummary, NodeError> {
    let (model, models) = ModelFeed::open(context)?;
    let step = GeometricStep::new(model, context.launch.max_covariate_age_s);
    pump(context, NodeName::Scale, Geometric { step, models })
}

pub(super) fn residual(context: &NodeContext) -> Result<NodeSummary, NodeError> {
    let points = match &context.ros {
        Some(node) => Some(node.publisher(topics::CORRECTED_POINT, &ros::stream_qos(QUEUE), QUEUE)?),
        None => None,
    };
    let (field, fields) = ResidualFeed::open(context)?;
    let without = Cell::default();
    pump(context, NodeName::Geometric, Residual { step: ResidualStep::new(field), fields, points, without })
}

/// Takes, corrects, gives; counts what each status says.
fn pump<M: Message>(context: &NodeContext, from: NodeName, mut stage: impl Stage<M>) -> Result<NodeSummary, NodeError> {
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
                stage.refresh();
                let since = Instant::now();
                let corrected = stage.correct(&sample);
                durations.push(since.elapsed());
                publisher.send(&corrected)?;
                stage.beside(&corrected);
                statuses[corrected.status as usize] += 1;
                summary.sent += 1;
            }
            None if stopping => break,
            None => stage.refresh(),
        }
        if reported.elapsed() >= REPORT_EVERY {
            reported = Instant::now();
            if let Some(health) = &health {
                report(health, &summary, subscriber.lost(), &statuses)?;
                stage.report(health)?;
            }
        }
    }
    (summary.lost, summary.dropped) = (subscriber.lost(), publisher.dropped());
    for (status, count) in CorrectionStatus::ALL.iter().zip(statuses) {
        summary.figures.insert(status.name().to_lowercase(), count as f64);
    }
    durations.figures(&mut summary);
    stage.figures(&mut summary);
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
    health: &Diagnostics,
    summary: &NodeSummary,
    lost: u64,
    statuses: &[u64; CorrectionStatus::ALL.len()],
) -> Result<(), NodeError> {
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
