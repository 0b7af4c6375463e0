//! A campaign as a bag, without nodes: the same messages that the scale and tracer node would publish.
//!
//! Place in the flow: `abbe convert` and tests make bags of campaigns with it.

use crate::driver::{self, DriverConfig};
use crate::node::NodeError;
use crate::topics;
use abbe_files::MachineFile;
use abbe_msgs::bag::{BagSummary, BagWriter};
use abbe_msgs::{Message, MessageError};
use std::path::Path;

/// Writes what the driver gives to scale and tracer topics in `namespace`.
pub fn write_bag(
    config: &DriverConfig,
    base: &Path,
    machine: &MachineFile,
    namespace: &str,
    out: &Path,
) -> Result<BagSummary, NodeError> {
    let mut scale = driver::open_scale(config, base, machine)?;
    let mut tracer = driver::open_tracer(config, base, machine)?;
    let mut writer = BagWriter::create(out)?;
    let topic = |name: &str| format!("/{}/{name}", namespace.trim_matches('/'));
    let (scale_topic, tracer_topic) = (topic(topics::SCALE_READING), topic(topics::TRACER_READING));
    loop {
        let (reading, length) = (scale.next_reading()?, tracer.next_reading()?);
        if let Some(reading) = &reading {
            writer.write(&scale_topic, reading, log_time_ns(reading)?)?;
        }
        if let Some(length) = &length {
            writer.write(&tracer_topic, length, log_time_ns(length)?)?;
        }
        if reading.is_none() && length.is_none() {
            return Ok(writer.finish()?);
        }
    }
}

/// Log time of a recorded message: its stamp, so that a recording says when things were measured.
pub(crate) fn log_time_ns<M: Message>(sample: &M) -> Result<u64, MessageError> {
    let seconds = sample.stamp().to_seconds();
    u64::try_from(sample.stamp().to_nanos()).map_err(|_| MessageError::StampRange { seconds })
}
