//! The monitor node: range residuals as a topic, the model's health on `/diagnostics`.
//!
//! Place in the flow: beside the correcting path, never in it.

use super::model::ModelFeed;
use super::{LOOK_UP, NodeContext, NodeError, NodeSummary, take};
use crate::launch::NodeName;
use crate::step::{Health, HealthState, MonitorStep};
use abbe_msgs::standard::DiagnosticStatus;
use abbe_msgs::{CorrectedCoordinates, RangeResidual, TracerReading};
use abbe_runtime::ros::Diagnostics;
use abbe_runtime::{Publish, TransportError};
use std::time::{Duration, Instant};

/// How often the health is told.
const REPORT_EVERY: Duration = Duration::from_secs(1);
/// What a degraded model means.
const DEGRADED: &str = "range residuals exceed their uncertainties: the model lacks something, or the machine changed";

pub(super) fn run(context: &NodeContext) -> Result<NodeSummary, NodeError> {
    let incomplete = |part| NodeError::Incomplete { node: context.name.name(), part };
    let (model, models) = ModelFeed::open(context)?;
    let (model, sha256) = model.ok_or_else(|| incomplete("a model"))?;
    let settings = context.launch.monitor_settings().ok_or_else(|| incomplete("the monitor's bounds"))?;
    let mut step = MonitorStep::new(model, sha256, settings);
    let mut summary = NodeSummary { node: context.name.name().to_owned(), ..NodeSummary::default() };
    let health = context.ros.as_ref().map(|node| node.diagnostics(&context.machine.machine.name)).transpose()?;
    let mut publisher: Option<Box<dyn Publish<RangeResidual>>> =
        if context.launch.publishes_over(context.name).is_empty() { None } else { Some(context.publisher()?) };
    let mut corrected = context.subscriber::<CorrectedCoordinates>(NodeName::Residual)?;
    let mut tracer = context.subscriber::<TracerReading>(NodeName::Tracer)?;
    let mut reported = Instant::now();
    let mut told = HealthState::Unknown;
    let mut looked_for = None;
    loop {
        let stopping = context.shutdown.requested();
        let patience = if stopping { Duration::ZERO } else { LOOK_UP };
        let mut residuals = Vec::new();
        if let Some((model, sha256)) = models.newest() {
            residuals.extend(step.learn(model, sha256));
        }
        let sample = take(corrected.as_mut(), patience, &mut summary)?;
        residuals.extend(sample.iter().flat_map(|sample| step.corrected(sample)));
        let mut idle = sample.is_none();
        while let Some(reading) = take(tracer.as_mut(), Duration::ZERO, &mut summary)? {
            residuals.extend(step.tracer(&reading));
            idle = false;
        }
        // The correcting node may be first to see a new model.
        if step.awaited_model() != looked_for {
            looked_for = step.awaited_model();
            models.look_now();
        }
        summary.sent += give(publisher.as_deref_mut(), &residuals)?;
        let now = step.health();
        if now.state != told && now.state == HealthState::Degraded {
            tracing::warn!(mean_square = now.mean_square, "{DEGRADED}");
        }
        if now.state != told || reported.elapsed() >= REPORT_EVERY {
            (told, reported) = (now.state, Instant::now());
            if let Some(health) = &health {
                report(health, &now)?;
                models.report(health, now.model_sha256)?;
            }
        }
        if stopping && idle {
            break;
        }
    }
    summary.sent += give(publisher.as_deref_mut(), &step.give_up())?;
    summary.lost = corrected.lost() + tracer.lost();
    summary.dropped = publisher.map_or(0, |p| p.dropped());
    figures(&mut summary, &step.health());
    models.figures(&mut summary);
    Ok(summary)
}

fn give(
    publisher: Option<&mut (dyn Publish<RangeResidual> + 'static)>,
    residuals: &[RangeResidual],
) -> Result<u64, TransportError> {
    let Some(publisher) = publisher else { return Ok(0) };
    for residual in residuals {
        publisher.send(residual)?;
    }
    Ok(residuals.len() as u64)
}

fn figures(summary: &mut NodeSummary, health: &Health) {
    let mut insert = |name: &str, value: f64| summary.figures.insert(name.to_owned(), value);
    insert("residuals_in_window", health.residuals as f64);
    insert("out_of_bounds", health.out_of_bounds as f64);
    insert("unpredicted", health.unpredicted as f64);
    if let (Some(mean_square), Some(rms_m)) = (health.mean_square, health.rms_m) {
        insert("mean_square", mean_square);
        insert("rms_um", rms_m * 1e6);
    }
}

fn report(diagnostics: &Diagnostics, health: &Health) -> Result<(), NodeError> {
    let (level, message) = match health.state {
        HealthState::Unknown => (DiagnosticStatus::OK, "too few range residuals to judge the model"),
        HealthState::Consistent => (DiagnosticStatus::OK, "range residuals are as large as their uncertainties say"),
        HealthState::Degraded => (DiagnosticStatus::WARN, DEGRADED),
    };
    let optional = |value: Option<f64>, scale: f64| value.map_or("unknown".to_owned(), |v| format!("{:.3}", v * scale));
    let figures = [
        ("residuals in window", health.residuals.to_string()),
        ("mean square of residual/u", optional(health.mean_square, 1.0)),
        ("rms residual (um)", optional(health.rms_m, 1e6)),
        ("out of bounds", health.out_of_bounds.to_string()),
        ("not predicted", health.unpredicted.to_string()),
    ];
    diagnostics.report("range residual", level, message, figures)?;
    Ok(())
}
