//! Simulated residual vectors with and without each cause: named where a registered effect explains them, described
//! where none does, silent where there is nothing. The errors are written out here, not taken from the effects.

use crate::bridge::{machine, normal};
use crate::seeds::{one_in_twenty, seeds};
use abbe_diagnose::DiagnoseError;
use abbe_diagnose::Explanation;
use abbe_diagnose::study::vectors::{ResidualVector, diagnose, diagnose_observed};
use abbe_diagnose::study::{Progress, StudyDiagnosis, StudyOptions};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SIGMA_M: f64 = 1e-6;

/// Error (m) at a vector.
type Error = fn(&ResidualVector) -> [f64; 3];

/// 240 positions in random order with a temperature, a load, a direction and a joint angle; a frame slightly moved.
fn measured(error: Error, seed: u64) -> Vec<ResidualVector> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut vectors = Vec::new();
    for k in 0..240 {
        let position_m = [0.8, 0.6, 0.6].map(|stroke| stroke * generator.random::<f64>());
        let time_s = 10.0 * k as f64;
        let covariates = [
            ("temp_scale_x_c".to_owned(), 21.0 + (time_s / 300.0).sin()),
            ("payload_n".to_owned(), generator.random_range(0.0..40.0)),
            ("dir_x".to_owned(), if generator.random_bool(0.5) { 1.0 } else { -1.0 }),
            ("joint_1_deg".to_owned(), generator.random_range(-170.0..170.0)),
        ];
        let mut vector = ResidualVector {
            position_m,
            time_s: Some(time_s),
            covariates: covariates.into(),
            u_m: Some([SIGMA_M; 3]),
            ..ResidualVector::default()
        };
        let [x, y, _] = position_m;
        let moved = [5e-6 - 8e-6 * y, -3e-6 + 8e-6 * x, 1e-6];
        let own = error(&vector);
        vector.residual_m = [0, 1, 2].map(|d| moved[d] + own[d] + SIGMA_M * normal(&mut generator));
        vectors.push(vector);
    }
    vectors
}

fn options() -> StudyOptions {
    StudyOptions::default()
}

fn study(error: Error, seed: u64) -> StudyDiagnosis {
    diagnose(&measured(error, seed), Some(&machine()), &options()).unwrap()
}

fn names(diagnosis: &StudyDiagnosis) -> Vec<&str> {
    diagnosis.effects.iter().map(|effect| effect.name.as_str()).collect()
}

#[test]
fn nothing_is_found_in_noise() {
    let mut alarms = Vec::new();
    for seed in 0..seeds(20) {
        let diagnosis = study(|_| [0.0; 3], seed);
        if !diagnosis.effects.is_empty() {
            alarms.push((seed, names(&diagnosis).join(", ")));
        }
        assert!((0.85..1.15).contains(&diagnosis.before.chi2_per_dof.unwrap()));
    }
    assert!(alarms.len() <= one_in_twenty(seeds(20)), "more than 5 %: {alarms:?}");
}

