//! Figures of the length test against hand cases, and data that are no test.

use super::*;
use crate::decision::TestUncertainty;
use crate::length::{LINES_E0, Probing};

fn measurement(line: &str, calibrated_mm: f64, repeat: u32, error_um: f64) -> LengthMeasurement {
    LengthMeasurement {
        line: line.to_owned(),
        calibrated_m: calibrated_mm / 1e3,
        repeat,
        error: ObservedError::from_metres(error_um / 1e6),
    }
}

/// Seven lines, four of them named as space diagonals.
const NAMES: [&str; LINES_E0] = ["PPP", "NPP", "PNP", "PPN", "5", "6", "7"];

/// A whole test: error = line/10 + length/1000 + repeat/100, in µm, on seven lines of 600 mm.
fn whole() -> (LengthTest, Vec<LengthMeasurement>) {
    let mut measurements = Vec::new();
    for line in 1..=LINES_E0 {
        for length_mm in [50.0, 150.0, 250.0, 350.0, 450.0] {
            for repeat in 1..=3 {
                let error_um = line as f64 / 10.0 + length_mm / 1000.0 + f64::from(repeat) / 100.0;
                measurements.push(measurement(NAMES[line - 1], length_mm, repeat, error_um));
            }
        }
    }
    let travel_m = NAMES.map(|line| (line.to_owned(), 0.6)).into_iter().collect();
    (LengthTest { tool_offset_m: 0.0, probing: Probing::Bidirectional, travel_m }, measurements)
}

#[test]
fn a_whole_test_has_no_departures_and_the_figures_worked_out_by_hand() {
    let (test, measurements) = whole();
    let errors = evaluate(test, &measurements).unwrap();
    assert!(errors.departures.is_empty(), "{:?}", errors.departures);
    assert_eq!((errors.sets.len(), errors.errors().count()), (35, 105));
    // Line 7 at 450 mm, third repeat: 0.7 + 0.45 + 0.03 µm. Ranges are all 0.02 µm.
    let (largest, line, length_m) = errors.largest();
    assert!((largest.metres() - 1.18e-6).abs() < 1e-15 && line == "7" && length_m == 0.45);
    assert!((errors.repeatability().unwrap().metres() - 0.02e-6).abs() < 1e-15);
    assert!((errors.lines[2].largest.0.metres() - 0.78e-6).abs() < 1e-15);
    assert_eq!(errors.test.symbol(), "E0");
}

#[test]
fn a_verdict_counts_sets_and_keeps_repeatability_apart() {
    let (test, measurements) = whole();
    let errors = evaluate(test, &measurements).unwrap();
    let limit = |text| MaximumPermissibleError::from_text(text).unwrap();
    let simple = DecisionRule::SimpleAcceptance;
    let verdict = errors.verdict(&limit("0.73+L/1000"), Some(PermissibleError::from_metres(0.03e-6)), &simple);
    assert_eq!((verdict.overall(), verdict.is_whole_test), (Verdict::Conforms, true));
    // Line 7 with 0.725 µm: its third repeat is beyond at all five lengths; with 0.715 the second is as well.
    let verdict = errors.verdict(&limit("0.725+L/1000"), None, &simple);
    assert_eq!(
        (verdict.errors, verdict.sets_with_one_beyond, verdict.sets_with_more_beyond),
        (Verdict::DoesNotConform, 5, 0)
    );
    let verdict = errors.verdict(&limit("0.715+L/1000"), None, &simple);
    assert_eq!((verdict.sets_with_one_beyond, verdict.sets_with_more_beyond), (0, 5));
    let verdict = errors.verdict(&limit("9"), Some(PermissibleError::from_metres(0.01e-6)), &simple);
    assert_eq!((verdict.errors, verdict.overall()), (Verdict::Conforms, Verdict::DoesNotConform));
}

#[test]
fn the_uncertainty_of_the_test_turns_a_narrow_pass_into_doubt() {
    let (test, measurements) = whole();
    let errors = evaluate(test, &measurements).unwrap();
    let limit = MaximumPermissibleError::from_text("0.75+L/1000").unwrap();
    let guarded = DecisionRule::GuardBand(TestUncertainty::expanded(0.05e-6, 0.0).unwrap());
    assert_eq!(errors.verdict(&limit, None, &DecisionRule::SimpleAcceptance).overall(), Verdict::Conforms);
    assert_eq!(errors.verdict(&limit, None, &guarded).overall(), Verdict::Undecided);
}

