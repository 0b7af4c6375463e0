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
