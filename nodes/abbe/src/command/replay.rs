//! `abbe replay`: the scale readings of a recorded run through the same steps, compared byte for byte.
//!
//! Place in the flow: evidence that a correction can be repeated; exit code 1 when anything differs.

use abbe_files::ModelFile;
use abbe_graph::replay::replay;
use abbe_graph::step::{GeometricStep, ResidualStep};
use abbe_msgs::Sha256;
use anyhow::bail;
use std::path::PathBuf;
use std::sync::Arc;

/// Arguments of `replay`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Recorded bag with scale readings and corrected coordinates
    #[arg(long)]
    bag: PathBuf,
    /// Model that was used
    #[arg(long)]
    model: PathBuf,
    /// Age in seconds from which a covariate is stale, as in the launch file of the run
    #[arg(long, default_value_t = 10.0)]
    max_covariate_age_s: f64,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let (model, sha256) = ModelFile::load(&arguments.model)?;
    let model = Some((Arc::new(model.model), Sha256::from_bytes(sha256)));
    let step = GeometricStep::new(model, arguments.max_covariate_age_s);
    let outcome = replay(&arguments.bag, &step, &ResidualStep::default())?;
    println!("{} of {} corrected messages are identical to the recorded ones", outcome.identical, outcome.replayed);
    if outcome.is_identical() {
        return Ok(());
    }
    if outcome.replayed == 0 {
        bail!("{}: holds no scale readings", arguments.bag.display());
    }
    let first = outcome.different.iter().chain(&outcome.unrecorded).min();
    bail!(
        "{}: {} differ and {} were not recorded, the first with sequence {}; check that model and launch file are those of the run",
        arguments.bag.display(),
        outcome.different.len(),
        outcome.unrecorded.len(),
        first.map_or_else(|| "unknown".to_owned(), u64::to_string)
    )
}
