//! The monitor's way to a diagnosis: the readings it keeps, who may ask, when it starts by itself, what it tells.
//!
//! Place in the flow: beside the monitor's loop, which hands it readings and the health of the model. A diagnosis is
//! about the readings since the model in use was last consistent over a whole window, and about all that are kept while
//! it is. So an effect that set in during the run is not diluted by readings from before; the readings in which the
//! verdict turned are left out too. One starts by itself only when these readings together contradict the model: a
//! window of a sound one does so once in a while.

use super::changes::STOPPING;
use super::{NodeContext, NodeError, NodeSummary};
use crate::diagnosis_run::{DiagnosisRun, Job};
use crate::launch::{MonitorConfig, NodeName};
use crate::step::{Health, HealthState, ReadingBuffer};
use crate::topics;
use abbe_geometry::machine::Machine;
use abbe_msgs::standard::DiagnosticStatus;
use abbe_msgs::{ScaleReading, Sha256, Stamp, TracerReading};
use abbe_runtime::gateway::{GatewayNode, GatewayService};
use abbe_runtime::ros::{Diagnostics, TriggerOutcome};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::time::Duration;

/// Longest that somebody who asks waits until it has started.
const ANSWER_WITHIN: Duration = Duration::from_secs(30);

/// What the launch file says about diagnoses.
struct Plan {
    config: MonitorConfig,
    folder: PathBuf,
    program: PathBuf,
    model_file: PathBuf,
    machine: Machine,
}

/// How far diagnoses have come.
#[derive(Default)]
struct Counts {
    started: u64,
    finished: u64,
    failed: u64,
}

/// Everything about diagnoses.
pub(super) struct Diagnosis {
    /// Nothing where the launch file names no folder.
    plan: Option<Plan>,
    /// Nothing where the scale readings do not come here.
    readings: Option<ReadingBuffer>,
    running: Option<DiagnosisRun>,
    /// What the last one came to.
    last: Option<Result<String, String>>,
    /// Model that one has been started for by itself.
    started_for: Option<Sha256>,
    counts: Counts,
    asked: Receiver<SyncSender<TriggerOutcome>>,
    advice: String,
    _service: Option<GatewayService>,
}

impl Diagnosis {
    /// Offers the service, and keeps readings where the scale readings come here.
    pub(super) fn open(context: &NodeContext, config: &MonitorConfig) -> Result<Diagnosis, NodeError> {
        let kept = context.launch.takes_over(context.name.name(), NodeName::Scale).is_some();
        let frame_id = &context.machine.machine.frame_id;
        let buffer = || ReadingBuffer::new(frame_id, config.match_within_s, context.launch.max_covariate_age_s);
        let readings = kept.then(buffer);
        let plan = match (&config.diagnosis_folder, &context.launch.model) {
            (Some(folder), Some(model)) => Some(Plan {
                config: config.clone(),
                folder: context.base.join(folder),
                program: std::env::current_exe().map_err(NodeError::Program)?,
                model_file: context.base.join(model),
                machine: context.machine.machine.clone(),
            }),
            _ => None,
        };
        let (ask, asked) = channel::<SyncSender<TriggerOutcome>>();
        let handler = move || {
            let (reply, answer) = sync_channel(1);
            ask.send(reply).map_err(|_| STOPPING.to_owned())?;
            answer.recv_timeout(ANSWER_WITHIN).unwrap_or_else(|_| Err(STOPPING.to_owned()))
        };
        let serve = |node: &GatewayNode| node.trigger_service(topics::DIAGNOSE, handler);
        let service = context.commanded().map(serve).transpose()?;
        let advice = advice(context, config);
        let (counts, running, last, started_for) = (Counts::default(), None, None, None);
        Ok(Diagnosis { plan, readings, running, last, started_for, counts, asked, advice, _service: service })
    }

    /// From now on, stamps this close are the same instant (s).
    pub(super) fn match_within(&mut self, match_within_s: f64) {
        if let Some(readings) = &mut self.readings {
            readings.within(match_within_s);
        }
    }

