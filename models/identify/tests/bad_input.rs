//! Contradictory, incomplete and impossible campaigns end in an error that names the place and the remedy.
//!
//! Place in the flow: the whole of identification on campaigns of the virtual machine, each spoilt in one way.

#![allow(clippy::unwrap_used, clippy::panic)] // a preparation that fails fails its test

mod common;

use abbe_identify::{IdentifyError, Options, identify};
use abbe_measurement::campaign::{Campaign, RangeReading};
use abbe_virtual_machine::TruthRecipe;
use common::{Case, INSTRUMENT, SPLINE};

fn case() -> Case {
    Case::case_like(TruthRecipe { seed: 14, ..TruthRecipe::default() }.bridge_xyz().unwrap(), SPLINE, 91)
}

/// The error of the campaign with some of its readings changed.
fn error_with(case: &Case, mut change: impl FnMut(&Campaign, &mut RangeReading)) -> IdentifyError {
    let original = case.campaign();
    let mut campaign = original.clone();
    campaign.readings.iter_mut().for_each(|reading| change(original, reading));
    assert_ne!(&campaign, original);
    case.try_identify(&campaign, &Options::default()).err().unwrap()
}

/// Lines of a station with an offset in that direction.
fn lines_with_offset(campaign: &Campaign, station: u32, d: usize) -> Vec<u32> {
    let mut lines: Vec<u32> =
        campaign.readings.iter().filter(|r| r.station == station && r.offset_m[d] != 0.0).map(|r| r.line).collect();
    lines.dedup();
    lines
}

/// Checks place and cause of a contradiction; returns its text.
fn contradiction(error: &IdentifyError, campaign: &Campaign, lines: &[u32], cause: &str) -> String {
    let text = error.to_string();
    println!("{text}");
    let IdentifyError::Contradiction { line, station, first, last, residual_mm, .. } = error else { panic!("{text}") };
    let index = campaign.lines.iter().position(|name| name == line).unwrap() as u32;
    assert!(lines.contains(&index), "{line} is not among the spoilt lines: {text}");
    for reading in &campaign.readings[first - 1..*last] {
        assert_eq!((reading.line, &campaign.stations[reading.station as usize]), (index, station));
    }
    assert!(*residual_mm > 2.0 && text.contains(cause), "{text}");
    text
}

#[test]
fn an_offset_with_the_wrong_sign_in_one_line_is_named() {
    let case = case();
    for d in 0..3 {
        let line = lines_with_offset(case.campaign(), 1, d)[1];
        let error = error_with(&case, |_, r| {
            if r.line == line {
                r.offset_m[d] = -r.offset_m[d]
            }
        });
        let cause = format!("correct the sign of offset_{}_mm", ['x', 'y', 'z'][d]);
        let text = contradiction(&error, case.campaign(), &[line], &cause);
        assert!(!text.contains("so do"), "{text}");
    }
}

#[test]
fn wrong_signs_in_several_lines_are_counted() {
    let case = case();
    let lines: Vec<u32> = lines_with_offset(case.campaign(), 2, 0).into_iter().take(4).collect();
    let error = error_with(&case, |_, r| {
        if lines.contains(&r.line) {
            r.offset_m[0] = -r.offset_m[0]
        }
    });
    let text = contradiction(&error, case.campaign(), &lines, "correct the sign of offset_x_mm");
    assert!(text.contains("so do 3 more lines"), "{text}");
}

#[test]
fn wrong_signs_in_half_of_a_station_are_found() {
    let case = case();
    // Every second line with an offset in X: half of those that say anything about its sign.
    let all = lines_with_offset(case.campaign(), 0, 0);
    let half: Vec<u32> = all.iter().copied().step_by(2).collect();
    let error = error_with(&case, |_, r| {
        if half.contains(&r.line) {
            r.offset_m[0] = -r.offset_m[0]
        }
    });
    contradiction(&error, case.campaign(), &half, "correct the sign of offset_x_mm");
    // Half of the lines of the station with the height of the reflector upside down.
    let mut lines = lines_with_offset(case.campaign(), 0, 2);
    lines.truncate(lines.len() / 2);
    let error = error_with(&case, |_, r| {
        if lines.contains(&r.line) {
            r.offset_m[2] = -r.offset_m[2]
        }
    });
    let all = lines_with_offset(case.campaign(), 0, 2);
    contradiction(&error, case.campaign(), &all, "correct the sign of offset_z_mm");
}

#[test]
fn a_line_under_the_name_of_another_station_is_sent_back() {
    let case = case();
    let line = case.campaign().readings.iter().find(|r| r.station == 3).unwrap().line + 4;
    let mut campaign = case.campaign().clone();
    campaign.readings.iter_mut().filter(|r| r.line == line).for_each(|r| r.station = 0);
    let error = case.try_identify(&campaign, &Options::default()).unwrap_err();
    let text = contradiction(&error, &campaign, &[line], "it agrees with station S4: correct the station's name");
    assert!(text.contains("of station S1"), "{text}");
}

