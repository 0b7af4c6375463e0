//! Simulated ISO 230-2 runs with and without each effect: what is there is found, and what is not is not.

use crate::bridge;
use crate::screw;
use crate::screw::predicted_at_m;
use crate::seeds::{one_in_twenty, seeds};
use abbe_diagnose::study::runs::{Approach, Run, diagnose, positions};
use abbe_diagnose::study::{LeftOver, StudyDiagnosis, StudyOptions, Terms};
use abbe_geometry::unseen_expansion::UnseenExpansion;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

const SIGMA_M: f64 = 0.5e-6;

/// Error (m) of an approach: target (m), sign, time (s), scale temperature (°C).
type Error = fn(f64, f64, f64, f64) -> f64;

/// Plan of a campaign.
#[derive(Clone, Copy)]
struct Plan {
    targets: usize,
    irregular: bool,
}

const PLAN: Plan = Plan { targets: 15, irregular: true };

fn normal(generator: &mut ChaCha8Rng) -> f64 {
    let (a, b): (f64, f64) = (generator.random(), generator.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
}

/// Five cycles up and down over 0.7 m; the scale warms in waves that the cycles do not follow.
fn measured(plan: Plan, error: Error, seed: u64) -> Vec<Run> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let step_m = 0.7 / (plan.targets as f64 - 1.0);
    let jitter =
        |generator: &mut ChaCha8Rng| if plan.irregular { 0.6 * (generator.random::<f64>() - 0.5) } else { 0.0 };
    let targets: Vec<f64> = (0..plan.targets).map(|k| (k as f64 + jitter(&mut generator)) * step_m).collect();
    let mut runs = Vec::new();
    for cycle in 1..=5 {
        for approach in [Approach::Positive, Approach::Negative] {
            let mut order = targets.clone();
            if approach == Approach::Negative {
                order.reverse();
            }
            for target_m in order {
                let time_s = 12.0 * runs.len() as f64;
                let scale_c = 21.0 + 0.8 * (time_s / 260.0).sin();
                let true_error = error(target_m, approach.sign(), time_s, scale_c);
                let measured_m = target_m + 3e-6 + true_error + SIGMA_M * normal(&mut generator);
                let covariates: BTreeMap<String, f64> = [
                    ("temp_scale_x_c".to_owned(), scale_c),
                    ("humidity_pct".to_owned(), generator.random_range(40.0..50.0)),
                ]
                .into();
                let time_s = Some(time_s);
                runs.push(Run { axis: "X".to_owned(), target_m, approach, cycle, measured_m, time_s, covariates });
            }
        }
    }
    runs
}

fn study(plan: Plan, error: Error, seed: u64) -> StudyDiagnosis {
    diagnose(&measured(plan, error, seed), &StudyOptions::default()).unwrap()
}

fn names(diagnosis: &StudyDiagnosis) -> Vec<&str> {
    diagnosis.effects.iter().map(|effect| effect.name.as_str()).collect()
}

#[test]
fn nothing_is_found_on_clean_axes() {
    let mut alarms = Vec::new();
    for seed in 0..seeds(40) {
        let plan = Plan { targets: 11 + (seed % 3) as usize * 5, irregular: seed % 2 == 0 };
        let diagnosis = study(plan, |_, _, _, _| 0.0, seed);
        if !diagnosis.consistent_with_noise {
            alarms.push((seed, names(&diagnosis).join(", "), diagnosis.lack_of_fit));
        }
    }
    assert!(alarms.len() <= one_in_twenty(seeds(40)), "more than 5 %: {alarms:?}");
}

