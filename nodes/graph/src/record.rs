//! A campaign as a bag, without nodes: the same messages that the scale and tracer node would publish.
//!
//! Place in the flow: `abbe convert`, the demo and tests make recordings with it. The log time of a message is its
//! stamp.

use crate::driver::{self, DriverConfig};
use crate::node::NodeError;
use crate::topics;
use abbe_files::MachineFile;
use abbe_msgs::bag::{BagSummary, BagWriter};
use abbe_msgs::{Message, MessageError, ScaleReading, Stamp, TracerReading};
use abbe_runtime::Shutdown;
use std::path::Path;

/// A recording of scale and tracer readings that is being written.
pub struct Tape {
    writer: BagWriter,
    scale_topic: String,
    tracer_topic: String,
    scale_readings: u64,
    tracer_readings: u64,
    latest: Option<Stamp>,
}

impl Tape {
    /// A new bag at `path` with topics in `namespace`.
    pub fn create(path: &Path, namespace: &str) -> Result<Tape, NodeError> {
        let topic = |name: &str| format!("/{}/{name}", namespace.trim_matches('/'));
        Ok(Tape {
            writer: BagWriter::create(path)?,
            scale_topic: topic(topics::SCALE_READING),
            tracer_topic: topic(topics::TRACER_READING),
            scale_readings: 0,
            tracer_readings: 0,
            latest: None,
        })
    }

    /// Adds a scale reading.
    pub fn scale(&mut self, reading: &ScaleReading) -> Result<(), NodeError> {
        self.writer.write(&self.scale_topic, reading, log_time_ns(reading)?)?;
        self.scale_readings += 1;
        self.latest = self.latest.max(Some(reading.stamp));
        Ok(())
    }

    /// Adds a tracer reading.
    pub fn tracer(&mut self, reading: &TracerReading) -> Result<(), NodeError> {
        self.writer.write(&self.tracer_topic, reading, log_time_ns(reading)?)?;
        self.tracer_readings += 1;
        Ok(())
    }

    /// Adds everything a driver gives, scale and tracer readings in turn.
    pub fn play(&mut self, config: &DriverConfig, base: &Path, machine: &MachineFile) -> Result<(), NodeError> {
        let to_its_end = Shutdown::manual();
        let mut scale = driver::open_scale(config, base, machine, &to_its_end, None)?;
        let mut tracer = driver::open_tracer(config, base, machine, &to_its_end, None)?;
        loop {
            let (reading, length) = (scale.next_reading()?, tracer.next_reading()?);
            reading.iter().try_for_each(|reading| self.scale(reading))?;
            length.iter().try_for_each(|length| self.tracer(length))?;
            if reading.is_none() && length.is_none() {
                return Ok(());
            }
        }
    }

    /// Scale and tracer readings so far.
    pub fn counts(&self) -> (u64, u64) {
        (self.scale_readings, self.tracer_readings)
    }

    /// Latest stamp of a scale reading so far.
    pub fn latest(&self) -> Option<Stamp> {
        self.latest
    }

    /// Completes the bag.
    pub fn finish(self) -> Result<BagSummary, NodeError> {
        Ok(self.writer.finish()?)
    }
}

/// Writes what the driver gives to scale and tracer topics in `namespace`.
pub fn write_bag(
    config: &DriverConfig,
    base: &Path,
    machine: &MachineFile,
    namespace: &str,
    out: &Path,
) -> Result<BagSummary, NodeError> {
    let mut tape = Tape::create(out, namespace)?;
    tape.play(config, base, machine)?;
    tape.finish()
}

/// Log time of a recorded message: its stamp, so that a recording says when things were measured.
pub(crate) fn log_time_ns<M: Message>(sample: &M) -> Result<u64, MessageError> {
    let seconds = sample.stamp().to_seconds();
    u64::try_from(sample.stamp().to_nanos()).map_err(|_| MessageError::LogTime { seconds })
}
