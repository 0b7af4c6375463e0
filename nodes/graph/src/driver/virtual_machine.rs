//! Driver: the virtual machine, measuring a campaign of its own.
//!
//! Place in the flow: `kind = "virtual_machine"` in a launch configuration, for trials without hardware. Scale and
//! tracer node with the same seed and the same effects see the same machine. An effect may set in during the run
//! (`from_s`, seconds of the recording).

use super::DriverError;
use super::recorded::Recorded;
use abbe_files::MachineFile;
use abbe_geometry::effects::TIME;
use abbe_virtual_machine::effects::from_text;
use abbe_virtual_machine::{Declared, VOLUMETRIC_RMS_M, shipped_bridge, simulate, simulate_campaign};

pub(super) use abbe_virtual_machine::SimulationError;

/// Names of the covariates that its readings hold.
pub(super) fn covariate_names() -> Vec<String> {
    simulate::covariate_names().chain([TIME]).map(str::to_owned).collect()
}

pub(super) fn open(seed: u64, effects: &[String], machine: &MachineFile) -> Result<Recorded, DriverError> {
    let declared = Declared {
        stroke_m: machine.machine.stroke_m,
        repeatability_m: machine.machine.repeatability_m,
        range: machine.instrument,
    };
    let mut config = shipped_bridge(seed, VOLUMETRIC_RMS_M, &declared)?;
    config.effects = effects.iter().map(|text| from_text(text)).collect::<Result<_, _>>()?;
    Ok(Recorded::new(simulate_campaign(&config)?.campaign, machine))
}
