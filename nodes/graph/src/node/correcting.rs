//! The geometric and the residual node: one sample in, one sample out, on one thread.
//!
//! Place in the flow: the correcting path. Nothing here waits for a subscriber, for the network or for a file:
//! transports hand samples on without waiting, the standard message goes out on a thread of its own, and a new model is
//! read on another; the loop takes it between two samples, so that none is lost and none corrected by half of each. The one thing
//! that the residual node waits for, and not for long, is the scale reading of a sample whose residual model has further inputs. Once
//! it is at work nothing that comes in, and no transport, ends the loop.

use super::changes::{FROM_NOW_ON, STOPPING};
use super::model::{ModelFeed, ResidualFeed};
use super::parameters::{MAX_COVARIATE_AGE, MODEL, RESIDUAL_MODEL};
use super::realtime::OnPath;
use super::remarks::{self, Input, Remarks};
use super::scenery;
use super::traffic::send;
use super::{LOOK_UP, NodeContext, NodeError, NodeSummary, take};
use crate::launch::NodeName;
use crate::step::{GeometricStep, Mark, ResidualStep, Scales, StreamCounts, StreamWatch};
use abbe_msgs::standard::DiagnosticStatus;
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, Message, ScaleReading, Sha256};
use abbe_runtime::Subscribe;
use abbe_runtime::ros::{Diagnostics, ParameterValue, TriggerOutcome};
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

/// Durations kept for the figures at the end.
const KEPT_DURATIONS: usize = 65_536;
/// Longest that the residual node waits for a reading that was sent before its corrected sample: threads of a loaded machine.
const READING_WITHIN: Duration = Duration::from_millis(20);
/// How often a node reports its health.
const REPORT_EVERY: Duration = Duration::from_secs(1);

/// What a correcting node does with its samples.
trait Stage<M> {
    /// Puts into use what has become ready since; called between two samples, and must not wait.
    fn refresh(&mut self) {}

    /// One sample in, one out.
    fn correct(&mut self, sample: &M) -> CorrectedCoordinates;

    /// What comes in, and what was found of its order.
    fn input(&self) -> (&'static str, StreamCounts);

    /// What is kept of it.
    fn beside(&mut self, _corrected: &CorrectedCoordinates) {}

    /// What it has to say of itself on `/diagnostics`.
    fn report(&self, _health: &Diagnostics) {}

    /// Its figures for the summary.
    fn figures(&self, _summary: &mut NodeSummary) {}
}

struct Geometric {
    step: GeometricStep,
    watch: StreamWatch,
    models: ModelFeed,
    /// Ages (s) that were set, newest last.
    ages_s: Receiver<f64>,
}

impl Stage<ScaleReading> for Geometric {
    fn refresh(&mut self) {
        if let Some((model, sha256)) = self.models.newest() {
            self.step.put_in_use(model, sha256);
        }
        if let Some(age_s) = self.ages_s.try_iter().last() {
            self.step.set_max_covariate_age_s(age_s);
        }
    }

    fn correct(&mut self, reading: &ScaleReading) -> CorrectedCoordinates {
        self.watch.pass(Mark::from(reading), self.step.correct(reading))
    }

    fn input(&self) -> (&'static str, StreamCounts) {
        ("scale readings", self.watch.counts())
    }

    fn report(&self, health: &Diagnostics) {
        self.models.report(health, self.step.model_sha256());
    }