    /// From now on, a covariate of more than this age (s) is missing.
    pub(super) fn set_max_covariate_age_s(&mut self, max_covariate_age_s: f64) {
        if let Some(readings) = &mut self.readings {
            readings.set_max_covariate_age_s(max_covariate_age_s);
        }
    }

    /// Keeps a scale reading.
    pub(super) fn scale(&mut self, reading: &ScaleReading) {
        if let Some(readings) = &mut self.readings {
            readings.scale(reading);
        }
    }

    /// Keeps a tracer reading.
    pub(super) fn tracer(&mut self, reading: &TracerReading) {
        if let Some(readings) = &mut self.readings {
            readings.tracer(reading);
        }
    }

    /// What to do about a model that does not hold.
    pub(super) fn advice(&self) -> &str {
        &self.advice
    }

    /// Looks after a diagnosis under way, answers who asks, starts one where that is due. Whether there is news.
    pub(super) fn attend(&mut self, health: &Health) -> bool {
        let mut news = self.conclude();
        while let Ok(reply) = self.asked.try_recv() {
            match self.job(health) {
                Ok(job) => self.start(job, Some(reply)),
                // Who asked may have given up.
                Err(refusal) => drop(reply.send(Err(refusal))),
            }
            news = true;
        }
        if self.is_due(health)
            && let Ok(job) = self.job(health)
        {
            tracing::warn!(readings = job.campaign.readings.len(), "the model is degraded: a diagnosis starts");
            self.started_for = Some(health.model_sha256);
            self.start(job, None);
            news = true;
        }
        news
    }

    /// Whether a diagnosis is to start by itself: once for a model, when enough of the new state has been seen.
    fn is_due(&self, health: &Health) -> bool {
        let (Some(plan), Some(readings)) = (&self.plan, &self.readings) else { return false };
        let least = plan.config.least_readings();
        plan.config.diagnose_when_degraded
            && health.state == HealthState::Degraded
            && health.unsound.is_some_and(|unsound| unsound.state == HealthState::Degraded)
            && self.running.is_none()
            && self.started_for != Some(health.model_sha256)
            && readings.count_since(since(health), least) >= least
    }

    /// What there is to diagnose, or why there is nothing.
    fn job(&self, health: &Health) -> Result<Job, String> {
        let without = "diagnoses are off: name a folder for them as diagnosis_folder in [monitor] of the launch file";
        let plan = self.plan.as_ref().ok_or(without)?;
        let readings =
            self.readings.as_ref().ok_or("no scale readings come here: add an edge from scale to monitor")?;
        if self.running.is_some() {
            return Err("a diagnosis is running; its outcome will stand on /diagnostics".to_owned());
        }
        let least = plan.config.least_readings();
        let found = readings.count_since(since(health), least);
        if found < least {
            let which = if health.unsound.is_some() { " since the model was last consistent" } else { "" };
            return Err(format!("{found} readings{which} are too few; a diagnosis needs {least}, go on measuring"));
        }
        Ok(Job {
            program: plan.program.clone(),
            model_file: plan.model_file.clone(),
            machine: plan.machine.clone(),
            in_use: health.model_sha256,
            campaign: readings.campaign(since(health)),
            folder: plan.folder.clone(),
            adopt: plan.config.adopt_diagnosed_model,
        })
    }

    /// Starts a diagnosis; one that cannot be started has failed, and the monitor goes on.
    fn start(&mut self, job: Job, reply: Option<SyncSender<TriggerOutcome>>) {
        match DiagnosisRun::start(job, reply) {
            Ok(run) => {
                self.running = Some(run);
                self.counts.started += 1;
            }
            Err(error) => {
                let problem = NodeError::Thread(error).to_string();
                tracing::warn!("no diagnosis: {problem}");
                self.counts.failed += 1;
                self.last = Some(Err(problem));
            }
        }
    }

