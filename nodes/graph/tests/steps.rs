//! Evidence for what the nodes compute: one output a reading, honest statuses, a monitor that notices.

#![allow(clippy::unwrap_used)] // helpers of a test

use abbe_files::{MachineFile, read_machine};
use abbe_geometry::correct::correct;
use abbe_geometry::effects::{NoCovariates, State};
use abbe_geometry::model::MachineModel;
use abbe_graph::step::{GeometricStep, HealthState, MonitorSettings, MonitorStep, ResidualStep};
use abbe_identify::{Options, identify};
use abbe_measurement::campaign::Campaign;
use abbe_msgs::{
    CorrectedCoordinates, CorrectionStatus, RangeResidual, ResidualStatus, ScaleReading, Sha256, Stamp, Text,
    TracerReading,
};
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::instrument::InstrumentConfig;
use abbe_virtual_machine::machine::Roughness;
use abbe_virtual_machine::plan::presets::case_like;
use abbe_virtual_machine::{SimulationConfig, TruthRecipe, simulate_campaign};
use std::path::Path;
use std::sync::{Arc, OnceLock};

struct Bench {
    machine: MachineFile,
    campaign: Campaign,
    model: Arc<MachineModel>,
}

const HASH: Sha256 = Sha256::from_bytes([3; 32]);

/// One simulated machine with its model, shared by all tests.
fn bench() -> &'static Bench {
    static BENCH: OnceLock<Bench> = OnceLock::new();
    BENCH.get_or_init(|| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config/machines/bridge_xyz.toml");
        let machine = read_machine(&path).unwrap();
        let recipe = TruthRecipe { seed: 5, roughness: Roughness::SMOOTH, volumetric_rms_m: 20e-6 };
        let truth = recipe.bridge_xyz().unwrap();
        let plan = case_like(truth.stroke_m, 5).build().unwrap();
        let config = SimulationConfig {
            seed: 5,
            machine: truth,
            plan,
            instrument: InstrumentConfig::LASER_TRACER,
            environment: EnvironmentConfig::workshop(),
            effects: Vec::new(),
        };
        let campaign = simulate_campaign(&config).unwrap().campaign;
        let found =
            identify(&machine.machine, machine.instrument, &campaign, &Options::default(), &mut |_| true).unwrap();
        Bench { machine, campaign, model: Arc::new(found.model) }
    })
}

fn geometric() -> GeometricStep {
    GeometricStep::new(Some((bench().model.clone(), HASH)), 10.0)
}

fn scale(row: usize) -> ScaleReading {
    let reading = &bench().campaign.readings[row];
    ScaleReading {
        stamp: Stamp::from_seconds(reading.time_s).unwrap(),
        sequence: row as u64,
        reading_m: reading.reading_m,
        offset_m: reading.offset_m,
        frame_id: Text::new(&bench().machine.machine.frame_id).unwrap(),
        ..ScaleReading::default()
    }
}

fn tracer(row: usize, error_m: f64) -> TracerReading {
    let reading = &bench().campaign.readings[row];
    TracerReading {
        stamp: Stamp::from_seconds(reading.time_s).unwrap(),
        sequence: row as u64,
        length_m: reading.length_m + error_m,
        u_length_m: bench().machine.instrument.standard_m(1.0),
        frame_id: Text::new(&bench().machine.machine.frame_id).unwrap(),
        station: Text::new(&bench().campaign.stations[reading.station as usize]).unwrap(),
        line: Text::default(),
    }
}

fn monitor() -> MonitorStep {
    let settings = MonitorSettings { single_bound: 4.0, window: 200, match_within_s: 0.0005 };
    MonitorStep::new(bench().model.clone(), HASH, settings)
}

/// Runs rows through correction and monitor; `error_m` is added to the lengths.
fn run(monitor: &mut MonitorStep, rows: std::ops::Range<usize>, error_m: impl Fn(usize) -> f64) -> Vec<RangeResidual> {
    let step = geometric();
    let each = |row: usize| {
        assert!(monitor.corrected(&step.correct(&scale(row))).is_empty());
        monitor.tracer(&tracer(row, error_m(row))).unwrap()
    };
    rows.map(each).collect()
}

