//! One diagnosis: its folder, its files, the program that does it, and what becomes of the model that comes out.
//!
//! Place in the flow: started by the monitor node on a thread of its own. The readings and the model in use are written
//! into a numbered folder; `abbe diagnose` works there as a child process that ends with this one. Everything a person
//! needs afterwards stands in that folder: readings, model, log, report; and what came of it, for programs.

use abbe_files::{FileError, ModelFile, hex, write_atomically, write_campaign};
use abbe_geometry::effects::Effect;
use abbe_geometry::machine::Machine;
use abbe_measurement::campaign::Campaign;
use abbe_msgs::Sha256;
use abbe_runtime::ros::TriggerOutcome;
use abbe_runtime::{LAUNCHER_PID, Shutdown};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::SyncSender;
use std::thread::{self, JoinHandle};
use std::time::Duration;
use thiserror::Error;

/// How often the program is looked after.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Names in the folder of a diagnosis.
const CAMPAIGN: &str = "campaign.csv";
const MODEL_IN_USE: &str = "model_in_use.json";
const DIAGNOSED_MODEL: &str = "model.json";
const LOG: &str = "diagnose.log";
const REPORT: &str = "report.html";
const OUTCOME: &str = "outcome.json";

/// Why there is no outcome.
#[derive(Debug, Error)]
enum RunError {
    /// A file of the folder, or the model.
    #[error(transparent)]
    File(#[from] FileError),
    /// The folder.
    #[error("{folder}: the folder cannot be made: {source}; correct monitor.diagnosis_folder")]
    Folder { folder: PathBuf, source: std::io::Error },
    /// The model file is not what corrects.
    #[error(
        "{file} holds model {held}, not the one in use ({in_use}); put a whole model in its place, or wait until it is \
         in use"
    )]
    OtherModel { file: PathBuf, held: Sha256, in_use: Sha256 },
    /// The program.
    #[error("{program} cannot be run: {source}")]
    Program { program: PathBuf, source: std::io::Error },
    /// It ended with an error.
    #[error("the diagnosis in {folder} ended with {status}: {words}; its words stand in {LOG} there")]
    Failed { folder: PathBuf, status: ExitStatus, words: String },
    /// The node ends.
    #[error("the diagnosis in {folder} was ended with the node")]
    Stopped { folder: PathBuf },
}

/// What to diagnose, and with what.
pub struct Job {
    /// The program that has the command `diagnose`.
    pub program: PathBuf,
    /// The file that the model in use came from.
    pub model_file: PathBuf,
    /// The machine that a model has to be of.
    pub machine: Machine,
    /// The model in use.
    pub in_use: Sha256,
    /// The readings to diagnose.
    pub campaign: Campaign,
    /// Folder in which this diagnosis gets one of its own.
    pub folder: PathBuf,
    /// Whether the model that comes out takes the place of the model file.
    pub adopt: bool,
}

/// What came of a diagnosis; `outcome.json` in its folder, written last.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Outcome {
    /// Whether the program came to its end; its report and figures then stand beside this file.
    pub finished: bool,
    /// In words, as the monitor tells it.
    pub words: String,
    /// SHA-256 of the model that took the place of the model file, if one did.
    pub put_into_use: Option<String>,
}

impl Outcome {
    /// That of the diagnosis in this folder; `None` while it is under way.
    pub fn read(folder: &Path) -> Result<Option<Outcome>, FileError> {
        let path = folder.join(OUTCOME);
        let io = |source| FileError::Io { file: path.display().to_string(), action: "read", source };
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(io(source)),
        };
        serde_json::from_str(&text).map(Some).map_err(|error| io(error.into()))
    }

    fn of(concluded: &Result<Concluded, RunError>) -> Outcome {
        match concluded {
            Ok(Concluded { words, put_into_use }) => {
                Outcome { finished: true, words: words.clone(), put_into_use: put_into_use.map(|hash| hash.to_hex()) }
            }
            Err(error) => Outcome { finished: false, words: error.to_string(), put_into_use: None },
        }
    }

    fn write(&self, folder: &Path) -> Result<(), FileError> {
        let path = folder.join(OUTCOME);
        let text = serde_json::to_string_pretty(self).map_err(|error| FileError::Io {
            file: path.display().to_string(),
            action: "write",
            source: error.into(),
        })?;
        write_atomically(&path, format!("{text}\n").as_bytes())
    }
}