#[test]
fn the_tightest_limit_holds_all_errors_of_the_test() {
    let (test, measurements) = whole();
    let errors = evaluate(test, &measurements).unwrap();
    // Line 7, third repeat: 0.73 µm + L/1000 touches all five of its points.
    let tightest = errors.frontier().unwrap().smallest_area();
    assert!((tightest.constant_m - 0.73e-6).abs() < 1e-15 && (tightest.per_metre - 1e-6).abs() < 1e-15, "{tightest:?}");
}

#[test]
fn what_a_whole_test_lacks_is_named() {
    let (test, measurements) = whole();
    let says = |test: LengthTest, measurements: Vec<LengthMeasurement>, says: &str| {
        let found = evaluate(test, &measurements).unwrap();
        assert!(found.departures.iter().any(|d| d.to_string().contains(says)), "{says}: {:?}", found.departures);
        let limit = MaximumPermissibleError::from_text("9").unwrap();
        assert!(!found.verdict(&limit, None, &DecisionRule::SimpleAcceptance).is_whole_test);
    };
    let keep = |wanted: fn(&LengthMeasurement) -> bool| measurements.iter().filter(|m| wanted(m)).cloned().collect();
    says(test.clone(), keep(|m| m.line != "5"), "7 measuring lines are asked for, there are 6");
    says(
        test.clone(),
        keep(|m| m.line != "5" || m.calibrated_m != 0.05),
        "line 5: 5 lengths are asked for, there are 4",
    );
    says(test.clone(), keep(|m| m.line != "5" || m.repeat != 2), "line 5: 5 of its lengths were measured fewer than 3");
    let mut longer = test.clone();
    longer.travel_m.insert("5".to_owned(), 0.7);
    says(longer, measurements.clone(), "line 5: the longest length, 450.0 mm, is 64.3 % of the travel of 700.0 mm");
    let mut unknown = test;
    unknown.travel_m.remove("5");
    says(unknown, measurements, "line 5: the travel along it is not given");
}

#[test]
fn exactly_66_percent_is_enough() {
    let (mut test, measurements) = whole();
    test.travel_m.values_mut().for_each(|travel_m| *travel_m = 0.45 / 0.66);
    assert!(evaluate(test, &measurements).unwrap().departures.is_empty());
}

#[test]
fn a_test_with_a_tool_offset_has_two_lines() {
    let (mut test, mut measurements) = whole();
    test.tool_offset_m = 0.15;
    measurements.retain(|m| m.line == "5" || m.line == "6");
    measurements.iter_mut().for_each(|m| m.line = if m.line == "5" { "0PP" } else { "0PN" }.to_owned());
    test.travel_m = ["0PP", "0PN"].map(|line| (line.to_owned(), 0.6)).into_iter().collect();
    let errors = evaluate(test, &measurements).unwrap();
    assert_eq!((errors.test.symbol().as_str(), errors.departures.len()), ("E150", 0));
}

