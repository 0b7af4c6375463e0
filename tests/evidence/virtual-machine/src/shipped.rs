//! The virtual machine that ships: a bridge XYZ CMM, measured by a plan like the recorded ones.
//!
//! Place in the flow: what `abbe simulate` writes to files and what the driver of the live nodes plays, so that a model
//! identified from the one corrects the other. SI.

use crate::environment::EnvironmentConfig;
use crate::error::SimulationError;
use crate::instrument::InstrumentConfig;
use crate::machine::{Roughness, TruthRecipe};
use crate::plan::presets::case_like;
use crate::simulate::SimulationConfig;
use abbe_measurement::instrument::RangeUncertainty;

/// Volumetric error before compensation where nobody says else (rms, m): that of a bridge CMM.
pub const VOLUMETRIC_RMS_M: f64 = 20e-6;

/// What a machine file says that the simulation keeps to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Declared {
    /// Strokes (m); those of the simulated bridge, or the file is of another machine.
    pub stroke_m: [(f64, f64); 3],
    /// Where each axis stops for one and the same reading: standard deviation (m).
    pub repeatability_m: [f64; 3],
    /// The tracer's ranges.
    pub range: RangeUncertainty,
}

/// Machine, plan, instrument and environment of this seed, without effects.
///
/// # Errors
/// For a machine of other strokes, or sizes that cannot be simulated.
pub fn shipped_bridge(
    seed: u64,
    volumetric_rms_m: f64,
    declared: &Declared,
) -> Result<SimulationConfig, SimulationError> {
    let mut truth = TruthRecipe { seed, roughness: Roughness::TYPICAL, volumetric_rms_m }.bridge_xyz()?;
    for (axis, (simulated, (lower_m, upper_m))) in truth.stroke_m.iter().zip(declared.stroke_m).enumerate() {
        if *simulated != [lower_m, upper_m] {
            let [low_mm, high_mm] = simulated.map(|end_m| end_m * 1e3);
            return Err(SimulationError::new(
                format!("stroke of {}", ["X", "Y", "Z"][axis]),
                format!(
                    "{} to {} mm is not that of the simulated bridge, {low_mm} to {high_mm} mm",
                    lower_m * 1e3,
                    upper_m * 1e3
                ),
                "give launch-config/machines/bridge_xyz.toml",
            ));
        }
    }
    let plan = case_like(truth.stroke_m, seed).build()?;
    // In the frame that identification chooses, so that truth and model can be compared point by point.
    truth.ram_turn.about_m = plan.mean_offset_m();
    let instrument = InstrumentConfig {
        range: declared.range,
        repeatability_m: declared.repeatability_m,
        ..InstrumentConfig::LASER_TRACER
    };
    Ok(SimulationConfig {
        seed,
        machine: truth,
        plan,
        instrument,
        environment: EnvironmentConfig::workshop(),
        effects: Vec::new(),
    })
}
