//! The monitor node: range residuals as a topic, the model's health on `/diagnostics`.
//!
//! Place in the flow: beside the correcting path, never in it. Keeps readings for a diagnosis where the launch file has
//! an edge from the scale node to it.

use super::changes::{FROM_NOW_ON, InUse, STOPPING};
use super::diagnosis_request::Diagnosis;
use super::model::ModelFeed;
use super::parameters::{MODEL, apply};
use super::remarks::{self, Input, Remarks};
use super::traffic::send;
use super::{LOOK_UP, NodeContext, NodeError, NodeSummary, take};
use crate::launch::NodeName;
use crate::step::{Health, HealthState, MonitorSettings, MonitorStep};
use abbe_msgs::standard::DiagnosticStatus;
use abbe_msgs::{CorrectedCoordinates, RangeResidual, ScaleReading, Sha256, Stamp, TracerReading};
use abbe_runtime::ros::{Diagnostics, ParameterValue, TriggerOutcome};
use abbe_runtime::{Publish, Subscribe};
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

/// How often the health is told.
const REPORT_EVERY: Duration = Duration::from_secs(1);
/// Times their uncertainty from which residuals are not those of a machine that lacks something.
const OF_ANOTHER: f64 = 100.0;

/// What comes in.
struct Inputs {
    corrected: Box<dyn Subscribe<CorrectedCoordinates>>,
    tracer: Box<dyn Subscribe<TracerReading>>,
    /// Only where the launch file has an edge for it.
    scale: Option<Box<dyn Subscribe<ScaleReading>>>,
}

/// What may be set while the loop runs.
struct Set {
    bounds: MonitorSettings,
    max_covariate_age_s: f64,
}

/// What the loop works with.
struct Monitor {
    step: MonitorStep,
    models: ModelFeed,
    diagnosis: Diagnosis,
    health: Option<Diagnostics>,
    reported: Instant,
    told: HealthState,
    /// Beginning of the state that has been warned of; a verdict may come and go in it.
    warned: Option<Stamp>,
    looked_for: Option<Sha256>,
    remarks: Remarks,
    /// What was set, newest last.
    set: Receiver<Set>,
    _changes: InUse,
}

pub(super) fn run(context: &NodeContext) -> Result<NodeSummary, NodeError> {
    let mut monitor = Monitor::open(context)?;
    let mut summary = context.summary();
    let mut publisher: Option<Box<dyn Publish<RangeResidual>>> =
        if context.launch.publishes_over(context.name).is_empty() { None } else { Some(context.publisher()?) };
    let mut inputs = Inputs::open(context)?;
    context.lifecycle.opened();
    loop {
        let stopping = context.shutdown.requested();
        let patience = if stopping { Duration::ZERO } else { LOOK_UP };
        let before = summary.received;
        let residuals = if context.lifecycle.is_active() {
            monitor.take(&mut inputs, patience, &mut summary)
        } else {
            inputs.pass_over(patience, &mut summary);
            monitor.step.give_up()
        };
        give(publisher.as_deref_mut(), &residuals, &mut summary);
        monitor.attend(&inputs, &summary);
        if stopping && summary.received == before {
            break;
        }
    }
    give(publisher.as_deref_mut(), &monitor.step.give_up(), &mut summary);
    remarks::figures(&mut summary, &inputs.remarkable(&monitor.step));
    summary.lost =
        inputs.corrected.lost() + inputs.tracer.lost() + inputs.scale.as_ref().map_or(0, |scale| scale.lost());
    summary.dropped = publisher.map_or(0, |p| p.dropped());
    figures(&mut summary, &monitor.step.health());
    monitor.models.figures(&mut summary);
    monitor.diagnosis.figures(&mut summary);
    Ok(summary)
}

impl Inputs {
    fn open(context: &NodeContext) -> Result<Inputs, NodeError> {
        let from_scale = context.launch.takes_over(context.name.name(), NodeName::Scale);
        Ok(Inputs {
            corrected: context.subscriber(NodeName::Residual)?,
            tracer: context.subscriber(NodeName::Tracer)?,
            scale: from_scale.map(|_| context.subscriber(NodeName::Scale)).transpose()?,
        })
    }

