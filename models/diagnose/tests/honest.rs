//! Machines of a simulator that shares nothing with this project, and causes that are in no list: what comes out may be wrong,
//! but not worse than before, and never without its uncertainty saying so.
//!
//! `cargo run --example foreign` (this crate) prints the same over many machines, causes and seeds.

use crate::foreign::bench::{Judged, campaign, description, identified, judged};
use crate::foreign::{RANGE, foreign};
use abbe_diagnose::{DiagnoseOptions, diagnose};
use abbe_measurement::instrument::RangeUncertainty;

fn diagnosed(machine: &str, forms: &[&str], seed: u64) -> Judged {
    judged(machine, forms, seed, &DiagnoseOptions { folds: 0, placebos: 0, ..DiagnoseOptions::default() })
}

/// 0.3 µm of noise correlated from reading to reading: three effects were claimed, and corrected points got worse.
#[test]
fn regress_noise_that_hangs_together_is_no_effect() {
    let judged = diagnosed("bridge", &["ar-0.9"], 1);
    assert_eq!(judged.names(), [""; 0], "{:?}", judged.diagnosis.steps);
    assert!(!judged.diagnosis.consistent_with_noise, "nobody can tell such noise from a cause without a form");
    assert!(judged.diagnosis.after.correlation.is_some());
    assert!(judged.diagnosis.only_correlated, "beyond that there is nothing: {:?}", judged.diagnosis.steps);
    let (before, after) = judged.outcome().inside;
    assert!(after.rms_m < 1.02 * before.rms_m && after.covered > 0.93, "{before:?} {after:?}");
}

/// A cycle in time tilts the machine; nothing that is logged follows it. Intervals held 70 % before and 31 % along X.
#[test]
fn regress_a_cycle_that_acts_through_a_lever_shows_in_the_uncertainty() {
    let judged = diagnosed("bridge", &["lever-cycle"], 1);
    let outcome = judged.outcome();
    for (before, after) in [outcome.inside, outcome.beyond] {
        assert!(after.rms_m < 1.02 * before.rms_m, "{before:?} {after:?} {:?}", judged.diagnosis.steps);
        assert!(after.covered > 0.93, "{before:?} {after:?} {:?}", judged.diagnosis.steps);
    }
}

/// A torsion by a sensor that lags: a dependence without a name takes the place of the cause, and takes noise with it. The readings
/// that it was fitted to do not show that; intervals held 86 % inside the volume. Lines that no step saw show it.
#[test]
fn regress_what_lines_left_out_show_stands_in_the_uncertainty() {
    let judged = judged(
        "bridge",
        &["torsion-lag"],
        31,
        &DiagnoseOptions { folds: 4, placebos: 0, ..DiagnoseOptions::default() },
    );
    assert_eq!(judged.names(), ["empirical"], "{:?}", judged.diagnosis.steps);
    let (before, after) = judged.outcome().inside;
    assert!(after.rms_m < before.rms_m && after.covered > 0.95, "{before:?} {after:?}");
    let unseen_m = judged.diagnosis.unseen.as_ref().unwrap().unexplained_m;
    let stated_m = judged.diagnosis.after.model.parts().quality.unexplained_m;
    assert!(unseen_m.iter().any(|u_m| *u_m > 0.0), "{unseen_m:?}");
    assert!(unseen_m.iter().zip(stated_m).all(|(unseen, stated)| stated >= *unseen), "{unseen_m:?} {stated_m:?}");
}

/// An identification alone takes a part of what it does not explain into its two hundred parameters: of machines that creep or walk the worst
/// axis was held to 87 to 90 %. Lines left out of the fit show it.
#[test]
fn regress_an_identification_alone_holds_what_lines_left_out_show() {
    for (form, seed) in [("walk", 2), ("creep:1200", 7), ("walk", 9)] {
        let [alone, held] = identified("bridge", &[form], seed);
        assert!(alone.worst_axis < 0.93, "{form}: the test shows nothing: {alone:?}");
        assert!(held.covered > 0.96 && held.worst_axis > 0.94, "{form}: {alone:?} {held:?}");
        assert!(held.stated_m < 1.5 * alone.stated_m, "{form}: {alone:?} {held:?}");
    }
    let [alone, held] = identified("bridge", &[], 1);
    assert!((held.stated_m - alone.stated_m).abs() < 1e-12, "{alone:?} {held:?}");
}

