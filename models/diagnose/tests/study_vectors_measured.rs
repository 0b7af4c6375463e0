//! Residual vectors as calibrations give them: noise that is correlated and differs by component, gross points, copies,
//! columns that nobody measured.

use crate::seeds::{one_in_twenty, seeds};
use abbe_diagnose::study::vectors::{ResidualVector, diagnose};
use abbe_diagnose::study::{StudyDiagnosis, StudyOptions};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Error (µm) of component x at a load (N).
type Bends = fn(f64) -> f64;

/// 160 poses of an arm in random order: noise of 2, 8 and 20 µm with this correlation.
fn measured(rho: f64, bends: Bends, seed: u64) -> Vec<ResidualVector> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let normal = |generator: &mut ChaCha8Rng| (0..12).map(|_| generator.random::<f64>()).sum::<f64>() - 6.0;
    let mut wandering = [0, 1, 2].map(|_| normal(&mut generator));
    (0..160)
        .map(|k| {
            let load = generator.random_range(0.0..50.0);
            for state in &mut wandering {
                *state = rho * *state + f64::sqrt(1.0 - rho * rho) * normal(&mut generator);
            }
            let [x, y, z] = wandering;
            ResidualVector {
                position_m: [0, 1, 2].map(|_| generator.random_range(-0.5..0.5)),
                residual_m: [2e-6 * x + 1e-6 * bends(load), 8e-6 * y, 20e-6 * z],
                time_s: seed.is_multiple_of(2).then_some(3.0 * f64::from(k)),
                covariates: [
                    ("load_n".to_owned(), load),
                    ("temp_arm_c".to_owned(), 22.0 + 0.01 * f64::from(k)),
                    ("joint_1_deg".to_owned(), generator.random_range(-90.0..90.0)),
                ]
                .into(),
                ..ResidualVector::default()
            }
        })
        .collect()
}

fn study(vectors: &[ResidualVector]) -> StudyDiagnosis {
    diagnose(vectors, None, &StudyOptions::default()).unwrap()
}

fn names(diagnosis: &StudyDiagnosis) -> String {
    diagnosis.effects.iter().map(|effect| effect.name.as_str()).collect::<Vec<_>>().join(" + ")
}

#[test]
fn regress_vectors_whose_noise_hangs_together_show_nothing() {
    for rho in [0.0, 0.5, 0.9] {
        let mut alarms = Vec::new();
        for seed in 0..seeds(34) {
            let diagnosis = study(&measured(rho, |_| 0.0, 40 + seed));
            if !diagnosis.effects.is_empty() {
                alarms.push((seed, names(&diagnosis)));
            }
        }
        assert!(alarms.len() <= one_in_twenty(seeds(34)), "rho {rho}: {alarms:?}");
    }
}

#[test]
fn regress_an_effect_is_found_beside_gross_points_and_these_are_named() {
    for seed in 0..10 {
        let mut vectors = measured(0.0, |load| 0.2 * (load - 25.0), seed);
        vectors[30].residual_m[0] += 400e-6;
        vectors[90].residual_m[2] -= 3e-3;
        let diagnosis = study(&vectors);
        assert!(names(&diagnosis).contains("load_n, degree 1, component x"), "{}", names(&diagnosis));
        let rejected: Vec<&str> = diagnosis.rejected.iter().map(|row| row.name.as_str()).collect();
        assert_eq!(rejected, ["vector 31 (component x)", "vector 91 (component z)"]);
    }
}

#[test]
fn regress_a_column_of_zeros_is_not_taken_as_measured() {
    let mut vectors = measured(0.0, |load| 0.2 * (load - 25.0), 1);
    vectors.iter_mut().for_each(|vector| vector.residual_m[2] = 0.0);
    let diagnosis = study(&vectors);
    assert!(diagnosis.notes.iter().any(|note| note.contains("Component z is zero")), "{:?}", diagnosis.notes);
    assert!(diagnosis.considered.iter().all(|candidate| !candidate.name.contains("component z")));
    assert_eq!(names(&diagnosis), "smooth in load_n, degree 1, component x");
    vectors.iter_mut().for_each(|vector| vector.residual_m = [0.0; 3]);
    assert!(
        diagnose(&vectors, None, &StudyOptions::default()).unwrap_err().to_string().contains("all residuals are zero")
    );
}

#[test]
fn regress_vectors_given_twice_count_once() {
    let once = measured(0.0, |load| 0.03 * (load - 25.0), 1);
    let twice: Vec<ResidualVector> = once.iter().chain(&once).cloned().collect();
    let (once, twice) = (study(&once), study(&twice));
    assert_eq!((once.rows, &once.effects), (twice.rows, &twice.effects));
    assert!(twice.notes.iter().any(|note| note.starts_with("160 vectors are copies")), "{:?}", twice.notes);
}

