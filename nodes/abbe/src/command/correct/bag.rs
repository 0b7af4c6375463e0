//! A bag with scale readings in, the same bag with corrected coordinates out.
//!
//! Place in the flow: `abbe correct` of a bag. Each reading goes through the steps of the live nodes, and is counted as a row of a table
//! is: what it was worth is told, and an offset of the wrong sign is refused.

use crate::offset_sign::{SIGN_REMEDY, opposite_sign};
use crate::pipeline::check_covariate_age;
use crate::residual::inputs_of;
use crate::tally::Tally;
use abbe_files::ModelFile;
use abbe_geometry::correct::Status;
use abbe_geometry::effects::State;
use abbe_graph::step::{GeometricStep, Mark, OwnedField, ResidualStep, SampleCovariates, StreamWatch};
use abbe_graph::topics;
use abbe_msgs::bag::{BagWriter, messages};
use abbe_msgs::{CorrectionStatus, Message, ScaleReading, Sha256};
use anyhow::ensure;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// What is corrected.
pub(super) struct Bag<'a> {
    pub(super) input: &'a Path,
    /// Age from which a covariate is stale (s).
    pub(super) max_covariate_age_s: f64,
}

/// What a bag came to.
#[derive(Default)]
pub(super) struct Worth {
    /// Readings of this machine in one stream.
    pub(super) tally: Tally,
    /// What is to be said of all others.
    pub(super) beside: Vec<String>,
}

/// Copies a bag and adds a corrected message after each scale reading.
///
/// # Errors
/// A bag that cannot be read, an offset with the sign that no offset of the campaign had, an age that is none.
pub(super) fn correct(
    bag: &Bag,
    (file, sha256): (&ModelFile, [u8; 32]),
    residual: Option<OwnedField>,
    unfinished: &Path,
) -> anyhow::Result<Worth> {
    let (name, max_age_s) = (bag.input.display(), bag.max_covariate_age_s);
    check_covariate_age(max_age_s)?;
    let model = &file.model;
    let mut worth = Worth { tally: Tally::asking(inputs_of(residual.as_ref())), ..Worth::default() };
    let step = GeometricStep::new(Some((Arc::new(model.clone()), Sha256::from_bytes(sha256))), max_age_s);
    let residual = ResidualStep::new(residual, max_age_s);
    let mut writer = BagWriter::create(unfinished)?;
    let mut number = 0_u64;
    let mut watches: BTreeMap<String, StreamWatch> = BTreeMap::new();
    let mut others: BTreeMap<&str, (u64, u64)> = BTreeMap::new();
    for message in messages(bag.input)? {
        let message = message?;
        writer.copy(&message)?;
        if message.ros_type() != ScaleReading::ROS_TYPE {
            continue;
        }
        number += 1;
        let reading: ScaleReading = message.decode()?;
        let topic = message.topic();
        let namespace = topic.strip_suffix(topics::SCALE_READING).unwrap_or("/").to_owned();
        let own = residual.correct(&step.correct(&reading), Some(&reading.covariates));
        let sample = watches.entry(topic.to_owned()).or_default().pass(Mark::from(&reading), own);
        if own.status != CorrectionStatus::OtherFrame
            && let Some((d, problem)) = opposite_sign(&model.parts().identified, reading.offset_m)
        {
            let axis = ["x", "y", "z"][d];
            anyhow::bail!("{name}, reading {number} ({topic}): the offset along {axis}: {problem}; {SIGN_REMEDY}");
        }
        match (status(sample.status), other_words(sample.status)) {
            (Some(status), _) => {
                let covariates = SampleCovariates { table: &reading.covariates, max_age_s };
                let state = State { reading_m: reading.reading_m, offset_m: reading.offset_m, covariates: &covariates };
                worth.tally.add(model, &state, status, number);
            }
            (None, words) => others.entry(words).or_insert((0, number)).0 += 1,
        }
        writer.write(&format!("{namespace}{}", topics::CORRECTED), &sample, message.log_time_ns)?;
    }
    ensure!(number > 0, "{name}: holds no {}; nothing to correct", ScaleReading::ROS_TYPE);
    writer.finish()?;
    let words = |(what, (count, first)): (&str, (u64, u64))| {
        format!("warning: {count} readings {what} (first: reading {first})")
    };
    worth.beside = others.into_iter().map(words).collect();
    Ok(worth)
}

/// The status of a reading that was judged by the model alone.
fn status(status: CorrectionStatus) -> Option<Status> {
    match status {
        CorrectionStatus::InVolume => Some(Status::InVolume),
        CorrectionStatus::Extrapolated => Some(Status::Extrapolated),
        CorrectionStatus::CovariateMissing => Some(Status::CovariateMissing),
        CorrectionStatus::Stale => Some(Status::Stale),
        CorrectionStatus::Rejected => Some(Status::Rejected),
        _ => None,
    }
}

/// What is the matter with all others.
fn other_words(status: CorrectionStatus) -> &'static str {
    match status {
        CorrectionStatus::OtherFrame => "are in another frame than the model's machine, and were not corrected",
        CorrectionStatus::SeveralSources => "come from several sources mixed on one topic, and were not corrected",
        CorrectionStatus::OutOfOrder => "were corrected, with stamps that do not follow those before",
        _ => "were not corrected",
    }
}