#[test]
fn slips_and_doubles_are_refused_with_their_place() {
    let (test, measurements) = whole();
    let refused = |spoil: &dyn Fn(&mut Vec<LengthMeasurement>), says: &[&str]| {
        let mut spoilt = measurements.clone();
        spoil(&mut spoilt);
        let told = evaluate(test.clone(), &spoilt).unwrap_err().to_string();
        assert!(says.iter().all(|s| told.contains(s)), "{told}");
    };
    refused(&|m| m.clear(), &["no measurement"]);
    refused(
        &|m| m[0].error = ObservedError::from_metres(f64::NAN),
        &["line PPP, 50 mm, repeat 1", "not a finite number"],
    );
    refused(&|m| m[3].calibrated_m = f64::INFINITY, &["not a finite number"]);
    refused(&|m| m[0].error = ObservedError::from_metres(0.0012), &["1.200 mm", "unit"]);
    refused(&|m| m[0].calibrated_m = 50.0e-6, &["calibrated lengths in millimetres"]);
    refused(&|m| m[0].calibrated_m = 450.0, &["no calibrated length"]);
    // Metres where millimetres are to stand.
    refused(
        &|m| m.iter_mut().for_each(|m| m.calibrated_m = 2e-3 + m.calibrated_m / 1e3),
        &["longest length", "metres"],
    );
    refused(&|m| m[1].repeat = 1, &["line PPP, 50 mm, repeat 1", "stands twice"]);
    let again = measurements[4].clone();
    refused(&|m| m.push(again.clone()), &["stands twice"]);
    let mut bad = test.clone();
    bad.tool_offset_m = 150.0;
    assert!(evaluate(bad, &measurements).unwrap_err().to_string().contains("E150"));
    let mut bad = test.clone();
    bad.tool_offset_m = 0.15e-3;
    assert!(evaluate(bad, &measurements).unwrap_err().to_string().contains("0.15 mm is no tool offset"));
    let mut bad = test.clone();
    bad.travel_m.insert("PPP".to_owned(), 0.0);
    assert!(evaluate(bad, &measurements).unwrap_err().to_string().contains("line PPP"));
}

#[test]
fn regress_seven_lines_without_the_four_space_diagonals_are_no_whole_test() {
    let said = |names: [&str; LINES_E0], travel_m: [f64; LINES_E0]| {
        let (mut test, mut measurements) = whole();
        let new = |old: &str| NAMES.iter().position(|name| *name == old).map(|k| names[k].to_owned()).unwrap();
        measurements.iter_mut().for_each(|m| m.line = new(&m.line));
        test.travel_m = names.map(str::to_owned).into_iter().zip(travel_m).collect();
        // 75 % of each travel.
        measurements.iter_mut().for_each(|m| m.calibrated_m *= test.travel_m[&m.line] / 0.6);
        evaluate(test, &measurements).unwrap().departures.iter().map(|d| format!("{d}; ")).collect::<String>()
    };
    let even = [0.6; LINES_E0];
    assert!(said(["A", "B", "C", "D", "E", "F", "PPQ"], even).contains("space diagonals, 0 can be told"));
    // NNN is PPP from the other end.
    assert!(said(["PPP", "NNN", "PNP", "PPN", "E", "F", "G"], even).contains("space diagonals, 3 can be told"));
    // Told by the travel: √(0.36² + 0.36² + 0.4²) = 0.6475.
    let whole_m = [0.6475, 0.6475, 0.6475, 0.6475, 0.36, 0.36, 0.4];
    assert_eq!(said(["a", "b", "c", "d", "X", "Y", "Z"], whole_m), "");
    let short_m = [0.4, 0.6475, 0.6475, 0.6475, 0.36, 0.36, 0.4];
    let says = said(["PPP", "b", "c", "d", "X", "Y", "Z"], short_m);
    assert!(
        says.contains("line PPP") && says.contains("400.0 mm is not the 647.5 mm") && says.contains("3 can be told"),
        "{says}"
    );
}

#[test]
fn regress_a_diagonal_from_both_ends_is_one_of_the_seven_lines() {
    let said = |names: &[&str], asked: usize| {
        let (mut test, measurements) = whole();
        test.tool_offset_m = if asked == 2 { 0.15 } else { 0.0 };
        test.travel_m = names.iter().map(|name| ((*name).to_owned(), 0.6)).collect();
        let of = |name: &str| -> Vec<LengthMeasurement> {
            let own = measurements.iter().filter(|m| m.line == "PPP").cloned();
            own.map(|m| LengthMeasurement { line: name.to_owned(), ..m }).collect()
        };
        let all: Vec<LengthMeasurement> = names.iter().flat_map(|name| of(name)).collect();
        evaluate(test, &all).unwrap().departures.iter().map(|d| format!("{d}.")).collect::<String>()
    };
    assert_eq!(
        said(&["PPP", "NNN", "NPP", "PNN", "PNP", "NPN", "PPN"], 7),
        "test: 7 measuring lines are asked for, there are 4; NNN is PPP from the other end; PNN is NPP from the other end; NPN is PNP \
         from the other end."
    );
    assert!(said(&["PPP", "nnn", "NPP", "PNP", "PPN", "A", "B"], 7).contains("there are 6; nnn is PPP"));
    // From both ends besides the seven is no harm.
    assert_eq!(said(&["PPP", "NNN", "NPP", "PNP", "PPN", "A", "B", "C"], 7), "");
    assert!(said(&["0PP", "0NN"], 2).contains("2 measuring lines are asked for, there are 1; 0NN is 0PP"));
}