    fn figures(&self, summary: &mut NodeSummary) {
        self.models.figures(summary);
    }
}

struct Residual {
    step: ResidualStep,
    watch: StreamWatch,
    fields: ResidualFeed,
    without: Without,
    /// Ages (s) that were set, newest last.
    ages_s: Receiver<f64>,
    /// Where the launch file has an edge for them.
    readings: Option<Readings>,
}

/// Scale readings beside the corrected samples, for residual models that ask for more than the position.
struct Readings {
    subscriber: Box<dyn Subscribe<ScaleReading>>,
    kept: Scales,
    frame_id: String,
    /// Whether one was waited for in vain, and none has come since: then none is waited for, as a stream that has broken off must not
    /// hold up the samples.
    is_silent: bool,
    /// What is told of the readings is told by the node that corrects them; here they only bring covariates.
    summary: NodeSummary,
}

impl Readings {
    fn open(context: &NodeContext) -> Result<Option<Readings>, NodeError> {
        let from_scale = context.launch.takes_over(context.name.name(), NodeName::Scale);
        let open = |_| {
            Ok(Readings {
                subscriber: context.subscriber(NodeName::Scale)?,
                kept: Scales::new(context.launch.max_covariate_age_s),
                frame_id: context.machine.machine.frame_id.clone(),
                is_silent: false,
                summary: context.summary(),
            })
        };
        from_scale.map(open).transpose()
    }

    /// Takes what has come, and what comes within this time if there was nothing.
    fn take(&mut self, mut patience: Duration) {
        while let Some(reading) = take(self.subscriber.as_mut(), patience, &mut self.summary) {
            (patience, self.is_silent) = (Duration::ZERO, false);
            // One of another frame would stand for this machine's.
            if reading.frame_id.as_str() == self.frame_id {
                self.kept.keep(&reading);
            }
        }
    }

    /// Takes what has come, and waits for the reading of this sample if it has not: it left before the sample was corrected, and is on
    /// its way. One that was lost is not waited for, as the next one shows it.
    fn await_reading_of(&mut self, sample: &CorrectedCoordinates) {
        let since = Instant::now();
        self.take(Duration::ZERO);
        while self.kept.may_come(sample) && !self.is_silent {
            self.take(READING_WITHIN.saturating_sub(since.elapsed()));
            self.is_silent = self.kept.may_come(sample) && since.elapsed() >= READING_WITHIN;
        }
    }
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
        let model = self.without.model_sha256.filter(|_| !self.step.residual_sha256().is_none())?;
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
        if let Some(age_s) = self.ages_s.try_iter().last() {
            self.step.set_max_covariate_age_s(age_s);
        }
        if let Some(readings) = &mut self.readings {
            readings.take(Duration::ZERO);
        }
    }

    fn correct(&mut self, sample: &CorrectedCoordinates) -> CorrectedCoordinates {
        let readings = self.readings.as_mut().filter(|_| self.step.asks_of(sample));
        let covariates = readings.and_then(|readings| {
            readings.await_reading_of(sample);
            readings.kept.table(sample)
        });
        self.watch.pass(Mark::from(sample), self.step.correct(sample, covariates))
    }

    fn input(&self) -> (&'static str, StreamCounts) {
        ("corrected samples", self.watch.counts())
    }

    fn beside(&mut self, corrected: &CorrectedCoordinates) {
        let before = self.without;
        let lacks = corrected.corrected_valid && corrected.residual_model_sha256.is_none();
        let model_sha256 = lacks.then_some(corrected.model_sha256);
        self.without = Without { samples: before.samples + u64::from(lacks), model_sha256 };
        if lacks
            && before.model_sha256 != model_sha256
            && let Some(warning) = self.warning()
        {
            tracing::warn!("{warning}");
        }
    }

    fn report(&self, health: &Diagnostics) {
        self.fields.report_with(health, self.step.residual_sha256(), self.warning().as_deref());
    }

    fn figures(&self, summary: &mut NodeSummary) {
        self.fields.figures(summary);
        summary.figures.insert("without_residual".to_owned(), self.without.samples as f64);
    }
}

pub(super) fn geometric(context: &NodeContext) -> Result<NodeSummary, NodeError> {
    let (model, models) = ModelFeed::open(context)?;
    let (give, ages_s) = channel();
    let _changes = context.changes.put_to_use(change(context, MODEL, models.changer(), give));
    let step = GeometricStep::new(model, context.launch.max_covariate_age_s);
    pump(context, NodeName::Scale, Geometric { step, watch: StreamWatch::default(), models, ages_s })
}

