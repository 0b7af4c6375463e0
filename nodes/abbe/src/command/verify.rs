//! `abbe verify`: error of indicated and corrected points against known actual positions.
//!
//! Place in the flow: scoring only; never part of a fit.

use crate::pairs::{PairErrors, pair_errors};
use crate::residual::load_residual;
use crate::verification::{VerificationPoints, correct_points, rms_and_max_m};
use abbe_files::ModelFile;
use abbe_geometry::Vector3;
use abbe_geometry::chain::nominal_point_m;
use abbe_graph::step::OwnedField;
use abbe_measurement::alignment::aligned_residuals_m;
use anyhow::Context;
use serde_json::json;
use std::fs::File;
use std::path::PathBuf;

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
    /// Print as JSON
    #[arg(long)]
    json: bool,
}

/// One state of the points: indicated, corrected by geometry, corrected by everything.
struct Stage {
    name: &'static str,
    /// Beginning of its keys in JSON.
    key: &'static str,
    rms_um: f64,
    max_um: f64,
    lengths: PairErrors,
}

impl Stage {
    fn new(
        (name, key): (&'static str, &'static str),
        points_m: &[Vector3<f64>],
        actual_m: &[Vector3<f64>],
    ) -> anyhow::Result<Stage> {
        let (rms_m, max_m) = rms_and_max_m(aligned_residuals_m(points_m, actual_m)?.into_iter());
        let lengths = pair_errors(points_m, actual_m)?;
        Ok(Stage { name, key, rms_um: rms_m * 1e6, max_um: max_m * 1e6, lengths })
    }
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
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
    let mut stages = vec![Stage::new(("indicated", "before"), &indicated_m, &actual_m)?];
    if residual.is_some() {
        stages.push(Stage::new(("by geometry", "geometric"), &corrected(None)?.corrected_m, &actual_m)?);
    }
    stages.push(Stage::new(("corrected", "after"), &points.corrected_m, &actual_m)?);
    if arguments.json {
        let mut value = json!({
            "points": points.rows.len(), "extrapolated": points.extrapolated(),
            "model_doubts": model.said_against().collect::<Vec<_>>(),
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
    }
    if !points.tally.is_inside() {
        eprintln!("abbe: {}", points.tally.words(&model.model, &name, "line"));
    }
    Ok(points.tally.judge(&name)?)
}

fn print_words(points: &VerificationPoints, stages: &[Stage]) {
    let extrapolated = points.extrapolated();
    let pairs = stages.first().map_or(0, |stage| stage.lengths.pairs);
    println!(
        "{} points, {extrapolated} extrapolated; 3-D error after rigid alignment, and length error of {pairs} pairs (um; L in mm):",
        points.rows.len()
    );
    for Stage { name, rms_um, max_um, lengths, .. } in stages {
        let (length_um, limit) = (lengths.largest_m * 1e6, lengths.limit());
        println!("  {name:<11} rms {rms_um:8.3}  max {max_um:8.3}  lengths within {length_um:7.3}, {limit}");
    }
}
