//! Machines that step in the middle of their campaign, by a simulator that shares nothing with this project: the step is said with its
//! instant, and the uncertainty of what is corrected afterwards holds it. What is no step is not called one.

use crate::foreign::bench::{Judged, judged};
use crate::foreign::causes::STEPS_AT_S;
use crate::foreign::foreign;
use crate::seeds::{seeds, some_of};
use abbe_diagnose::Explanation;
use abbe_diagnose::{Change, DiagnoseOptions};

fn diagnosed(machine: &str, forms: &[&str], seed: u64) -> Judged {
    judged(machine, forms, seed, &DiagnoseOptions { folds: 0, placebos: 0, ..DiagnoseOptions::default() })
}

/// Machines whose arm creeps.
const CREEPS: [(&str, &str, u64); 8] = [
    ("bridge", "creep:1200", 1),
    ("gantry", "creep:1200", 1),
    ("bridge", "creep:600", 1),
    ("gantry", "creep:2400", 1),
    ("bridge", "creep:1200", 2),
    ("gantry", "creep:1200", 2),
    ("bridge", "creep:600", 2),
    ("gantry", "creep:2400", 2),
];

/// An angle between axes that jumps: intervals held 68 to 75 % after the campaign, and nothing was said.
#[test]
fn regress_a_step_of_squareness_is_said_and_covered() {
    for &(machine, form, seed) in some_of(&[
        ("bridge", "step-square:8", 1),
        ("gantry", "step-square:5", 1),
        ("table", "step-square:16", 1),
        ("bridge", "step-square:30", 2),
    ]) {
        let judged = diagnosed(machine, &[form], seed);
        let step = judged.diagnosis.machine_step.as_ref();
        let step = step.unwrap_or_else(|| panic!("{machine} {form} {seed}: {:?}", judged.diagnosis.steps));
        let (before_s, after_s) = step.times_s;
        assert!((before_s..=after_s).contains(&STEPS_AT_S), "{machine} {form} {seed}: {step:?}");
        assert!(after_s - before_s < 1500.0, "{machine} {form} {seed}: {step:?}");
        assert!(!judged.diagnosis.consistent_with_noise);
        let (before, after) = judged.outcome().inside;
        assert!(after.covered > 0.95 && after.worst_axis > 0.93, "{machine} {form} {seed}: {before:?} {after:?}");
        let found = || judged.diagnosis.found.iter().map(|f| (f.name, &f.shape, f.size_m)).collect::<Vec<_>>();
        assert!(after.rms_m < 1.05 * before.rms_m, "{machine} {form} {seed}: {before:?} {after:?} {:?}", found());
    }
}

/// A scale that was another one from some reading on was called a growth with time, of a time constant longer than the campaign.
#[test]
fn regress_a_step_of_a_scale_is_said_and_covered_and_is_no_growth() {
    for &(machine, form, seed) in some_of(&[("bridge", "step-scale:8", 1), ("gantry", "step-scale:-6", 2)]) {
        let judged = diagnosed(machine, &[form], seed);
        let step = judged.diagnosis.machine_step.as_ref();
        let step = step.unwrap_or_else(|| panic!("{machine} {form} {seed}: {:?}", judged.diagnosis.steps));
        assert!((step.times_s.0..=step.times_s.1).contains(&STEPS_AT_S), "{machine} {form} {seed}: {step:?}");
        let size = form.rsplit(':').next().unwrap().parse::<f64>().unwrap() * 1e-6;
        assert_eq!(step.change, Change::Scales, "{step:?}");
        assert!(
            (step.by[1].0 - size).abs() < 4.0 * step.by[1].1 + 0.1 * size.abs(),
            "{machine} {form} {seed}: {step:?}"
        );
        assert!(step.words().contains("the scales of its axes by X "), "{}", step.words());
        let is_named = judged.diagnosis.found.iter().any(|found| found.kind == Explanation::Attributed);
        assert!(!is_named, "{machine} {form} {seed}: {:?}", judged.names());
        let (before, after) = judged.outcome().inside;
        assert!(after.covered > 0.95 && after.worst_axis > 0.93, "{machine} {form} {seed}: {before:?} {after:?}");
    }
}