/// In all seeds but one in twenty exactly one effect, of that name, with the noise left and unseen cycles better.
#[track_caller]
fn assert_found(error: Error, wanted: &[&str]) {
    let mut wrong = Vec::new();
    for seed in 0..seeds(20) {
        let diagnosis = study(PLAN, error, 1000 + seed);
        let found = names(&diagnosis);
        let left = |of: fn(&LeftOver) -> f64| {
            let square: f64 = diagnosis.left.iter().map(|own| of(own).powi(2)).sum();
            (square / diagnosis.left.len() as f64).sqrt() * 1e6
        };
        // What is told row by row is what is told of all of them.
        assert!((left(|own| own.before_m) / diagnosis.before.rms_um - 1.0).abs() < 1e-9);
        assert!((left(|own| own.after_m) / diagnosis.after.rms_um - 1.0).abs() < 1e-9);
        let is_right = found.len() == 1 && wanted.iter().any(|name| found[0].starts_with(name));
        let (before, after) = (diagnosis.before.held_out.rms_um, diagnosis.after.held_out.rms_um);
        let gained = diagnosis.after.estimated_sigma_um < 1.15 * SIGMA_M * 1e6 && after < 0.85 * before;
        if !(is_right && gained) {
            wrong.push((seed, found.join(" + "), before, after));
        }
    }
    assert!(wrong.len() <= one_in_twenty(seeds(20)), "{wrong:?}");
}

#[test]
fn a_smooth_position_error_is_found() {
    assert_found(|x, _, _, _| 2e-6 * (x / 0.7 * 4.0).sin(), &["position"]);
}

#[test]
fn a_constant_reversal_value_is_found() {
    assert_found(|_, sign, _, _| 0.5 * 1.5e-6 * sign, &["reversal value, constant"]);
}

#[test]
fn a_reversal_value_that_grows_along_the_axis_is_found() {
    assert_found(|x, sign, _, _| 0.5 * sign * (0.5e-6 + 3e-6 * x), &["reversal value, degree 1"]);
}

#[test]
fn warming_up_is_found() {
    assert_found(|_, _, t, _| 4e-6 * (1.0 - (-t / 500.0).exp()), &["warm-up", "drift with time"]);
}

/// A screw between a fixed bearing and a floating one, warmed by its own friction: it grows as far as it is long.
#[test]
fn a_screw_that_warms_up_is_found() {
    let mut found = 0;
    for seed in 0..seeds(20) {
        let diagnosis = study(PLAN, |x, _, t, _| 9e-6 * x / 0.7 * (1.0 - (-t / 450.0).exp()), 3000 + seed);
        let is_warm_up = |name: &&str| name.starts_with("warm-up of offset and scale");
        let tau_s =
            names(&diagnosis).into_iter().find(is_warm_up).and_then(|name| name.split(' ').nth(7)?.parse::<f64>().ok());
        found += u64::from(tau_s.is_some_and(|tau_s| (300.0..700.0).contains(&tau_s)));
        let sigma_um = diagnosis.after.estimated_sigma_um;
        assert!(sigma_um < 1.15 * SIGMA_M * 1e6, "seed {seed}: {sigma_um} {:?}", names(&diagnosis));
    }
    assert!(found >= seeds(20) * 9 / 10, "{found} of {}", seeds(20));
}

/// The same with what a load does to the reversal value and to the scale, the load changed between approaches.
#[test]
fn what_a_load_does_to_reversal_and_scale_is_found() {
    type ByLoad = fn(f64, f64, f64) -> f64;
    let cases: [(ByLoad, &str); 2] = [
        (|_, sign, load_kg| 0.5 * sign * 0.01e-6 * load_kg, "reversal value by load_kg"),
        (|x, _, load_kg| 0.02e-6 * load_kg * x / 0.7, "offset and scale by load_kg"),
    ];
    for (by_load, wanted) in cases {
        let mut found = 0;
        for seed in 0..seeds(20) {
            let mut runs = measured(PLAN, |_, _, _, _| 0.0, 2000 + seed);
            let mut generator = ChaCha8Rng::seed_from_u64(seed);
            for run in &mut runs {
                let load_kg = 50.0 * f64::from(generator.random_range(0..5_u8));
                run.measured_m += by_load(run.target_m, run.approach.sign(), load_kg);
                run.covariates.insert("load_kg".to_owned(), load_kg);
            }
            let diagnosis = diagnose(&runs, &StudyOptions::default()).unwrap();
            found += u64::from(names(&diagnosis).iter().any(|name| name.starts_with(wanted)));
            let sigma_um = diagnosis.after.estimated_sigma_um;
            assert!(sigma_um < 1.15 * SIGMA_M * 1e6, "{wanted}, seed {seed}: {sigma_um} {:?}", names(&diagnosis));
        }
        assert!(found >= seeds(20) * 9 / 10, "{wanted}: {found} of {}", seeds(20));
    }
}