#[test]
fn the_node_gives_what_the_correcting_function_gives() {
    for row in (0..bench().campaign.readings.len()).step_by(97) {
        let sample = ResidualStep::default().correct(&geometric().correct(&scale(row)));
        let reading = &bench().campaign.readings[row];
        let state = State { reading_m: reading.reading_m, offset_m: reading.offset_m, covariates: &NoCovariates };
        let expected = correct(&bench().model, &state);
        assert_eq!(sample.corrected_m, <[f64; 3]>::from(expected.position_m));
        assert_eq!(sample.status, CorrectionStatus::InVolume);
        assert_eq!((sample.sequence, sample.stamp), (row as u64, scale(row).stamp));
        assert_eq!(sample.model_sha256, HASH);
        let sum = |d: usize| {
            sample.reading_m[d] + sample.offset_m[d] + sample.geometric_correction_m[d] + sample.effect_correction_m[d]
        };
        assert!((0..3).all(|d| (sum(d) - sample.corrected_m[d]).abs() < 1e-15));
    }
}

#[test]
fn without_a_model_the_sample_says_so_and_repeats_the_indicated_position() {
    let sample = GeometricStep::new(None, 10.0).correct(&scale(0));
    assert_eq!(sample.status, CorrectionStatus::NoModel);
    assert!(!sample.corrected_valid && sample.corrected_point_in_machine_m().is_none());
    assert!(sample.model_sha256.is_none());
}

#[test]
fn extrapolated_and_rejected_readings_are_told_apart() {
    let at = |x_m: f64| {
        let mut reading = scale(0);
        reading.reading_m[0] = x_m;
        geometric().correct(&reading)
    };
    assert_eq!(at(0.4).status, CorrectionStatus::InVolume);
    assert_eq!(at(0.81).status, CorrectionStatus::Extrapolated);
    assert!(at(0.81).corrected_valid);
    for x_m in [5.0, f64::NAN, f64::INFINITY] {
        assert_eq!(at(x_m).status, CorrectionStatus::Rejected, "{x_m}");
        assert!(!at(x_m).corrected_valid);
    }
    let mut far_offset = scale(0);
    far_offset.offset_m[2] = 0.3;
    assert_eq!(geometric().correct(&far_offset).status, CorrectionStatus::Extrapolated);
}

#[test]
fn the_monitor_finds_a_sound_model_consistent() {
    let mut monitor = monitor();
    let residuals = run(&mut monitor, 0..600, |_| 0.0);
    assert_eq!(monitor.health().state, HealthState::Consistent, "{:?}", monitor.health());
    assert!(residuals.iter().all(|r| r.residual_valid));
    let worst = residuals.iter().map(|r| r.residual_m.abs()).fold(0.0, f64::max);
    assert!(worst < 3e-6, "{worst}");
}

#[test]
fn the_monitor_notices_a_machine_that_drifts() {
    let mut monitor = monitor();
    run(&mut monitor, 0..300, |_| 0.0);
    assert_eq!(monitor.health().state, HealthState::Consistent);
    let residuals = run(&mut monitor, 300..600, |row| (row - 300) as f64 * 20e-9);
    assert_eq!(monitor.health().state, HealthState::Degraded, "{:?}", monitor.health());
    assert!(residuals.iter().any(|r| r.status == ResidualStatus::OutOfBounds));
}

#[test]
fn the_order_of_arrival_changes_nothing() {
    let step = geometric();
    let rows = 0..50;
    let mut corrected_first = monitor();
    let expected = run(&mut corrected_first, rows.clone(), |_| 0.0);
    let mut tracer_first = monitor();
    assert!(rows.clone().all(|row| tracer_first.tracer(&tracer(row, 0.0)).is_none()));
    let samples: Vec<CorrectedCoordinates> = rows.map(|row| step.correct(&scale(row))).collect();
    let found: Vec<RangeResidual> = samples.iter().flat_map(|sample| tracer_first.corrected(sample)).collect();
    assert_eq!(found, expected);
}

#[test]
fn what_cannot_be_predicted_is_said_not_guessed() {
    let mut monitor = monitor();
    monitor.corrected(&geometric().correct(&scale(0)));
    let mut stranger = tracer(0, 0.0);
    stranger.station = Text::new("S99").unwrap();
    let residual = monitor.tracer(&stranger).unwrap();
    assert_eq!(residual.status, ResidualStatus::UnknownStation);
    assert!(residual.residual().is_none());
    monitor.corrected(&GeometricStep::new(None, 10.0).correct(&scale(1)));
    assert_eq!(monitor.tracer(&tracer(1, 0.0)).unwrap().status, ResidualStatus::NotCorrected);
    assert_eq!(monitor.health().unpredicted, 2);
    assert_eq!(monitor.health().state, HealthState::Unknown);
}