/// What a finished diagnosis led to.
struct Concluded {
    words: String,
    put_into_use: Option<Sha256>,
}

impl Concluded {
    fn without_change(words: String) -> Concluded {
        Concluded { words, put_into_use: None }
    }
}

/// A diagnosis under way. Dropping it ends it.
pub struct DiagnosisRun {
    stop: Shutdown,
    thread: Option<JoinHandle<Result<String, RunError>>>,
}

impl DiagnosisRun {
    /// Starts a diagnosis; `started` is told once its program runs, or why it does not.
    pub fn start(job: Job, started: Option<SyncSender<TriggerOutcome>>) -> std::io::Result<DiagnosisRun> {
        let stop = Shutdown::manual();
        let stopped = stop.clone();
        let run = move || {
            let begun = begin(&job);
            if let Some(started) = started {
                let said = begun.as_ref().map(|begun| format!("started, see {}", begun.folder.display()));
                // Who asked may have given up.
                let _ = started.send(said.map_err(ToString::to_string));
            }
            let begun = begun?;
            let folder = begun.folder.clone();
            let concluded = begun.end(&job.program, &stopped).and_then(|folder| conclude(&job, &folder));
            if let Err(error) = Outcome::of(&concluded).write(&folder) {
                // What came of it holds all the same.
                tracing::warn!("{error}");
            }
            concluded.map(|concluded| concluded.words)
        };
        let thread = thread::Builder::new().name("diagnosis".into()).spawn(run)?;
        Ok(DiagnosisRun { stop, thread: Some(thread) })
    }

    /// What came of it, in words, once it has ended.
    pub fn outcome(&mut self) -> Option<Result<String, String>> {
        let thread = self.thread.take_if(|thread| thread.is_finished())?;
        let outcome = thread.join().map_err(|_| "the diagnosis broke off; its log says more".to_owned());
        Some(outcome.and_then(|outcome| outcome.map_err(|error| error.to_string())))
    }
}

impl Drop for DiagnosisRun {
    fn drop(&mut self) {
        self.stop.request();
        if let Some(thread) = self.thread.take() {
            // Whatever it would have said, nobody asks any more.
            let _ = thread.join();
        }
    }
}

/// A program at work in its folder.
struct Begun {
    folder: PathBuf,
    child: Child,
}

fn begin(job: &Job) -> Result<Begun, RunError> {
    let bytes = std::fs::read(&job.model_file).map_err(|source| unreadable(&job.model_file, source))?;
    let (_, held) = ModelFile::from_bytes(&bytes, &job.model_file.display().to_string())?;
    let held = Sha256::from_bytes(held);
    if held != job.in_use {
        return Err(RunError::OtherModel { file: job.model_file.clone(), held, in_use: job.in_use });
    }
    let folder = next_folder(&job.folder)?;
    let [campaign, model] = [CAMPAIGN, MODEL_IN_USE].map(|name| folder.join(name));
    write_atomically(&model, &bytes)?;
    write_campaign(&campaign, &job.campaign)?;
    let unusable = |source| RunError::Program { program: job.program.clone(), source };
    let log = File::create(folder.join(LOG)).map_err(unusable)?;
    let words = log.try_clone().map_err(unusable)?;
    let child = Command::new(&job.program)
        .arg("diagnose")
        .env(LAUNCHER_PID, std::process::id().to_string())
        .args([Path::new("--model"), &model, Path::new("--campaign"), &campaign, Path::new("--out"), &folder])
        .stdin(Stdio::null())
        .stdout(log)
        .stderr(words)
        .spawn()
        .map_err(unusable)?;
    Ok(Begun { folder, child })
}

impl Begun {
    /// Waits for the program; ends it when told to stop.
    fn end(mut self, program: &Path, stop: &Shutdown) -> Result<PathBuf, RunError> {
        let unwatched = |source| RunError::Program { program: program.to_owned(), source };
        loop {
            if let Some(status) = self.child.try_wait().map_err(unwatched)? {
                let folder = self.folder;
                if status.success() {
                    return Ok(folder);
                }
                let words = last_words(&folder.join(LOG));
                return Err(RunError::Failed { folder, status, words });
            }
            if stop.sleep(LOOK_EVERY) {
                // Its files appear whole or not at all, so that nothing half is left. It may have ended just now.
                let _ = self.child.kill();
                let _ = self.child.wait();
                return Err(RunError::Stopped { folder: self.folder });
            }
        }
    }
}

