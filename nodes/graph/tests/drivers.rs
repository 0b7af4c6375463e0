//! Evidence for what recorded campaigns say of their uncertainty: that of the reflector's distance, so that a monitor on a
//! sound machine sees a mean square of one.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

mod common;

use abbe_files::write_campaign;
use abbe_geometry::chain::nominal_point_m;
use abbe_graph::driver::{DriverConfig, open_scale, open_tracer};
use abbe_graph::step::{GeometricStep, MonitorSettings, MonitorStep};
use abbe_identify::{Options, identify};
use abbe_measurement::campaign::Campaign;
use abbe_msgs::TracerReading;
use common::{HASH, bench};
use std::sync::Arc;

/// Campaign files that a driver reads.
struct Recording(tempfile::TempDir);

impl Recording {
    fn of(campaign: &Campaign) -> Recording {
        let folder = tempfile::tempdir().unwrap();
        write_campaign(&folder.path().join("campaign.csv"), campaign).unwrap();
        Recording(folder)
    }

    fn config() -> DriverConfig {
        DriverConfig::Campaign { file: "campaign.csv".into() }
    }

    fn tracer(&self) -> Vec<TracerReading> {
        let mut driver = open_tracer(&Recording::config(), self.0.path(), &bench().machine).unwrap();
        std::iter::from_fn(|| driver.next_reading().unwrap()).collect()
    }
}

/// Readings of every second line, or of the others.
fn half(odd: bool) -> Campaign {
    let campaign = &bench().campaign;
    let of_half = |k: &usize| (campaign.readings[*k].line % 2 == 1) == odd;
    campaign.part(&(0..campaign.readings.len()).filter(of_half).collect::<Vec<_>>())
}

#[test]
fn the_uncertainty_of_a_length_is_that_of_the_distance_and_not_of_the_travel() {
    let bench = bench();
    let told = Recording::of(&bench.campaign).tracer();
    assert_eq!(told.len(), bench.campaign.readings.len());
    let mut travelled_less = 0;
    for (told, reading) in told.iter().zip(&bench.campaign.readings) {
        let (_, station) = bench.model.station(told.station.as_str()).unwrap();
        let distance_m = (nominal_point_m(reading.reading_m, reading.offset_m) - station.position_m).norm();
        let expected_m = bench.machine.instrument.standard_m(distance_m);
        // Errors of some ten micrometres, of which the uncertainty holds some 1e-7.
        assert!((told.u_length_m - expected_m).abs() < 1e-10, "{} {expected_m}", told.u_length_m);
        travelled_less += usize::from(reading.length_m.abs() < 0.5 * distance_m);
    }
    assert!(travelled_less > told.len() / 2, "distance and travel differ, so that the test can tell");
}

#[test]
fn a_recording_that_cannot_place_its_station_states_the_uncertainty_of_the_travel() {
    let campaign = &bench().campaign;
    let few = Recording::of(&campaign.part(&[0, 1, 2, 3])).tracer();
    for (told, reading) in few.iter().zip(&campaign.readings) {
        let expected_m = bench().machine.instrument.standard_m(reading.length_m);
        assert!((told.u_length_m - expected_m).abs() < 1e-15, "{told:?}");
    }
}

#[test]
fn the_mean_square_over_a_sound_machine_is_one() {
    let machine = &bench().machine;
    let seen = half(false);
    let found = identify(&machine.machine, machine.instrument, &seen, &Options::default(), &mut |_| true).unwrap();
    let model = Arc::new(found.model);
    let recording = Recording::of(&half(true));
    let correcting = GeometricStep::new(Some((Arc::clone(&model), HASH)), 10.0);
    let settings = MonitorSettings { single_bound: 4.0, window: usize::MAX, match_within_s: 0.0005 };
    let mut monitor = MonitorStep::new(model, HASH, settings);
    let mut scale = open_scale(&Recording::config(), recording.0.path(), machine).unwrap();
    for reading in recording.tracer() {
        let sample = correcting.correct(&scale.next_reading().unwrap().unwrap());
        assert!(monitor.corrected(&sample).is_empty());
        assert!(monitor.tracer(&reading).unwrap().residual_valid);
    }
    let health = monitor.health();
    assert_eq!(health.residuals, half(true).readings.len());
    let mean_square = health.mean_square.unwrap();
    println!("mean square over {} residuals: {mean_square:.3}", health.residuals);
    // Three deviations of χ²/n over some 1400 residuals are 0.11.
    assert!((mean_square - 1.0).abs() < 0.11, "{mean_square}");
}
