//! `abbe train`: residual vectors in, a residual model with the evidence for it out.
//!
//! Place in the flow: offline, between `abbe residuals` and the residual node. Prints and reports what held-out data say;
//! Ctrl-C keeps the best so far and what is needed to go on, or says that there is nothing yet. The model belongs to the geometric model that the residuals
//! are of, and corrects nothing else.

use crate::data::{self, Data};
use crate::inputs::Inputs;
use crate::off_text::off_text;
use crate::report;
use abbe::command::training::{Processor, TrainArguments};
use abbe::exit::Ended;
use abbe::identity::Said;
use abbe::next::{KNOWN_POINTS, Next};
use abbe::progress::spinner;
use abbe::{output, software, stop};
use abbe_files::{DataSource, ModelFile, ResidualFile, ResidualOwner, hex, write_atomically};
use abbe_geometry::Vector3;
use abbe_measurement::correspondence::check_vectors;
use abbe_report::MetaItem;
use abbe_residual_training::{Config, Device, Go, POSITION_ALONE, Progress, State, Trained, ZERO, train_beside};
use anyhow::{Context, ensure};
use indicatif::ProgressBar;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Deviations beyond which a held-out point is named: one in two million of a normal distribution.
const FAR: f64 = 5.0;
/// Outliers that are shown.
const MOST_SHOWN: usize = 5;
/// Extent of the points over the stroke, along the axis where it is largest.
const SMALLEST_SHARE: f64 = 0.02;
const LARGEST_SHARE: f64 = 5.0;

pub(crate) fn run(arguments: &TrainArguments) -> anyhow::Result<()> {
    let paths = Paths::beside(&arguments.out);
    // Before the first epoch there is nothing to keep.
    let has_something = Arc::new(AtomicBool::new(false));
    let shutdown = stop::keep_what_there_is(&has_something)?;
    let read = arguments.config.iter().chain(&arguments.model).chain([&arguments.residuals]).map(PathBuf::as_path);
    output::check([arguments.out.as_path(), &paths.report, &paths.state], read)?;
    let device = device(arguments.device)?;
    let config = data::read_config(arguments.config.as_deref())?;
    let data = Data::read(&arguments.residuals, &Inputs::of(&arguments.inputs)?)?;
    let owner = owner(arguments, &data)?;
    let resume = arguments.resume.then(|| read_state(&paths.state)).transpose()?;
    let mut observe = |progress: &Progress, bar: &ProgressBar| {
        bar.set_message(progress_text(progress));
        has_something.store(true, Ordering::Relaxed);
        if shutdown.requested() { Go::Stop } else { Go::On }
    };
    let trained = with_progress(&data, &config, &device, resume, &mut observe)
        .with_context(|| arguments.residuals.display().to_string())?;
    let file = artifact(&trained, &data, &config, owner)?;
    let machine_name = file.owner.as_ref().map(|owner| owner.machine.as_str());
    // A bag of vectors is no table: it logs no temperature beside them.
    let tables: Vec<&Path> =
        Some(arguments.residuals.as_path()).into_iter().filter(|path| !abbe::is_bag(path)).collect();
    let who = arguments.identity.gather(&Said { machine_name, tables: &tables, ..Said::default() })?.shown;
    let (bytes, sha256) = file.to_bytes(&arguments.out.display().to_string())?;
    let name = arguments.out.file_name().unwrap_or(arguments.out.as_os_str()).to_string_lossy();
    let made = MetaItem::file("Residual model", &name, Some(&hex(&sha256)));
    let html = report::html(&trained, &file, &data, (made, who, next(arguments, &trained).step()))?;
    write_atomically(&arguments.out, &bytes)?;
    write_atomically(&paths.report, html.as_bytes())?;
    if trained.record.complete {
        remove_state(&paths.state)?;
    } else {
        write_atomically(&paths.state, &serde_json::to_vec(&trained.state)?)?;
    }
    say(arguments, &trained, &data, &file, &sha256, &paths);
    let (out, state) = (arguments.out.display(), paths.state.display());
    let stopped = || format!("stopped on request; {out} holds the best so far, and --resume goes on from {state}");
    ensure!(trained.record.complete, Ended::stopped(stopped()));
    Ok(())
}

fn device(processor: Processor) -> anyhow::Result<Device> {
    match processor {
        Processor::Cpu => Ok(Device::cpu()),
        Processor::Wgpu => {
            Device::wgpu().context("--device wgpu; --device cpu trains everywhere, in seconds to minutes")
        }
    }
}

