//! `abbe capture`: a planned campaign from the drivers of a machine and a tracer.
//!
//! Place in the flow: between `abbe plan` and `abbe identify`. Every reading is on the disk before the next one is waited for; the
//! same command goes on where it stopped, whatever stopped it.

use crate::capturing::{Outcome, Screen, write_outcome};
use crate::exit::Ended;
use crate::identity::{IdentityOptions, Said, temperature_c};
use crate::next::Next;
use crate::provenance::hashed;
use abbe_files::Days;
use abbe_files::{CaptureJournal, FileError, JournalHead, MachineFile, Place, read_machine, read_path, sha256_hex};
use abbe_graph::capture::{CaptureConfig, Capturer, Ending, Planned, campaign_of, capture, preview};
use abbe_report::MetaItem;
use abbe_runtime::Shutdown;
use anyhow::{Context, anyhow, bail, ensure};
use std::io::{BufRead, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::Instant;

/// The journal in the folder that is written.
const JOURNAL: &str = "journal.jsonl";

/// Arguments of `capture`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// File that names machine, plan and drivers
    config: PathBuf,
    /// Folder for the journal, campaign.csv and the report; the same folder again goes on
    #[arg(long)]
    out: PathBuf,
    /// Write campaign.csv and the report of what is captured already, and end
    #[arg(long)]
    finish: bool,
    /// Write the moves that the table `drive` would make, and end; nothing is opened and nothing moves
    #[arg(long, conflicts_with_all = ["finish", "json"])]
    preview: bool,
    /// Print the outcome as JSON on standard output
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    identity: IdentityOptions,
}

/// What the files say.
struct Job {
    config: CaptureConfig,
    base: PathBuf,
    machine: MachineFile,
    planned: Planned,
    head: JournalHead,
    promised_um: Option<f64>,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let shutdown = Shutdown::on_signals()?;
    let job = read(&arguments.config)?;
    let journal_path = arguments.out.join(JOURNAL);
    if arguments.finish {
        ensure!(journal_path.exists(), "{}: there is no journal; capture something first", journal_path.display());
    }
    if arguments.preview {
        return show_moves(&job, &arguments.config, &journal_path);
    }
    std::fs::create_dir_all(&arguments.out).with_context(|| format!("{}: cannot be made", arguments.out.display()))?;
    let (mut journal, entries, was_cut) = CaptureJournal::open(&journal_path, &job.head)?;
    let mut capturer = Capturer::new(&job.config, job.planned.clone(), &job.machine);
    capturer.restore(&entries).map_err(|problem| {
        anyhow!(
            "{}: {problem}; take the journal from a copy, or name another folder with --out",
            journal_path.display()
        )
    })?;
    let mut screen = Screen::new(&capturer, job.promised_um, entries.len() > 1, was_cut);
    let ending = if arguments.finish || (0..capturer.planned().len()).all(|point| capturer.is_done(point)) {
        Ok(if arguments.finish { Ending::Stopped } else { Ending::Complete })
    } else {
        let confirmed = confirmations(&capturer, &job.config);
        let source = (&job.config, job.base.as_path(), &job.machine);
        capture(source, &mut capturer, &mut journal, (&shutdown, &confirmed), &mut |capturer, shown| {
            screen.show(capturer, &shown);
        })
    };
    screen.end();
    let days = Days::of_stamps_ns(capturer.taken().iter().flatten().map(|captured| captured.stamp_ns));
    let captured = campaign_of(capturer.planned(), capturer.taken(), job.machine.absolute_range);
    let temperature_c = temperature_c(&captured.campaign);
    let said = Said { machine: Some(&job.machine), days, temperature_c, ..Said::default() };
    let who = arguments.identity.gather(&said)?.shown;
    let [identify, go_on] = next(arguments, &job);
    let is_whole = capturer.done() == capturer.wanted() || arguments.finish;
    let next = if is_whole { &identify } else { &go_on };
    let outcome = Outcome {
        machine: &job.machine,
        capturer: &capturer,
        promised_um: job.promised_um,
        who: &who,
        captured: &captured,
        files: files(&job, &journal_path)?,
        next,
        go_on: &go_on,
    };
    let written = write_outcome(&outcome, &arguments.out, arguments.json, &shutdown);
    // What stopped it comes first; what was captured is written in any case.
    match ending {
        Ok(Ending::Complete) => written,
        Ok(Ending::Stopped) if arguments.finish => written,
        Ok(Ending::Stopped) => {
            written?;
            Err(Ended::stopped(format!(
                "stopped on request with {} of {} points; the same command goes on",
                capturer.done(),
                capturer.wanted()
            ))
            .into())
        }
        Err(error) => Err(error).with_context(|| arguments.config.display().to_string()),
    }
}