/// A scale slips when nearly all is measured. The last lines were outlying ones, and U held 22 to 29 % of the points after the campaign along that axis.
#[test]
fn regress_a_scale_that_slips_in_the_last_lines_stands_in_the_uncertainty() {
    let cases = [("bridge", 14.0, 0.96, 1), ("gantry", 12.0, 0.95, 2), ("bridge", -14.0, 0.97, 3)];
    for &(machine, size, share, seed) in some_of(&cases) {
        let quiet = foreign(machine, &[], seed);
        let at_s = quiet.readings[(share * quiet.readings.len() as f64) as usize].time_s;
        let judged = diagnosed(machine, &[&format!("slip:{size}@{at_s}")], seed);
        let late = judged.diagnosis.late.as_ref();
        let late = late.unwrap_or_else(|| panic!("{machine} {seed}: {:?}", judged.diagnosis.steps));
        assert!(late.words().contains("nothing was measured after them"), "{}", late.words());
        assert!(judged.diagnosis.next_measurements[0].contains("again"), "{:?}", judged.diagnosis.next_measurements);
        let (before, after) = judged.outcome().inside;
        assert!(after.covered > 0.92 && after.worst_axis > 0.8, "{machine} {seed}: {before:?} {after:?}");
        assert_eq!(diagnosed(machine, &[], seed).diagnosis.late, None, "{machine} {seed}");
    }
}

/// What moves the whole machine or one station leaves its geometry as it was.
#[test]
fn regress_what_is_no_step_of_the_machine_is_not_called_one() {
    for (machine, form, seed) in
        [("bridge", "", 1), ("bridge", "ar-0.9", 2), ("bridge", "step-zero:15", 1), ("bridge", "squareness-settles", 1)]
    {
        let judged = diagnosed(machine, &[form], seed);
        assert_eq!(judged.diagnosis.machine_step, None, "{machine} {form} {seed}: {:?}", judged.diagnosis.steps);
    }
}

/// The zero of X jumps while a station stands, which to that station is a bump of its stand the other way. It was a drift of that stand, of which U
/// held 75 % along the axis.
#[test]
fn regress_a_zero_that_jumps_is_a_jump_of_the_stand_or_of_the_machine_and_is_covered() {
    for machine in ["bridge", "gantry", "table"] {
        for seed in 1..=seeds(2) {
            let judged = diagnosed(machine, &["step-zero:2"], seed);
            let jump = judged.diagnosis.found.iter().find(|found| found.name == "stand_jump");
            let jump = jump.unwrap_or_else(|| panic!("{machine} {seed}: {:?}", judged.diagnosis.steps));
            let x = &jump.parameters[0];
            assert!((x.value + 2e-6).abs() < 3.0 * x.u, "{machine} {seed}: {x:?}");
            let (before, after) = judged.outcome().inside;
            assert!(after.rms_m < 1.02 * before.rms_m, "{machine} {seed}: {before:?} {after:?}");
            assert!(after.covered > 0.95 && after.worst_axis > 0.93, "{machine} {seed}: {before:?} {after:?}");
        }
    }
}

/// Somebody runs into the stand, in all directions at once: no scale that lost counts. U was 15 to 30 times too large for it.
#[test]
fn regress_a_stand_that_was_bumped_does_not_widen_what_is_corrected() {
    let cases = [("bridge", 4.0, 1), ("gantry", 10.0, 1), ("table", 4.0, 1), ("bridge", 10.0, 2), ("table", 10.0, 2)];
    let (mut named, tried) = (0, some_of(&cases));
    for &(machine, size_um, seed) in tried {
        let quiet = diagnosed(machine, &[], seed).outcome().inside.1;
        let judged = diagnosed(machine, &[&format!("bump:{size_um}")], seed);
        let (steps, (_, after)) = (&judged.diagnosis.steps, judged.outcome().inside);
        assert!(after.covered > 0.95 && after.worst_axis > 0.93, "{machine} {seed}: {after:?}");
        let Some(jump) = judged.diagnosis.found.iter().find(|found| found.name == "stand_jump") else {
            // So few lines came after it that chance among lines could explain them.
            assert!(steps.iter().any(|step| step.contains("its stand was moved")), "{machine} {seed}: {steps:?}");
            continue;
        };
        named += 1;
        assert_eq!(jump.kind, Explanation::Attributed, "{machine} {seed}: {jump:?}");
        for (parameter, size) in jump.parameters.iter().zip([0.7e-6, -0.5e-6, 0.5e-6].map(|share| share * size_um)) {
            assert!((parameter.value - size).abs() < 4.0 * parameter.u, "{machine} {seed}: {parameter:?}");
        }
        assert!(after.stated_m < 1.3 * quiet.stated_m, "{machine} {seed}: {quiet:?} {after:?}");
        assert!(after.rms_m < 1.2 * quiet.rms_m, "{machine} {seed}: {quiet:?} {after:?}");
    }
    assert!(5 * named >= 2 * tried.len(), "{named} of {}", tried.len());
}

