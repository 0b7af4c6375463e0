//! `abbe demo`: the whole chain on a recorded campaign.
//!
//! Place in the flow: identify, start the nodes as processes, play the recording through them, subscribe to the
//! corrected topic; let the monitor have diagnosed what the model lacks, and the new model go into the running nodes;
//! report the error before, after geometry and after the loop. Everything lands in one folder; Ctrl-C leaves no process
//! and no shared memory behind.

mod closing;
mod live;
mod recording;
mod report;
mod shipped;
mod taken;

use crate::command::progress_text;
use crate::identity::{self, IdentityOptions, Said};
use crate::next::Next;
use crate::pipeline::{self, BagJoin, Choices};
use crate::verdict::Accept;
use crate::verification::{self, VerificationPoints};
use abbe_files::{ModelFile, hex, read_machine, write_atomically};
use abbe_runtime::{Shutdown, end_with_reader};
use anyhow::{Context, ensure};
use indicatif::{ProgressBar, ProgressStyle};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Arguments of `demo`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Folder for model, recording and report
    #[arg(long, default_value = "out/demo")]
    out: PathBuf,
    /// Machine file; the shipped bridge machine by default
    #[arg(long, requires = "campaign")]
    machine: Option<PathBuf>,
    /// Campaign CSV; the shipped one by default
    #[arg(long, requires = "machine", requires = "verify")]
    campaign: Option<PathBuf>,
    /// Points with known actual positions, for scoring only; the shipped ones by default
    #[arg(long, requires = "campaign")]
    verify: Option<PathBuf>,
    /// Samples a second that the recording is played at
    #[arg(long, default_value_t = 500.0)]
    rate_hz: f64,
    #[command(flatten)]
    accept: Accept,
    /// Leave the loop out: no diagnosis, no second model
    #[arg(long)]
    fast: bool,
    /// Also publish on DDS (ROS 2), on the domain of the environment
    #[arg(long)]
    dds: bool,
    #[command(flatten)]
    identity: IdentityOptions,
}

/// The model of the campaign, and the file that the nodes take theirs from where the loop is closed.
const MODEL: &str = "model.json";
const MODEL_IN_USE: &str = "model_in_use.json";

/// Seconds that each step took.
type Steps = Vec<(&'static str, f64)>;

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    ensure!(arguments.rate_hz.is_finite() && arguments.rate_hz > 0.0, "--rate-hz must be a number above 0");
    let shutdown = Shutdown::on_signals()?;
    let out = std::path::absolute(&arguments.out).context("the output folder has no absolute path")?;
    std::fs::create_dir_all(&out).with_context(|| format!("{}: cannot be made", out.display()))?;
    let inputs = shipped::inputs(
        arguments.machine.as_deref(),
        arguments.campaign.as_deref(),
        arguments.verify.as_deref(),
        &out,
    )?;
    let mut steps = Steps::new();

    let bar = step("identify");
    let machine = timed(&mut steps, "read machine", || read_machine(&inputs.machine))?;
    let loaded = timed(&mut steps, "read campaign", || {
        pipeline::load_campaign(&inputs.campaign, &machine, &BagJoin::default())
    })?;
    let mut observe = |progress| {
        bar.set_message(progress_text(&progress));
        !shutdown.requested()
    };
    let choices = Choices { robust: true, correlated_noise: false, accept: arguments.accept };
    let identified = timed(&mut steps, "identify", || pipeline::identify(&machine, &loaded, choices, &mut observe));
    let (model, found) = identified?;
    let sha256 = model.save(&out.join(MODEL))?;
    let model_file = out.join(if arguments.fast { MODEL } else { MODEL_IN_USE });
    model.save(&model_file)?;
    finish(&bar, &format!("model {} from {} readings", &hex(&sha256)[..12], loaded.campaign.readings.len()));

    let bar = step("record");
    let points = corrected_points(&inputs, &model)?;
    let bag = timed(&mut steps, "make the recording", || recording::write(&machine, &inputs, &out))?;
    finish(&bar, &format!("{} scale and {} tracer readings", bag.scale_readings, bag.tracer_readings));

    let run = live::Run {
        out: &out,
        machine_file: &inputs.machine,
        model_file: &model_file,
        bag: &bag,
        rate_hz: arguments.rate_hz,
        dds: arguments.dds,
        closes: !arguments.fast,
    };
    let live = live::run(&run, &shutdown, &mut steps).map_err(|error| match shutdown.requested() {
        true => error,
        false => error.context(format!("nodes of the demo, whose log is {}", out.join(live::NODES_LOG).display())),
    })?;
    let closed = match live.closing.as_ref().and_then(|closing| closing.taken_over.as_ref()) {
        Some(_) => Some(corrected_points(&inputs, &ModelFile::load(&model_file)?.0)?),
        None => None,
    };

    let bar = step("report");
    let said = Said {
        machine: Some(&machine),
        days: loaded.days,
        temperature_c: identity::temperature_c(&loaded.campaign),
        ..Said::default()
    };
    let next = next(arguments, &inputs);
    let data = report::data(&report::Facts {
        who: arguments.identity.gather(&said)?.shown,
        machine: &machine,
        loaded: &loaded,
        model: &model,
        model_sha256: &sha256,
        found: &found,
        points: &points,
        points_after_loop: closed.as_ref(),
        live: &live,
        steps: &steps,
        dds: arguments.dds,
        next: &next,
    })?;
    let since = Instant::now();
    write_atomically(&out.join("report.html"), data.html()?.as_bytes())?;
    write_atomically(&out.join("report.png"), &data.png()?)?;
    write_atomically(&out.join("report.json"), data.json()?.as_bytes())?;
    finish(&bar, &format!("written in {:.1} s", since.elapsed().as_secs_f64()));
    end_with_reader()?;
    report::print(&data, &out, &next);
    Ok(())
}

/// The first step of the tour, with what the demo unpacked.
fn next(arguments: &Arguments, inputs: &shipped::Inputs) -> Next {
    let unpacked = |path: &Path| arguments.out.join(path.file_name().unwrap_or_default());
    let machine = arguments.machine.clone().unwrap_or_else(|| unpacked(&inputs.machine));
    let campaign = arguments.campaign.clone().unwrap_or_else(|| unpacked(&inputs.campaign));
    let next = Next::new("to do it step by step", "identify").file("--machine", &machine);
    next.file("--campaign", &campaign).text("--out model.json")
}

/// The verification points as a model corrects them in a file.
fn corrected_points(inputs: &shipped::Inputs, model: &ModelFile) -> anyhow::Result<VerificationPoints> {
    let file = std::fs::File::open(&inputs.verify)
        .with_context(|| format!("{}: cannot be opened", inputs.verify.display()))?;
    verification::correct_points(file, &inputs.verify.display().to_string(), model, None)
}

fn timed<T, E>(steps: &mut Steps, name: &'static str, work: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
    let since = Instant::now();
    let result = work();
    steps.push((name, since.elapsed().as_secs_f64()));
    result
}

fn step(name: &str) -> ProgressBar {
    let style = ProgressStyle::with_template("{prefix:>10}  {spinner} {msg}")
        .unwrap_or_else(|_| ProgressStyle::default_spinner());
    let bar = ProgressBar::new_spinner().with_style(style).with_prefix(name.to_owned());
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}

/// Ends a step with its outcome, also where there is no terminal to draw on.
fn finish(bar: &ProgressBar, outcome: &str) {
    let name = bar.prefix();
    bar.finish_and_clear();
    // Not `eprintln!`: the nodes run whether or not somebody reads this.
    let _ = writeln!(std::io::stderr(), "{name:>10}  {outcome}");
}