#[test]
fn exchanged_columns_are_named_for_a_line_and_for_a_station() {
    let case = case();
    // Y and Z have equal strokes, so that no reading leaves its stroke.
    let line = case.campaign().readings[700].line;
    let error = error_with(&case, |_, r| {
        if r.line == line {
            r.reading_m.swap(1, 2)
        }
    });
    contradiction(&error, case.campaign(), &[line], "when y_mm and z_mm are exchanged");
    let lines: Vec<u32> = case.campaign().readings.iter().filter(|r| r.station == 2).map(|r| r.line).collect();
    let error = error_with(&case, |_, r| {
        if r.station == 2 {
            r.reading_m.swap(1, 2)
        }
    });
    contradiction(&error, case.campaign(), &lines, "when y_mm and z_mm are exchanged");
    // X is longer than Y: exchanged they leave the stroke.
    let error = error_with(&case, |_, r| r.reading_m.swap(0, 1));
    let text = error.to_string();
    assert!(matches!(error, IdentifyError::OutsideStroke { axis: 'Y', .. }), "{text}");
    assert!(text.contains("columns are exchanged") && text.contains("0 … 600 mm"), "{text}");
}

#[test]
fn a_lost_beam_is_named_without_a_wrong_explanation() {
    let case = case();
    let line = case.campaign().readings[1500].line;
    let error = error_with(&case, |_, r| {
        if r.line == line {
            r.length_m += 0.0371
        }
    });
    contradiction(&error, case.campaign(), &[line], "whether the beam was lost");
}

#[test]
fn numbers_that_are_none_are_named_by_row_and_quantity() {
    let case = case();
    type Spoil = fn(&mut RangeReading);
    let spoils: [(Spoil, &str); 4] = [
        (|r| r.reading_m[1] = f64::NAN, "the axis position"),
        (|r| r.offset_m[2] = f64::INFINITY, "the offset"),
        (|r| r.length_m = f64::NEG_INFINITY, "the length"),
        (|r| r.time_s = f64::NAN, "the time"),
    ];
    for (spoil, what) in spoils {
        let mut campaign = case.campaign().clone();
        spoil(&mut campaign.readings[41]);
        let error = case.try_identify(&campaign, &Options::default()).unwrap_err();
        assert_eq!(error, IdentifyError::NotFinite { reading: 42, what });
    }
}

#[test]
fn too_few_readings_are_counted_against_the_unknowns() {
    let case = case();
    let mut campaign = case.campaign().clone();
    campaign.readings = campaign.readings.iter().step_by(12).copied().collect();
    let error = case.try_identify(&campaign, &Options::default()).unwrap_err();
    let readings = campaign.readings.len();
    // 12 functions of 14 and 6 of 13 coefficients, three angles, five stations.
    assert_eq!(error, IdentifyError::TooFewReadings { readings, unknowns: 12 * 14 + 6 * 13 + 3 + 20 });
}

#[test]
fn stations_without_enough_readings_are_named() {
    let case = case();
    let mut campaign = case.campaign().clone();
    let keep = campaign.readings.iter().position(|r| r.station == 4).unwrap() + 3;
    campaign.readings.truncate(keep);
    let error = case.try_identify(&campaign, &Options::default()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "station S5: 3 readings cannot place a station (at least 5 are needed); measure more points from it"
    );
    let empty = case.try_identify(&Campaign::default(), &Options::default()).unwrap_err();
    assert_eq!(empty, IdentifyError::TooFewStations { found: 0 });
}

#[test]
fn a_campaign_that_refers_to_nothing_is_refused() {
    let case = case();
    for (what, index) in [("station", 5), ("line", 9999)] {
        let mut campaign = case.campaign().clone();
        match what {
            "station" => campaign.readings[6].station = index,
            _ => campaign.readings[6].line = index,
        }
        let error = case.try_identify(&campaign, &Options::default()).unwrap_err();
        assert_eq!(error, IdentifyError::Dangling { reading: 7, what, index });
    }
}

#[test]
fn an_unsettled_fit_is_an_error_and_not_a_model() {
    let case = case();
    let error = case.try_identify(case.campaign(), &Options { max_passes: 1, ..Options::default() }).unwrap_err();
    assert!(matches!(error, IdentifyError::NotConverged { passes: 1, largest_step } if largest_step > 1.0), "{error}");
    assert!(error.to_string().contains("not converged after 1 passes"), "{error}");
}

#[test]
fn the_observer_sees_every_pass_and_can_stop() {
    let case = case();
    let mut seen = Vec::new();
    let stopped = identify(&case.machine, INSTRUMENT.range, case.campaign(), &Options::default(), &mut |progress| {
        seen.push(progress.pass);
        progress.pass < 2
    });
    assert_eq!(stopped.err().unwrap(), IdentifyError::Stopped);
    assert_eq!(seen, [1, 2]);
}
