//! Driver: the virtual machine, measuring a campaign of its own.
//!
//! Place in the flow: `kind = "virtual_machine"` in a launch configuration, for trials without hardware. Scale and
//! tracer node with the same seed and the same effects see the same machine. An effect may set in during the run
//! (`from_s`, seconds of the recording).

use super::DriverError;
use super::recorded::Recorded;
use abbe_files::MachineFile;
use abbe_virtual_machine::effects::from_text;
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::instrument::InstrumentConfig;
use abbe_virtual_machine::machine::Roughness;
use abbe_virtual_machine::plan::presets::case_like;
use abbe_virtual_machine::{SimulationConfig, TruthRecipe, simulate_campaign};

/// Volumetric error of the simulated machine (rms, m): that of a bridge CMM before compensation.
const VOLUMETRIC_RMS_M: f64 = 20e-6;

pub(super) fn open(seed: u64, effects: &[String], machine: &MachineFile) -> Result<Recorded, DriverError> {
    let recipe = TruthRecipe { seed, roughness: Roughness::TYPICAL, volumetric_rms_m: VOLUMETRIC_RMS_M };
    let truth = recipe.bridge_xyz()?;
    let plan = case_like(truth.stroke_m, seed).build()?;
    let config = SimulationConfig {
        seed,
        machine: truth,
        plan,
        instrument: InstrumentConfig::LASER_TRACER,
        environment: EnvironmentConfig::workshop(),
        effects: effects.iter().map(|text| from_text(text)).collect::<Result<_, _>>()?,
    };
    Ok(Recorded::new(simulate_campaign(&config)?.campaign, machine))
}