    /// Takes the outcome of a diagnosis that has ended.
    fn conclude(&mut self) -> bool {
        let Some(outcome) = self.running.as_mut().and_then(DiagnosisRun::outcome) else { return false };
        self.running = None;
        match &outcome {
            Ok(words) => {
                self.counts.finished += 1;
                tracing::warn!("diagnosis {words}");
            }
            Err(problem) => {
                self.counts.failed += 1;
                tracing::warn!("no diagnosis: {problem}");
            }
        }
        self.last = Some(outcome);
        true
    }

    /// Tells what is kept, and how far diagnoses have come.
    pub(super) fn report(&self, diagnostics: &Diagnostics, health: &Health) {
        let (level, message) = match (&self.running, &self.last) {
            (Some(_), _) => (DiagnosticStatus::OK, "a diagnosis is running"),
            (None, Some(Ok(words))) => (DiagnosticStatus::OK, words.as_str()),
            (None, Some(Err(problem))) => (DiagnosticStatus::WARN, problem.as_str()),
            (None, None) if self.plan.is_none() => (DiagnosticStatus::OK, "diagnoses are off"),
            (None, None) => (DiagnosticStatus::OK, "no diagnosis so far"),
        };
        let count = |of: fn(&ReadingBuffer) -> u64| self.readings.as_ref().map_or(0, of).to_string();
        let to_diagnose = |readings: &ReadingBuffer| readings.count_since(since(health), usize::MAX);
        let needed = self.plan.as_ref().map_or("none".to_owned(), |plan| plan.config.least_readings().to_string());
        let figures = [
            ("readings kept", count(|readings| readings.len() as u64)),
            ("oldest readings given up", count(ReadingBuffer::dropped)),
            ("readings not usable", count(ReadingBuffer::unusable)),
            ("readings to diagnose", self.readings.as_ref().map_or(0, to_diagnose).to_string()),
            ("readings needed", needed),
            ("diagnoses started", self.counts.started.to_string()),
            ("diagnoses finished", self.counts.finished.to_string()),
            ("diagnoses failed", self.counts.failed.to_string()),
        ];
        diagnostics.report("diagnosis", level, message, figures);
    }

    /// Counts for the node's summary.
    pub(super) fn figures(&self, summary: &mut NodeSummary) {
        let counts = &self.counts;
        let kept = self.readings.as_ref().map_or(0, ReadingBuffer::len);
        let figures = [
            ("readings_kept", kept as f64),
            ("diagnoses_started", counts.started as f64),
            ("diagnoses_finished", counts.finished as f64),
            ("diagnoses_failed", counts.failed as f64),
        ];
        summary.figures.extend(figures.map(|(name, value)| (name.to_owned(), value)));
    }
}

/// Instant from which readings are about the state to diagnose; `None` where all are.
fn since(health: &Health) -> Option<Stamp> {
    health.unsound.map(|unsound| unsound.since)
}

/// What to do about a model that does not hold.
fn advice(context: &NodeContext, config: &MonitorConfig) -> String {
    let itself = "a diagnosis starts by itself when enough readings of this state have come";
    let service = |node: &GatewayNode| {
        format!("call the service {}/diagnose (std_srvs/srv/Trigger)", node.identity().qualified())
    };
    match (&config.diagnosis_folder, context.commanded(), config.diagnose_when_degraded) {
        (None, _, _) => "name a diagnosis_folder in [monitor] of the launch file to have it diagnosed".to_owned(),
        (_, Some(node), false) => format!("to have it diagnosed, {}", service(node)),
        (_, Some(node), true) => format!("{itself}; to have it now, {}", service(node)),
        (_, None, true) => itself.to_owned(),
        (_, None, false) if context.ros.is_some() => {
            "to have it diagnosed, set diagnose_when_degraded in [monitor] of the launch file, or let its service ~/diagnose be \
             called with commands_from_ros = true"
                .to_owned()
        }
        (_, None, false) => {
            "to have it diagnosed, set diagnose_when_degraded in [monitor] of the launch file, or give \
                             the monitor an edge over dds and call its service ~/diagnose"
                .to_owned()
        }
    }
}