/// What a finished diagnosis leads to.
fn conclude(job: &Job, folder: &Path) -> Result<Concluded, RunError> {
    let report = format!("finished, see {}", folder.join(REPORT).display());
    let path = folder.join(DIAGNOSED_MODEL);
    if !path.exists() {
        return Ok(Concluded::without_change(format!("{report}; it proposes no model")));
    }
    let (diagnosed, sha256) = ModelFile::load_for(&path, &job.machine)?;
    let proposed = Sha256::from_bytes(sha256);
    if proposed == job.in_use {
        return Ok(Concluded::without_change(format!("{report}; the model in use stays the best")));
    }
    if !job.adopt {
        let (from, to) = (path.display(), job.model_file.display());
        let words = format!("{report}; to use its model {proposed}, copy {from} over {to}");
        return Ok(Concluded::without_change(words));
    }
    let lacking = lacking_live(&diagnosed, &job.campaign, |effect| effect.covariates());
    if !lacking.is_empty() {
        let lacking = lacking.join(", ");
        return Ok(Concluded::without_change(format!(
            "{report}; its model {proposed} is not put into use: it corrects by {lacking}, which the scale readings do \
             not carry; add that to them, or diagnose again on more readings"
        )));
    }
    let bytes = std::fs::read(&path).map_err(|source| unreadable(&path, source))?;
    let (_, held) = ModelFile::load_for(&job.model_file, &job.machine)?;
    if Sha256::from_bytes(held) != job.in_use {
        // Somebody was faster; a person's choice is not overwritten.
        return Ok(Concluded::without_change(format!(
            "{report}; the model file has changed since, so model {} is not put into use",
            hex(&sha256)
        )));
    }
    write_atomically(&job.model_file, &bytes)?;
    let unseen = lacking_live(&diagnosed, &job.campaign, |effect| effect.range_covariates());
    let blind = match unseen.is_empty() {
        true => String::new(),
        false => format!(
            ", but the monitor cannot judge it: the ranges depend on {}, which the scale readings do not carry",
            unseen.join(", ")
        ),
    };
    let words = format!("{report}; its model {proposed} is put into use{blind}");
    Ok(Concluded { words, put_into_use: Some(proposed) })
}

/// Covariates that the model corrects by, or predicts ranges by, and no scale reading carried. A campaign also has `time_s`, the time since it
/// began; a live sample has none.
fn lacking_live(diagnosed: &ModelFile, campaign: &Campaign, reads: impl Fn(&dyn Effect) -> Vec<String>) -> Vec<String> {
    let effects = diagnosed.model.parts().effects.iter().filter(|fitted| fitted.corrects());
    let read: BTreeSet<String> = effects.flat_map(|fitted| reads(fitted.effect.as_ref())).collect();
    read.into_iter().filter(|name| campaign.covariate(name).is_none()).collect()
}

/// The next folder that does not exist yet: `0001`, `0002`, …
fn next_folder(folder: &Path) -> Result<PathBuf, RunError> {
    let failed = |folder: &Path, source| RunError::Folder { folder: folder.to_owned(), source };
    let base = std::path::absolute(folder).map_err(|source| failed(folder, source))?;
    std::fs::create_dir_all(&base).map_err(|source| failed(&base, source))?;
    let mut number = 1_u64;
    loop {
        let next = base.join(format!("{number:04}"));
        match std::fs::create_dir(&next) {
            Ok(()) => return Ok(next),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => number += 1,
            Err(source) => return Err(failed(&next, source)),
        }
    }
}

/// The last line of a log; what cannot be read is only missing from a message.
fn last_words(log: &Path) -> String {
    let text = std::fs::read(log).unwrap_or_default();
    let text = String::from_utf8_lossy(&text).into_owned();
    text.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("(it said nothing)").trim().to_owned()
}

fn unreadable(path: &Path, source: std::io::Error) -> RunError {
    RunError::File(FileError::Io { file: path.display().to_string(), action: "read the model", source })
}