/// A field that held-out data speak for is tested with its geometric model; where they speak for none, the cause may have a name.
fn next(arguments: &TrainArguments, trained: &Trained) -> Next {
    if !trained.record.complete {
        let next = Next::new("to go on", "train").file("--residuals", &arguments.residuals);
        return next.file("--out", &arguments.out).text("--resume");
    }
    if trained.record.recommendation.method == ZERO {
        let next = Next::new("to see whether what is left has a name", "diagnose");
        return next.file("--residuals", &arguments.residuals).text("--out diagnosis");
    }
    let next = Next::new("to hold it, with its geometric model, against points that no fit has seen", "verify");
    next.text("--model MODEL.json").file("--residual", &arguments.out).text(KNOWN_POINTS)
}

/// Files beside the residual model.
struct Paths {
    report: PathBuf,
    state: PathBuf,
}

impl Paths {
    fn beside(out: &Path) -> Paths {
        Paths { report: out.with_extension("html"), state: out.with_extension("state.json") }
    }
}

/// The geometric model that leaves these residuals, as the file or the command line says; both must agree.
fn owner(arguments: &TrainArguments, data: &Data) -> anyhow::Result<Option<ResidualOwner>> {
    let told = data.owner.clone();
    let Some(path) = &arguments.model else { return Ok(told) };
    let (model, model_sha256) = ModelFile::load(path)?;
    let name = || arguments.residuals.display().to_string();
    check_extent(data, &model.model.parts().machine.stroke_m).with_context(name)?;
    check_vectors(data.field.errors_m(), true).with_context(name)?;
    let given = ResidualOwner { machine: model.model.parts().machine.name.clone(), model_sha256 };
    if let Some(told) = told {
        ensure!(
            told == given,
            "{}: these are residuals of model {} of machine {}, not of {} ({} of machine {}); leave --model out, or compute \
             the residuals of this model",
            arguments.residuals.display(),
            hex(&told.model_sha256),
            told.machine,
            path.display(),
            hex(&given.model_sha256),
            given.machine
        );
    }
    Ok(Some(given))
}

/// Refuses points that are a speck in the machine, or larger than it: they are in another unit, or another machine's.
fn check_extent(data: &Data, stroke_m: &[(f64, f64); 3]) -> anyhow::Result<()> {
    let Some(places_m) = data.places_m() else { return Ok(()) };
    let low = places_m.iter().fold(Vector3::repeat(f64::INFINITY), |low, p| low.inf(p));
    let high = places_m.iter().fold(Vector3::repeat(f64::NEG_INFINITY), |high, p| high.sup(p));
    let shares = Vector3::from_fn(|axis, _| (high[axis] - low[axis]) / (stroke_m[axis].1 - stroke_m[axis].0));
    let [x, y, z] = <[f64; 3]>::from((high - low) * 1e3);
    let strokes = stroke_m.map(|(low, high)| (high - low) * 1e3);
    ensure!(
        shares.max() >= SMALLEST_SHARE && shares.max() <= LARGEST_SHARE,
        "the points span {x:.3} × {y:.3} × {z:.3} mm of a machine that moves {:.0} × {:.0} × {:.0} mm; check the unit of their \
         columns, and that they are of this machine",
        strokes[0],
        strokes[1],
        strokes[2]
    );
    Ok(())
}

/// Points that measured residuals leave far from what all others say, the farthest first, as text.
fn outliers(trained: &Trained, data: &Data) -> Vec<String> {
    let mut found = Vec::new();
    for point in &trained.held_out {
        let measured_m = data.field.errors_m()[point.index];
        for axis in 0..3 {
            let off_m = measured_m[axis] - point.predicted_m[axis];
            let times = (off_m / point.u_m[axis]).abs();
            if times > FAR {
                found.push((times, off_text(&data.field, point.index, axis, off_m, times)));
            }
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.into_iter().map(|(_, text)| text).collect()
}

fn read_state(path: &Path) -> anyhow::Result<State> {
    let bytes = std::fs::read(path).with_context(|| {
        format!("{}: there is no stopped training to go on with; leave --resume out", path.display())
    })?;
    serde_json::from_slice(&bytes)
        .with_context(|| format!("{}: this is no stopped training; remove it and leave --resume out", path.display()))
}

fn remove_state(path: &Path) -> anyhow::Result<()> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("{}: cannot be removed", path.display()))
        }
        _ => Ok(()),
    }
}