#[test]
fn expansion_of_the_scale_is_found() {
    assert_found(|x, _, _, c| 11.5e-6 * (c - 20.0) * (x - 0.1), &["expansion of the scale by temp_scale_x_c"]);
}

#[test]
fn a_periodic_error_is_found_with_its_period() {
    assert_found(
        |x, _, _, _| 1e-6 * (TAU * x / 0.131 + 0.4).sin(),
        &["periodic error, period 13", "periodic error, period 12"],
    );
}

#[test]
fn equal_steps_alias_a_short_period_and_the_study_says_so() {
    let plan = Plan { targets: 21, irregular: false };
    // Step 35 mm; a period of 27 mm looks like one of 1 / (1/27 − 1/35) = 118 mm.
    let diagnosis = study(plan, |x, _, _, _| 1.2e-6 * (TAU * x / 0.027).sin(), 3);
    assert!(names(&diagnosis)[0].starts_with("periodic error, period 11"), "{:?}", names(&diagnosis));
    let said = diagnosis.not_identifiable.iter().find(|item| item.because.contains("equal steps")).unwrap();
    assert!(said.because.contains("26.9") && said.decided_by.contains("irregular"), "{said:?}");
    assert!(diagnosis.untestable.iter().any(|item| item.name.contains("divides the step of 35.000 mm")));
    assert!(diagnosis.hidden.iter().any(|what| what.contains("35.000 mm")), "{:?}", diagnosis.hidden);
    assert!(study(PLAN, |_, _, _, _| 0.0, 3).hidden.is_empty(), "irregular steps hide nothing");
}

/// Waves that are all alike on such a grid told nothing at the periods proposed, and something at others: the program ended with an overflow.
#[test]
fn regress_a_grid_with_gaps_is_studied_and_what_it_hides_is_said() {
    let plan = Plan { targets: 17, irregular: false };
    for seed in 0..seeds(30) {
        let mut runs = measured(plan, |x, _, _, _| 6e-6 * x, seed);
        runs.retain(|run| ![3, 9, 13].contains(&((run.target_m * 16.0 / 0.7).round() as i32)));
        let diagnosis = diagnose(&runs, &StudyOptions::default()).unwrap();
        assert_eq!(names(&diagnosis), ["position, straight, axis X"], "seed {seed}");
        assert!(diagnosis.hidden.iter().any(|what| what.contains("43.750 mm")), "{:?}", diagnosis.hidden);
    }
}

/// The pitch of a screw, a third of the step of targets that are off equal ones by at most 30 % of it.
#[test]
fn regress_a_short_wave_is_not_taken_for_a_long_one() {
    let plan = Plan { targets: 31, irregular: true };
    let mut found = 0;
    for seed in 0..seeds(20) {
        let diagnosis = study(plan, |x, sign, _, _| 1.2e-6 * (TAU * x / 0.008).sin() + sign * 1e-6 - 4e-6 * x, seed);
        let waves: Vec<&str> = names(&diagnosis).into_iter().filter(|name| name.starts_with("periodic")).collect();
        let is_pitch = |name: &&str| name.contains("period 8.00") || name.contains("period 7.99");
        let is_said = diagnosis.not_identifiable.iter().any(|item| item.because.contains("go nearly as well"));
        assert!(waves.iter().all(|name| is_pitch(name) || is_said), "seed {seed}: {waves:?}");
        found += u64::from(waves.iter().any(is_pitch));
    }
    assert!(found >= seeds(20) * 9 / 10, "{found} of {}", seeds(20));
}

