//! Evidence for what the nodes compute: one output a reading, honest statuses, a monitor that notices.

#![allow(clippy::unwrap_used)] // helpers of a test

mod common;

use abbe_geometry::Vector3;
use abbe_geometry::correct::correct;
use abbe_geometry::effects::{NoCovariates, State};
use abbe_graph::step::{GeometricStep, HealthState, MonitorStep, ResidualStep};
use abbe_msgs::{
    CorrectedCoordinates, CorrectionStatus, RangeResidual, ResidualStatus, ScaleReading, Sha256, Text, TracerReading,
};
use common::{HASH, bench, monitor, other_bench};

const OTHER_HASH: Sha256 = Sha256::from_bytes([4; 32]);

fn geometric() -> GeometricStep {
    GeometricStep::new(Some((bench().model.clone(), HASH)), 10.0)
}

fn scale(row: usize) -> ScaleReading {
    bench().scale(row)
}

fn tracer(row: usize, error_m: f64) -> TracerReading {
    bench().tracer(row, error_m)
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
fn the_monitor_allows_for_what_a_residual_field_leaves_open() {
    let judged = |sample: &CorrectedCoordinates| {
        let mut monitor = monitor();
        monitor.corrected(sample);
        monitor.tracer(&tracer(0, 0.0)).unwrap()
    };
    let sample = geometric().correct(&scale(0));
    let added_m2 = Vector3::new(1e-12, 4e-12, 9e-12);
    let mut widened = sample;
    (0..3).for_each(|axis| widened.covariance_m2[4 * axis] += added_m2[axis]);
    let (plain, widened) = (judged(&sample), judged(&widened));
    let (_, station) = bench().model.station(plain.station.as_str()).unwrap();
    let direction = (Vector3::from(sample.corrected_m) - station.position_m).normalize();
    let expected_m = (plain.u_residual_m.powi(2) + direction.component_mul(&direction).dot(&added_m2)).sqrt();
    assert!((widened.u_residual_m / expected_m - 1.0).abs() < 1e-9, "{} {expected_m}", widened.u_residual_m);
    assert!(widened.u_residual_m > 2.0 * plain.u_residual_m);
    assert_eq!(widened.residual_m, plain.residual_m);
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

/// The machine of the other bench, corrected by its own model.
fn other_sample(row: usize) -> CorrectedCoordinates {
    GeometricStep::new(Some((other_bench().model.clone(), OTHER_HASH)), 10.0).correct(&other_bench().scale(row))
}

#[test]
fn each_sample_is_judged_by_the_model_that_it_names() {
    let mut monitor = monitor();
    run(&mut monitor, 0..250, |_| 0.0);
    assert!(monitor.learn(other_bench().model.clone(), OTHER_HASH).is_empty());
    assert_eq!(monitor.health().model_sha256, HASH, "known, but nothing is corrected by it yet");
    // Two late readings of samples made by the first model.
    let late = [geometric().correct(&scale(250)), geometric().correct(&scale(251))];
    late.iter().for_each(|sample| assert!(monitor.corrected(sample).is_empty()));
    for row in 400..650 {
        monitor.corrected(&other_sample(row));
        let residual = monitor.tracer(&other_bench().tracer(row, 0.0)).unwrap();
        assert_eq!((residual.model_sha256, residual.status), (OTHER_HASH, ResidualStatus::Consistent), "{residual:?}");
    }
    let in_use = monitor.health();
    assert_eq!((in_use.state, in_use.model_sha256), (HealthState::Consistent, OTHER_HASH));
    for row in [250, 251] {
        let residual = monitor.tracer(&tracer(row, 0.0)).unwrap();
        assert_eq!((residual.model_sha256, residual.status), (HASH, ResidualStatus::Consistent), "{residual:?}");
    }
    assert_eq!(monitor.health(), in_use, "late samples of the model before say nothing about the one in use");
}

#[test]
fn the_verdict_begins_anew_with_a_new_model() {
    let mut monitor = monitor();
    run(&mut monitor, 0..300, |_| 5e-6);
    assert_eq!(monitor.health().state, HealthState::Degraded);
    monitor.learn(other_bench().model.clone(), OTHER_HASH);
    monitor.corrected(&other_sample(400));
    let health = monitor.health();
    assert_eq!((health.state, health.residuals, health.unsound), (HealthState::Unknown, 0, None));
    let residual = monitor.tracer(&other_bench().tracer(400, 0.0)).unwrap();
    assert_eq!(monitor.health().unsound.unwrap().since, residual.stamp, "not yet shown to be sound");
}

#[test]
fn a_sample_waits_for_the_model_it_names_and_is_told_when_that_never_comes() {
    let pair = |monitor: &mut MonitorStep, row: usize| {
        monitor.corrected(&other_sample(row));
        monitor.tracer(&other_bench().tracer(row, 0.0))
    };
    let mut early = monitor();
    assert!((0..20).all(|row| pair(&mut early, row).is_none()));
    assert_eq!(early.awaited_model(), Some(OTHER_HASH));
    let residuals = early.learn(other_bench().model.clone(), OTHER_HASH);
    assert_eq!(residuals.iter().map(|r| r.sequence).collect::<Vec<_>>(), (0..20).collect::<Vec<_>>());
    assert!(residuals.iter().all(|r| r.status == ResidualStatus::Consistent));
    assert_eq!((early.awaited_model(), early.health().residuals), (None, 20));
    let mut never = monitor();
    assert!((0..20).all(|row| pair(&mut never, row).is_none()));
    let residuals = never.give_up();
    assert!(residuals.iter().all(|r| r.status == ResidualStatus::NotCorrected && !r.residual_valid));
    assert_eq!((residuals.len(), never.health().unpredicted, never.health().residuals), (20, 20, 0));
}