    /// Takes what has come, and makes nothing of it.
    fn pass_over(&mut self, patience: Duration, summary: &mut NodeSummary) {
        take(self.corrected.as_mut(), patience, summary);
        while take(self.tracer.as_mut(), Duration::ZERO, summary).is_some() {}
        let Some(scale) = &mut self.scale else { return };
        while take(scale.as_mut(), Duration::ZERO, summary).is_some() {}
    }

    /// What was found of the order of what comes in.
    fn remarkable(&self, step: &MonitorStep) -> [Input; 2] {
        let [corrected, tracer] = step.streams();
        [
            Input { name: "corrected samples", counts: corrected, interleaved: self.corrected.interleaved() },
            // Several tracers may share the topic; those that share a station's name are told by their sequences.
            Input { name: "tracer readings", counts: tracer, interleaved: 0 },
        ]
    }
}

impl Monitor {
    fn open(context: &NodeContext) -> Result<Monitor, NodeError> {
        let incomplete = |part| NodeError::Incomplete { node: context.name.name(), part };
        let (model, models) = ModelFeed::open(context)?;
        let (model, sha256) = model.ok_or_else(|| incomplete("a model"))?;
        let bounds = || incomplete("the monitor's bounds");
        let settings = context.launch.monitor_settings().ok_or_else(bounds)?;
        let config = context.launch.monitor.as_ref().ok_or_else(bounds)?;
        let (give, taken) = channel();
        let changes = context.changes.put_to_use(change(context, models.changer(), give));
        Ok(Monitor {
            step: match context.launch.takes_over(context.name.name(), NodeName::Scale) {
                Some(_) => MonitorStep::new(model, sha256, settings).with_scales(context.launch.max_covariate_age_s),
                None => MonitorStep::new(model, sha256, settings),
            },
            models,
            diagnosis: Diagnosis::open(context, config)?,
            health: context.ros.as_ref().map(|node| node.diagnostics(&context.machine.machine.name)),
            reported: Instant::now(),
            told: HealthState::Unknown,
            warned: None,
            looked_for: None,
            remarks: Remarks::default(),
            set: taken,
            _changes: changes,
        })
    }

    /// Takes what has come, waiting at most `patience` for it; gives what can be said about it.
    fn take(&mut self, inputs: &mut Inputs, patience: Duration, summary: &mut NodeSummary) -> Vec<RangeResidual> {
        let mut residuals = Vec::new();
        if let Some(Set { bounds, max_covariate_age_s }) = self.set.try_iter().last() {
            self.diagnosis.match_within(bounds.match_within_s);
            self.diagnosis.set_max_covariate_age_s(max_covariate_age_s);
            self.step.judge_by(bounds);
            self.step.set_max_covariate_age_s(max_covariate_age_s);
        }
        if let Some((model, sha256)) = self.models.newest() {
            residuals.extend(self.step.learn(model, sha256));
        }
        if let Some(sample) = take(inputs.corrected.as_mut(), patience, summary) {
            residuals.extend(self.step.corrected(&sample));
        }
        if let Some(scale) = &mut inputs.scale {
            while let Some(reading) = take(scale.as_mut(), Duration::ZERO, summary) {
                self.diagnosis.scale(&reading);
                residuals.extend(self.step.scale(&reading));
            }
        }
        while let Some(reading) = take(inputs.tracer.as_mut(), Duration::ZERO, summary) {
            self.diagnosis.tracer(&reading);
            residuals.extend(self.step.tracer(&reading));
        }
        // The correcting node may be first to see a new model.
        if self.step.awaited_model() != self.looked_for {
            self.looked_for = self.step.awaited_model();
            self.models.look_now();
        }
        residuals
    }

    /// Looks after diagnoses and tells the health, at once when there is news.
    fn attend(&mut self, inputs: &Inputs, summary: &NodeSummary) {
        let now = self.step.health();
        let news = self.diagnosis.attend(&now);
        let spell = now.unsound.map(|unsound| unsound.since);
        if now.state == HealthState::Degraded && self.warned != spell {
            self.warned = spell;
            tracing::warn!(mean_square = now.mean_square, "{}; {}", degraded(&now), self.diagnosis.advice());
        }
        if !news && now.state == self.told && self.reported.elapsed() < REPORT_EVERY {
            return;
        }
        (self.told, self.reported) = (now.state, Instant::now());
        self.remarks.report(self.health.as_ref(), summary, &inputs.remarkable(&self.step));
        let Some(health) = &self.health else { return };
        report(health, &now, self.diagnosis.advice(), self.step.lacking());
        self.models.report(health, now.model_sha256);
        self.diagnosis.report(health, &now);
    }
}

