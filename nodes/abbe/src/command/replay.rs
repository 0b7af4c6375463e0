//! `abbe replay`: the scale readings of a recorded run through the same steps, compared byte for byte.
//!
//! Place in the flow: evidence that a correction can be repeated; exit code 1 unless every message was compared and is
//! identical.

use crate::next::{KNOWN_POINTS, Next};
use crate::pipeline::check_covariate_age;
use abbe_files::{LoadedResidual, ModelFile, ResidualFile};
use abbe_graph::replay::{ReplayOutcome, ReplaySteps, TopicOutcome, replay};
use abbe_graph::step::OwnedField;
use abbe_msgs::Sha256;
use anyhow::ensure;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Arguments of `replay`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Recorded bag with scale readings and corrected coordinates; several are replayed one after the other
    #[arg(long, required = true)]
    bag: Vec<PathBuf>,
    /// Model that was used; where it changed during the run, give each of them
    #[arg(long, required = true)]
    model: Vec<PathBuf>,
    /// Residual model that was used; where it changed during the run, give each of them
    #[arg(long)]
    residual: Vec<PathBuf>,
    /// Age in seconds from which a covariate is stale, as in the launch file of the run; where it was set during the run, each that held, in their order
    #[arg(long, default_value = "10")]
    max_covariate_age_s: Vec<f64>,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let steps = steps(arguments)?;
    let mut faults = Vec::new();
    for bag in &arguments.bag {
        let outcome = replay(bag, &steps)?;
        if arguments.bag.len() > 1 {
            println!("{}", bag.display());
        }
        outcome.topics.iter().for_each(|topic| tell(topic, !arguments.residual.is_empty()));
        for hash in &outcome.models_not_named {
            println!("no message names the given model {hash}");
        }
        faults.extend(faults_of(bag, &outcome, &arguments.max_covariate_age_s));
    }
    ensure!(faults.is_empty(), "{}", faults.join("\n"));
    next(arguments).print();
    Ok(())
}

/// The same again may be wrong again: what the models are worth, the last of them where there are several.
fn next(arguments: &Arguments) -> Next {
    let next = Next::new("to see what these coordinates are worth", "verify");
    let next = arguments.model.last().into_iter().fold(next, |next, model| next.file("--model", model));
    let residual = match (arguments.model.as_slice(), arguments.residual.as_slice()) {
        ([_], [residual]) => Some(residual),
        // Which of them belongs to that model is not known here.
        _ => None,
    };
    residual.into_iter().fold(next, |next, residual| next.file("--residual", residual)).text(KNOWN_POINTS)
}

fn tell(topic: &TopicOutcome, residual: bool) {
    let TopicOutcome { topic: name, recorded, identical, with_residual, .. } = topic;
    let TopicOutcome { restarts, corrector_restarts, changes_of_age, .. } = topic;
    println!("{name}: {identical} of {recorded} corrected messages are identical to the recorded ones");
    if residual {
        println!("  {with_residual} of them with a residual correction");
    }
    if *restarts > 0 {
        println!("  the source of the readings began anew {restarts} times in the recording");
    }
    if *corrector_restarts > 0 {
        println!("  the node that corrected them was started again {corrector_restarts} times");
    }
    if *changes_of_age > 0 {
        println!("  the age from which a covariate is stale changed {changes_of_age} times");
    }
}

/// What keeps a bag from being the same again, in words.
fn faults_of(bag: &Path, outcome: &ReplayOutcome, max_covariate_ages_s: &[f64]) -> Vec<String> {
    let bag = bag.display();
    let mut faults: Vec<String> = Vec::new();
    if let Some(damage) = &outcome.damage {
        faults.push(format!("compared only as far as the bag can be read: {damage}"));
    }
    if outcome.topics.is_empty() {
        faults.push(format!("{bag}: holds no scale readings and no corrected messages, so nothing was compared"));
    }
    faults.extend(outcome.topics.iter().filter(|topic| !topic.is_identical()).map(|topic| {
        let counts = [
            (topic.different, "differ"),
            (topic.not_comparable, "cannot be compared, because their model was not given"),
            (topic.missing, "scale readings have no corrected message (lost, or not recorded)"),
            (topic.repeated, "repeat an earlier message"),
            (topic.additional, "have no scale reading (lost, or not recorded)"),
            (topic.reordered, "are out of order"),
        ];
        let counts = counts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
        let counts: Vec<String> = counts.collect();
        let counts = if counts.is_empty() { "holds no messages".to_owned() } else { counts.join(", ") };
        let first = topic.first_fault.map_or_else(String::new, |first| format!(", the first with sequence {first}"));
        format!("{bag}: {}: {counts}{first}", topic.topic)
    }));
    if !outcome.models_not_given.is_empty() {
        let hashes: Vec<&str> = outcome.models_not_given.iter().map(String::as_str).collect();
        faults
            .push(format!("{bag}: messages name models that were not given: {}; give each of them", hashes.join(", ")));
    }
    if outcome.topics.iter().any(|topic| topic.different > 0) {
        let ages: Vec<String> = max_covariate_ages_s.iter().map(f64::to_string).collect();
        let ages = ages.join(", ");
        faults.push(format!(
            "{bag}: check that the model is that of the run, that --max-covariate-age-s ({ages} here) is max_covariate_age_s of \
             its launch file, then each that was set during the run, and that the bag is as it was recorded: sorted by stamp, or merged, a temperature comes before a reading that was \
             corrected without it"
        ));
    }
    faults
}

/// Steps for the models given; residual models are those of the machine, each with the geometric model it belongs to.
fn steps(arguments: &Arguments) -> anyhow::Result<ReplaySteps> {
    arguments.max_covariate_age_s.iter().try_for_each(|age_s| check_covariate_age(*age_s))?;
    let (mut models, mut fields, mut machine) = (Vec::new(), Vec::new(), String::new());
    for path in &arguments.model {
        let (file, sha256) = ModelFile::load(path)?;
        machine.clone_from(&file.model.parts().machine.name);
        models.push((Arc::new(file.model), Sha256::from_bytes(sha256)));
    }
    for path in &arguments.residual {
        let (file, owner, sha256) = ResidualFile::load_for(path, &machine)?;
        let field = Arc::new(LoadedResidual::new(file.model, sha256));
        fields.push(OwnedField { field, model_sha256: Sha256::from_bytes(owner.model_sha256) });
    }
    Ok(ReplaySteps::new(&models, &fields, &arguments.max_covariate_age_s))
}
