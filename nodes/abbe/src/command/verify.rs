//! `abbe verify`: error of indicated and corrected points against known actual positions.
//!
//! Place in the flow: scoring only; never part of a fit.

mod report;

use crate::identity::{IdentityOptions, Said};
use crate::next::{Next, READINGS};
use crate::output;
use crate::pairs::{PairErrors, pair_errors};
use crate::pipeline::software;
use crate::provenance::file_name;
use crate::residual::{load_residual, residual_meta};
use crate::verification::{VerificationPoints, correct_points, rms_and_max_m};
use abbe_files::{ModelFile, TableFacts, hex, write_atomically};
use abbe_geometry::Vector3;
use abbe_geometry::chain::nominal_point_m;
use abbe_geometry::correct::Status;
use abbe_graph::step::OwnedField;
use abbe_measurement::alignment::{UNKNOWNS, aligned_residuals_m, share_left};
use abbe_report::{MetaItem, digits};
use anyhow::Context;
use serde_json::json;
use std::fs::File;
use std::path::PathBuf;

/// With fewer points the alignment takes more than a twentieth of the errors, and it is said.
const FEW_POINTS: usize = 20;
/// Share of an rms by which another is larger that is rounding.
const ROUNDING: f64 = 1e-9;

/// Arguments of `verify`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Model file
    #[arg(long)]
    model: PathBuf,
    /// Residual model that belongs to this model
    #[arg(long)]
    residual: Option<PathBuf>,
    /// CSV with scale readings and actual_x_mm, actual_y_mm, actual_z_mm
    #[arg(long)]
    points: PathBuf,
    /// Page with the errors before and after, as HTML
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// The same as PDF
    #[arg(long, value_name = "FILE")]
    pdf: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    identity: IdentityOptions,
}

/// One state of the points: indicated, corrected by geometry, corrected by everything.
struct Stage {
    name: &'static str,
    /// Beginning of its keys in JSON.
    key: &'static str,
    rms_um: f64,
    max_um: f64,
    lengths: PairErrors,
    /// Errors after rigid alignment, point by point.
    errors_um: Vec<[f64; 3]>,
}

impl Stage {
    fn new(
        (name, key): (&'static str, &'static str),
        points_m: &[Vector3<f64>],
        actual_m: &[Vector3<f64>],
    ) -> anyhow::Result<Stage> {
        let errors_m = aligned_residuals_m(points_m, actual_m)?;
        let errors_um = errors_m.iter().map(|error_m| (error_m * 1e6).into()).collect();
        let (rms_m, max_m) = rms_and_max_m(errors_m.into_iter());
        let lengths = pair_errors(points_m, actual_m)?;
        Ok(Stage { name, key, rms_um: rms_m * 1e6, max_um: max_m * 1e6, lengths, errors_um })
    }
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let outputs = [&arguments.html, &arguments.pdf].into_iter().flatten().map(PathBuf::as_path);
    let inputs = arguments.residual.iter().chain([&arguments.model, &arguments.points]).map(PathBuf::as_path);
    output::check(outputs, inputs)?;
    let (model, sha256) = ModelFile::load(&arguments.model)?;
    let residual = arguments.residual.as_deref().map(|path| load_residual(path, &model, &sha256)).transpose()?;
    let name = arguments.points.display().to_string();
    let corrected = |residual: Option<&OwnedField>| {
        let input = File::open(&arguments.points).with_context(|| format!("{name}: cannot be opened"))?;
        correct_points(input, &name, &model, residual)
    };
    let points = corrected(residual.as_ref())?;
    let actual_m: Vec<Vector3<f64>> = points.rows.iter().filter_map(|row| row.actual_m).map(Vector3::from).collect();
    let indicated_m: Vec<Vector3<f64>> = points.rows.iter().map(|r| nominal_point_m(r.reading_m, r.offset_m)).collect();
    let before = Stage::new(("indicated", "before"), &indicated_m, &actual_m);
    let mut stages = vec![before.with_context(|| name.clone())?];
    if residual.is_some() {
        stages.push(Stage::new(("by geometry", "geometric"), &corrected(None)?.corrected_m, &actual_m)?);
    }
    stages.push(Stage::new(("corrected", "after"), &points.corrected_m, &actual_m)?);
    write(arguments, (&model, &hex(&sha256)), residual.as_ref(), (&points, &stages))?;
    if arguments.json {
        let mut value = json!({
            "points": points.rows.len(), "extrapolated": points.extrapolated(),
            "covariate_missing": points.tally.count(Status::CovariateMissing),
            "rms_left_by_alignment": share_left(points.rows.len()),
            "model_doubts": model.said_against().collect::<Vec<_>>(),
            "correction_makes_worse": worse(&stages).is_some(),
        });
        for stage in &stages {
            let Stage { key, rms_um, max_um, lengths, .. } = stage;
            value[format!("{key}_rms_um")] = json!(rms_um);
            value[format!("{key}_max_um")] = json!(max_um);
            value[format!("{key}_length_error_max_um")] = json!(lengths.largest_m * 1e6);
            value[format!("{key}_length_limit_um")] = json!(lengths.limit());
        }
        println!("{}", serde_json::to_string_pretty(&value)?);
    } else {
        print_words(&points, &stages);
        next(arguments, &points, &stages).print();
    }
    if let Some(worse) = worse(&stages) {
        eprintln!("abbe: warning: {name}: {worse}");
    }
    if !points.tally.is_inside() {
        eprintln!("abbe: {}", points.tally.words(&model.model, &name, "line"));
    }
    Ok(points.tally.judge(&name)?)
}

