//! Driver: a recorded campaign as CSV.
//!
//! Place in the flow: `kind = "campaign"` in a launch configuration; scale and tracer node read the same file.

use super::DriverError;
use super::recorded::Recorded;
use abbe_files::{MachineFile, read_campaign_file};
use std::path::Path;

pub(super) fn open(path: &Path, machine: &MachineFile) -> Result<Recorded, DriverError> {
    let file = read_campaign_file(path, machine.machine.default_offset_m)?;
    Ok(Recorded::new(file.campaign, machine))
}