#[test]
fn several_effects_are_found_one_after_another() {
    let error: Error =
        |x, sign, _, c| 4e-6 * (x / 0.7) * (1.0 - x / 0.7) + 0.5 * 1.2e-6 * sign + 11e-6 * (c - 20.0) * x;
    let diagnosis = study(PLAN, error, 5);
    let found = names(&diagnosis).join(" + ");
    for part in ["position", "reversal value, constant", "expansion of the scale"] {
        assert!(found.contains(part), "{part} is not in {found}");
    }
    assert_eq!(diagnosis.ladder.len(), diagnosis.effects.len() + 1);
    let rungs: Vec<f64> = diagnosis.ladder.iter().map(|rung| rung.judgement.held_out.rms_um).collect();
    assert!(rungs.windows(2).all(|pair| pair[1] < pair[0]), "{rungs:?}");
    assert!(*rungs.last().unwrap() < 0.58, "{rungs:?}");
    let alpha = diagnosis.effects.iter().flat_map(|e| &e.parameters).find(|p| p.name == "alpha").unwrap();
    assert!((alpha.value - 11e-6).abs() < 4.0 * alpha.u && alpha.u < 1e-6 && alpha.is_plausible(), "{alpha:?}");
}

#[test]
fn what_was_not_measured_is_listed_as_untestable() {
    let mut runs = measured(PLAN, |_, _, _, _| 0.0, 1);
    runs.retain(|run| run.approach == Approach::Positive);
    for run in &mut runs {
        run.covariates.clear();
        run.time_s = None;
    }
    runs[3].covariates.insert("load_kg".to_owned(), 3.0);
    let diagnosis = diagnose(&runs, &StudyOptions::default()).unwrap();
    let listed: Vec<&str> = diagnosis.untestable.iter().map(|item| item.name.as_str()).collect();
    for part in ["reversal value", "drift with time", "expansion of the scale", "dependence on load_kg"] {
        assert!(listed.iter().any(|name| name.starts_with(part)), "{part} is not in {listed:?}");
    }
    assert!(positions(&runs).iter().all(|place| place.reversal_m().is_none()));
}

#[test]
fn two_axes_are_studied_each_by_itself() {
    let mut runs = measured(PLAN, |_, sign, _, _| 0.5 * 2e-6 * sign, 1);
    let other = measured(PLAN, |_, _, _, _| 0.0, 2).into_iter().map(|run| Run { axis: "Y".to_owned(), ..run });
    runs.extend(other);
    let diagnosis = diagnose(&runs, &StudyOptions::default()).unwrap();
    assert_eq!(names(&diagnosis), ["reversal value, constant, axis X"]);
    assert_eq!(diagnosis.blocks.count, 10);
    let reversal: Vec<f64> = positions(&runs).iter().filter(|p| p.axis == "X").filter_map(|p| p.reversal_m()).collect();
    let mean = reversal.iter().sum::<f64>() / reversal.len() as f64;
    assert!((mean - 2e-6).abs() < 0.3e-6, "{mean}");
}

#[test]
fn what_cannot_be_used_is_refused_with_a_remedy() {
    let runs = measured(PLAN, |_, _, _, _| 0.0, 1);
    let two: Vec<Run> = runs.iter().filter(|run| run.cycle < 3).cloned().collect();
    assert!(diagnose(&two, &StudyOptions::default()).unwrap_err().to_string().contains("five cycles"));
    assert!(diagnose(&[], &StudyOptions::default()).unwrap_err().to_string().contains("no runs"));
    let exchanged: Vec<Run> =
        runs.iter().map(|run| Run { target_m: run.measured_m, measured_m: run.target_m, ..run.clone() }).collect();
    assert!(diagnose(&exchanged, &StudyOptions::default()).unwrap_err().to_string().contains("exchanged"));
    let mut broken = runs;
    broken[4].measured_m = f64::INFINITY;
    assert!(diagnose(&broken, &StudyOptions::default()).unwrap_err().to_string().contains("run 5"));
}

