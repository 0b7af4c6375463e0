//! `abbe conformity`: figures of ISO 10360-2, -5 and ISO 230-2, -6, observed and, where limits are given, held against them.
//!
//! Place in the flow: on measured data of an acceptance test, or on the virtual machine before and after correction.

use super::identify::progress_text;
use super::simulate::VOLUMETRIC_RMS_UM;
use crate::conformity::{self, Limits, Product, dcc, lengths, runs, simulated, sphere};
use crate::exit::Ended;
use crate::identity::{IdentityOptions, Said, Who};
use crate::next::Next;
use crate::output;
use crate::progress::spinner;
use abbe_conformity::length::Probing;
use abbe_conformity::{MaximumPermissibleError, Verdict};
use abbe_files::{read_machine, write_atomically};
use abbe_identify::Progress;
use abbe_runtime::Shutdown;
use anyhow::{Context, bail, ensure};
use clap::ValueEnum;
use std::path::{Path, PathBuf};

/// How the ends of a length were probed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ProbingText {
    /// From opposite sides, as on a gauge block
    Bidirectional,
    /// From the same side
    Unidirectional,
}

/// Arguments of `conformity`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Measured lengths (CSV): ISO 10360-2
    #[arg(
        long,
        requires = "probing",
        required_unless_present_any = ["sphere", "runs", "machine"],
        conflicts_with_all = ["sphere", "runs", "machine"]
    )]
    lengths: Option<PathBuf>,
    /// Points probed on a sphere (CSV): ISO 10360-5
    #[arg(long, conflicts_with_all = ["runs", "machine"])]
    sphere: Option<PathBuf>,
    /// Positioning runs (CSV): ISO 230-2, and ISO 230-6 for runs along diagonals
    #[arg(long, conflicts_with = "machine")]
    runs: Option<PathBuf>,
    /// Machine file of a bridge XYZ machine: simulated, identified, and tested before and after correction
    #[arg(long, requires = "seed")]
    machine: Option<PathBuf>,
    /// How the lengths were probed; must be stated
    #[arg(long, requires = "lengths")]
    probing: Option<ProbingText>,
    /// Distance of the tip from the ram axis: 0 for E0, 150 for E150
    #[arg(long, default_value_t = 0.0, conflicts_with_all = ["sphere", "runs"])]
    tool_offset_mm: f64,
    /// Maximum permissible error of length, as on a data sheet: "0.5+L/400" (µm, L in mm)
    #[arg(long, conflicts_with_all = ["sphere", "runs"])]
    mpe: Option<String>,
    /// Limit of the repeatability range R0
    #[arg(long, requires = "mpe")]
    r0_limit_um: Option<f64>,
    /// Calibrated diameter of the sphere
    #[arg(long, requires = "sphere")]
    diameter_mm: Option<f64>,
    /// Limit of the form error of probing
    #[arg(long, requires = "sphere")]
    form_limit_um: Option<f64>,
    /// Limit of the size error of probing
    #[arg(long, requires_all = ["sphere", "diameter_mm"])]
    size_limit_um: Option<f64>,
    /// Expanded uncertainty (k = 2) of the test, such as "0.07+L/4000": decide after ISO 14253-1
    #[arg(long, conflicts_with = "runs")]
    uncertainty: Option<String>,
    /// Seed of the simulated machine
    #[arg(long, requires = "machine")]
    seed: Option<u64>,
    /// Physics beyond the geometry of the simulated machine, such as "backlash axis=y size_um=3"
    #[arg(long = "effect", requires = "machine")]
    effects: Vec<String>,
    /// Raw volumetric error of the simulated machine (rms)
    #[arg(long, requires = "machine", default_value_t = VOLUMETRIC_RMS_UM)]
    volumetric_um: f64,
    /// Model to correct the simulated machine with; left out, one is identified from a simulated campaign
    #[arg(long, requires = "machine")]
    model: Option<PathBuf>,
    /// Residual model that belongs to the model: a third test, with both
    #[arg(long, requires = "model")]
    residual: Option<PathBuf>,
    /// Folder for report.html and conformity.json
    #[arg(long)]
    out: Option<PathBuf>,
    /// The report as PDF
    #[arg(long, value_name = "FILE")]
    pdf: Option<PathBuf>,
    /// Digital Calibration Certificate (XML, PTB's schema 3.1) of measured lengths or of a probed sphere; wants the table identity complete
    #[arg(long, value_name = "FILE", conflicts_with_all = ["runs", "machine"])]
    dcc: Option<PathBuf>,
    /// Print conformity.json on standard output
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    identity: IdentityOptions,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let outputs = [&arguments.pdf, &arguments.dcc].into_iter().flatten().map(PathBuf::as_path);
    let inputs = [&arguments.lengths, &arguments.sphere, &arguments.runs, &arguments.machine, &arguments.model];
    output::check(outputs, inputs.into_iter().flatten().map(PathBuf::as_path))?;
    let mut product = product(arguments)?;
    let who = who(arguments)?;
    product.report.identity = who.shown.clone();
    let next = next(arguments, product.verdict);
    product.report.next = Some(next.step());
    // What cannot be written is said before anything is.
    let pdf = arguments.pdf.as_ref().map(|_| product.report.pdf()).transpose().context("--pdf")?;
    let dcc = arguments.dcc.as_ref().map(|_| dcc::text(&who, &product)).transpose().context("--dcc")?;
    if let (Some(path), Some(pdf)) = (&arguments.pdf, &pdf) {
        write_atomically(path, pdf)?;
    }
    if let (Some(path), Some(dcc)) = (&arguments.dcc, &dcc) {
        write_atomically(path, dcc.as_bytes())?;
    }
    if let Some(folder) = &arguments.out {
        conformity::write(folder, &product)?;
    }
    match arguments.json {
        true => println!("{}", serde_json::to_string_pretty(&product.json)?),
        false => print!("{}{}", product.words, next.words()),
    }
    if let Some(outside) = product.outside {
        eprintln!("abbe: {}", outside.words);
        outside.judged?;
    }
    match product.verdict {
        None | Some(Verdict::Conforms) => Ok(()),
        Some(Verdict::Undecided) => {
            Err(Ended::undecided("neither conformity nor nonconformity is proved".to_owned()).into())
        }
        Some(Verdict::DoesNotConform) => Err(Ended::not_conforming("does not conform".to_owned()).into()),
    }
}