/// Puts another model file, other bounds, or another age to use; a file that cannot be used leaves the others as they are.
fn change(
    context: &NodeContext,
    model: impl Fn(&Path) -> Result<(), String> + Send + 'static,
    set: Sender<Set>,
) -> impl FnMut(&[(String, ParameterValue)]) -> TriggerOutcome + Send + 'static {
    let (mut launch, base, node) = (context.launch.clone(), context.base.clone(), context.name);
    move |values| {
        for (_, value) in values.iter().filter(|(name, _)| name == MODEL) {
            if let ParameterValue::String(path) = value {
                model(&base.join(path))?;
            }
        }
        apply(values.iter().map(|(name, value)| (name.as_str(), value)), &mut launch, node);
        if let Some(bounds) = launch.monitor_settings() {
            let max_covariate_age_s = launch.max_covariate_age_s;
            set.send(Set { bounds, max_covariate_age_s }).map_err(|_| STOPPING.to_owned())?;
        }
        Ok(FROM_NOW_ON.to_owned())
    }
}

fn give(
    publisher: Option<&mut (dyn Publish<RangeResidual> + 'static)>,
    residuals: &[RangeResidual],
    summary: &mut NodeSummary,
) {
    let Some(publisher) = publisher else { return };
    residuals.iter().for_each(|residual| send(publisher, residual, summary));
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

/// What a degraded model means, by how large the residuals are.
fn degraded(health: &Health) -> String {
    let times = health.mean_square.map(f64::sqrt);
    let size = match (health.rms_m, times) {
        (Some(rms_m), Some(times)) => format!(" ({:.3} µm rms, {times:.1} times as large)", rms_m * 1e6),
        _ => String::new(),
    };
    let cause = match times {
        Some(times) if times > OF_ANOTHER => {
            "more than a machine changes; is the model that of this machine, and are stations, offsets and units those of its campaign?"
        }
        _ => "the model lacks something, or the machine changed",
    };
    format!("range residuals exceed their uncertainties{size}: {cause}")
}

fn report(diagnostics: &Diagnostics, health: &Health, advice: &str, lacking: Option<&str>) {
    let (level, message) = match (health.state, lacking) {
        (HealthState::Unknown, Some(lacking)) => {
            (DiagnosticStatus::WARN, format!("nothing tells whether the model holds: {lacking}"))
        }
        (HealthState::Unknown, None) => (DiagnosticStatus::OK, "too few range residuals to judge the model".to_owned()),
        (HealthState::Consistent, _) => {
            (DiagnosticStatus::OK, "range residuals are as large as their uncertainties say".to_owned())
        }
        (HealthState::Degraded, _) => (DiagnosticStatus::WARN, format!("{}; {advice}", degraded(health))),
    };
    let optional = |value: Option<f64>, scale: f64| value.map_or("unknown".to_owned(), |v| format!("{:.3}", v * scale));
    let figures = [
        ("residuals in window", health.residuals.to_string()),
        ("mean square of residual/u", optional(health.mean_square, 1.0)),
        ("rms residual (um)", optional(health.rms_m, 1e6)),
        ("out of bounds", health.out_of_bounds.to_string()),
        ("not predicted", health.unpredicted.to_string()),
        ("lacking for a prediction", lacking.unwrap_or("nothing").to_owned()),
    ];
    diagnostics.report("range residual", level, &message, figures);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Residuals of 248 mm were told in the same words as those of 1.2 times the noise.
    #[test]
    fn regress_a_misfit_is_told_with_its_size_and_one_beyond_any_machine_as_such() {
        let health = |mean_square: f64, rms_m: f64| Health {
            state: HealthState::Degraded,
            model_sha256: Sha256::from_bytes([7; 32]),
            residuals: 400,
            mean_square: Some(mean_square),
            rms_m: Some(rms_m),
            unsound: None,
            out_of_bounds: 0,
            unpredicted: 0,
        };
        let little = degraded(&health(1.44, 0.36e-6));
        assert!(little.contains("(0.360 µm rms, 1.2 times as large): the model lacks something"), "{little}");
        let another = degraded(&health(7e11, 0.248));
        assert!(
            another.contains("more than a machine changes") && another.contains("that of this machine"),
            "{another}"
        );
    }
}