#[test]
fn regress_a_wrong_declared_uncertainty_says_what_can_be_known() {
    let mut vectors = measured(0.0, |_| 0.0, 2);
    vectors.iter_mut().for_each(|vector| vector.u_m = Some([1e-6, 4e-6, 10e-6]));
    let diagnosis = study(&vectors);
    let scatter = diagnosis.looked.iter().find(|look| look.what == "scatter").unwrap();
    assert!(!diagnosis.consistent_with_noise && diagnosis.effects.is_empty());
    assert!(scatter.says.contains("either the declared uncertainties are too small"), "{scatter:?}");
}

/// A printer at one place for four hours: its bed goes up in two steps, its frame follows slowly and takes back what the bed lifts, the chamber is
/// logged as well. 2 µm/K by the bed, −9 µm/K by the frame, 4 µm of noise.
fn warming(seed: u64) -> Vec<ResidualVector> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = |size: f64| size * ((0..12).map(|_| generator.random::<f64>()).sum::<f64>() - 6.0);
    let (mut chamber, mut frame) = (22.0, 22.0);
    (0..240)
        .map(|k| {
            let time_s = 60.0 * f64::from(k);
            let bed = if time_s < 2500.0 { 22.0 + time_s / 66.0 } else { 60.0 + 35.0 * f64::from(time_s > 9000.0) };
            chamber += (22.0 + 0.35 * (bed - 22.0) - chamber) / 25.0;
            frame += (22.0 + 0.5 * (chamber - 22.0) - frame) / 67.0;
            ResidualVector {
                position_m: [0.175, 0.175, 0.0],
                residual_m: [0.0, 0.0, 1e-6 * (2.0 * (bed - 22.0) - 9.0 * (frame - 22.0) + noise(4.0))],
                residual_lacks: [true, true, false],
                time_s: Some(time_s),
                covariates: [
                    ("temp_bed_c".to_owned(), bed + noise(0.1)),
                    ("temp_chamber_c".to_owned(), chamber + noise(0.05)),
                    ("temp_frame_c".to_owned(), frame + noise(0.02)),
                ]
                .into(),
                ..ResidualVector::default()
            }
        })
        .collect()
}

/// Neither is seen alone, and a form that bends with bed and time describes both: it fits, and predicted the next half hour five times worse.
#[test]
fn regress_two_straight_lines_that_take_each_other_back_are_found_as_such() {
    for seed in 0..seeds(6) {
        let diagnosis = study(&warming(seed));
        let found = names(&diagnosis);
        assert!(found.contains("smooth in temp_bed_c, degree 1, component z"), "seed {seed}: {found}");
        assert!(!found.contains(" and "), "seed {seed}: {found}");
        let after = diagnosis.unseen.after.as_ref().unwrap();
        assert!(after.rms_um < 6.0, "seed {seed}: {:.2} µm", after.rms_um);
    }
}

/// More quantities than are tried in pairs with each other: what goes with a position and any of them is found as such. It was told by a sensor that
/// went along, as the right one came later in the alphabet.
#[test]
fn regress_every_logged_quantity_is_tried_with_the_position() {
    let mut generator = ChaCha8Rng::seed_from_u64(5);
    let mut normal = || (0..12).map(|_| generator.random::<f64>()).sum::<f64>() - 6.0;
    let mut sensors_c = [20.0; 20];
    let vectors: Vec<ResidualVector> = (0..240)
        .map(|k| {
            sensors_c.iter_mut().for_each(|value_c| *value_c += 0.1 * normal());
            let position_m = [0, 1, 2].map(|_| 0.1 * normal());
            let y_um = 30.0 * position_m[1].powi(2) * (sensors_c[19] - 20.0) / 0.01;
            let covariates = sensors_c.iter().enumerate().map(|(n, value_c)| (format!("temp_{n:02}_c"), *value_c));
            ResidualVector {
                position_m,
                residual_m: [1e-6 * normal(), 1e-6 * (y_um + normal()), 1e-6 * normal()],
                time_s: Some(4.0 * f64::from(k)),
                covariates: covariates.collect(),
                ..ResidualVector::default()
            }
        })
        .collect();
    let diagnosis = study(&vectors);
    let found = names(&diagnosis);
    assert!(found.contains("smooth in y_m and temp_19_c, degree 3"), "{found}");
    let sensors = (0..19).filter(|n| found.contains(&format!("temp_{n:02}_c")));
    assert_eq!(sensors.count(), 0, "{found}");
    assert!(diagnosis.notes.iter().any(|note| note.contains("with positions and the time")), "{:?}", diagnosis.notes);
}