/// What follows from figures without a limit, from a verdict, and from runs.
fn next(arguments: &Arguments, verdict: Option<Verdict>) -> Next {
    if let Some(runs) = &arguments.runs {
        return Next::new("to find what is behind the figures", "diagnose")
            .file("--campaign", runs)
            .text("--out causes");
    }
    if arguments.machine.is_some() {
        return Next::new("to test a real machine", "conformity --lengths LENGTHS.csv --probing bidirectional");
    }
    let same = |what_for: &str| {
        let next = Next::new(what_for, "conformity");
        let next = match (&arguments.lengths, &arguments.sphere) {
            (Some(path), _) => next.file("--lengths", path),
            (None, Some(path)) => next.file("--sphere", path),
            (None, None) => next,
        };
        stated(arguments).iter().fold(next, |next, text| next.text(text))
    };
    let limits = limits(arguments);
    let limit = match limits.as_str() {
        "" if arguments.sphere.is_some() => "--form-limit-um LIMIT",
        "" => "--mpe 'A+L/K'",
        limits => limits,
    };
    match (verdict, &arguments.uncertainty) {
        (None, _) => same("to hold the figures against a limit").text(limit),
        (Some(Verdict::Conforms), None) => {
            same("to take the uncertainty of the test into account").text(limit).text("--uncertainty 'A+L/K'")
        }
        (Some(Verdict::Conforms), Some(uncertainty)) => {
            let certified = same("to certify it").text(limit).text(&format!("--uncertainty '{uncertainty}'"));
            certified.text("--identity LAB.toml --pdf test.pdf --dcc test.xml")
        }
        (Some(Verdict::Undecided | Verdict::DoesNotConform), _) => Next::new(
            "to find and correct the machine's errors",
            "plan --machine MACHINE.toml --request REQUEST.toml --out plan",
        ),
    }
}

