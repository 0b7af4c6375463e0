//! A simulated machine with its identified model, and the samples of its campaign; shared by the tests of the steps.

#![allow(clippy::unwrap_used)] // helpers of a test
#![allow(dead_code)] // Each test takes what it needs.

use abbe_files::{MachineFile, ModelFile, read_machine};
use abbe_geometry::model::MachineModel;
use abbe_graph::step::{MonitorSettings, MonitorStep};
use abbe_identify::{IdentifyOptions, identify};
use abbe_measurement::campaign::Campaign;
use abbe_msgs::{ScaleReading, Sha256, Stamp, Text, TracerReading};
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::instrument::InstrumentConfig;
use abbe_virtual_machine::machine::Roughness;
use abbe_virtual_machine::plan::presets::case_like;
use abbe_virtual_machine::{SimulationConfig, TruthRecipe, simulate_campaign};
use std::path::Path;
use std::sync::{Arc, OnceLock};

pub(crate) struct Bench {
    pub(crate) machine: MachineFile,
    pub(crate) campaign: Campaign,
    pub(crate) model: Arc<MachineModel>,
}

pub(crate) const HASH: Sha256 = Sha256::from_bytes([3; 32]);

/// One simulated machine with its model, shared by the tests of a file.
pub(crate) fn bench() -> &'static Bench {
    static BENCH: OnceLock<Bench> = OnceLock::new();
    BENCH.get_or_init(|| measured(5))
}

/// The same machine as measured in another year: other errors, other stations.
pub(crate) fn other_bench() -> &'static Bench {
    static BENCH: OnceLock<Bench> = OnceLock::new();
    BENCH.get_or_init(|| measured(6))
}

fn measured(seed: u64) -> Bench {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config/machines/bridge_xyz.toml");
    let machine = read_machine(&path).unwrap();
    let recipe = TruthRecipe { seed, roughness: Roughness::SMOOTH, volumetric_rms_m: 20e-6 };
    let truth = recipe.bridge_xyz().unwrap();
    let plan = case_like(truth.stroke_m, seed).build().unwrap();
    let config = SimulationConfig {
        seed,
        machine: truth,
        plan,
        instrument: InstrumentConfig::LASER_TRACER,
        environment: EnvironmentConfig::workshop(),
        effects: Vec::new(),
    };
    let campaign = simulate_campaign(&config).unwrap().campaign;
    let found =
        identify(&machine.machine, machine.instrument, &campaign, &IdentifyOptions::default(), &mut |_| true).unwrap();
    Bench { machine, campaign, model: Arc::new(found.model) }
}

impl Bench {
    /// The model as a file; `machine` is the name it says it is of.
    pub(crate) fn model_file(&self, machine: &str) -> ModelFile {
        let mut parts = self.model.parts().clone();
        parts.machine.name = machine.into();
        ModelFile {
            model: MachineModel::new(parts).unwrap(),
            order: self.machine.order,
            instrument: self.machine.instrument,
            absolute_range: self.machine.absolute_range,
            residual_network: None,
            data: Vec::new(),
            seed: None,
            options: Default::default(),
            evidence: Default::default(),
            doubts: Vec::new(),
            software: "test".to_owned(),
        }
    }

    /// The scale reading of a row of the campaign.
    pub(crate) fn scale(&self, row: usize) -> ScaleReading {
        let reading = &self.campaign.readings[row];
        ScaleReading {
            stamp: Stamp::from_seconds(reading.time_s).unwrap(),
            sequence: row as u64,
            reading_m: reading.reading_m,
            offset_m: reading.offset_m,
            frame_id: Text::new(&self.machine.machine.frame_id).unwrap(),
            ..ScaleReading::default()
        }
    }

    /// Standard uncertainty of the length of a row (m, k = 1) at the distance of its reflector.
    pub(crate) fn u_length_m(&self, row: usize) -> f64 {
        let reading = &self.campaign.readings[row];
        let (_, station) = self.model.station(&self.campaign.stations[reading.station as usize]).unwrap();
        self.machine.instrument.standard_m(reading.length_m + station.dead_path_m)
    }

    /// The tracer reading of a row, with an error added.
    pub(crate) fn tracer(&self, row: usize, error_m: f64) -> TracerReading {
        let reading = &self.campaign.readings[row];
        TracerReading {
            stamp: Stamp::from_seconds(reading.time_s).unwrap(),
            sequence: row as u64,
            length_m: reading.length_m + error_m,
            u_length_m: self.machine.instrument.standard_m(1.0),
            frame_id: Text::new(&self.machine.machine.frame_id).unwrap(),
            station: Text::new(&self.campaign.stations[reading.station as usize]).unwrap(),
            line: Text::default(),
        }
    }
}

pub(crate) fn monitor() -> MonitorStep {
    let settings = MonitorSettings { single_bound: 4.0, window: 200, match_within_s: 0.0005 };
    MonitorStep::new(bench().model.clone(), HASH, settings)
}

/// The file's next version, whole at once: who looks at it meanwhile finds the old one or this one, never a part.
pub(crate) fn replace(path: &Path, content: &[u8]) {
    let new = path.with_extension("new");
    std::fs::write(&new, content).unwrap();
    std::fs::rename(&new, path).unwrap();
}