/// An arm that creeps for minutes after its carriage moved was called a jump of a tracer's zero, or of its stand.
#[test]
fn regress_what_creeps_is_no_jump() {
    for &(machine, form, seed) in some_of(&CREEPS) {
        let judged = diagnosed(machine, &[form], seed);
        let found = || judged.diagnosis.found.iter();
        let jumps = found().filter(|found| found.name.ends_with("_jump"));
        let named: Vec<_> = jumps.filter(|found| found.kind == Explanation::Attributed).collect();
        assert!(named.is_empty(), "{machine} {form} {seed}: {:?}", named.iter().map(|f| f.name).collect::<Vec<_>>());
        let (before, after) = judged.outcome().inside;
        assert!(after.covered > 0.95, "{machine} {form} {seed}: {before:?} {after:?}");
    }
}

/// A jump that is so large that the robust fit rejects all that comes after it at the station is in no search; lines were told one by one.
#[test]
fn regress_lines_rejected_up_to_the_end_of_a_station_are_told_as_what_moved_it() {
    for machine in ["bridge", "gantry"] {
        let judged = diagnosed(machine, &["step-zero:15"], 1);
        let said = judged
            .diagnosis
            .steps
            .iter()
            .any(|step| step.contains("lines of station S3") && step.contains("name of their own"));
        assert!(said && !judged.diagnosis.consistent_with_noise, "{machine}: {:?}", judged.diagnosis.steps);
    }
}

/// A squareness settles while the pressure rises. The dependence on pressure that describes it is none: corrected by it, the error was
/// nearly twice that before, and intervals held 62 to 68 %.
#[test]
fn regress_what_went_along_with_the_time_is_in_the_uncertainty_and_corrects_nothing() {
    for seed in [1, 2] {
        let judged = diagnosed("bridge", &["squareness-settles"], seed);
        let found = &judged.diagnosis.found;
        assert!(found.iter().any(|found| found.covariates.iter().any(|name| name == "pressure_hpa")), "{found:?}");
        assert!(found.iter().all(|found| !found.corrects), "{found:?}");
        for (before, after) in [judged.outcome().inside, judged.outcome().beyond] {
            assert!(after.rms_m < 1.1 * before.rms_m, "seed {seed}: {before:?} {after:?}");
            assert!(after.covered > 0.95 && after.worst_axis > 0.93, "seed {seed}: {before:?} {after:?}");
        }
    }
}

/// A squareness that settles by little: whether it is named or not, it is said, and covered.
#[test]
fn regress_what_settles_slowly_is_said_and_covered() {
    let mut said = 0;
    let all = seeds(4);
    for seed in 1..=all {
        let judged = diagnosed("bridge", &["settles:5"], seed);
        let (before, after) = judged.outcome().inside;
        println!("{seed}: {before:?} {after:?} {:?} {:?}", judged.diagnosis.wander, judged.diagnosis.steps);
        said += u64::from(!judged.diagnosis.consistent_with_noise);
        assert!(after.rms_m < 1.1 * before.rms_m, "seed {seed}: {before:?} {after:?}");
        assert!(judged.diagnosis.consistent_with_noise || after.worst_axis > 0.93, "seed {seed}: {before:?} {after:?}");
    }
    assert!(4 * said >= 3 * all, "{said} of {all}");
}

/// A bed that gives way evenly while the humidity rises: a bow under moisture goes with it as well. It was told as the cause, and U held 58 to
/// 65 % along the worst axis.
#[test]
fn regress_a_slow_change_that_goes_with_what_was_logged_is_no_cause_and_stands_in_the_uncertainty() {
    let mut named = 0;
    for &seed in some_of(&[2, 3, 5, 6]) {
        let judged = diagnosed("bridge", &["settling"], seed);
        let found = &judged.diagnosis.found;
        named += usize::from(found.iter().any(|found| found.name == "moisture_bow"));
        assert!(found.iter().all(|found| found.kind == Explanation::Empirical), "seed {seed}: {found:?}");
        let said = judged.diagnosis.slow.words().unwrap_or_default();
        assert!(said.contains("bow under moisture (axis"), "seed {seed}: {said}");
        let (before, after) = judged.outcome().inside;
        println!("{seed}: {before:?} {after:?} {:?}", judged.diagnosis.slow.words());
        assert!(after.rms_m < before.rms_m && after.worst_axis > 0.84, "seed {seed}: {before:?} {after:?}");
        assert!(after.stated_m < 2.0 * after.rms_m, "seed {seed}: {before:?} {after:?}");
    }
    assert!(named > 0, "the test tries nothing");
    // A backlash goes with the side of approach, and with nothing slow.
    let judged = diagnosed("bridge", &["reversal"], 11);
    assert_eq!(judged.names(), ["reversal"]);
    assert_eq!((judged.diagnosis.found[0].kind, judged.diagnosis.slow.words()), (Explanation::Attributed, None));
}