/// An axis that was approached from one side corrected the other by the same values, U 0.3 µm, and was wrong by its reversal of 4 µm.
#[test]
fn regress_a_side_that_nobody_measured_stands_in_the_uncertainty() {
    let runs = measured(PLAN, |x, sign, _, _| 8e-6 * x + 0.5 * 4e-6 * sign, 3);
    let both = diagnose(&runs, &StudyOptions::default()).unwrap().terms;
    assert!(both.untold.is_empty() && both.covariates["dir_x"] == (-1.0, 1.0), "{both:?}");
    let down: Vec<Run> = runs.into_iter().filter(|run| run.approach == Approach::Negative).collect();
    let terms = diagnose(&down, &StudyOptions::default()).unwrap().terms;
    assert_eq!(terms.untold, ["X in approaches in +: it was measured in approaches in - only"]);
    // Where nobody says from which side, it may be either.
    assert_eq!(terms.covariates["dir_x"], (-1.0, 1.0));
    let last = terms.list.last().unwrap();
    assert_eq!((last.values.as_slice(), last.shape.0.contains_key("by")), ([0.0].as_slice(), true), "{last:?}");
    let u_m = terms.covariance.last().unwrap().sqrt();
    assert!((1e-5..1e-3).contains(&u_m), "{u_m}");
}

/// Axes measured one after the other while the room got warm: that one of them never saw what another did was said nowhere.
#[test]
fn regress_axes_that_were_measured_at_different_temperatures_are_told() {
    let at = |name: &str, by_c: f64| -> Vec<Run> {
        let warmer = |run: Run| {
            let covariates = run.covariates.iter().map(|(key, value)| match key.as_str() {
                "temp_scale_x_c" => (key.clone(), value + by_c),
                _ => (key.clone(), *value),
            });
            Run { axis: name.to_owned(), covariates: covariates.collect(), ..run }
        };
        measured(PLAN, |x, _, _, _| 8e-6 * x, 4).into_iter().map(warmer).collect()
    };
    let terms = diagnose(&[at("X", 0.0), at("Y", 1.2)].concat(), &StudyOptions::default()).unwrap().terms;
    // What nobody logs may be anything that was seen.
    let (low_c, high_c) = terms.covariates["temp_scale_x_c"];
    assert!((low_c - 20.2).abs() < 0.05 && (high_c - 23.0).abs() < 0.05, "{low_c} {high_c}");
    assert!(terms.apart.len() == 1 && terms.apart[0].starts_with("temp_scale_x_c (X 20."), "{:?}", terms.apart);
    let alike = diagnose(&[at("X", 0.0), at("Y", 0.1)].concat(), &StudyOptions::default()).unwrap().terms;
    assert!(alike.apart.is_empty(), "{:?}", alike.apart);
    let constant = |name: &str, temp_c: f64| {
        let set = |mut run: Run| {
            run.covariates.insert("temp_scale_x_c".to_owned(), temp_c);
            run
        };
        at(name, 0.0).into_iter().map(set).collect::<Vec<Run>>()
    };
    let held = diagnose(&[constant("X", 20.0), constant("Y", 24.0)].concat(), &StudyOptions::default()).unwrap().terms;
    assert_eq!(held.apart, ["temp_scale_x_c (X 20.00 to 20.00, Y 24.00 to 24.00)"]);
    // Nobody knows how X expands: steel is as usual as anything, 0.7 m of it by 4 K.
    let machine = bridge::machine();
    let u_m = |terms: &Terms, scale_c: f64, x_m: f64| {
        screw::predicted_at_m(terms, &machine, x_m, ("temp_scale_x_c", scale_c)).1
    };
    let (own, away) = (u_m(&held, 20.0, 0.7), u_m(&held, 24.0, 0.7));
    assert!(own < 2e-6 && away > 0.5 * 11.5e-6 * 4.0 * 0.35, "{own} {away}");
    let said = |terms: &Terms, axis: &str| {
        terms.untold.iter().any(|what| what.starts_with(&format!("expansion of {axis} by temp_scale_x_c")))
    };
    assert!(said(&held, "X") && said(&held, "Y") && !said(&alike, "X"), "{:?} {:?}", held.untold, alike.untold);
    // Its runs bound what an axis does that saw a kelvin and a half: less is open than where nothing varied.
    let bounded = u_m(&terms, 23.0, 0.7);
    assert!(bounded > 1.2 * u_m(&terms, 21.0, 0.7) && bounded < 0.7 * away * 2.0 / 4.0, "{bounded}");
}