pub(super) fn residual(context: &NodeContext) -> Result<NodeSummary, NodeError> {
    let (field, fields) = ResidualFeed::open(context)?;
    let (give, ages_s) = channel();
    let _changes = context.changes.put_to_use(change(context, RESIDUAL_MODEL, fields.changer(), give));
    let step = ResidualStep::new(field, context.launch.max_covariate_age_s).in_frame(&context.machine.machine.frame_id);
    let (watch, without) = (StreamWatch::default(), Without::default());
    let readings = Readings::open(context)?;
    let _scenery = scenery::open(context)?;
    pump(context, NodeName::Geometric, Residual { step, watch, fields, without, ages_s, readings })
}

/// Puts another file, or another age, to use; a file that cannot be used leaves the age as it is.
fn change(
    context: &NodeContext,
    file: &'static str,
    load: impl Fn(&Path) -> Result<(), String> + Send + 'static,
    ages_s: Sender<f64>,
) -> impl FnMut(&[(String, ParameterValue)]) -> TriggerOutcome + Send + 'static {
    let base = context.base.clone();
    move |values| {
        let mut age_s = None;
        for (name, value) in values {
            match value {
                ParameterValue::String(path) if name == file => load(&base.join(path))?,
                ParameterValue::Double(seconds) if name == MAX_COVARIATE_AGE => age_s = Some(*seconds),
                _ => return Err(format!("parameter '{name}' is fixed while the node runs; set it at the start")),
            }
        }
        age_s.map_or(Ok(()), |age_s| ages_s.send(age_s)).map_err(|_| STOPPING.to_owned())?;
        Ok(FROM_NOW_ON.to_owned())
    }
}

/// Takes, corrects, gives; counts what each status says.
fn pump<M: Message>(context: &NodeContext, from: NodeName, mut stage: impl Stage<M>) -> Result<NodeSummary, NodeError> {
    let mut summary = context.summary();
    let mut passed = Passed::default();
    let health = context.ros.as_ref().map(|node| node.diagnostics(&context.machine.machine.name));
    let mut publisher = context.publisher::<CorrectedCoordinates>()?;
    let mut subscriber = context.subscriber::<M>(from)?;
    let mut reported = Instant::now();
    let (mut durations, mut remarks) = (Durations::default(), Remarks::default());
    let mut rivals = Rivals::of(context.name);
    let mut realtime = OnPath::enter(context)?;
    context.lifecycle.opened();
    loop {
        realtime.breathe();
        let stopping = context.shutdown.requested();
        let patience = if stopping { Duration::ZERO } else { LOOK_UP };
        match take(subscriber.as_mut(), patience, &mut summary) {
            Some(sample) => {
                stage.refresh();
                let since = Instant::now();
                let corrected = stage.correct(&sample);
                let corrected = if context.lifecycle.is_active() { corrected } else { corrected.while_inactive() };
                let corrected = Rivals::mark(corrected, publisher.others());
                durations.push(since.elapsed());
                send(publisher.as_mut(), &corrected, &mut summary);
                stage.beside(&corrected);
                passed.count(corrected.status);
            }
            None if stopping => break,
            None => stage.refresh(),
        }
        if reported.elapsed() >= REPORT_EVERY {
            reported = Instant::now();
            rivals.tell(publisher.others());
            let input = input(&stage, subscriber.as_ref());
            remarks.report(health.as_ref(), &summary, &[input]);
            if let Some(health) = &health {
                report(health, &summary, subscriber.lost(), &passed, &rivals);
                stage.report(health);
            }
        }
    }
    remarks::figures(&mut summary, &[input(&stage, subscriber.as_ref())]);
    (summary.lost, summary.dropped) = (subscriber.lost(), publisher.dropped());
    for (status, count) in CorrectionStatus::ALL.iter().zip(passed.statuses) {
        summary.figures.insert(status.name().to_lowercase(), count as f64);
    }
    durations.figures(&mut summary);
    realtime.figures(&mut summary);
    stage.figures(&mut summary);
    Ok(summary)
}

fn input<M: Message>(stage: &impl Stage<M>, subscriber: &dyn Subscribe<M>) -> Input {
    let (name, counts) = stage.input();
    Input { name, counts, interleaved: subscriber.interleaved() }
}