/// In every seed exactly one effect, whose name holds these words, and the noise left.
#[track_caller]
fn assert_found(error: Error, words: &[&str], kind: Explanation) {
    let mut wrong = Vec::new();
    for seed in 0..5 {
        let diagnosis = study(error, 500 + seed);
        let found = names(&diagnosis);
        let is_right = found.len() == 1 && words.iter().all(|word| found[0].contains(word));
        let (before, after) = (diagnosis.before.held_out.rms_um, diagnosis.after.held_out.rms_um);
        if !(is_right && diagnosis.effects[0].kind == kind && after < 1.1 && before > 1.05 * after) {
            wrong.push((seed, found.join(" + "), before, after));
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}

#[test]
fn thermal_expansion_is_attributed() {
    let error: Error = |v| [11e-6 * (v.covariates["temp_scale_x_c"] - 20.0) * (v.position_m[0] - 0.2), 0.0, 0.0];
    assert_found(error, &["expansion", "x", "temp_scale_x_c"], Explanation::Attributed);
}

/// A grid gone through row by row while the room warms by 0.9 K: scales of X and Y grow with sensors of their own.
fn raster_in_a_warming_room(seed: u64) -> Vec<ResidualVector> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let vector = |k: usize| {
        let position_m =
            [0.05 + 0.14 * (k / 30) as f64, 0.05 + 0.1 * (k / 5 % 6) as f64, 0.05 + 0.125 * (k % 5) as f64];
        let time_s = 8.0 * k as f64;
        let above_k = 0.3 + 6e-4 * time_s;
        let mut normal = || normal(&mut generator);
        let sensors =
            ["temp_scale_x_c", "temp_scale_y_c"].map(|name| (name.to_owned(), 20.0 + above_k + 0.03 * normal()));
        let noise_m = [0, 1, 2].map(|_| 0.4e-6 * normal());
        ResidualVector {
            position_m,
            time_s: Some(time_s),
            residual_m: [0, 1, 2].map(|d| noise_m[d] + EXPANDS_PER_K[d] * above_k * position_m[d]),
            covariates: sensors.into(),
            u_m: Some([0.4e-6; 3]),
            ..ResidualVector::default()
        }
    };
    (0..180).map(vector).collect()
}

const EXPANDS_PER_K: [f64; 3] = [11e-6, 9e-6, 0.0];

/// What the temperature does looks like an error of position there, and is called one. What it may be is in the uncertainty.
#[test]
fn an_expansion_in_the_place_of_what_was_found_is_in_the_uncertainty() {
    let mut doubted = 0;
    for seed in 0..seeds(15) {
        let diagnosis = diagnose(&raster_in_a_warming_room(seed), Some(&machine()), &options()).unwrap();
        for (d, axis) in ["x", "y"].into_iter().enumerate() {
            let expansion = format!("thermal expansion of a scale (axis {axis}, ");
            let is_expansion = |name: &String| name.starts_with(&expansion);
            let is_found = diagnosis.effects.iter().any(|effect| is_expansion(&effect.name));
            if is_found || !diagnosis.effects.iter().any(|effect| effect.rivals.iter().any(is_expansion)) {
                continue;
            }
            doubted += 1;
            let most = diagnosis.terms.unseen_expansions.iter().map(|own| own.per_kelvin[d]).fold(0.0, f64::max);
            assert!(2.0 * most > EXPANDS_PER_K[d], "seed {seed}, {axis}: {most:e} in {:?}", names(&diagnosis));
        }
    }
    assert!(doubted > 0, "all were told: the case tests nothing");
}

#[test]
fn backlash_is_attributed() {
    assert_found(|v| [-0.5 * 3e-6 * v.covariates["dir_x"], 0.0, 0.0], &["backlash", "x"], Explanation::Attributed);
}

#[test]
fn warm_up_is_attributed() {
    let error: Error = |v| {
        let grown = 1.0 - (-v.time_s.unwrap() / 700.0).exp();
        [0.0, 2e-6 * grown, -8e-6 * grown]
    };
    assert_found(error, &["warm-up"], Explanation::Attributed);
}

/// With the temperatures of both sides of a column, which go their own ways; what their difference does to x at a height z (m).
fn beside_a_column(seed: u64, error: impl Fn(f64, f64) -> f64) -> StudyDiagnosis {
    let mut vectors = measured(|_| [0.0; 3], seed);
    for vector in &mut vectors {
        let time_s = vector.time_s.unwrap();
        let [warm, cold] = [21.0 + (time_s / 400.0).sin(), 20.5 + 0.8 * (time_s / 650.0 + 1.0).cos()];
        vector.covariates.insert("temp_warm_side_c".to_owned(), warm);
        vector.covariates.insert("temp_cold_side_c".to_owned(), cold);
        vector.residual_m[0] += error(warm - cold, vector.position_m[2]);
    }
    diagnose(&vectors, Some(&machine()), &options()).unwrap()
}

#[test]
fn a_column_that_bends_between_two_temperatures_is_attributed() {
    for seed in [700, 702] {
        let bow = beside_a_column(seed, |difference_k, z_m| difference_k * (10e-6 * z_m * z_m - 2e-6 * z_m));
        let found = names(&bow);
        assert!(found.len() == 1 && found[0].contains("sideways thermal bow"), "{seed}: {found:?}");
        let curvature = bow.effects[0].parameters.iter().find(|p| p.name == "curvature").unwrap();
        // The temperatures may stand in the other order.
        assert!((curvature.value.abs() - 20e-6).abs() < 4.0 * curvature.u, "{seed}: {curvature:?}");
        assert!(bow.after.held_out.rms_um < 1.1, "{seed}: {}", bow.after.held_out.rms_um);
        // A straight lean is a squareness that changes, and no bow.
        let lean = beside_a_column(seed, |difference_k, z_m| difference_k * 8e-6 * z_m);
        let found = names(&lean);
        assert!(!found.is_empty() && found.iter().all(|name| !name.contains("bow")), "{seed}: {found:?}");
    }
}

#[test]
fn what_no_effect_describes_is_named_by_its_quantities_and_component() {
    let error: Error = |v| [0.0, 3e-6 * (v.covariates["payload_n"] / 20.0 - 1.0).powi(2), 0.0];
    assert_found(error, &["smooth in payload_n", "component y"], Explanation::Empirical);
    let error: Error = |v| {
        let [p, z] = [v.covariates["payload_n"] / 20.0 - 1.0, v.position_m[2] / 0.3 - 1.0];
        [0.0, 0.0, 3e-6 * p * z]
    };
    assert_found(error, &["product of z_m and payload_n", "component z"], Explanation::Empirical);
    let error: Error = |v| [2e-6 * (v.covariates["joint_1_deg"].to_radians() + 0.5).sin(), 0.0, 0.0];
    assert_found(error, &["1 a turn of joint_1_deg", "component x"], Explanation::Empirical);
}

#[test]
fn two_causes_are_found_one_after_another_and_the_ladder_descends() {
    let error: Error = |v| {
        let grown = 11e-6 * (v.covariates["temp_scale_x_c"] - 20.0) * v.position_m[0];
        [grown, 3e-6 * (v.covariates["payload_n"] / 20.0 - 1.0).powi(2), 0.0]
    };
    let diagnosis = study(error, 9);
    assert_eq!(diagnosis.effects.len(), 2, "{:?}", names(&diagnosis));
    let rungs: Vec<f64> = diagnosis.ladder.iter().map(|rung| rung.judgement.held_out.rms_um).collect();
    assert!(rungs.windows(2).all(|pair| pair[1] < pair[0]) && rungs[2] < 1.1, "{rungs:?}");
    let alpha = diagnosis.effects.iter().flat_map(|effect| &effect.parameters).find(|p| p.name == "alpha").unwrap();
    assert!((alpha.value - 11e-6).abs() < 4.0 * alpha.u, "{alpha:?}");
}

#[test]
fn without_a_machine_it_still_says_what_the_residual_depends_on() {
    let error: Error = |v| [11e-6 * (v.covariates["temp_scale_x_c"] - 20.0) * v.position_m[0], 0.0, 0.0];
    let diagnosis = diagnose(&measured(error, 4), None, &options()).unwrap();
    assert!(diagnosis.effects.iter().all(|effect| effect.kind == Explanation::Empirical));
    assert!(diagnosis.effects[0].covariates.contains(&"temp_scale_x_c".to_owned()), "{:?}", names(&diagnosis));
    assert!(diagnosis.untestable.iter().any(|item| item.needs.contains("machine file")));
}

#[test]
fn what_acts_on_ranges_only_and_what_was_not_logged_is_untestable() {
    let diagnosis = study(|_| [0.0; 3], 1);
    let needs = |part: &str| {
        let found = diagnosis.untestable.iter().find(|item| item.name.contains(part));
        found.unwrap_or_else(|| panic!("{part} is not in {:?}", diagnosis.untestable)).needs.clone()
    };
    assert!(needs("gimbal").contains("does not move the tip"));
    assert!(needs("drift of the stand").contains("does not move the tip"));
    assert!(needs("bow").contains("two temperatures"));
}

#[test]
fn uncertainties_that_are_too_small_look_like_something_missing_but_nothing_is_claimed() {
    let mut vectors = measured(|_| [0.0; 3], 2);
    vectors.iter_mut().for_each(|vector| vector.u_m = Some([0.5 * SIGMA_M; 3]));
    let diagnosis = diagnose(&vectors, None, &options()).unwrap();
    assert!(diagnosis.effects.is_empty() && !diagnosis.consistent_with_noise);
    assert!(diagnosis.before.chi2_per_dof.unwrap() > 3.5 && (diagnosis.before.estimated_sigma_um - 1.0).abs() < 0.1);
}

#[test]
fn what_cannot_be_used_is_refused_with_a_remedy() {
    let vectors = measured(|_| [0.0; 3], 1);
    let message = |vectors: &[ResidualVector]| diagnose(vectors, None, &options()).unwrap_err().to_string();
    assert!(message(&vectors[..5]).contains("more points"));
    let mut two = vectors.clone();
    two.iter_mut().enumerate().for_each(|(k, vector)| vector.block = Some(format!("{}", k % 2)));
    assert!(message(&two).contains("column block"));
    let mut broken = vectors;
    broken[6].residual_m[1] = f64::NAN;
    assert!(message(&broken).contains("vector 7"));
}

/// Who waits is told of each part that is left out, and of the search on all vectors after them.
#[test]
fn every_part_of_the_search_is_told_and_candidates_with_it() {
    let vectors = measured(|v| [2e-7 * v.covariates["payload_n"], 0.0, 0.0], 4);
    let mut told: Vec<Progress> = Vec::new();
    let mut observe = |progress| {
        told.push(progress);
        true
    };
    let found = diagnose_observed(&vectors, None, &StudyOptions::default(), &mut observe).unwrap();
    let mut parts: Vec<Option<(usize, usize)>> = told.iter().map(|progress| progress.part).collect();
    parts.dedup();
    let folds = found.unseen.folds;
    let expected: Vec<_> = std::iter::once(None).chain((1..=folds).map(|k| Some((k, folds)))).collect();
    assert_eq!(parts, expected);
    // Steps whose place is free wait for the first of them.
    let candidates = told[0].candidates;
    assert!(told.iter().all(|progress| progress.candidates == candidates) && candidates >= found.considered.len());
    assert!(told.iter().any(|progress| progress.part.is_none() && progress.effects == found.effects.len()));
}

#[test]
fn an_observer_that_says_no_stops_it_in_any_part() {
    let vectors = measured(|_| [0.0; 3], 5);
    for steps in [1, 3, 9] {
        let mut left = steps;
        let mut observe = |_| {
            left -= 1;
            left > 0
        };
        let stopped = diagnose_observed(&vectors, None, &StudyOptions::default(), &mut observe);
        assert!(matches!(stopped, Err(DiagnoseError::Stopped)), "{steps}");
        assert_eq!(left, 0);
    }
}

/// A component that nobody measured makes no data larger: they are left out in as many parts as those of one component.
#[test]
fn vectors_of_one_component_are_left_out_in_all_their_blocks() {
    let mut generator = ChaCha8Rng::seed_from_u64(3);
    let one = |k: usize| {
        let (x, noise) = (generator.random_range(0.0..0.8), normal(&mut generator));
        ResidualVector {
            position_m: [x, 0.0, 0.0],
            residual_m: [0.0, 0.0, 5e-6 * x + SIGMA_M * noise],
            time_s: Some(k as f64),
            ..ResidualVector::default()
        }
    };
    let vectors: Vec<ResidualVector> = (0..700).map(one).collect();
    let diagnosis = diagnose(&vectors, None, &options()).unwrap();
    assert_eq!((diagnosis.rows, diagnosis.blocks.count, diagnosis.unseen.folds), (700, 8, 8));
}

/// A screw of 9 mm has 88 turns in a stroke of 800 mm: a scan of 20 waves took it for noise, and without a machine none was looked for.
#[test]
fn regress_a_wave_of_whatever_period_is_found_with_its_period_and_amplitude() {
    const PERIOD_M: f64 = 0.009_07;
    let wave: Error = |vector| [3e-6 * (std::f64::consts::TAU * vector.position_m[0] / PERIOD_M + 0.4).sin(), 0.0, 0.0];
    for seed in 0..seeds(6) {
        for machine in [None, Some(machine())] {
            let mut vectors = measured(wave, 900 + seed);
            // With joints and without a machine they are those of a robot, which has no screw along X.
            for vector in vectors.iter_mut().filter(|_| machine.is_none()) {
                vector.covariates.remove("joint_1_deg");
            }
            let diagnosis = diagnose(&vectors, machine.as_ref(), &options()).unwrap();
            let said = names(&diagnosis);
            let period_mm =
                |name: &str| name.strip_prefix("periodic scale error of X, period ")?.strip_suffix(" mm")?.parse().ok();
            let found_mm: Vec<Option<f64>> = said.iter().map(|name| period_mm(name)).collect();
            // Over 800 mm a thousandth is a sixth of a turn.
            let [Some(found_mm)] = found_mm.as_slice() else { panic!("seed {seed}: {said:?}") };
            assert!((found_mm / (1e3 * PERIOD_M) - 1.0).abs() < 1e-3, "seed {seed}: {found_mm}");
            let [sine, cosine] = diagnosis.effects[0].parameters.as_slice() else { panic!("a sine and a cosine") };
            // Of 240 vectors u is σ times the root of 2/240, and the phase is open beside it.
            let amplitude_m = sine.value.hypot(cosine.value);
            assert!((amplitude_m - 3e-6).abs() < 4.0 * SIGMA_M * (2.0_f64 / 240.0).sqrt(), "{amplitude_m}");
            let after = diagnosis.unseen.after.unwrap().rms_um;
            assert!(after < 1.1, "seed {seed}: {after}");
        }
    }
}

/// Five waves of X were claimed of a robot, each as an effect of a linear axis.
#[test]
fn regress_a_robot_has_no_screw_along_a_coordinate() {
    let wave: Error = |vector| [3e-6 * (700.0 * vector.position_m[0]).sin(), 0.0, 0.0];
    let diagnosis = diagnose(&measured(wave, 31), None, &options()).unwrap();
    assert!(!names(&diagnosis).iter().any(|name| name.contains("periodic")), "{:?}", names(&diagnosis));
}

/// A bridge whose X carriage rolls and pitches in a bend, measured at points of its volume. Times the arm behind it that is a function of two
/// positions, and was called *sag or twist under a travelling carriage*.
#[test]
fn regress_angular_errors_have_their_names_and_are_no_sag() {
    let bend: Error = |vector| {
        let [x, y, z] = vector.position_m;
        let (roll_rad, pitch_rad) = (30e-6 * (4.0 * x).sin(), 40e-6 * x * (0.8 - x) + 10e-6 * x);
        [pitch_rad * z, -roll_rad * z, roll_rad * y]
    };
    for seed in 0..seeds(2) {
        let diagnosis = study(bend, 1200 + seed);
        let found = names(&diagnosis);
        let has = |name: &str| found.iter().any(|found| found.starts_with(name));
        assert!(
            has("angular error EAX of X about X") && has("angular error EBX of X about Y"),
            "seed {seed}: {found:?}"
        );
        assert!(!found.iter().any(|name| name.contains("sag")), "seed {seed}: {found:?}");
        let after = diagnosis.after.held_out.rms_um;
        assert!(after < 1.15, "seed {seed}: {after}, {found:?}");
    }
}
