//! Replay of a recorded run: do the same scale readings give the same corrected messages, byte for byte?
//!
//! Place in the flow: `abbe replay` runs every recorded scale reading through the steps of the nodes and compares
//! the CDR bytes with those recorded. A recorded sample names the models that made it, so a run in which models changed
//! is replayed with each of them. No clock, no transport.

use crate::step::{GeometricStep, ResidualStep};
use crate::topics;
use abbe_msgs::bag::{BagError, messages};
use abbe_msgs::cdr::{self, CdrError};
use abbe_msgs::{CorrectedCoordinates, Message, ScaleReading, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use thiserror::Error;

/// Why a recording cannot be replayed.
#[derive(Debug, Error)]
pub enum ReplayError {
    /// The bag cannot be read.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// A corrected sample cannot be encoded.
    #[error(transparent)]
    Encode(#[from] CdrError),
}

/// The models of a run.
pub struct ReplaySteps {
    /// One step for each geometric model.
    pub geometric: Vec<GeometricStep>,
    /// One step for each residual model.
    pub residual: Vec<ResidualStep>,
}

impl ReplaySteps {
    /// What the steps make of a reading whose recorded sample names these models; a model that was not given is taken
    /// for the first one, so that the difference shows.
    fn correct(&self, reading: &ScaleReading, recorded: Option<&Recorded>) -> Option<CorrectedCoordinates> {
        let named = recorded.map_or(Sha256::NONE, |r| r.model_sha256);
        let geometric = self.geometric.iter().find(|step| step.model_sha256() == named).or(self.geometric.first())?;
        let sample = geometric.correct(reading);
        let named = recorded.map_or(Sha256::NONE, |r| r.residual_model_sha256);
        let residual = self.residual.iter().find(|step| !named.is_none() && step.residual_sha256() == named);
        Some(residual.map_or(sample, |step| step.correct(&sample)))
    }

    fn lacks(&self, recorded: &Recorded) -> impl Iterator<Item = Sha256> {
        let known = |hash: Sha256| {
            hash.is_none()
                || self.geometric.iter().any(|step| step.model_sha256() == hash)
                || self.residual.iter().any(|step| step.residual_sha256() == hash)
        };
        let hashes = [recorded.model_sha256, recorded.residual_model_sha256];
        hashes.map(|hash| (!known(hash)).then_some(hash)).into_iter().flatten()
    }
}

/// A recorded corrected message: the models it names, and its bytes.
struct Recorded {
    model_sha256: Sha256,
    residual_model_sha256: Sha256,
    cdr: Vec<u8>,
}

/// Outcome of a replay.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReplayOutcome {
    /// Scale readings replayed.
    pub replayed: usize,
    /// Corrected messages that came out byte by byte as recorded.
    pub identical: usize,
    /// Those of them that hold a residual correction.
    pub with_residual: usize,
    /// Sequences whose corrected message differs from the recorded one.
    pub different: Vec<u64>,
    /// Sequences of scale readings without a recorded corrected message.
    pub unrecorded: Vec<u64>,
    /// Hashes that recorded messages name and that belong to no model given.
    pub models_not_given: BTreeSet<String>,
}

impl ReplayOutcome {
    /// Whether everything came out as recorded.
    pub fn is_identical(&self) -> bool {
        self.replayed > 0 && self.identical == self.replayed
    }
}

/// Runs the scale readings of a bag through the steps and compares with what was recorded.
///
/// # Errors
/// A bag that cannot be read, a sample that cannot be encoded.
pub fn replay(bag: &Path, steps: &ReplaySteps) -> Result<ReplayOutcome, ReplayError> {
    let recorded = recorded(bag)?;
    let mut outcome = ReplayOutcome::default();
    for named in recorded.values() {
        outcome.models_not_given.extend(steps.lacks(named).map(|sha256| sha256.to_hex()));
    }
    let mut computed: BTreeMap<u64, Vec<u8>> = BTreeMap::new();
    for message in messages(bag)? {
        let message = message?;
        if message.ros_type() == ScaleReading::ROS_TYPE {
            let reading: ScaleReading = message.decode()?;
            if let Some(corrected) = steps.correct(&reading, recorded.get(&reading.sequence)) {
                computed.insert(reading.sequence, cdr::encode(&corrected.to_ros())?);
            }
        }
    }
    outcome.replayed = computed.len();
    for (sequence, bytes) in &computed {
        match recorded.get(sequence) {
            Some(before) if before.cdr == *bytes => {
                outcome.identical += 1;
                outcome.with_residual += usize::from(!before.residual_model_sha256.is_none());
            }
            Some(_) => outcome.different.push(*sequence),
            None => outcome.unrecorded.push(*sequence),
        }
    }
    Ok(outcome)
}

/// The corrected messages of a bag by their sequence.
fn recorded(bag: &Path) -> Result<BTreeMap<u64, Recorded>, ReplayError> {
    let corrected_suffix = format!("/{}", topics::CORRECTED);
    let geometric_suffix = format!("/{}", topics::GEOMETRIC);
    let mut recorded = BTreeMap::new();
    for message in messages(bag)? {
        let message = message?;
        if message.ros_type() == CorrectedCoordinates::ROS_TYPE
            && message.topic().ends_with(&corrected_suffix)
            && !message.topic().ends_with(&geometric_suffix)
        {
            let sample: CorrectedCoordinates = message.decode()?;
            let CorrectedCoordinates { model_sha256, residual_model_sha256, .. } = sample;
            recorded
                .insert(sample.sequence, Recorded { model_sha256, residual_model_sha256, cdr: message.cdr.clone() });
        }
    }
    Ok(recorded)
}
