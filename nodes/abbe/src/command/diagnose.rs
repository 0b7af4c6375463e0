//! `abbe diagnose`: measured data in; what the model lacks, the report of it, and the model that has it out.
//!
//! Place in the flow: offline, or started by the monitor node on the readings it keeps. The error before and after is
//! that on data which no step used; verification points score at the very end.

use crate::diagnosis::study::{self, DataKind};
use crate::diagnosis::{MODEL, Product, Request, output, tracer};
use crate::exit::Ended;
use crate::identity::{IdentityOptions, Said};
use crate::next::{KNOWN_POINTS, Next, READINGS};
use crate::pipeline::BagJoin;
use crate::pipeline::is_bag;
use crate::progress::{Parts, Told};
use crate::stop;
use crate::verdict::{Accept, shown};
use abbe_diagnose::Progress;
use abbe_files::{Days, read_machine, read_residual_origin};
use abbe_report::Identity;
use abbe_report::diagnosis::DiagnosisReport;
use abbe_runtime::Shutdown;
use anyhow::{Context, bail};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Steps by which a diagnosis that a node started gives way to others: correction comes first.
#[cfg(target_os = "linux")]
const GIVES_WAY: i32 = 5;

/// Arguments of `diagnose`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Model file that the campaign belongs to; data without a tracer need none
    #[arg(long)]
    model: Option<PathBuf>,
    /// Machine file of the axes behind positioning runs or residual vectors: what is found comes out as a model file, too
    #[arg(long, conflicts_with = "model")]
    machine: Option<PathBuf>,
    /// Tracer campaign (CSV, .mcap or rosbag2 folder), ISO 230-2 runs (CSV) or sphere centres (CSV); the header decides
    #[arg(long, required_unless_present = "residuals", conflicts_with = "residuals")]
    campaign: Option<PathBuf>,
    #[command(flatten)]
    join: BagJoin,
    /// Residual vectors of any other calibration (CSV), or of `abbe residuals`: with the model that leaves them, what is found is added to it
    #[arg(long, conflicts_with = "verify")]
    residuals: Option<PathBuf>,
    /// Folder for report.html, diagnosis.json and model.json; what was there is replaced at the end
    #[arg(long)]
    out: PathBuf,
    /// Points with known actual positions, for scoring only
    #[arg(long, requires = "model")]
    verify: Option<PathBuf>,
    /// Seed of the parts left out and of the placebos (tracer campaigns)
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Parts in which lines are left out of the whole search
    #[arg(long)]
    folds: Option<usize>,
    /// A mark that stands still was measured before, between and after: neither the instrument nor a plate drifted, so that what goes with the time is
    /// the machine's (positioning runs, residual vectors)
    #[arg(long)]
    instrument_checked: bool,
    /// Print diagnosis.json on standard output
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    accept: Accept,
    #[command(flatten)]
    identity: IdentityOptions,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let has_found = Arc::new(AtomicBool::new(false));
    let shutdown = stop::keep_what_there_is(&has_found)?;
    diagnosed(arguments, &shutdown, &has_found).map_err(|error| stop::told_as_stopped(error, &shutdown))
}

fn diagnosed(arguments: &Arguments, shutdown: &Shutdown, has_found: &AtomicBool) -> anyhow::Result<()> {
    #[cfg(target_os = "linux")]
    if std::env::var_os(abbe_runtime::LAUNCHER_PID).is_some() {
        // Where the system refuses, it goes on as it is.
        let _ = rustix::process::nice(GIVES_WAY);
    }
    let inputs = [&arguments.model, &arguments.machine, &arguments.campaign, &arguments.residuals, &arguments.verify];
    let inputs: Vec<_> = inputs.into_iter().flatten().map(PathBuf::as_path).collect();
    output::check(&arguments.out, &inputs)?;
    let told = Told::new("diagnosing");
    let mut fold = None;
    let mut observe = |progress: Progress| {
        told.say(progress_text(&progress, &mut fold));
        !shutdown.requested()
    };
    let mut parts = Parts::default();
    let mut observe_study = |progress: study::Progress| {
        told.say(study_text(&progress, &mut parts, told.elapsed()));
        if progress.part.is_none() && progress.effects > 0 {
            has_found.store(true, Ordering::Relaxed);
        }
        !shutdown.requested()
    };
    let made = product(arguments, &mut observe, &mut observe_study);
    told.finish();
    let mut product = shown(made, arguments.json)?;
    product.report.identity = who(arguments, &product.report)?;
    let next = next(arguments, &product);
    product.report.next = Some(next.step());
    let json = product.report.json()?;
    if shutdown.requested() && !has_found.load(Ordering::Relaxed) {
        bail!("stopped on request; nothing was written");
    }
    output::write(&arguments.out, &product, &json)?;
    match arguments.json {
        true => print!("{json}"),
        false => {
            println!("{}", output::words(&product.report.record, &arguments.out));
            product.without_model.iter().for_each(|why| println!("{why}"));
            next.print();
        }
    }
    if product.is_partial {
        let out = arguments.out.display();
        let words = format!("stopped on request; {out} holds what was found until then, not judged on data left out");
        return Err(Ended::stopped(words).into());
    }
    Ok(())
}