fn with_progress(
    data: &Data,
    config: &Config,
    device: &Device,
    resume: Option<State>,
    observe: &mut dyn FnMut(&Progress, &ProgressBar) -> Go,
) -> anyhow::Result<Trained> {
    let bar = spinner(&format!("training on {} points", data.points()));
    let alone = data.alone.as_ref();
    let trained =
        train_beside(&data.field, alone, config, device, resume, &mut |progress: &Progress| observe(progress, &bar));
    bar.finish_and_clear();
    Ok(trained?)
}

fn progress_text(progress: &Progress) -> String {
    format!(
        "{} {} of {}, epoch {} of {}: loss {:.4}, validation {:.4}, best {:.4}",
        progress.kind.name(),
        progress.member + 1,
        progress.members,
        progress.epoch + 1,
        progress.epochs,
        progress.training_loss,
        progress.validation_loss,
        progress.best_validation_loss
    )
}

fn artifact(
    trained: &Trained,
    data: &Data,
    config: &Config,
    owner: Option<ResidualOwner>,
) -> anyhow::Result<ResidualFile> {
    let mut validation = serde_json::to_value(&trained.record)?;
    if !data.left_out.is_empty() {
        validation["left_out"] = data.left_out.clone().into();
    }
    Ok(ResidualFile {
        model: trained.model.clone(),
        owner,
        data: vec![DataSource { file: data.file.clone(), sha256: hex(&data.sha256) }],
        seed: config.seed,
        complete: trained.record.complete,
        config: serde_json::to_value(config)?,
        validation,
        software: software(),
    })
}

fn say(
    arguments: &TrainArguments,
    trained: &Trained,
    data: &Data,
    file: &ResidualFile,
    sha256: &[u8; 32],
    paths: &Paths,
) {
    let record = &trained.record;
    println!("recommended {}: {}", record.recommendation.method, record.recommendation.why);
    match &file.owner {
        Some(owner) => println!("  belongs to        {} of machine {}", hex(&owner.model_sha256), owner.machine),
        None => {
            println!("  belongs to        no known model: it predicts, but corrects nothing; name one with --model")
        }
    }
    println!(
        "  points            {}, held out by {}",
        record.points,
        if record.flattering { "single points (flattering)" } else { "blocks of space" }
    );
    if !data.left_out.is_empty() {
        println!("  left out          {} that contradict all others, named above", data.left_out.len());
    }
    if !record.inputs.is_empty() {
        println!("  inputs            {}", record.inputs.join(" "));
    }
    println!("  trained on        {}", record.device);
    if let Some([x, y, z]) = record.declared_seen.map(|seen| seen.map(|share| share * 100.0)) {
        println!(
            "  declared u        {x:.0} {y:.0} {z:.0} % of it (x y z) is seen as scatter; the rest is taken as common to all points \
             around, and stays in u_*"
        );
    }
    let [x, y, z] = record.unshared_um;
    println!(
        "  unshared          {x:.3} {y:.3} {z:.3} µm (x y z) that neighbours do not share{}; in u_*",
        if record.declared_seen.is_some() {
            ", beyond what is declared"
        } else {
            ", noise of the measurement included: no u is declared"
        }
    );
    let width = record.held_out.iter().map(|method| method.method.len()).fold(18, usize::max);
    let head = "held out";
    println!("  {head:<0$}   MSE µm²    MAE µm   95 % µm  worst µm   in 95 %    points", width + 2);
    for method in &record.held_out {
        let coverage = method.coverage_95.map_or_else(|| "-".to_owned(), |share| format!("{:.1} %", share * 100.0));
        let s = &method.scores;
        println!(
            "    {:<width$} {:>9.4} {:>9.4} {:>9.4} {:>9.4} {coverage:>9} {:>9}",
            method.method, s.mse_um2, s.mae_um, s.error_95_um, s.worst_um, method.points
        );
    }
    println!("  made              {}", record.kind);
    if record.recommendation.method.ends_with(POSITION_ALONE) {
        println!(
            "  note              held-out data do not show that the further inputs help: train with --inputs position instead"
        );
    }
    if record.recommendation.method == ZERO {
        println!("  note              held-out data speak for no residual model at all: do not correct with this one");
    }
    let outliers = outliers(trained, data);
    if !outliers.is_empty() {
        let count = outliers.len();
        println!("  outliers          {count} more than {FAR} u from what the others say; look at them first:");
        outliers.iter().take(MOST_SHOWN).for_each(|outlier| println!("    {outlier}"));
    }
    println!("  written           {}", arguments.out.display());
    println!("  residual model    {}", hex(sha256));
    println!("  report            {}", paths.report.display());
    next(arguments, trained).print();
}