/// What is shown in steps of twice the noise scatters by more than a mean of repeats hides, and rounding is most of it.
#[test]
fn readings_in_whole_steps_are_told_where_rounding_is_much_of_their_scatter() {
    let step_m = 2.0 * SIGMA_M;
    let shown = |step_m: f64| {
        let mut runs = measured(PLAN, |_, _, _, _| 0.0, 7);
        for run in &mut runs {
            run.target_m = (run.target_m * 1e3).round() / 1e3;
            run.measured_m = run.target_m + ((run.measured_m - run.target_m) / step_m).round() * step_m;
        }
        diagnose(&runs, &StudyOptions::default()).unwrap()
    };
    let told =
        |diagnosis: &StudyDiagnosis| diagnosis.looked.iter().find(|look| look.what.starts_with("display")).cloned();
    let coarse = told(&shown(step_m)).unwrap();
    assert!(
        coarse.says.contains("whole multiples of 1.000 µm") && coarse.says.contains("a finer display"),
        "{coarse:?}"
    );
    assert!(coarse.is_noise.is_none());
    assert_eq!(told(&shown(0.1 * SIGMA_M)), None);
}

fn refused(runs: &[Run]) -> String {
    diagnose(runs, &StudyOptions::default()).unwrap_err().to_string()
}

/// Both were candidates of a model's one axis, so that it was corrected twice over: 11.3 µm where 5.6 were due, at U of 1.
#[test]
fn regress_one_axis_under_two_names_is_refused() {
    let mut runs = measured(PLAN, |x, _, _, _| 8e-6 * x, 4);
    let first = runs.len();
    let small = |run: &Run| Run { axis: "x".to_owned(), cycle: run.cycle + 5, ..run.clone() };
    runs.extend(runs.clone().iter().map(small));
    let said = refused(&runs);
    assert!(said.starts_with(&format!("row {}: axis X is called x here", first + 1)), "{said}");
}

/// Two sessions that were each counted from 1 were laid over each other: a step of 30 µm between them was 19 µm of noise.
#[test]
fn regress_cycles_that_stand_twice_are_refused_and_numbered_on_they_show_the_step() {
    let morning = measured(PLAN, |_, _, _, _| 0.0, 4);
    let afternoon = |cycles: i64| {
        let moved = |run: Run| Run {
            measured_m: run.measured_m + 30e-6,
            cycle: run.cycle + cycles,
            time_s: run.time_s.map(|time_s| time_s + 12.0 * morning.len() as f64),
            ..run
        };
        measured(PLAN, |_, _, _, _| 0.0, 4).into_iter().map(moved).collect::<Vec<Run>>()
    };
    let said = refused(&[morning.clone(), afternoon(0)].concat());
    let wanted = format!(
        "row {}: axis X, target {:.4} mm, cycle 1: the approach from this direction (+)",
        morning.len() + 1,
        morning[0].target_m * 1e3
    );
    assert!(said.starts_with(&wanted) && said.contains("number the cycles"), "{said}");
    let told = diagnose(&[morning.clone(), afternoon(5)].concat(), &StudyOptions::default()).unwrap();
    assert!(names(&told).iter().any(|name| name.contains("step between")), "{:?}", names(&told));
    // Rows that were written twice are no second session.
    let copied = diagnose(&[morning.clone(), morning.clone()].concat(), &StudyOptions::default()).unwrap();
    assert_eq!(copied.rows, morning.len());
}

