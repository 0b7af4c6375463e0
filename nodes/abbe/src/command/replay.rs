//! `abbe replay`: the scale readings of a recorded run through the same steps, compared byte for byte.
//!
//! Place in the flow: evidence that a correction can be repeated; exit code 1 when anything differs.

use abbe_files::{LoadedResidual, ModelFile, ResidualFile};
use abbe_graph::replay::{ReplaySteps, replay};
use abbe_graph::step::{GeometricStep, OwnedField, ResidualStep};
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
    /// Model that was used; where it changed during the run, give each of them
    #[arg(long, required = true)]
    model: Vec<PathBuf>,
    /// Residual model that was used; where it changed during the run, give each of them
    #[arg(long)]
    residual: Vec<PathBuf>,
    /// Age in seconds from which a covariate is stale, as in the launch file of the run
    #[arg(long, default_value_t = 10.0)]
    max_covariate_age_s: f64,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let steps = steps(arguments)?;
    let outcome = replay(&arguments.bag, &steps)?;
    println!("{} of {} corrected messages are identical to the recorded ones", outcome.identical, outcome.replayed);
    if !arguments.residual.is_empty() {
        println!("{} of them with a residual correction", outcome.with_residual);
    }
    if outcome.is_identical() {
        return Ok(());
    }
    if outcome.replayed == 0 {
        bail!("{}: holds no scale readings", arguments.bag.display());
    }
    let first = outcome.different.iter().chain(&outcome.unrecorded).min();
    let not_given: Vec<&str> = outcome.models_not_given.iter().map(String::as_str).collect();
    let not_given = match not_given.as_slice() {
        [] => String::new(),
        hashes => format!("; samples name models that were not given: {}", hashes.join(", ")),
    };
    bail!(
        "{}: {} differ and {} were not recorded, the first with sequence {}; check that model and launch file are those of the run{not_given}",
        arguments.bag.display(),
        outcome.different.len(),
        outcome.unrecorded.len(),
        first.map_or_else(|| "unknown".to_owned(), u64::to_string)
    )
}

/// A step for each model given; residual models are those of the machine, each with the geometric model it belongs to.
fn steps(arguments: &Arguments) -> anyhow::Result<ReplaySteps> {
    let mut steps = ReplaySteps { geometric: Vec::new(), residual: Vec::new() };
    let mut machine = String::new();
    for path in &arguments.model {
        let (file, sha256) = ModelFile::load(path)?;
        machine.clone_from(&file.model.parts().machine.name);
        let model = Some((Arc::new(file.model), Sha256::from_bytes(sha256)));
        steps.geometric.push(GeometricStep::new(model, arguments.max_covariate_age_s));
    }
    for path in &arguments.residual {
        let (file, owner, sha256) = ResidualFile::load_for(path, &machine)?;
        let field = Arc::new(LoadedResidual::new(file.model, sha256));
        let owned = OwnedField { field, model_sha256: Sha256::from_bytes(owner.model_sha256) };
        steps.residual.push(ResidualStep::new(Some(owned)));
    }
    Ok(steps)
}
