//! Replay of a recorded run: do the same scale readings give the same corrected messages, byte for byte?
//!
//! Place in the flow: `abbe replay` runs every recorded scale reading through the steps of the nodes and compares
//! the CDR bytes with those recorded. No clock, no transport.

use crate::step::{GeometricStep, ResidualStep};
use crate::topics;
use abbe_msgs::bag::{BagError, messages};
use abbe_msgs::cdr::{self, CdrError};
use abbe_msgs::{CorrectedCoordinates, Message, ScaleReading};
use std::collections::BTreeMap;
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

/// Outcome of a replay.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReplayOutcome {
    /// Scale readings replayed.
    pub replayed: usize,
    /// Corrected messages that came out byte by byte as recorded.
    pub identical: usize,
    /// Sequences whose corrected message differs from the recorded one.
    pub different: Vec<u64>,
    /// Sequences of scale readings without a recorded corrected message.
    pub unrecorded: Vec<u64>,
}

impl ReplayOutcome {
    /// Whether everything came out as recorded.
    pub fn is_identical(&self) -> bool {
        self.replayed > 0 && self.identical == self.replayed
    }
}

/// Runs the scale readings of a bag through the steps and compares with what was recorded.
pub fn replay(bag: &Path, geometric: &GeometricStep, residual: &ResidualStep) -> Result<ReplayOutcome, ReplayError> {
    let mut recorded: BTreeMap<u64, Vec<u8>> = BTreeMap::new();
    let mut computed: BTreeMap<u64, Vec<u8>> = BTreeMap::new();
    let corrected_suffix = format!("/{}", topics::CORRECTED);
    let geometric_suffix = format!("/{}", topics::GEOMETRIC);
    for message in messages(bag)? {
        let message = message?;
        if message.ros_type() == ScaleReading::ROS_TYPE {
            let reading: ScaleReading = message.decode()?;
            let corrected = residual.correct(&geometric.correct(&reading));
            computed.insert(reading.sequence, cdr::encode(&corrected.to_ros())?);
        } else if message.ros_type() == CorrectedCoordinates::ROS_TYPE
            && message.topic().ends_with(&corrected_suffix)
            && !message.topic().ends_with(&geometric_suffix)
        {
            let sample: CorrectedCoordinates = message.decode()?;
            recorded.insert(sample.sequence, message.cdr.clone());
        }
    }
    let mut outcome = ReplayOutcome { replayed: computed.len(), ..ReplayOutcome::default() };
    for (sequence, bytes) in &computed {
        match recorded.get(sequence) {
            Some(before) if before == bytes => outcome.identical += 1,
            Some(_) => outcome.different.push(*sequence),
            None => outcome.unrecorded.push(*sequence),
        }
    }
    Ok(outcome)
}