/// Where a line lies was taken for a quantity like a temperature, and no reading had it: every corrected row lacked a covariate.
#[test]
fn regress_positions_of_other_axes_are_no_covariate_of_runs() {
    for name in ["y_mm", "Z_um", "x_m"] {
        let mut runs = measured(PLAN, |x, _, _, _| 8e-6 * x, 4);
        for run in &mut runs {
            run.covariates.insert(name.to_owned(), 250.0 * (run.cycle % 2) as f64);
        }
        let said = refused(&runs);
        assert!(
            said.contains(&format!("column {name} holds positions")) && said.contains("a file of their own"),
            "{said}"
        );
    }
}

/// Each target in its turn, both ways five times, as in a step cycle, while the scale gets warmer.
fn in_turn(error: Error, warming_k: f64, seed: u64) -> Vec<Run> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut runs = Vec::new();
    for k in 0..15 {
        for cycle in 1..=5 {
            for approach in [Approach::Positive, Approach::Negative] {
                let (target_m, time_s) = (f64::from(k) * 0.05, 12.0 * runs.len() as f64);
                let scale_c = 20.2 + warming_k * time_s / 1800.0 + 0.02 * normal(&mut generator);
                let error_m = error(target_m, approach.sign(), time_s, scale_c) + SIGMA_M * normal(&mut generator);
                let covariates = [("temp_scale_x_c".to_owned(), scale_c)].into();
                let (measured_m, time_s) = (target_m + error_m, Some(time_s));
                runs.push(Run { axis: "X".to_owned(), target_m, approach, cycle, measured_m, time_s, covariates });
            }
        }
    }
    runs
}

/// A straight error of position was called a shift of an expansion: of places and temperatures within those measured 22 to 26 % were within U.
#[test]
fn regress_what_goes_with_the_time_goes_with_the_place_where_targets_are_measured_in_turn() {
    let error: Error = |x_m, _, _, scale_c| 12e-6 * x_m + 11.5e-6 * (scale_c - 20.0) * x_m;
    let machine = bridge::machine();
    for (warming_k, seed) in [(2.0, 1), (2.0, 2), (1.0, 3), (1.0, 4)] {
        let diagnosis = diagnose(&in_turn(error, warming_k, seed), &StudyOptions::default()).unwrap();
        let words = "one target was measured after the other";
        let said = diagnosis.hidden.iter().find(|hidden| hidden.contains(words));
        assert!(said.is_some_and(|said| said.contains("temp_scale_x_c")), "{:?}", diagnosis.hidden);
        let mut generator = ChaCha8Rng::seed_from_u64(90 + seed);
        let mut off = Vec::new();
        for _ in 0..300 {
            let (x_m, scale_c) = (generator.random_range(0.0..0.7), 20.2 + warming_k * generator.random::<f64>());
            let (own_m, u_m) = predicted_at_m(&diagnosis.terms, &machine, x_m, ("temp_scale_x_c", scale_c));
            let of = |unseen: &UnseenExpansion| unseen.per_kelvin[0] * (scale_c - unseen.at_c[0]).abs() * (x_m - 0.35);
            let beside_m =
                diagnosis.terms.unseen_expansions.iter().map(of).fold(0.0, |most: f64, own| most.max(own.abs()));
            off.push((error(x_m, 1.0, 0.0, scale_c) - own_m, u_m.hypot(beside_m)));
        }
        // Where the axis is at its first target is a matter of datum.
        let mean_m = off.iter().map(|(off_m, _)| off_m).sum::<f64>() / off.len() as f64;
        let held = off.iter().filter(|(off_m, u_m)| (off_m - mean_m).abs() < 2.0 * u_m).count();
        println!("{warming_k} {seed}: {held} of 300 within U, {:?}", names(&diagnosis));
        assert!(held > 255, "{warming_k} {seed}: {held} of 300 within U, {:?}", names(&diagnosis));
    }
    let there_and_back = study(PLAN, |x_m, _, _, _| 12e-6 * x_m, 1);
    assert!(there_and_back.hidden.iter().all(|hidden| !hidden.contains("one target was measured")));
}

