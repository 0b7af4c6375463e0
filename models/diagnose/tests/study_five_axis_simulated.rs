//! Simulated fork heads with a known flaw: it is found and rightly named, and nothing is found where there is none.
//! The kinematics here are the test's own: matrices multiplied out, no code shared with the study.
use abbe_diagnose::study::five_axis::{SphereCentre, diagnose};
use abbe_diagnose::study::{StudyDiagnosis, StudyOptions};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

type Matrix = [[f64; 3]; 3];
type Vector = [f64; 3];

const SIGMA_M: f64 = 10e-6;
const SEEDS: u64 = 20;

/// What is wrong with a machine.
#[derive(Default, Clone, Copy)]
struct Flaw {
    c_zero_rad: f64,
    a_gain: f64,
    a_sag_rad: f64,
    offset_y_m: f64,
    c_tilt_x_rad: f64,
}

fn times(a: &Matrix, v: Vector) -> Vector {
    [0, 1, 2].map(|i| (0..3).map(|j| a[i][j] * v[j]).sum())
}

fn about_x(angle: f64) -> Matrix {
    let (s, c) = angle.sin_cos();
    [[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]
}

fn about_z(angle: f64) -> Matrix {
    let (s, c) = angle.sin_cos();
    [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
}

fn normal(generator: &mut ChaCha8Rng) -> f64 {
    let (a, b): (f64, f64) = (generator.random(), generator.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

/// Indicated centre of a sphere probed at these indicated angles.
fn indicated_m(flaw: &Flaw, a_rad: f64, c_rad: f64, d_m: f64) -> Vector {
    let (sphere, direction, zero) = ([-0.4, -0.34, -0.86], [0.001, 0.018, -0.99984], [-0.011, 0.033, -0.453]);
    let probe = [0, 1, 2].map(|k| d_m * direction[k] + zero[k]);
    let a_true = a_rad * (1.0 + flaw.a_gain) + flaw.a_sag_rad * a_rad.sin();
    let mut hung = times(&about_x(a_true), probe);
    hung[1] += flaw.offset_y_m;
    // The C axis leans about X: into its frame, turned, and back.
    let inside = times(&about_x(-flaw.c_tilt_x_rad), hung);
    let turned = times(&about_z(c_rad + flaw.c_zero_rad), inside);
    let point = times(&about_x(flaw.c_tilt_x_rad), turned);
    [0, 1, 2].map(|k| sphere[k] - point[k])
}

/// 35 poses, two distances each.
fn measured(flaw: &Flaw, seed: u64) -> Vec<SphereCentre> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut centres = Vec::new();
    for a_deg in [-80.0_f64, -55.0, -30.0, 0.0, 25.0, 60.0, 85.0] {
        for c_deg in [-150.0_f64, -70.0, 0.0, 65.0, 140.0] {
            for distance_m in [0.09, 0.1] {
                let (a_rad, c_rad) = (a_deg.to_radians(), c_deg.to_radians());
                let centre = indicated_m(flaw, a_rad, c_rad, distance_m);
                let centre_m = centre.map(|value| value + SIGMA_M * normal(&mut generator));
                centres.push(SphereCentre { a_rad, c_rad, distance_m, centre_m, u_m: None });
            }
        }
    }
    centres
}

fn study(flaw: &Flaw, seed: u64) -> StudyDiagnosis {
    diagnose(&measured(flaw, seed), &StudyOptions::default()).unwrap()
}

#[test]
fn nothing_is_found_on_clean_machines() {
    let found: Vec<Vec<String>> = (0..SEEDS)
        .map(|seed| study(&Flaw::default(), seed))
        .filter(|diagnosis| !diagnosis.consistent_with_noise)
        .map(|diagnosis| diagnosis.effects.into_iter().map(|effect| effect.name).collect())
        .collect();
    assert!(found.len() <= 1, "{found:?}");
}

/// Name, injected flaw, value in the first parameter, names that mean the same.
#[track_caller]
fn assert_found(flaw: Flaw, value: f64, names: &[&str]) {
    for seed in 0..3 {
        let diagnosis = study(&flaw, 100 + seed);
        let effects: Vec<&str> = diagnosis.effects.iter().map(|effect| effect.name.as_str()).collect();
        assert_eq!(effects.len(), 1, "seed {seed}: {effects:?}");
        let effect = &diagnosis.effects[0];
        assert!(names.contains(&effect.name.as_str()), "seed {seed}: {effects:?}");
        assert!((effect.parameters[0].value.abs() - value.abs()).abs() < 4.0 * effect.parameters[0].u, "{effect:?}");
        for other in names.iter().filter(|name| **name != effect.name) {
            assert!(
                effect.rivals.iter().any(|rival| rival == other),
                "{other} is not named a rival: {:?}",
                effect.rivals
            );
        }
        let (before, after) = (diagnosis.before.held_out.rms_um, diagnosis.after.held_out.rms_um);
        let noise_um = SIGMA_M * 1e6;
        assert!(after < 1.25 * noise_um && before > 1.5 * noise_um, "{before} {after}");
    }
}

/// A zero of C equals the A axis turned in the plane of X and Y: one is found, the other named as its rival.
#[test]
fn a_zero_of_c_is_found_and_its_double_named() {
    assert_found(Flaw { c_zero_rad: 150e-6, ..Flaw::default() }, 150e-6, &["zero of C", "tilt of A about z"]);
}

#[test]
fn an_offset_of_the_axes_is_found() {
    assert_found(Flaw { offset_y_m: 60e-6, ..Flaw::default() }, 60e-6, &["offset of A from C along y"]);
}

#[test]
fn with_seven_angles_gain_and_sag_are_told_apart() {
    assert_found(Flaw { a_gain: 400e-6, ..Flaw::default() }, 400e-6, &["gain of A"]);
    assert_found(Flaw { a_sag_rad: 400e-6, ..Flaw::default() }, 400e-6, &["sag of the head"]);
}

#[test]
fn a_leaning_c_axis_is_found() {
    assert_found(Flaw { c_tilt_x_rad: 100e-6, ..Flaw::default() }, 100e-6, &["tilt of C about x"]);
}

/// One degree: far beyond what a single linear step could follow.
#[test]
fn a_large_flaw_is_followed_to_the_end() {
    let flaw = Flaw { c_zero_rad: 17.5e-3, ..Flaw::default() };
    let diagnosis = study(&flaw, 7);
    let effect = diagnosis.effects.iter().find(|e| e.name == "zero of C" || e.name == "tilt of A about z").unwrap();
    assert!((effect.parameters[0].value.abs() - 17.5e-3).abs() < 30e-6, "{effect:?}");
    assert!(diagnosis.after.held_out.rms_um < 12.5 && diagnosis.before.held_out.rms_um > 1000.0);
}