#[test]
fn regress_a_length_above_the_travel_of_its_line_is_refused() {
    let told = |travel_m: f64| {
        let (mut test, measurements) = whole();
        test.travel_m.insert("6".to_owned(), travel_m);
        evaluate(test, &measurements).map_err(|error| error.to_string())
    };
    // Metres in the column, and a gauge of another line.
    let metres = told(0.6e-3).unwrap_err();
    assert!(["line 6", "450.0000 mm", "travel of 0.6000 mm", "1000"].iter().all(|s| metres.contains(s)), "{metres}");
    assert!(told(0.40).unwrap_err().contains("longer than the travel of 400.0000 mm"));
    // The whole travel, also where it is stated in whole millimetres.
    assert!(told(0.45).unwrap().departures.is_empty() && told(0.4495).unwrap().departures.is_empty());
}

#[test]
fn regress_ends_that_were_probed_from_one_side_are_no_whole_test() {
    let (mut test, measurements) = whole();
    test.probing = Probing::Unidirectional;
    let errors = evaluate(test, &measurements).unwrap();
    let told: Vec<String> = errors.departures.iter().map(ToString::to_string).collect();
    assert!(told.len() == 1 && told[0].contains("probe from opposite sides: the short calibrated length"), "{told:?}");
    let limit = MaximumPermissibleError::from_text("9").unwrap();
    assert!(!errors.verdict(&limit, None, &DecisionRule::SimpleAcceptance).is_whole_test);
}

/// |E| + U on line 7, third repeat: 0.73 + L/1000 + 0.1 + L/2000 µm; with K = 1000 the longest length, 450 mm, decides.
#[test]
fn regress_the_limit_that_would_do_is_the_one_of_the_decision_rule() {
    let (test, measurements) = whole();
    let errors = evaluate(test, &measurements).unwrap();
    let rule = DecisionRule::GuardBand(TestUncertainty::expanded(0.1e-6, 0.5e-6).unwrap());
    let constant_m = errors.frontier_to_conform(&rule).unwrap().smallest_constant_m(1e-6);
    assert!((constant_m - (0.83e-6 + 0.225e-6)).abs() < 1e-15, "{constant_m}");
    let verdict =
        |constant_m: f64| errors.verdict(&MaximumPermissibleError::new(constant_m, 1e-6).unwrap(), None, &rule).errors;
    assert_eq!((verdict(constant_m), verdict(constant_m - 1e-9)), (Verdict::Conforms, Verdict::Undecided));
    let simple = errors.frontier_to_conform(&DecisionRule::SimpleAcceptance).unwrap();
    assert_eq!(simple, errors.frontier().unwrap());
}

#[test]
fn regress_with_a_tool_offset_the_two_diagonals_of_a_plane_are_asked_for() {
    let said = |lines: [&str; 2]| {
        let (mut test, measurements) = whole();
        test.tool_offset_m = 0.15;
        test.travel_m = lines.iter().map(|line| ((*line).to_owned(), 0.6)).collect();
        let two = measurements.into_iter().filter(|m| ["PPP", "NPP"].contains(&m.line.as_str()));
        let renamed = |mut m: LengthMeasurement| {
            m.line = lines[usize::from(m.line == "NPP")].to_owned();
            m
        };
        let two: Vec<LengthMeasurement> = two.map(renamed).collect();
        evaluate(test, &two).unwrap().departures.iter().map(ToString::to_string).collect::<String>()
    };
    assert_eq!(said(["0PP", "0NP"]), "");
    assert_eq!(said(["P0P", "P0N"]), "");
    assert!(said(["0PP", "P0N"]).contains("diagonals of one plane"));
    assert!(said(["A", "B"]).contains("diagonals of one plane"));
}
