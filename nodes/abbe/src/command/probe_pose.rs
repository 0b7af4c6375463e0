//! `abbe probe-pose`: sphere centres in several poses of A and C in; pose of the laser probe and compensation table out.
//!
//! Place in the flow: on its own, after `abbe sphere` has fitted the centres. What the calibration leaves is for
//! `abbe diagnose`, which takes the same file.

use crate::calibration::{check_folder, finish, lead_on, probe_pose};
use crate::identity::IdentityOptions;
use crate::next::Next;
use crate::verdict::{Accept, shown};
use abbe_measurement::probe_pose::{BeamLength, ProbePoseModel};
use clap::ValueEnum;
use std::path::PathBuf;

/// What is assumed of the length of the beam's direction.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum BeamText {
    /// Fitted: the scale of the distance reading
    Free,
    /// One: the distance reading is true
    One,
}

/// Arguments of `probe-pose`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Sphere centres (CSV): a_deg, c_deg, d_mm, x_mm, y_mm, z_mm, optional u_um
    #[arg(long)]
    centres: PathBuf,
    /// Length of the beam's direction
    #[arg(long, default_value = "free")]
    beam: BeamText,
    /// Fit an offset of the A axis from the C axis as well
    #[arg(long)]
    axis_offset: bool,
    /// Folder for report.html, compensation.csv and probe_pose.json
    #[arg(long)]
    out: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    accept: Accept,
    #[command(flatten)]
    identity: IdentityOptions,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if let Some(folder) = &arguments.out {
        check_folder(folder)?;
    }
    let beam = match arguments.beam {
        BeamText::Free => BeamLength::Free,
        BeamText::One => BeamLength::One,
    };
    let model = ProbePoseModel { beam, axis_offset: arguments.axis_offset };
    let mut product = shown(probe_pose::product(&arguments.centres, model, arguments.accept), arguments.json)?;
    product.identify(&arguments.identity, &arguments.centres)?;
    let next = Next::new("to find what the calibration leaves", "diagnose").file("--campaign", &arguments.centres);
    lead_on(&mut product, &next.text("--out causes"));
    finish(&product, arguments.out.as_deref(), &arguments.centres, arguments.json)
}
