//! A function that the machine file holds at zero is named as the cause of a misfit where the machine has it.

use crate::common;
use crate::common::{Case, INSTRUMENT, SPLINE};
use abbe_geometry::ErrorId;
use abbe_identify::verdict::{Cause, Verdict, ask_held_functions, of_campaign};
use abbe_identify::{IdentifyOptions, identify};
use abbe_measurement::instrument::RangeUncertainty;
use abbe_virtual_machine::TruthRecipe;

fn case(held: &[&str]) -> Case {
    let truth = TruthRecipe { seed: 11, ..TruthRecipe::default() }.bridge_xyz().unwrap();
    let mut case = Case::case_like(truth, SPLINE, 11);
    for name in held {
        case.machine.kinds[ErrorId::from_name(name).unwrap().index()] = None;
    }
    case
}

fn said(case: &Case, instrument: RangeUncertainty) -> (Verdict, Vec<Vec<String>>) {
    let options = IdentifyOptions::default();
    let found = identify(&case.machine, instrument, case.campaign(), &options, &mut |_| true).unwrap();
    let mut verdict = of_campaign(case.campaign(), &found);
    ask_held_functions(&mut verdict, &case.machine, instrument, case.campaign(), &options, &mut |_| true).unwrap();
    let causes = verdict.findings.iter().flat_map(|finding| &finding.causes);
    let named = causes.filter_map(|cause| match cause {
        Cause::Held { errors, .. } => Some(errors.clone()),
        _ => None,
    });
    let named = named.collect();
    (verdict, named)
}

#[test]
fn a_held_function_that_the_machine_has_is_named_before_other_causes() {
    for held in [&["EBX"][..], &["EYX"], &["EBX", "EZY"]] {
        let (verdict, named) = said(&case(held), INSTRUMENT.range);
        assert!(!named.is_empty(), "{held:?}: {verdict:?}");
        for mut errors in named {
            errors.sort();
            let mut wanted = held.to_vec();
            wanted.sort_unstable();
            assert_eq!(errors, wanted, "{verdict:?}");
        }
        let words: Vec<String> = verdict.findings.iter().map(ToString::to_string).collect();
        assert!(words.iter().any(|text| text.contains("at zero: free, ")), "{words:?}");
    }
}

#[test]
fn a_held_function_is_not_named_where_it_explains_nothing() {
    let small = RangeUncertainty {
        constant_m: INSTRUMENT.range.constant_m / 4.0,
        per_metre: INSTRUMENT.range.per_metre / 4.0,
        ..INSTRUMENT.range
    };
    let mut quiet = case(&[]);
    quiet.machine.repeatability_m = [1e-8; 3];
    // Nothing is held.
    let (verdict, named) = said(&quiet, small);
    assert!(!verdict.findings.is_empty() && named.is_empty(), "{verdict:?}");
    // What is held is not there; the noise was declared too small.
    let mut truth = TruthRecipe { seed: 12, ..TruthRecipe::default() }.bridge_xyz().unwrap();
    let mut kinds = [Some(SPLINE); ErrorId::COUNT];
    common::held_zero(&mut truth, &mut kinds, &["EBX", "EAZ"]);
    let mut held = Case::case_like(truth, SPLINE, 12);
    held.machine.kinds = kinds;
    held.machine.repeatability_m = [1e-8; 3];
    let (verdict, named) = said(&held, small);
    assert!(!verdict.findings.is_empty() && named.is_empty(), "{verdict:?}");
}