/// A temperature of a model of runs was nowhere held against the others: where it parted from them, 29 to 35 % were within U, as `in_volume`.
#[test]
fn regress_how_temperatures_stood_to_each_other_goes_into_the_model_of_runs() {
    let mut runs = measured(PLAN, |x_m, _, _, scale_c| 11.5e-6 * (scale_c - 20.0) * x_m, 5);
    for run in &mut runs {
        let scale_c = run.covariates["temp_scale_x_c"];
        run.covariates.insert("temp_air_c".to_owned(), scale_c + 0.5);
    }
    let terms = diagnose(&runs, &StudyOptions::default()).unwrap().terms;
    let [difference] = terms.differences.as_slice() else { panic!("{:?}", terms.differences) };
    let size = if difference.name == "temp_air_c" { 0.5 } else { -0.5 };
    assert!((difference.range.0 - size).abs() < 1e-9 && (difference.range.1 - size).abs() < 1e-9, "{difference:?}");
    assert!(terms.unseen_expansions.iter().all(|unseen| unseen.per_kelvin[0] == 0.0), "{:?}", terms.unseen_expansions);
}

/// Of a campaign at one temperature, U held 69 to 79 % two tenths of a kelvin away.
#[test]
fn regress_what_a_campaign_at_one_temperature_leaves_open_of_an_expansion_goes_into_the_model() {
    let mut runs = measured(PLAN, |x_m, _, _, _| 12e-6 * x_m, 6);
    for run in &mut runs {
        run.covariates.insert("temp_scale_x_c".to_owned(), 20.0);
    }
    let terms = diagnose(&runs, &StudyOptions::default()).unwrap().terms;
    let [unseen] = terms.unseen_expansions.as_slice() else { panic!("{:?}", terms.unseen_expansions) };
    assert!((unseen.at_c[0] - 20.0).abs() < 1e-9 && (8e-6..15e-6).contains(&unseen.per_kelvin[0]), "{unseen:?}");
}

/// Five targets of an arm, each from both sides and four times before the next: its errors and its reversal leave steps in time, alone
/// of each other, and both passed for slow noise of 80 µm.
#[test]
fn regress_errors_and_reversal_of_targets_in_their_turn_are_found_together() {
    for seed in 0..seeds(4) {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        let mut runs = Vec::new();
        for target in 0..5 {
            let error_m = 120e-6 * normal(&mut generator);
            let lost_m = -450e-6 + 60e-6 * normal(&mut generator);
            for approach in [Approach::Positive, Approach::Negative] {
                for cycle in 1..=4 {
                    let target_m = 0.17 * f64::from(target);
                    let own_m = error_m + 0.5 * approach.sign() * lost_m + 4e-6 * normal(&mut generator);
                    let time_s = 60.0 * runs.len() as f64 + 400.0 * (runs.len() / 4) as f64;
                    runs.push(Run {
                        axis: "X".to_owned(),
                        target_m,
                        approach,
                        cycle,
                        measured_m: target_m + own_m,
                        time_s: Some(time_s),
                        covariates: BTreeMap::new(),
                    });
                }
            }
        }
        let diagnosis = diagnose(&runs, &StudyOptions::default()).unwrap();
        let found: Vec<&str> = diagnosis.effects.iter().map(|effect| effect.name.as_str()).collect();
        let has = |name: &str| found.iter().any(|found| found.starts_with(name));
        assert!(has("position, target by target") && has("reversal value, target by target"), "seed {seed}: {found:?}");
        assert!(diagnosis.after.rms_um < 6.0, "seed {seed}: {}", diagnosis.after.rms_um);
    }
}
