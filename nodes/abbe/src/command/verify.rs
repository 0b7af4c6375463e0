//! `abbe verify`: error of indicated and corrected points against known actual positions.
//!
//! Place in the flow: scoring only; never part of a fit.

use crate::verification::{correct_points, errors, rms_and_max_m};
use abbe_files::ModelFile;
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
    /// CSV with scale readings and actual_x_mm, actual_y_mm, actual_z_mm
    #[arg(long)]
    points: PathBuf,
    /// Print as JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let (model, _) = ModelFile::load(&arguments.model)?;
    let name = arguments.points.display().to_string();
    let input = File::open(&arguments.points).with_context(|| format!("{name}: cannot be opened"))?;
    let verified = errors(&correct_points(input, &name, &model)?)?;
    let (before_rms_m, before_max_m) = rms_and_max_m(verified.iter().map(|v| v.before_m));
    let (after_rms_m, after_max_m) = rms_and_max_m(verified.iter().map(|v| v.after_m));
    let extrapolated = verified.iter().filter(|v| v.extrapolated).count();
    if arguments.json {
        let um = |metres: f64| metres * 1e6;
        let value = json!({
            "points": verified.len(),
            "extrapolated": extrapolated,
            "before_rms_um": um(before_rms_m), "before_max_um": um(before_max_m),
            "after_rms_um": um(after_rms_m), "after_max_um": um(after_max_m),
        });
        println!("{}", serde_json::to_string_pretty(&value)?);
        return Ok(());
    }
    println!("{} points, {extrapolated} extrapolated; 3-D error after rigid alignment (um):", verified.len());
    println!("  indicated  rms {:8.3}  max {:8.3}", before_rms_m * 1e6, before_max_m * 1e6);
    println!("  corrected  rms {:8.3}  max {:8.3}", after_rms_m * 1e6, after_max_m * 1e6);
    Ok(())
}
