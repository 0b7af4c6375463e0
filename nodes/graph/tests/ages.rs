//! The age from which a covariate is stale: in a step, set while it runs, and in the replay of such a run.

use crate::common::{HASH, bench};
use abbe_geometry::effects::Shape;
use abbe_geometry::model::MachineModel;
use abbe_graph::replay::{ReplaySteps, TopicOutcome, replay};
use abbe_graph::step::GeometricStep;
use abbe_msgs::bag::BagWriter;
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, ScaleReading};
use std::path::Path;
use std::sync::Arc;

/// The model with an effect that reads a temperature.
fn with_expansion() -> Arc<MachineModel> {
    let mut parts = bench().model.parts().clone();
    let shape = Shape::new().text("axis", "x").text("sensor", SENSOR);
    let parameters = vec![10e-6, 0.0];
    parts.effects = vec![MachineModel::fitted_effect("scale_expansion", shape, &parts.machine, parameters).unwrap()];
    parts.identified.covariates.insert(SENSOR.to_owned(), (18.0, 24.0));
    parts.stations.clear();
    parts.chord_covariance.clear();
    parts.quality.unseen_expansions = Default::default();
    let unknowns = bench().model.layout().len() + 2;
    parts.covariance = vec![0.0; unknowns * (unknowns + 1) / 2];
    Arc::new(MachineModel::new(parts).unwrap())
}

const SENSOR: &str = "temp_scale_x_c";

#[test]
fn regress_a_covariate_from_after_its_reading_is_stale() {
    let step = GeometricStep::new(Some((with_expansion(), HASH)), 10.0);
    let at_age = |age_s: f64| {
        let mut reading = bench().scale(40);
        reading.covariates.push(SENSOR, 23.0, age_s).unwrap();
        step.correct(&reading)
    };
    let fresh = at_age(0.0);
    assert_eq!(fresh.status, CorrectionStatus::InVolume);
    assert!(fresh.effect_correction_m[0].abs() > 1e-6, "the effect does nothing: the test tests nothing");
    // As far as clocks agree it is used; further ahead its age is as unknown as beyond the limit it is too great.
    for age_s in [-1e-3, 10.0] {
        assert_eq!(at_age(age_s), fresh, "{age_s} s");
    }
    for age_s in [-1.1e-3, -0.5, -3600.0, f64::MIN, 10.001] {
        let stale = at_age(age_s);
        assert_eq!(stale.status, CorrectionStatus::Stale, "{age_s} s");
        // A third of what it does at 23 °C: its range goes from 18 to 24.
        let share = stale.effect_correction_m[0] / fresh.effect_correction_m[0];
        assert!((share - 1.0 / 3.0).abs() < 1e-6, "{age_s} s: {share}");
        assert!(stale.covariance_m2[0] > fresh.covariance_m2[0], "{age_s} s: what is missing is not in doubt");
    }
}

#[test]
fn a_run_in_which_the_age_was_set_comes_out_again_with_the_ages_that_it_had_and_with_no_others() {
    let folder = tempfile::tempdir().unwrap();
    let (model, bag) = (with_expansion(), folder.path().join("run"));
    let mut writer = BagWriter::create(&bag).unwrap();
    let mut step = GeometricStep::new(Some((model.clone(), HASH)), 10.0);
    let mut statuses = Vec::new();
    for row in 0..30 {
        let mut reading = bench().scale(row);
        reading.covariates.push(SENSOR, 23.0, 5.0).unwrap();
        match row {
            10 => step.set_max_covariate_age_s(1.0),
            20 => step.set_max_covariate_age_s(7.0),
            _ => {}
        }
        let (corrected, at): (CorrectedCoordinates, _) = (step.correct(&reading), reading.stamp.to_nanos() as u64);
        statuses.push(corrected.status);
        writer.write::<ScaleReading>("/m/scale/reading", &reading, at).unwrap();
        writer.write("/m/corrected", &corrected, at).unwrap();
    }
    writer.finish().unwrap();
    let of_third = |k: usize| &statuses[10 * k..10 * (k + 1)];
    assert!(of_third(1).iter().all(|status| *status == CorrectionStatus::Stale), "{statuses:?}");
    assert!(of_third(0).iter().chain(of_third(2)).all(|status| *status != CorrectionStatus::Stale), "{statuses:?}");

    let with_ages = |ages_s: &[f64]| replayed(&bag, &ReplaySteps::new(&[(model.clone(), HASH)], &[], ages_s));
    let all = with_ages(&[10.0, 1.0, 7.0]);
    assert!(all.is_identical(), "{all:?}");
    // Readings of 5 s do not tell 7 s from 10 s.
    assert_eq!((all.identical, all.changes_of_age), (30, 2), "{all:?}");
    let some =
        [(&[10.0][..], 20, 10), (&[1.0], 10, 0), (&[2.0, 3.0], 10, 0), (&[1e-6, 1e6], 20, 10), (&[1.0, 10.0], 20, 10)];
    for (ages_s, identical, first) in some {
        let some = with_ages(ages_s);
        assert_eq!((some.identical, some.different, some.first_fault), (identical, 30 - identical, Some(first)));
    }
    assert_eq!(with_ages(&[]).not_comparable, 30);
}

fn replayed(bag: &Path, steps: &ReplaySteps) -> TopicOutcome {
    let mut outcome = replay(bag, steps).unwrap();
    assert_eq!(outcome.topics.len(), 1);
    outcome.topics.remove(0)
}