/// What it was captured by, with hashes: the plan's is of points and stations together, as in the journal.
fn files(job: &Job, journal: &Path) -> anyhow::Result<Vec<MetaItem>> {
    Ok(vec![
        hashed("Every reading", journal)?,
        hashed("Machine file", &job.base.join(&job.config.machine))?,
        MetaItem::file("Plan", "path.csv and stations.csv", Some(&job.head.plan_sha256)),
    ])
}

/// What follows from a campaign that can be identified, and from one that is to be gone on with.
fn next(arguments: &Arguments, job: &Job) -> [Next; 2] {
    let identify = Next::new("to identify the machine", "identify")
        .file("--machine", &job.base.join(&job.config.machine))
        .file("--campaign", &arguments.out.join("campaign.csv"))
        .text("--out model.json");
    [identify, Next::new("to go on", "capture").path(&arguments.config).file("--out", &arguments.out)]
}

/// Writes the moves that are left.
fn show_moves(job: &Job, config: &Path, journal_path: &Path) -> anyhow::Result<()> {
    let Some(drive) = &job.config.drive else {
        bail!("{}: has no table drive, so that nothing would be moved; add one with speed_mm_s", config.display());
    };
    let mut capturer = Capturer::new(&job.config, job.planned.clone(), &job.machine);
    if journal_path.exists() {
        let (_, entries, _) = CaptureJournal::open(journal_path, &job.head)?;
        capturer.restore(&entries).map_err(|problem| anyhow!("{}: {problem}", journal_path.display()))?;
    }
    preview(&capturer, drive).iter().for_each(|line| println!("{line}"));
    Ok(())
}

fn read(path: &Path) -> anyhow::Result<Job> {
    let name = path.display().to_string();
    let text = std::fs::read_to_string(path).with_context(|| format!("{name}: cannot be read; check the path"))?;
    let config: CaptureConfig = toml::from_str(&text).map_err(|error| anyhow!("{name}: {error}"))?;
    config.check().map_err(|error| anyhow!("{name}: {error}"))?;
    let base = path.parent().unwrap_or(Path::new("")).to_owned();
    let (machine_path, folder) = (base.join(&config.machine), base.join(&config.plan));
    let machine = read_machine(&machine_path)?;
    let promised_um = promised(&folder, &machine)?;
    let planned = Planned::new(&read_path(&folder)?, &machine.machine, config.points.within_mm / 1e3)
        .map_err(|problem| anyhow!("{}: {problem}", folder.join("path.csv").display()))?;
    if let Some(drive) = &config.drive {
        drive.check(&planned, &machine.machine).map_err(|error| anyhow!("{name}: {error}"))?;
    }
    let bytes = |path: &Path| std::fs::read(path).with_context(|| format!("{}: cannot be read", path.display()));
    let mut plan = bytes(&folder.join("path.csv"))?;
    plan.extend(bytes(&folder.join("stations.csv"))?);
    let hashes = [bytes(&machine_path)?, plan, config.identity().into_bytes()].map(|bytes| sha256_hex(&bytes));
    let head = JournalHead::new(&machine.machine.name, hashes, &crate::pipeline::software());
    Ok(Job { config, base, machine, planned, head, promised_um })
}

/// What `plan.json` promises (µm); a plan for another machine is refused. A path that somebody else wrote has none.
fn promised(folder: &Path, machine: &MachineFile) -> anyhow::Result<Option<f64>> {
    let path = folder.join("plan.json");
    let Ok(text) = std::fs::read_to_string(&path) else { return Ok(None) };
    let wrong =
        |problem: String, remedy: &str| FileError::content(Place::file(&path.display().to_string()), problem, remedy);
    let plan: serde_json::Value = serde_json::from_str(&text)
        .map_err(|error| wrong(format!("is no JSON: {error}"), "plan again, or remove this file"))?;
    match plan["machine"].as_str() {
        Some(other) if other != machine.machine.name => {
            let problem =
                format!("the plan is of machine {other}, and the machine file is of {}", machine.machine.name);
            bail!(wrong(problem, "name the machine file of the plan, or plan with this one"))
        }
        _ => Ok(plan["u_um"].as_f64()),
    }
}

/// Each line on standard input says that the next set-up stands, where no driver tells it.
fn confirmations(capturer: &Capturer, config: &CaptureConfig) -> Receiver<Instant> {
    let (give, confirmed) = channel();
    let is_asked = !config.tells_station() || !config.tells_offset();
    if config.drive.is_some() || is_asked && capturer.planned().set_ups.len() > 1 {
        // It waits for input until the program ends.
        thread::spawn(move || {
            for line in std::io::stdin().lock().lines() {
                if line.is_err() || give.send(Instant::now()).is_err() {
                    return;
                }
            }
        });
    }
    if is_asked {
        let words = capturer.set_up_words(capturer.set_up());
        let _ = writeln!(std::io::stderr(), "abbe: measuring from {words}");
    }
    confirmed
}
