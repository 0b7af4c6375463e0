//! How the loop closes while the nodes run: the monitor asks for a diagnosis, the model that comes out is taken over.
//!
//! Place in the flow: beside the samples that [`super::live`] takes. Everything is done by the nodes themselves, as in
//! any other launch; here it is only watched, in the folder that the monitor gives its diagnosis and in the model that
//! each sample names.

use super::taken::Taken;
use super::{Steps, finish, step};
use abbe_graph::diagnosis_run::Outcome;
use abbe_msgs::CorrectedCoordinates;
use abbe_report::diagnosis::Record;
use anyhow::{Context, bail};
use indicatif::ProgressBar;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Time after its judgement of the last reading in which a monitor that wants a diagnosis has begun it.
const BEGUN_WITHIN: Duration = Duration::from_secs(5);
/// Longest that the monitor may take to judge what it has.
const JUDGED_WITHIN: Duration = Duration::from_secs(120);

/// How the loop went.
pub(super) struct Loop {
    /// What came of the diagnosis; `None` where the monitor asked for none.
    pub(super) outcome: Option<Outcome>,
    /// What the diagnosis says; `None` where it did not come to its end.
    pub(super) record: Option<Record>,
    /// The model that took over.
    pub(super) taken_over: Option<TakenOver>,
}

/// A model that took over.
pub(super) struct TakenOver {
    pub(super) sha256: String,
    /// Sequence of the first sample that it corrected.
    pub(super) first_sample: u64,
    /// The verification points as it corrected them, all of one pass.
    pub(super) points: Vec<CorrectedCoordinates>,
}

/// Where the loop is.
enum Stage {
    /// The recording is played for the first time.
    Playing,
    /// The monitor has all readings.
    Noticing,
    /// A diagnosis is under way.
    Diagnosing,
    /// Its model is in place.
    TakingOver,
}

/// Watches a running graph.
pub(super) struct Watch {
    folder: PathBuf,
    /// Process of the monitor: a new one knows nothing of the diagnosis.
    monitor: Option<u32>,
    stage: Stage,
    since: Instant,
    /// Since when the monitor has judged every reading.
    judged: Option<Instant>,
    bar: ProgressBar,
    so_far: Loop,
}

impl Watch {
    /// Watches for the first diagnosis in `folder`; `bar` shows the recording played.
    pub(super) fn new(folder: &Path, monitor: Option<u32>, bar: ProgressBar) -> Watch {
        let so_far = Loop { outcome: None, record: None, taken_over: None };
        let (folder, stage, since, judged) = (folder.join("0001"), Stage::Playing, Instant::now(), None);
        Watch { folder, monitor, stage, since, judged, bar, so_far }
    }

    /// What the step under way is showing.
    pub(super) fn bar(&self) -> &ProgressBar {
        &self.bar
    }

    /// Looks how far it is; true at the end. `monitor` is the process of the monitor now.
    pub(super) fn look(&mut self, taken: &Taken, monitor: Option<u32>, steps: &mut Steps) -> anyhow::Result<bool> {
        if monitor != self.monitor {
            bail!("the monitor ended and was started again; what it had kept for a diagnosis is lost");
        }
        match self.stage {
            Stage::Playing if taken.is_played() => {
                let played = format!("{} corrected samples, each of them {}", taken.count, taken.by_what());
                self.next(Stage::Noticing, &played, "play through the nodes", "monitor", steps);
            }
            Stage::Noticing if self.folder.exists() => {
                let noticed =
                    "range residuals exceed their uncertainties; it starts a diagnosis of the readings it kept";
                self.next(Stage::Diagnosing, noticed, "notice", "diagnose", steps);
            }
            Stage::Noticing => return self.is_content(taken),
            Stage::Diagnosing => return self.diagnosed(steps),
            Stage::TakingOver => return Ok(self.taken_over(taken, steps)),
            Stage::Playing => {}
        }
        Ok(false)
    }

    /// Whether the monitor has judged every reading, and found nothing to diagnose.
    fn is_content(&mut self, taken: &Taken) -> anyhow::Result<bool> {
        if taken.is_judged() {
            self.judged.get_or_insert_with(Instant::now);
        } else if self.since.elapsed() > JUDGED_WITHIN {
            bail!("the monitor has not judged all readings: this machine is too busy; try again, or with --fast");
        }
        let is_content = self.judged.is_some_and(|since| since.elapsed() > BEGUN_WITHIN);
        if is_content {
            finish(&self.bar, "it has judged every reading and asks for no diagnosis");
        }
        Ok(is_content)
    }

    /// What the loop came to.
    pub(super) fn end(self) -> Loop {
        self.so_far
    }

    fn next(&mut self, stage: Stage, outcome: &str, step_done: &'static str, next: &str, steps: &mut Steps) {
        finish(&self.bar, outcome);
        steps.push((step_done, self.since.elapsed().as_secs_f64()));
        (self.stage, self.since, self.bar) = (stage, Instant::now(), step(next));
    }

    /// Takes the outcome of the diagnosis once there is one; true where no model comes of it.
    fn diagnosed(&mut self, steps: &mut Steps) -> anyhow::Result<bool> {
        self.bar.set_message(format!("looking for the cause, {} s", self.since.elapsed().as_secs()));
        let Some(outcome) = Outcome::read(&self.folder)? else { return Ok(false) };
        let put_into_use = outcome.put_into_use.is_some();
        let words = outcome.words.clone();
        if outcome.finished {
            self.so_far.record = Some(read_record(&self.folder.join("diagnosis.json"))?);
        }
        let said = self.so_far.record.as_ref().map_or(words, |record| record.verdict.clone());
        self.so_far.outcome = Some(outcome);
        self.next(Stage::TakingOver, &said, "diagnose, while the nodes correct", "take over", steps);
        if !put_into_use {
            finish(&self.bar, "no new model: the one in use stays");
        }
        Ok(!put_into_use)
    }

    /// Whether all verification points of a pass have come from the new model.
    fn taken_over(&mut self, taken: &Taken, steps: &mut Steps) -> bool {
        let sha256 = self.so_far.outcome.as_ref().and_then(|outcome| outcome.put_into_use.clone());
        let Some((sha256, first_sample)) = sha256.zip(taken.first_of_new_model()) else { return false };
        let of_new_model = |point: &CorrectedCoordinates| point.model_sha256.to_hex() == sha256;
        let Some(points) = taken.last_points().filter(|points| points.iter().all(of_new_model)) else { return false };
        let short: String = sha256.chars().take(12).collect();
        let words = format!("model {short} corrects from sample {first_sample} on, without a break in the stream");
        finish(&self.bar, &words);
        steps.push(("take the new model over", self.since.elapsed().as_secs_f64()));
        self.so_far.taken_over = Some(TakenOver { sha256, first_sample, points: points.to_vec() });
        true
    }
}

fn read_record(path: &Path) -> anyhow::Result<Record> {
    let text = std::fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{}: no diagnosis of this version", path.display()))
}
