//! Runs the trial bench: `cargo run --release -p abbe-trials --example trials -- --out DIR --seeds 20`.
//!
//! Place in the flow: scenarios of [`abbe_trials::suite`] go through the diagnosis, seed by seed, so that a run that is
//! stopped has something of everything. `DIR/trials.csv` grows row by row and is taken up again by the next run;
//! `summary.txt`, `power.csv` and `failures.txt` are made from it at the end. Progress goes to stderr.

mod accepted;
mod diagnoser;
mod store;

use abbe_trials::trial::Memory;
use abbe_trials::{Record, Scenario, Trial, run, suite, summary};
use anyhow::{Context, Result, bail};
use clap::Parser;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use store::Store;

/// Detection, attribution and error removed for every effect, over sizes and seeds.
#[derive(Debug, Parser)]
struct Arguments {
    /// Folder for rows and tables; rows already there are kept and not run again.
    #[arg(long)]
    out: PathBuf,
    /// Number of seeds.
    #[arg(long, default_value_t = 20)]
    seeds: u64,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    first_seed: u64,
    /// Families to run: single, pair, triple, elsewhere, undescribed, aliased, clean, adverse.
    #[arg(long, value_delimiter = ',')]
    family: Vec<String>,
    /// A scenario to run, by exact name; may be given several times.
    #[arg(long)]
    scenario: Vec<String>,
    /// Levels to run of those that each scenario has; without it all.
    #[arg(long, value_delimiter = ',')]
    level: Vec<f64>,
    /// Threads.
    #[arg(long, default_value_t = 2)]
    threads: usize,
    /// Also lets the diagnosis judge what it found, as users have it: the same findings, some times as slow.
    #[arg(long)]
    judges: bool,
    /// Starts no trial after this many minutes.
    #[arg(long)]
    minutes: Option<f64>,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    std::fs::create_dir_all(&arguments.out).with_context(|| format!("{}", arguments.out.display()))?;
    let path = arguments.out.join("trials.csv");
    let kept = store::read(&path)?;
    let scenarios = suite::scenarios();
    let trials = wanted(&arguments, &scenarios, &kept)?;
    eprintln!("{} trials to run, {} rows are there", trials.len(), kept.len());
    let store = Mutex::new(Store::open(&path, &kept)?);
    work(&arguments, &trials, &store)?;
    drop(store);
    let records: Vec<Record> = store::read(&path)?.into_iter().map(|(record, _)| record).collect();
    write_tables(&arguments.out, &records)
}

/// Trials that are asked for and not yet there; all scenarios of one seed come before the next seed.
fn wanted<'a>(arguments: &Arguments, scenarios: &'a [Scenario], kept: &[(Record, f64)]) -> Result<Vec<Trial<'a>>> {
    for name in &arguments.scenario {
        if !scenarios.iter().any(|scenario| scenario.name == *name) {
            let known: Vec<&str> = scenarios.iter().map(|scenario| scenario.name.as_str()).collect();
            bail!("--scenario {name:?}: not known; known are {}", known.join(", "));
        }
    }
    for name in &arguments.family {
        if !scenarios.iter().any(|scenario| scenario.family.name() == name) {
            bail!("--family {name:?}: not known; see --help");
        }
    }
    let is_chosen = |list: &[String], name: &str| list.is_empty() || list.iter().any(|entry| entry == name);
    let done: BTreeSet<_> = kept.iter().map(|(record, _)| record.key()).collect();
    let mut trials = Vec::new();
    for seed in arguments.first_seed..arguments.first_seed + arguments.seeds {
        for scenario in scenarios {
            if !is_chosen(&arguments.scenario, &scenario.name) || !is_chosen(&arguments.family, scenario.family.name())
            {
                continue;
            }
            let is_asked = |level: &f64| arguments.level.is_empty() || arguments.level.contains(level);
            let levels = scenario.levels.iter().copied().filter(is_asked).map(Some);
            let alone = scenario.levels.is_empty().then_some(None);
            trials.extend(levels.chain(alone).map(|level| Trial { scenario, seed, level }));
        }
    }
    trials.retain(|trial| {
        let level = trial.level.map(|level| format!("{level}"));
        !done.contains(&(trial.scenario.name.clone(), trial.seed, level))
    });
    Ok(trials)
}

/// Shares the trials among threads until they are done, the time is up, or somebody presses Ctrl-C.
fn work(arguments: &Arguments, trials: &[Trial], store: &Mutex<Store>) -> Result<()> {
    let stopped = Arc::new(AtomicBool::new(false));
    // A second Ctrl-C ends at once: the flag is already set then.
    signal_hook::flag::register_conditional_shutdown(signal_hook::consts::SIGINT, 130, Arc::clone(&stopped))?;
    signal_hook::flag::register(signal_hook::consts::SIGINT, Arc::clone(&stopped))?;
    let began = Instant::now();
    let limit = arguments.minutes.map(|minutes| Duration::from_secs_f64(60.0 * minutes));
    let (memory, next) = (Memory::default(), AtomicUsize::new(0));
    let worker = || -> Result<()> {
        loop {
            let place = next.fetch_add(1, Ordering::Relaxed);
            let is_late = limit.is_some_and(|limit| began.elapsed() > limit);
            let Some(trial) = trials.get(place).filter(|_| !is_late && !stopped.load(Ordering::Relaxed)) else {
                return Ok(());
            };
            let since = Instant::now();
            let record = run(trial, &memory, &diagnoser::Real { judges: arguments.judges }, accepted::ACCEPTED);
            let wall_s = since.elapsed().as_secs_f64();
            eprintln!("{}/{} {wall_s:5.1} s  {}", place + 1, trials.len(), told(&record));
            let Ok(mut store) = store.lock() else { bail!("another worker died while writing") };
            store.append(&record, wall_s)?;
        }
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..arguments.threads.max(1)).map(|_| scope.spawn(worker)).collect();
        workers.into_iter().try_for_each(|worker| match worker.join() {
            Ok(result) => result,
            Err(_) => bail!("a worker died; its trial has no row"),
        })
    })
}

/// One line of progress.
fn told(record: &Record) -> String {
    let level = record.level.map_or(String::new(), |level| format!(" x{level}"));
    let what = match &record.outcome {
        Err(problem) => problem.clone(),
        Ok(outcome) => format!(
            "{:.3} -> {:.3} um (clean {:.3}): {}",
            outcome.before_m * 1e6,
            outcome.after_m * 1e6,
            outcome.clean_m * 1e6,
            if outcome.found.is_empty() { "nothing".to_owned() } else { outcome.found.join(" + ") }
        ),
    };
    format!("seed {} {}{level}: {what}", record.seed, record.scenario)
}

fn write_tables(folder: &Path, records: &[Record]) -> Result<()> {
    let lines = summary::lines(records);
    let text = summary::text(&lines);
    println!("{text}");
    std::fs::write(folder.join("summary.txt"), text)?;
    std::fs::write(folder.join("failures.txt"), summary::failures(records).join("\n") + "\n")?;
    let mut power = csv::Writer::from_path(folder.join("power.csv"))?;
    power.write_record(summary::POWER_COLUMNS)?;
    for line in &lines {
        power.write_record(summary::power_row(line))?;
    }
    Ok(power.flush()?)
}