/// Other programs that publish what this node does; on one host they would have been refused.
struct Rivals {
    topic: &'static str,
    /// As many as were told of in the log.
    now: usize,
}

impl Rivals {
    fn of(node: NodeName) -> Rivals {
        Rivals { topic: node.topic().unwrap_or_default(), now: 0 }
    }

    /// The sample with what there is to say of its topic.
    fn mark(corrected: CorrectedCoordinates, rivals: usize) -> CorrectedCoordinates {
        if rivals > 0 { corrected.beside_another_publisher() } else { corrected }
    }

    /// What to say of it while there are any.
    fn words(&self) -> Option<String> {
        let (now, topic) = (self.now, self.topic);
        (now > 0).then(|| {
            format!(
                "{now} other publishers of {topic} over DDS: users take a mixture; a second launch in this namespace, or a \
                 recording that is played? Stop all but one (ros2 topic info --verbose names them)"
            )
        })
    }

    /// Puts every change into the log.
    fn tell(&mut self, now: usize) {
        if std::mem::replace(&mut self.now, now) == now {
            return;
        }
        match self.words() {
            Some(words) => tracing::warn!("{words}"),
            None => tracing::warn!("{} has no other publisher any more", self.topic),
        }
    }
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

/// Samples that went through, by their status.
#[derive(Default)]
struct Passed {
    statuses: [u64; CorrectionStatus::ALL.len()],
    last: Option<CorrectionStatus>,
}

impl Passed {
    fn count(&mut self, status: CorrectionStatus) {
        self.statuses[status as usize] += 1;
        self.last = Some(status);
    }

    /// What to say of them: of the state that passes now, else of all since the start.
    fn words(&self, lost: u64) -> (u8, &'static str) {
        use CorrectionStatus::{Inactive, NoModel, OtherFrame, Rejected, SeveralSources};
        let count = |status: CorrectionStatus| self.statuses[status as usize];
        let uncorrected: u64 = [Rejected, NoModel, OtherFrame, SeveralSources].map(count).iter().sum();
        match (self.last, uncorrected, lost) {
            (Some(Inactive), ..) => (DiagnosticStatus::WARN, "no sample is corrected: a node of the chain is inactive"),
            (_, 0, 0) => (DiagnosticStatus::OK, "correcting"),
            (_, 0, _) => (DiagnosticStatus::WARN, "samples were lost on the way here"),
            _ => (DiagnosticStatus::WARN, "some samples were not corrected"),
        }
    }
}

fn report(health: &Diagnostics, summary: &NodeSummary, lost: u64, passed: &Passed, rivals: &Rivals) {
    let (level, message) = match rivals.words() {
        Some(words) => (DiagnosticStatus::WARN, words),
        None => {
            let (level, words) = passed.words(lost);
            (level, words.to_owned())
        }
    };
    let counts =
        CorrectionStatus::ALL.iter().zip(passed.statuses).map(|(status, count)| (status.name(), count.to_string()));
    let figures = [
        ("received", summary.received.to_string()),
        ("lost", lost.to_string()),
        ("other publishers", rivals.now.to_string()),
    ];
    health.report("correction", level, &message, figures.into_iter().chain(counts));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chain at rest was "correcting" for whoever watched its second node.
    #[test]
    fn regress_samples_of_a_chain_at_rest_are_no_good_health() {
        let mut passed = Passed::default();
        passed.count(CorrectionStatus::InVolume);
        assert_eq!(passed.words(0), (DiagnosticStatus::OK, "correcting"));
        passed.count(CorrectionStatus::Inactive);
        let (level, words) = passed.words(0);
        assert!(level == DiagnosticStatus::WARN && words.contains("inactive"), "{words}");
        passed.count(CorrectionStatus::InVolume);
        assert_eq!(passed.words(0), (DiagnosticStatus::OK, "correcting"), "it goes on");
        assert_eq!(passed.words(2).0, DiagnosticStatus::WARN);
    }
}