/// What the user said of the test, which belongs to every command for the same data.
fn stated(arguments: &Arguments) -> Vec<String> {
    let probing = arguments.probing.map(|probing| match probing {
        ProbingText::Bidirectional => "--probing bidirectional".to_owned(),
        ProbingText::Unidirectional => "--probing unidirectional".to_owned(),
    });
    let offset_mm = Some(arguments.tool_offset_mm).filter(|mm| *mm != 0.0);
    let offset = offset_mm.map(|mm| format!("--tool-offset-mm {mm}"));
    let diameter = arguments.diameter_mm.map(|mm| format!("--diameter-mm {mm}"));
    [probing, offset, diameter].into_iter().flatten().collect()
}

/// All limits that were given, as options; empty for none.
fn limits(arguments: &Arguments) -> String {
    let mpe = arguments.mpe.as_ref().map(|mpe| format!("--mpe '{mpe}'"));
    let in_um = [
        ("--r0-limit-um", arguments.r0_limit_um),
        ("--form-limit-um", arguments.form_limit_um),
        ("--size-limit-um", arguments.size_limit_um),
    ];
    let in_um = in_um.into_iter().filter_map(|(option, um)| um.map(|um| format!("{option} {um}")));
    mpe.into_iter().chain(in_um).collect::<Vec<String>>().join(" ")
}

/// Who measured. A simulated machine was measured by nobody: what its file says of operator, instrument and certificate is of another
/// measurement.
fn who(arguments: &Arguments) -> anyhow::Result<Who> {
    let tables = [&arguments.lengths, &arguments.sphere, &arguments.runs].into_iter().flatten().map(PathBuf::as_path);
    let tables: Vec<&Path> = tables.collect();
    let machine = arguments.machine.as_deref().map(read_machine).transpose()?;
    let machine_name = machine.as_ref().map(|file| file.machine.name.as_str());
    arguments.identity.gather(&Said { machine_name, tables: &tables, ..Said::default() })
}

fn product(arguments: &Arguments) -> anyhow::Result<Product> {
    let rule = conformity::rule(arguments.uncertainty.as_deref())?;
    let length = arguments.mpe.as_deref().map(MaximumPermissibleError::from_text).transpose().context("--mpe")?;
    let limits = Limits {
        length,
        repeatability: conformity::limit_um("--r0-limit-um", arguments.r0_limit_um)?,
        form: conformity::limit_um("--form-limit-um", arguments.form_limit_um)?,
        size: conformity::limit_um("--size-limit-um", arguments.size_limit_um)?,
    };
    let has_limit = limits.length.is_some() || limits.form.is_some() || limits.size.is_some();
    ensure!(arguments.uncertainty.is_none() || has_limit, "--uncertainty is for a decision; give a limit as well");
    match (&arguments.lengths, &arguments.sphere, &arguments.runs, &arguments.machine) {
        (Some(path), ..) => {
            let probing = match arguments.probing.context("state how the lengths were probed with --probing")? {
                ProbingText::Bidirectional => Probing::Bidirectional,
                ProbingText::Unidirectional => Probing::Unidirectional,
            };
            let stated = lengths::Stated { probing, tool_offset_m: arguments.tool_offset_mm / 1e3 };
            lengths::run(path, &stated, &limits, &rule)
        }
        (_, Some(path), ..) => sphere::run(path, arguments.diameter_mm.map(|d| d / 1e3), &limits, &rule),
        (.., Some(path), _) => runs::run(path),
        (.., Some(machine)) => {
            let seed = arguments.seed.context("name a seed with --seed")?;
            let tool_offset_m = arguments.tool_offset_mm / 1e3;
            let asked = simulated::Simulated {
                machine,
                seed,
                effects: &arguments.effects,
                volumetric_um: arguments.volumetric_um,
                tool_offset_m,
                model: arguments.model.as_deref(),
                residual: arguments.residual.as_deref(),
            };
            with_progress(|observe| simulated::run(&asked, &limits, &rule, observe))
        }
        _ => bail!("name the data with --lengths, --sphere, --runs or --machine"),
    }
}

fn with_progress(
    work: impl FnOnce(&mut dyn FnMut(Progress) -> bool) -> anyhow::Result<Product>,
) -> anyhow::Result<Product> {
    let shutdown = Shutdown::on_signals()?;
    let bar = spinner("identifying the simulated machine");
    let made = work(&mut |progress: Progress| {
        bar.set_message(progress_text(&progress));
        !shutdown.requested()
    });
    bar.finish_and_clear();
    made
}
