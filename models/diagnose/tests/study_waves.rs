//! Waves of a screw in runs after ISO 230-2, beside its pitch error: named where the plan tells them, never where there is none; and what lies
//! between the targets is within U, whatever it is called. The axes are those of a generator of its own (`common/screw.rs`).

use crate::bridge;
use crate::screw::{Screw, predicted_m};
use crate::seeds::seeds;
use abbe_diagnose::DiagnoseError;
use abbe_diagnose::study::runs::{diagnose, diagnose_observed};
use abbe_diagnose::study::{StudyDiagnosis, StudyOptions};

/// Places between the targets at which a model is held against the axis.
const PLACES: u32 = 200;
/// Share of the period within which a wave is the one that is there: phases agree over the stroke, or it is an alias.
const SAME_PERIOD: f64 = 0.02;

fn of(screw: &Screw) -> StudyDiagnosis {
    diagnose(&screw.runs(), &StudyOptions::default()).unwrap()
}

/// Periods of the waves that were named (m).
fn periods_m(diagnosis: &StudyDiagnosis) -> Vec<f64> {
    let names = diagnosis.effects.iter().map(|effect| effect.name.as_str());
    let words = names.filter_map(|name| name.strip_prefix("periodic error, period "));
    words.map(|word| word.split(' ').next().unwrap().parse::<f64>().unwrap() / 1e3).collect()
}

/// How many of the places between the targets lie within U (k = 2).
fn held(screw: &Screw, diagnosis: &StudyDiagnosis) -> u32 {
    let machine = bridge::machine();
    let (low_m, high_m) = (screw.targets_m[0], screw.targets_m[screw.targets_m.len() - 1]);
    let is_held = |k: &u32| {
        let x_m = low_m + (high_m - low_m) * (f64::from(*k) + 0.5) / f64::from(PLACES);
        let (value_m, u_m) = predicted_m(&diagnosis.terms, &machine, x_m, 1.0);
        // A model is zero at the lowest target, in the mean of both sides.
        let truth_m = screw.error_m(x_m) - screw.error_m(low_m) - 0.5 * screw.play_m;
        (value_m - truth_m).abs() <= 2.0 * u_m
    };
    (0..PLACES).filter(is_held).count() as u32
}

/// Most of such waves were a table of errors target by target: of a pitch error and a wave none explains as much as a table.
#[test]
fn regress_a_wave_beside_a_pitch_error_is_named_with_its_period() {
    let (mut named, mut wrong, mut count) = (0, Vec::new(), 0);
    for targets in [15, 18, 21] {
        for seed in 0..seeds(12) {
            let screw = Screw::new(targets, 100 * targets as u64 + seed);
            let periods_m = periods_m(&of(&screw));
            let is_own = |period_m: &f64| (period_m / screw.wave.1 - 1.0).abs() < SAME_PERIOD;
            count += 1;
            named += usize::from(periods_m.iter().any(is_own));
            if !periods_m.iter().all(is_own) {
                wrong.push((targets, seed, periods_m));
            }
        }
    }
    println!("{named} of {count} waves named");
    assert!(10 * named >= 8 * count && wrong.is_empty(), "{named} of {count}; {wrong:?}");
}

/// Scales whose errors add up from mark to mark, or are drawn anew at each, and smooth ones: a wave goes through much of what few targets
/// show of them.
#[test]
fn what_is_no_wave_is_called_none() {
    let (mut alarms, mut count) = (Vec::new(), 0);
    for targets in [13, 15, 21] {
        for seed in 0..seeds(24) {
            let mut screw = Screw::new(targets, 500 + 100 * targets as u64 + seed);
            screw.wave.0 = 0.0;
            match seed % 4 {
                0 => screw.walk_m = 2e-6,
                1 => screw.marks_m = 3e-6,
                2 => screw.bow_m = [8e-6, -5e-6, 3e-6],
                _ => {}
            }
            count += 1;
            let periods_m = periods_m(&of(&screw));
            if !periods_m.is_empty() {
                alarms.push((targets, seed, periods_m));
            }
        }
    }
    assert!(20 * alarms.len() <= count.max(20), "{} of {count}: {alarms:?}", alarms.len());
}

/// U held 87 % of what lies between the targets, of waves that were not told and of rough scales.
#[test]
fn regress_what_lies_between_the_targets_is_within_u() {
    let (mut inside, mut all) = (0, 0);
    for targets in [9, 11, 13, 15, 21] {
        for seed in 0..seeds(18) {
            let mut screw = Screw::new(targets, 900 + 100 * targets as u64 + seed);
            match seed % 3 {
                0 => {}
                1 => (screw.wave.0, screw.walk_m) = (0.0, 2e-6),
                _ => (screw.wave.0, screw.marks_m) = (0.0, 3e-6),
            }
            let diagnosis = of(&screw);
            if diagnosis.effects.iter().any(|effect| effect.name.starts_with("reversal")) {
                (inside, all) = (inside + held(&screw, &diagnosis), all + PLACES);
            }
        }
    }
    let share = f64::from(inside) / f64::from(all);
    println!("{share:.3} of {all} places within U");
    assert!(share > 0.92, "{share}");
}

/// Ctrl-C ended a study without a trace of what it had found.
#[test]
fn regress_a_study_that_is_stopped_gives_what_it_had_found() {
    let runs = Screw::new(15, 3).runs();
    let whole = diagnose(&runs, &StudyOptions::default()).unwrap();
    assert!(!whole.is_stopped && whole.effects.len() > 1);
    let mut steps = 0;
    diagnose_observed(&runs, &StudyOptions::default(), &mut |_| {
        steps += 1;
        true
    })
    .unwrap();
    let mut kept = 0;
    for last in 0..steps {
        let mut asked = 0;
        let stopped = diagnose_observed(&runs, &StudyOptions::default(), &mut |_| {
            asked += 1;
            asked <= last
        });
        match stopped {
            Err(error) => assert!(matches!(error, DiagnoseError::Stopped) && kept == 0, "{last}: {error}"),
            Ok(part) => {
                kept += 1;
                assert!(part.is_stopped && !part.effects.is_empty() && !part.terms.list.is_empty(), "{last}");
                assert!(part.unseen.before.is_none() && part.unseen.missing_because.is_some());
                assert!(part.notes[0].contains("stopped on request"), "{:?}", part.notes);
                assert!(part.effects.len() <= whole.effects.len() + 1);
            }
        }
    }
    assert!(kept > 3 && kept < steps, "{kept} of {steps}");
}