/// A bed that settles, a micrometre in an hour and without a log: stations and errors take nearly all of it, the fit seems to explain its readings,
/// and what it says of Z is too good. The course of time shows the greater part.
#[test]
fn regress_an_identification_alone_holds_more_of_what_changes_slowly() {
    for seed in [1, 2, 3] {
        let [alone, held] = identified("bridge", &["settling"], seed);
        println!("{seed}: {alone:?} {held:?}");
        assert!(alone.worst_axis < 0.8, "{seed}: the test shows nothing: {alone:?}");
        assert!(held.worst_axis > alone.worst_axis + 0.15, "{seed}: {alone:?} {held:?}");
        assert!(held.stated_m < 3.0 * alone.stated_m, "{seed}: {alone:?} {held:?}");
    }
}

/// A holder 6 µm off: found, and its place known as far as the offsets allow.
#[test]
fn regress_a_reflector_holder_off_by_micrometres_is_found_and_put_right() {
    let judged = diagnosed("bridge", &["holder"], 1);
    assert_eq!(judged.names(), ["reflector_offset"], "{:?}", judged.diagnosis.steps);
    let (before, after) = judged.outcome().inside;
    assert!(after.rms_m < 0.5 * before.rms_m && after.covered > 0.93, "{before:?} {after:?}");
}

/// Friction that remembers travel: it was called backlash, half of it stayed, and intervals held 60 to 80 % along Y.
#[test]
fn regress_hysteresis_over_travel_is_found_and_put_right() {
    let judged = diagnosed("bridge", &["dahl"], 1);
    assert_eq!(judged.names().first(), Some(&"hysteresis"), "{:?}", judged.diagnosis.steps);
    let (before, after) = judged.outcome().inside;
    assert!(after.rms_m < 0.6 * before.rms_m, "{before:?} {after:?}");
    assert!(after.covered > 0.95 && after.worst_axis > 0.93, "{before:?} {after:?}");
}

/// What is in the list is found as before.
#[test]
fn a_cause_in_the_list_is_still_found() {
    let judged = diagnosed("bridge", &["reversal"], 11);
    assert_eq!(judged.names(), ["reversal"], "{:?}", judged.diagnosis.steps);
}

/// Three cells in a hundred are empty: the right sensor was not tried, and another stood in for it.
#[test]
fn regress_a_log_with_empty_cells_still_names_its_cause() {
    for seed in [1, 2] {
        let judged = diagnosed("bridge", &["holes"], seed);
        let [found] = judged.diagnosis.found.as_slice() else { panic!("{seed}: {:?}", judged.diagnosis.steps) };
        let whole = diagnosed("bridge", &["expansion"], seed);
        let [cause] = whole.diagnosis.found.as_slice() else { panic!("{seed}: {:?}", whole.diagnosis.steps) };
        assert_eq!((found.name, &found.covariates), (cause.name, &cause.covariates), "{seed}");
        let (after, wanted) = (judged.outcome().inside.1, whole.outcome().inside.1);
        assert!(
            after.rms_m < 1.1 * wanted.rms_m && after.covered > wanted.covered - 0.03,
            "{seed}: {after:?} {wanted:?}"
        );
    }
}

/// Rows that a logger wrote twice have no scatter among them: the test against points measured again ended the program.
#[test]
fn regress_copies_of_readings_are_no_points_measured_again() {
    let foreign = foreign("bridge", &[], 1);
    let once = campaign(&foreign);
    let twice: Vec<usize> =
        (0..once.readings.len()).flat_map(|k| [Some(k), Some(k).filter(|k| k % 10 == 0)]).flatten().collect();
    let range = RangeUncertainty { constant_m: RANGE.0, per_metre: RANGE.1, common_per_metre: 0.0 };
    let options = DiagnoseOptions { folds: 0, placebos: 0, ..DiagnoseOptions::default() };
    let found = diagnose(&description(&foreign), &[], range, &once.part(&twice), &options, &mut |_| true).unwrap();
    let test = found.detection_before.lack_of_fit;
    assert!(found.steps.is_empty() && test.is_none_or(|test| test.p_value > 0.01), "{:?} {test:?}", found.steps);
}