/// A model that makes errors smaller corrects; one that does not lacks something. Points of which none was inside tell neither.
fn next(arguments: &Arguments, points: &VerificationPoints, stages: &[Stage]) -> Next {
    if points.tally.count(Status::InVolume) == 0 {
        let again = Next::new("to judge the model where it was identified", "verify").file("--model", &arguments.model);
        return again.text("--points POINTS_INSIDE.csv");
    }
    let is_better = stages.first().zip(stages.last()).is_some_and(|(before, after)| after.rms_um < before.rms_um);
    if !is_better {
        let diagnose = Next::new("to find what the model lacks", "diagnose").file("--model", &arguments.model);
        return diagnose.text("--campaign CAMPAIGN.csv --out diagnosis");
    }
    let correct = Next::new("to correct readings with it", "correct").file("--model", &arguments.model);
    arguments.residual.iter().fold(correct, |correct, path| correct.file("--residual", path)).text(READINGS)
}

/// That a correction does harm, where it does: figures alone are read past.
fn worse(stages: &[Stage]) -> Option<String> {
    let (before, after) = stages.first().zip(stages.last())?;
    let [indicated, corrected] = [before, after].map(|stage| digits::result(stage.rms_um));
    (after.rms_um > before.rms_um * (1.0 + ROUNDING)).then(|| {
        format!(
            "the correction makes the errors larger: {indicated} µm rms indicated, {corrected} µm rms corrected; do not correct with this model \
             before it is known why: see whether points and model are of one machine in one state, and identify it anew"
        )
    })
}

/// The page, where one is asked for.
fn write(
    arguments: &Arguments,
    (model, sha256): (&ModelFile, &str),
    residual: Option<&OwnedField>,
    (points, stages): (&VerificationPoints, &[Stage]),
) -> anyhow::Result<()> {
    if arguments.html.is_none() && arguments.pdf.is_none() {
        return Ok(());
    }
    let machine_name = Some(model.model.parts().machine.name.as_str());
    let tables = [arguments.points.as_path()];
    let who = arguments.identity.gather(&Said { machine_name, tables: &tables, ..Said::default() })?;
    let of_points = TableFacts::read(&arguments.points)?.sha256;
    let mut meta = vec![
        MetaItem::file("Points", &file_name(&arguments.points), Some(&hex(&of_points))),
        MetaItem::file("Model", &file_name(&arguments.model), Some(sha256)),
    ];
    meta.extend(residual_meta(arguments.residual.as_deref(), residual));
    meta.push(MetaItem::software(software()));
    let report = report::report(report::Page {
        identity: who.shown,
        meta,
        at_m: points.rows.iter().map(|row| row.reading_m).collect(),
        stages,
        inside: points.tally.count(Status::InVolume) as usize,
        few: few(points.rows.len()),
        worse: worse(stages),
        outside: points.tally.sentences(&model.model),
        doubts: model.said_against().collect(),
        next: next(arguments, points, stages).step(),
    });
    let pdf = arguments.pdf.as_ref().map(|_| report.pdf()).transpose().context("--pdf")?;
    if let Some(path) = &arguments.html {
        write_atomically(path, report.html()?.as_bytes())?;
    }
    if let (Some(path), Some(pdf)) = (&arguments.pdf, &pdf) {
        write_atomically(path, pdf)?;
    }
    Ok(())
}

/// What an alignment of few points does to the figures.
fn few(points: usize) -> Option<String> {
    let left = share_left(points).filter(|_| points < FEW_POINTS)?;
    let enough = share_left(FEW_POINTS)?;
    Some(format!(
        "{points} points are few: their alignment fits {UNKNOWNS} of {} numbers, so that each rms is about {left:.2} of the true one, and \
         the largest error too small as well; of {FEW_POINTS} points {enough:.2} is left",
        3 * points
    ))
}

fn print_words(points: &VerificationPoints, stages: &[Stage]) {
    let extrapolated = points.extrapolated();
    let lacking = match points.tally.count(Status::CovariateMissing) {
        0 => String::new(),
        lacking => format!(", {lacking} without a quantity that the model reads"),
    };
    let pairs = stages.first().map_or(0, |stage| stage.lengths.pairs);
    println!(
        "{} points, {extrapolated} extrapolated{lacking}; 3-D error after rigid alignment, and length error of {pairs} pairs (µm; L in mm):",
        points.rows.len()
    );
    for Stage { name, rms_um, max_um, lengths, .. } in stages {
        let [rms, max, length] = [*rms_um, *max_um, lengths.largest_m * 1e6].map(digits::result);
        let limit = lengths.growing_limit().map_or_else(String::new, |limit| format!(", all within {limit}"));
        println!("  {name:<11} rms {rms:>6}  max {max:>6}  length error max {length:>6}{limit}");
    }
    if let Some(few) = few(points.rows.len()) {
        println!("  {few}");
    }
}
