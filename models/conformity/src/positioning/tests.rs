//! Figures of ISO 230-2 against a case worked out by hand, and data that are no axis.

use super::*;

/// An approach to a target.
pub(crate) fn run(target_m: f64, approach: Approach, cycle: i64, deviation_m: f64) -> Run {
    let measured_m = target_m + deviation_m;
    Run { axis: "X".to_owned(), target_m, approach, cycle, measured_m, time_s: None, covariates: BTreeMap::new() }
}

/// The same deviation at another target.
fn moved(from: &Run, target_m: f64) -> Run {
    run(target_m, from.approach, from.cycle, from.error_m())
}

/// Deviations in µm: for each target the five approaches upwards and downwards.
///
/// By hand, µm. Target 0: ↑ −1 0 1 0 0: mean 0, s = √(2/4) = 0.70711; ↓ 2 2 2 2 2: mean 2, s = 0; B = −2, x̄ = 1.
/// Target 100: ↑ 4 6 5 5 5: mean 5, s = 0.70711; ↓ 3 5 4 2 6: mean 4, s = √(10/4) = 1.58114; B = 1, x̄ = 4.5.
/// Target 200: ↑ 1 1 1 1 1; ↓ 1 1 1 1 1: mean 1, s = 0, B = 0, x̄ = 1. Targets 300 and 400 as 200.
const CASE_UM: [([f64; 5], [f64; 5]); 5] = [
    ([-1.0, 0.0, 1.0, 0.0, 0.0], [2.0; 5]),
    ([4.0, 6.0, 5.0, 5.0, 5.0], [3.0, 5.0, 4.0, 2.0, 6.0]),
    ([1.0; 5], [1.0; 5]),
    ([1.0; 5], [1.0; 5]),
    ([1.0; 5], [1.0; 5]),
];

fn case() -> Vec<Run> {
    let mut list = Vec::new();
    for (k, (up, down)) in CASE_UM.iter().enumerate() {
        for (approach, values) in [(Approach::Positive, up), (Approach::Negative, down)] {
            for (cycle, value) in values.iter().enumerate() {
                // Steps as the standard wants them; no figure depends on them.
                let target_m = 0.1 * k as f64 + [0.0, 3e-3, -2e-3, 0.0, 0.0][k];
                list.push(run(target_m, approach, cycle as i64 + 1, value * 1e-6));
            }
        }
    }
    list
}

fn close(value_m: Option<f64>, expected_um: f64) {
    let value_um = value_m.unwrap() * 1e6;
    assert!((value_um - expected_um).abs() < 1e-9, "{value_um} instead of {expected_um}");
}

#[test]
fn figures_are_those_worked_out_by_hand() {
    let found = evaluate("X", &case()).unwrap();
    let (s_a, s_b) = (0.5_f64.sqrt(), 2.5_f64.sqrt());
    close(found.targets[0].reversal_m(), -2.0);
    close(found.targets[1].mean_m(), 4.5);
    // R_0 = max(2·0.70711 + 0 + 2, 2.828, 0) = 3.414; R_1 = max(1.414 + 3.162 + 1, 2.828, 6.325) = 6.325.
    close(found.targets[0].repeatability_m(), 2.0 * s_a + 2.0);
    close(found.targets[1].repeatability_m(), 4.0 * s_b);
    close(found.reversal_m, 2.0);
    close(found.mean_reversal_m, (-2.0 + 1.0) / 5.0);
    close(found.repeatability_up_m, 4.0 * s_a);
    close(found.repeatability_down_m, 4.0 * s_b);
    close(found.repeatability_m, 4.0 * s_b);
    close(found.systematic_up_m, 5.0);
    close(found.systematic_down_m, 3.0);
    close(found.systematic_m, 5.0);
    close(found.mean_bidirectional_m, 3.5);
    // A↑: 5 + 2·0.70711 − (0 − 2·0.70711); A↓: 4 + 3.16228 − min(4 − 3.16228, 1) = 7.16228 − 0.83772.
    close(found.accuracy_up_m, 5.0 + 4.0 * s_a);
    close(found.accuracy_down_m, 4.0 * s_b);
    // A: max(6.41421, 7.16228) − min(−1.41421, 0.83772).
    close(found.accuracy_m, 4.0 + 2.0 * s_b + 2.0 * s_a);
    assert!(found.departures.is_empty(), "{:?}", found.departures);
}

#[test]
fn one_direction_alone_gives_unidirectional_figures_only() {
    let up: Vec<Run> = case().into_iter().filter(|a| a.approach == Approach::Positive).collect();
    let found = evaluate("X", &up).unwrap();
    close(found.accuracy_up_m, 5.0 + 4.0 * 0.5_f64.sqrt());
    assert_eq!(
        (found.reversal_m, found.accuracy_m, found.repeatability_m, found.systematic_down_m),
        (None, None, None, None)
    );
    assert!(found.departures.iter().any(|d| d.text.contains("fewer than 5 times from each direction")));
}

/// Targets that stand 0.2 mm apart by direction gave a line of dashes, and no reason that helps.
#[test]
fn regress_targets_of_one_direction_each_are_told() {
    let apart = |a: Run| match a.approach {
        Approach::Positive => a,
        Approach::Negative => moved(&a, a.target_m + 2e-4),
    };
    let apart: Vec<Run> = case().into_iter().map(apart).collect();
    let told = evaluate("X", &apart).unwrap().departures;
    assert!(told.iter().any(|d| d.text.contains("upwards alone") && d.text.contains("the same each way")), "{told:?}");
    assert!(!evaluate("X", &case()).unwrap().departures.iter().any(|d| d.text.contains("alone")));
}