/// At a significance of one in a hundred, none of these machines that stay as they are is said to wander.
#[test]
fn machines_that_stay_as_they_are_do_not_wander() {
    let of = |machine: &str, form: &str| {
        let said = (1..=seeds(3)).filter(|seed| diagnosed(machine, &[form], *seed).diagnosis.wander.is_some());
        said.count()
    };
    let said = [of("bridge", ""), of("gantry", ""), of("table", ""), of("bridge", "ar-0.9")];
    assert_eq!(said, [0; 4]);
}

/// A log that goes by another clock, while a scale expands: a lagged sensor, or two together, stood in for the right one, and were wrong
/// hours later. Of what is in order, or lags, the clock is not blamed.
#[test]
fn regress_a_log_by_another_clock_is_said_and_not_followed() {
    let mut said = 0;
    let all = [(900.0, 1), (-900.0, 1), (900.0, 2), (-900.0, 2), (600.0, 3), (-600.0, 3)];
    let tried = some_of(&all);
    for &(behind_s, seed) in tried {
        let judged = diagnosed("bridge", &["expansion", &format!("clock:{behind_s}")], seed);
        let Some(clock) = &judged.diagnosis.clock else { continue };
        said += 1;
        assert!(clock.shift_s * behind_s < 0.0 && clock.shift_s.abs() < 1000.0, "{behind_s} {seed}: {clock:?}");
        assert!(!judged.diagnosis.found.iter().any(|found| found.name == "scale_expansion"));
        println!("{behind_s} {seed}: {:?}", judged.diagnosis.wander.as_ref().map(|wander| wander.words()));
        let (before, after) = judged.outcome().inside;
        assert!(after.rms_m < 1.02 * before.rms_m, "{behind_s} {seed}: {before:?} {after:?}");
        assert!(after.covered > 0.95 && after.worst_axis > 0.92, "{behind_s} {seed}: {before:?} {after:?}");
    }
    assert!(3 * said >= 2 * tried.len(), "{said} of {}", tried.len());
    // Beside a backlash that stayed in the residual, a log in order was blamed.
    for forms in [&["expansion"][..], &["expansion-y"], &["bend-lag"], &["expansion-y", "reversal"]] {
        for seed in 1..=seeds(2) {
            assert_eq!(diagnosed("bridge", forms, seed).diagnosis.clock, None, "{forms:?} {seed}");
        }
    }
}

/// What comes and goes in cycles and is logged nowhere was hardly said, and U held a third of it. It has no cause here, whatever else was logged.
#[test]
fn regress_cycles_that_nothing_logs_are_said_with_their_period_and_covered() {
    for &(machine, period_s, seed) in some_of(&[("bridge", 1500.0, 1), ("bridge", 900.0, 2), ("gantry", 2000.0, 3)]) {
        let judged = diagnosed(machine, &[&format!("lean-cycle:{period_s}")], seed);
        let wander = judged.diagnosis.wander.as_ref();
        let wander = wander.unwrap_or_else(|| panic!("{machine} {period_s}: {:?}", judged.diagnosis.steps));
        let said = wander.follows.strip_prefix("cycles of ").and_then(|words| words.strip_suffix(" min"));
        let said_s = said.map_or(0.0, |minutes| 60.0 * minutes.parse::<f64>().unwrap());
        assert!((said_s / period_s - 1.0).abs() < 0.1, "{machine} {period_s}: {}", wander.follows);
        let named: Vec<&str> = judged.names();
        let is_named = judged.diagnosis.found.iter().any(|found| found.kind == Explanation::Attributed);
        assert!(!is_named, "{machine} {period_s}: {named:?}");
        let (before, after) = judged.outcome().inside;
        println!("{machine} {period_s}: {before:?} {after:?} {}", wander.words());
        assert!(after.rms_m < 1.05 * before.rms_m, "{machine} {period_s}: {before:?} {after:?}");
        assert!(after.covered > 0.95 && after.worst_axis > 0.93, "{machine} {period_s}: {before:?} {after:?}");
    }
}
