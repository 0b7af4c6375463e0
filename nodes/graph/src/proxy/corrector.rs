//! The correcting function of the live nodes, for positions that pass a proxy.
//!
//! Place in the flow: [`abbe_ippdme::relay`] asks it for each position. What it is asked for is made a scale reading, goes
//! through [`GeometricStep`] and [`ResidualStep`], and is recorded with what came out. The stamp is the instant at which the line
//! arrived. Metres, machine frame.

use super::ProxyError;
use crate::connecting::stamp_of;
use crate::launch::RecordConfig;
use crate::node::recorder::Tape;
use crate::node::recording::Recording;
use crate::step::{GeometricStep, OwnedField, ResidualStep, opposite_offset};
use crate::topics;
use abbe_geometry::model::{IdentifiedVolume, MachineModel};
use abbe_ippdme::relay::{Correct, Purpose};
use abbe_msgs::types::NAME_CAPACITY;
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, Covariates, ScaleReading, Sha256, Stamp, Text};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::SystemTime;

/// Corrects positions, counts and records them.
pub struct Corrector {
    geometric: GeometricStep,
    residual: ResidualStep,
    identified: IdentifiedVolume,
    frame_id: Text<NAME_CAPACITY>,
    /// Whether effects may be left out whose covariates nobody tells.
    goes_without_covariates: bool,
    stamp: Result<Stamp, String>,
    sequence: u64,
    by_status: BTreeMap<CorrectionStatus, u64>,
    last_status: CorrectionStatus,
    tape: Option<Tape>,
    /// What was reported, and is neither told nor recorded yet.
    waiting: Vec<(ScaleReading, CorrectedCoordinates)>,
    scale_topic: Arc<str>,
    corrected_topic: Arc<str>,
}

impl Corrector {
    /// Of a model, with what belongs to it.
    pub fn new(
        model: Arc<MachineModel>,
        sha256: Sha256,
        residual: Option<OwnedField>,
        goes_without_covariates: bool,
    ) -> Result<Corrector, String> {
        let machine = &model.parts().machine;
        let frame_id = Text::new(&machine.frame_id).map_err(|error| format!("frame_id: {error}"))?;
        let topic = |name: &str| -> Arc<str> { format!("/{}/{name}", machine.name.trim_matches('/')).into() };
        Ok(Corrector {
            identified: model.parts().identified.clone(),
            frame_id,
            goes_without_covariates,
            stamp: stamp_of(SystemTime::now()),
            sequence: 0,
            by_status: BTreeMap::new(),
            last_status: CorrectionStatus::InVolume,
            tape: None,
            waiting: Vec::new(),
            scale_topic: topic(topics::SCALE_READING),
            corrected_topic: topic(topics::CORRECTED),
            // No covariate passes, so that none can be stale.
            geometric: GeometricStep::new(Some((model, sha256)), f64::MAX),
            residual: ResidualStep::new(residual, f64::MAX),
        })
    }

    /// Records from now on into a bag in this folder, by the recorder's own writer.
    pub fn record(&mut self, folder: &Path) -> Result<(), ProxyError> {
        let recording = Recording::start(folder, &RecordConfig::new(folder))?.map_err(ProxyError::Thread)?;
        self.tape = Some(Tape { recording, refused: 0 });
        Ok(())
    }

    /// Lines have arrived.
    pub(super) fn arrived(&mut self) {
        self.stamp = stamp_of(SystemTime::now());
    }

    /// Corrected positions by what they are worth.
    pub(super) fn by_status(&self) -> BTreeMap<String, u64> {
        self.by_status.iter().map(|(status, count)| (format!("{status:?}"), *count)).collect()
    }

    /// Completes the bag; gives how many messages are in it, and how many are not.
    pub(super) fn finish(&mut self) -> Result<(u64, u64), ProxyError> {
        self.sent();
        let Some(Tape { recording, refused }) = self.tape.take() else { return Ok((0, 0)) };
        let status = recording.finish()?;
        if let Some(why) = &status.stopped {
            tracing::warn!("recording has stopped: {why}");
        }
        Ok((status.recorded, status.unrecorded + refused))
    }

    fn sample(
        &self,
        indicated_m: [f64; 3],
        offset_m: [f64; 3],
    ) -> Result<(ScaleReading, CorrectedCoordinates), String> {
        let reading = ScaleReading {
            stamp: self.stamp.clone()?,
            sequence: self.sequence,
            reading_m: std::array::from_fn(|d| indicated_m[d] - offset_m[d]),
            offset_m,
            covariates: Covariates::new(),
            frame_id: self.frame_id,
        };
        Ok((reading, self.residual.correct(&self.geometric.correct(&reading), None)))
    }

    /// Why a sample may not leave; `None` where it may.
    fn refusal(&self, sample: &CorrectedCoordinates) -> Option<String> {
        if let Some(axis) = opposite_offset(&self.identified, sample.offset_m) {
            let axis = ["X", "Y", "Z"][axis];
            return Some(format!("the offset of the tip along {axis} has the opposite sign of every identified one"));
        }
        match sample.status {
            CorrectionStatus::CovariateMissing | CorrectionStatus::Stale if !self.goes_without_covariates => {
                Some("the model needs temperatures or the like, which do not pass here".to_owned())
            }
            _ if sample.corrected_valid => None,
            CorrectionStatus::Rejected => {
                Some("the position is implausible for this machine, its tool or its model".to_owned())
            }
            status => Some(format!("{status:?}")),
        }
    }

    /// Positions have left: tells what there is to tell of them, and records them. Both come after sending, since words wait for
    /// whoever reads them, and a record wakes the thread of the disk, which takes the processor where that is scarce.
    pub(super) fn sent(&mut self) {
        for (reading, sample) in self.waiting.drain(..) {
            if std::mem::replace(&mut self.last_status, sample.status) != sample.status
                && sample.status == CorrectionStatus::Extrapolated
            {
                let mm = sample.corrected_m.map(|m| m * 1e3);
                tracing::warn!(
                    "positions from {:.3}, {:.3}, {:.3} mm on lie outside what the model was identified from; they are corrected, \
                     and their uncertainty is not known",
                    mm[0],
                    mm[1],
                    mm[2]
                );
            }
            if let Some(tape) = &mut self.tape {
                tape.record(&self.scale_topic, &reading);
                tape.record(&self.corrected_topic, &sample);
            }
        }
    }
}

impl Correct for Corrector {
    fn corrected_m(&mut self, indicated_m: [f64; 3], offset_m: [f64; 3], purpose: Purpose) -> Result<[f64; 3], String> {
        let (reading, sample) = self.sample(indicated_m, offset_m)?;
        let outcome = self.refusal(&sample).map_or(Ok(sample.corrected_m), Err);
        if purpose == Purpose::Report {
            self.sequence += 1;
            *self.by_status.entry(sample.status).or_default() += 1;
            self.waiting.push((reading, sample));
        }
        outcome
    }
}