/// What to do with what was found: test the model that came of it, then correct with it; where there is no model, make one.
fn next(arguments: &Arguments, product: &Product) -> Next {
    let record = &product.report.record;
    let found = !record.effects.is_empty() || record.enriched;
    let model = arguments.out.join(MODEL);
    match (&product.model, &arguments.model, &arguments.campaign) {
        (Some(_), Some(given), Some(campaign))
            if !(found || record.consistent_with_noise || record.only_correlated) =>
        {
            Next::new("to see whether a field of position explains what has no name", "residuals")
                .file("--model", given)
                .file("--campaign", campaign)
                .text("--out residuals.csv")
        }
        (Some(_), ..) if arguments.verify.is_none() => {
            Next::new("to hold it against points that no fit has seen", "verify")
                .file("--model", &model)
                .text(KNOWN_POINTS)
        }
        (Some(_), ..) => Next::new("to correct readings with it", "correct").file("--model", &model).text(READINGS),
        (None, Some(given), _) if found => Next::new("to have residuals that say which model leaves them", "residuals")
            .file("--model", given)
            .text("--campaign CAMPAIGN.csv --out residuals.csv"),
        (None, ..) if found => {
            let data = [("--campaign", &arguments.campaign), ("--residuals", &arguments.residuals)];
            let what_for = match product.without_model.is_empty() {
                true => "to have a model with it, where the machine has linear axes",
                false => "to have a model with it, once the data hold what it needs",
            };
            let next = Next::new(what_for, "diagnose");
            let named = data.into_iter().filter_map(|(option, path)| Some((option, path.as_deref()?)));
            let next = named.fold(next, |next, (option, path)| next.file(option, path));
            let of_model = arguments.residuals.as_deref().map(read_residual_origin);
            let next = match &arguments.machine {
                _ if matches!(of_model, Some(Ok(Some(_)))) => next.text("--model MODEL.json"),
                Some(machine) => next.file("--machine", machine),
                None => next.text("--machine MACHINE.toml"),
            };
            next.file("--out", &arguments.out)
        }
        (None, ..) => {
            let plan = "plan --machine MACHINE.toml --request REQUEST.toml --out plan";
            Next::new("to measure all errors of the machine together", plan)
        }
    }
}

/// Who measured what the diagnosis is about; what the campaign itself says is in the report already.
fn who(arguments: &Arguments, report: &DiagnosisReport) -> anyhow::Result<Identity> {
    let of_data = &report.identity;
    let tables = [&arguments.campaign, &arguments.residuals].into_iter().flatten().map(PathBuf::as_path);
    let tables: Vec<&Path> = tables.filter(|path| !is_bag(path)).collect();
    let machine = arguments.machine.as_deref().map(read_machine).transpose()?;
    let said = Said {
        machine: machine.as_ref(),
        machine_name: report.record.machine.as_deref(),
        tables: &tables,
        days: of_data.measured.as_deref().and_then(Days::parse),
        temperature_c: of_data.temperature_c,
    };
    Ok(arguments.identity.gather(&said)?.shown)
}

fn product(
    arguments: &Arguments,
    observe: &mut dyn FnMut(Progress) -> bool,
    observe_study: &mut dyn FnMut(study::Progress) -> bool,
) -> anyhow::Result<Product> {
    let request = Request {
        machine: arguments.machine.as_deref(),
        verify: arguments.verify.as_deref(),
        seed: arguments.seed,
        folds: arguments.folds,
        instrument_checked: arguments.instrument_checked,
        accept: arguments.accept,
        join: &arguments.join,
    };
    if let Some(residuals) = &arguments.residuals {
        return study::run_residuals(residuals, arguments.model.as_deref(), &request, observe_study);
    }
    let campaign = arguments.campaign.as_deref().context("name the data with --campaign or --residuals")?;
    match (study::kind_of(campaign), &arguments.model) {
        (Some(kind), Some(_)) => bail!(
            "{}: {} need no model; leave --model out",
            campaign.display(),
            match kind {
                DataKind::Runs => "positioning runs",
                DataKind::SphereCentres => "sphere centres",
            }
        ),
        (None, _) if arguments.instrument_checked => bail!(
            "{}: --instrument-checked is for positioning runs and residual vectors; in a tracer campaign a drift of the tracer is one of the \
             causes that are tried, so leave it out",
            campaign.display()
        ),
        (None, Some(model)) => tracer::run(model, campaign, &request, observe),
        (None, None) if arguments.machine.is_some() => bail!(
            "{}: its header is not that of positioning runs (axis, target_mm); a tracer campaign is diagnosed with the model it belongs \
             to: name it with --model and leave --machine out",
            campaign.display()
        ),
        (None, None) => bail!(
            "{}: its header is not that of positioning runs (axis, target_mm) or sphere centres (a_deg, c_deg); a tracer campaign is \
             diagnosed with the model it belongs to: name it with --model, or make it with abbe identify",
            campaign.display()
        ),
        (Some(kind), None) => study::run(kind, campaign, &request, observe_study),
    }
}

/// Progress of a study in words. The search on all data comes before those without each part, and is of their size.
fn study_text(progress: &study::Progress, parts: &mut Parts, elapsed: Duration) -> String {
    let part = progress.part.map_or_else(String::new, |(number, of)| format!("without part {number} of {of}: "));
    let (number, of) = progress.part.unwrap_or_default();
    let left = parts.left(number, of + 1, elapsed);
    let left = left.map_or_else(String::new, |left| format!(", {left}"));
    format!("{part}{} candidates beside {} effects{left}", progress.candidates, progress.effects)
}

/// Progress in words. Within a part left out, the search goes through the same steps again.
fn progress_text(progress: &Progress, fold: &mut Option<String>) -> String {
    if let Progress::Judging { fold: number, folds } = progress {
        *fold = Some(format!("without part {number} of {folds} of the lines: "));
    }
    let part = fold.as_deref().unwrap_or("");
    match progress {
        Progress::Fitting { pass, effects } => format!("{part}fit with {effects} effects, pass {pass}"),
        Progress::Scoring { round, effects } => format!("{part}round {round}, {effects} effects so far"),
        Progress::Judging { .. } => format!("{part}search from the start"),
    }
}