#[test]
fn order_of_the_approaches_does_not_matter() {
    let mut turned = case();
    turned.reverse();
    assert_eq!(evaluate("X", &turned).unwrap(), evaluate("X", &case()).unwrap());
}

#[test]
fn what_a_whole_test_lacks_is_named() {
    let few: Vec<Run> = case().into_iter().filter(|a| a.target_m < 0.35 && a.cycle < 5).collect();
    let told: Vec<String> = evaluate("X", &few).unwrap().departures.iter().map(ToString::to_string).collect();
    assert!(told[0].contains("axis X: 5 targets are asked for on 300 mm, there are 4"), "{told:?}");
    assert!(told[1].contains("4 of 4 targets were approached fewer than 5 times"), "{told:?}");
}

#[test]
fn on_more_than_two_metres_one_approach_from_each_direction_gives_b_e_and_m() {
    // Every 250 mm or so on 3 m, 2 µm of play, and a scale that is 1 µm/m long.
    let of_target = |k: u32, approach: Approach, cycle: i64| {
        let target_m = 0.25 * f64::from(k) + 0.004 * f64::from(k * k % 7);
        run(target_m, approach, cycle, 1e-6 * target_m + 1e-6 * approach.sign())
    };
    let both = |k: u32| [Approach::Positive, Approach::Negative].map(|approach| of_target(k, approach, 1));
    let once: Vec<Run> = (0..=12).flat_map(both).collect();
    let found = evaluate("X", &once).unwrap();
    // A micrometre a metre.
    let travel_um = once[24].target_m - once[0].target_m;
    close(found.reversal_m, 2.0);
    close(found.systematic_up_m, travel_um);
    close(found.systematic_m, travel_um + 2.0);
    close(found.mean_bidirectional_m, travel_um);
    assert_eq!((found.repeatability_m, found.accuracy_m, found.accuracy_up_m), (None, None, None));
    assert!(found.departures.is_empty(), "{:?}", found.departures);
    // Fewer targets are no whole test; a second cycle at some gives no repeatability of all.
    let few: Vec<Run> = once.iter().filter(|a| !(0.9..1.3).contains(&a.target_m)).cloned().collect();
    let told: Vec<String> = evaluate("X", &few).unwrap().departures.iter().map(ToString::to_string).collect();
    assert!(told[0].contains("13 targets are asked for on 3016 mm, there are 11"), "{told:?}");
    let one_more: Vec<Run> = once.iter().cloned().chain([of_target(3, Approach::Positive, 2)]).collect();
    assert_eq!(evaluate("X", &one_more).unwrap().repeatability_up_m, None);
    // Two metres that begin at 1.4 mm are 4e-16 longer than two, and no longer axis.
    let two = |target_m: f64| [1, 2].map(|cycle| Run { cycle, ..moved(&once[0], target_m) });
    let two_metres: Vec<Run> = [0.0014, 1.0, 2.0014].into_iter().flat_map(two).collect();
    let told = evaluate("X", &two_metres).unwrap().departures;
    assert!(told.iter().any(|d| d.text.contains("10 targets are asked for")), "{told:?}");
    // On up to 2 m once is not enough.
    let short: Vec<Run> = once.iter().filter(|a| a.target_m < 1.9).cloned().collect();
    assert!(evaluate("X", &short).unwrap_err().to_string().contains("one approach has no scatter"));
}

#[test]
fn data_that_are_no_axis_are_refused_with_their_place() {
    let refused = |spoil: &dyn Fn(&mut Vec<Run>), says: &str| {
        let mut spoilt = case();
        spoil(&mut spoilt);
        let told = evaluate("X", &spoilt).unwrap_err().to_string();
        assert!(told.contains("axis X") && told.contains(says), "{told}");
    };
    refused(&|a| a.clear(), "no approach");
    refused(&|a| a.retain(|a| a.target_m == 0.0), "one target is no axis");
    refused(&|a| a[2].measured_m = f64::NAN, "not a finite number");
    refused(&|a| a[2].target_m = f64::INFINITY, "not a finite number");
    refused(&|a| a[2].measured_m = a[2].target_m + 0.004, "4.000 mm");
    // Metres where millimetres are to stand.
    refused(&|a| a.iter_mut().for_each(|a| *a = moved(a, a.target_m / 1e3)), "the targets span 0.4000 mm");
    refused(&|a| a[2].cycle = 1, "stands twice");
    refused(&|a| a.retain(|a| a.target_m > 0.05 || a.cycle == 1), "one approach has no scatter");
}

#[test]
fn regress_equal_steps_are_no_whole_test() {
    let said = |step_m: &dyn Fn(usize) -> f64| {
        let mut approaches = case();
        approaches.iter_mut().for_each(|a| *a = moved(a, step_m((a.target_m / 0.1).round() as usize)));
        evaluate("X", &approaches).unwrap().departures.iter().map(ToString::to_string).collect::<String>()
    };
    assert!(said(&|k| 0.1 * k as f64).contains("equal steps of 100.000 mm"));
    // Rounding of equal steps does not make them others, a shift of 2 % of the step does.
    assert!(said(&|k| 0.1 * k as f64 + 1e-4 * (k % 2) as f64).contains("equal steps"));
    assert_eq!(said(&|k| 0.1 * k as f64 + 2.5e-3 * (k % 2) as f64), "");
}
