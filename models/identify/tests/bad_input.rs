//! Contradictory, incomplete and impossible campaigns end in an error that names the place and the remedy.
//!
//! Place in the flow: the whole of identification on campaigns of the virtual machine, each spoilt in one way.

use crate::common::{Case, INSTRUMENT, SPLINE, state};
use abbe_geometry::Vector3;
use abbe_geometry::correct::correct;
use abbe_identify::station_start::start;
use abbe_identify::verdict::{Cause, Finding, Grade, Subject, Verdict, of_campaign, widened};
use abbe_identify::{Identified, IdentifyError, IdentifyOptions, identify};
use abbe_measurement::campaign::{Campaign, RangeReading};
use abbe_virtual_machine::TruthRecipe;
use abbe_virtual_machine::instrument::Outliers;
use abbe_virtual_machine::{SimulationConfig, simulate_campaign};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn case() -> Case {
    Case::case_like(TruthRecipe { seed: 14, ..TruthRecipe::default() }.bridge_xyz().unwrap(), SPLINE, 91)
}

/// The error of the campaign with some of its readings changed.
fn error_with(case: &Case, mut change: impl FnMut(&Campaign, &mut RangeReading)) -> IdentifyError {
    let original = case.campaign();
    let mut campaign = original.clone();
    campaign.readings.iter_mut().for_each(|reading| change(original, reading));
    assert_ne!(&campaign, original);
    case.try_identify(&campaign, &IdentifyOptions::default()).err().unwrap()
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
    let error = case.try_identify(&campaign, &IdentifyOptions::default()).unwrap_err();
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

/// Half of such campaigns could not be placed, the others blamed one line; of a zero nothing was said.
#[test]
fn regress_a_tracer_set_to_zero_at_each_line_is_named() {
    let case = case();
    let mut firsts = std::collections::BTreeMap::new();
    case.campaign().readings.iter().for_each(|r| {
        firsts.entry((r.station, r.line)).or_insert(r.length_m);
    });
    let error = error_with(&case, |_, r| r.length_m -= firsts[&(r.station, r.line)]);
    let text = error.to_string();
    assert!(text.contains("station S1: its lengths begin anew at ") && text.contains("set to zero"), "{text}");
    assert!(text.contains("a station name for each line is no way out"), "{text}");
}

/// The last line before was blamed, with its offsets and its station name.
#[test]
fn regress_a_tracer_set_to_zero_once_is_named_with_its_reading() {
    let case = case();
    for (station, share) in [(1, 0.5), (2, 0.4), (3, 0.65)] {
        let own = places(case.campaign(), station);
        let at = own[(share * own.len() as f64) as usize];
        let shown_m = case.campaign().readings[at].length_m;
        let mut campaign = case.campaign().clone();
        let after = campaign.readings.iter_mut().enumerate().filter(|(k, r)| *k >= at && r.station == station);
        after.for_each(|(_, r)| r.length_m -= shown_m);
        let text = case.try_identify(&campaign, &IdentifyOptions::default()).unwrap_err().to_string();
        let between = format!("its lengths begin anew between readings {at} and {}", at + 1);
        assert!(text.contains(&between) && text.contains("set to zero again"), "{text}");
    }
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
        let error = case.try_identify(&campaign, &IdentifyOptions::default()).unwrap_err();
        assert_eq!(error, IdentifyError::NotFinite { reading: 42, what });
    }
}

#[test]
fn too_few_readings_are_counted_against_the_unknowns() {
    let case = case();
    let mut campaign = case.campaign().clone();
    campaign.readings = campaign.readings.iter().step_by(12).copied().collect();
    let error = case.try_identify(&campaign, &IdentifyOptions::default()).unwrap_err();
    let readings = campaign.readings.len();
    // 12 functions of 14 and 6 of 13 coefficients, three squareness angles, three of the ram, five stations.
    assert_eq!(error, IdentifyError::TooFewReadings { readings, unknowns: 12 * 14 + 6 * 13 + 3 + 3 + 20 });
}

#[test]
fn stations_without_enough_readings_are_named() {
    let case = case();
    let mut campaign = case.campaign().clone();
    let keep = campaign.readings.iter().position(|r| r.station == 4).unwrap() + 3;
    campaign.readings.truncate(keep);
    let error = case.try_identify(&campaign, &IdentifyOptions::default()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "station S5: 3 readings cannot place a station (at least 5 are needed); measure more points from it"
    );
    let empty = case.try_identify(&Campaign::default(), &IdentifyOptions::default()).unwrap_err();
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
        let error = case.try_identify(&campaign, &IdentifyOptions::default()).unwrap_err();
        assert_eq!(error, IdentifyError::Dangling { reading: 7, what, index });
    }
}

#[test]
fn an_unsettled_fit_is_an_error_and_not_a_model() {
    let case = case();
    let error = case
        .try_identify(case.campaign(), &IdentifyOptions { max_passes: 1, ..IdentifyOptions::default() })
        .unwrap_err();
    assert!(matches!(error, IdentifyError::NotConverged { passes: 1, largest_step } if largest_step > 1.0), "{error}");
    assert!(error.to_string().contains("not converged after 1 passes"), "{error}");
}

#[test]
fn the_observer_sees_every_pass_and_can_stop() {
    let case = case();
    let mut seen = Vec::new();
    let stopped =
        identify(&case.machine, INSTRUMENT.range, case.campaign(), &IdentifyOptions::default(), &mut |progress| {
            seen.push(progress.pass);
            progress.pass < 2
        });
    assert_eq!(stopped.err().unwrap(), IdentifyError::Stopped);
    assert_eq!(seen, [1, 2]);
}

/// The fit of the campaign with its readings changed, and what it says against itself.
fn judged(case: &Case, change: impl FnMut((usize, &mut RangeReading))) -> (Identified, Verdict, Campaign) {
    let mut campaign = case.campaign().clone();
    campaign.readings.iter_mut().enumerate().for_each(change);
    let fit = case.try_identify(&campaign, &IdentifyOptions::default()).unwrap();
    let verdict = of_campaign(&campaign, &fit);
    verdict.findings.iter().for_each(|finding| println!("{}: {finding}", finding.grade.name()));
    (fit, verdict, campaign)
}

fn rejected(verdict: &Verdict) -> &Finding {
    verdict.findings.iter().find(|finding| matches!(finding.subject, Subject::Rejected { .. })).unwrap()
}

fn to_step(value_m: f64, step_m: f64) -> f64 {
    (value_m / step_m).round() * step_m
}

#[test]
fn regress_positions_rounded_to_a_millimetre_are_refused_and_what_is_accepted_has_an_honest_uncertainty() {
    let case = case();
    for step_m in [1e-3, 1e-4] {
        let (fit, verdict, _) = judged(&case, |(_, r)| r.reading_m = r.reading_m.map(|v| to_step(v, step_m)));
        assert!(verdict.is_refused());
        let rounded = verdict.of(Grade::Refusal).flat_map(|finding| &finding.causes).find_map(|cause| match cause {
            Cause::Rounded { columns, step_m } => Some((columns.clone(), *step_m)),
            _ => None,
        });
        let (columns, found_m) = rounded.unwrap();
        assert!((found_m / step_m - 1.0).abs() < 1e-9 && columns.contains(&"x_mm"), "{columns:?}, {found_m}");
        let model = widened(fit.model, verdict.widening).unwrap();
        let (mut held, mut all) = (0, 0);
        for point in case.verification(300) {
            let correction = correct(&model, &state(&point));
            let error_m = correction.position_m - Vector3::from(point.actual_in_machine_m);
            let variance_m2 = correction.covariance_m2.unwrap();
            held += (0..3).filter(|d| error_m[*d].abs() < 1.96 * variance_m2[(*d, *d)].sqrt()).count();
            all += 3;
        }
        println!("{step_m} m: {held} of {all} within the stated 95 % interval");
        assert!(held * 100 > all * 90, "{held} of {all} within the stated 95 % interval");
    }
}

/// Places of a station's readings in the campaign.
fn places(campaign: &Campaign, station: u32) -> Vec<usize> {
    (0..campaign.readings.len()).filter(|k| campaign.readings[*k].station == station).collect()
}

#[test]
fn regress_a_station_that_moved_midway_is_named_with_its_instant_and_agrees_when_split() {
    let case = case();
    let own = places(case.campaign(), 2);
    let at = own[own.len() * 3 / 5];
    let station_m = Vector3::from(case.simulated.truth.stations_m[2]);
    let moved_m = Vector3::new(60e-6, -30e-6, 40e-6);
    let shift = |r: &RangeReading| {
        let sight = (Vector3::from(r.reading_m) + Vector3::from(r.offset_m) - station_m).normalize();
        -sight.dot(&moved_m)
    };
    let move_station = |(k, r): (usize, &mut RangeReading)| {
        if r.station == 2 && k >= at {
            r.length_m += shift(r);
        }
    };
    let (fit, verdict, mut campaign) = judged(&case, move_station);
    let finding = rejected(&verdict);
    assert_eq!(finding.grade, Grade::Refusal);
    let [Cause::Step { station, readings, moved_m: Some(found_m), .. }] = finding.causes.as_slice() else {
        panic!("{finding}")
    };
    assert_eq!((station.as_str(), *readings), ("S3", (at, at + 1)), "{} rejected", fit.evidence.rejected.len());
    assert!((found_m - moved_m).norm() < 20e-6, "{found_m:?}");
    // As the message says: a station name of their own.
    campaign.stations.push("S3b".to_owned());
    let last = campaign.stations.len() as u32 - 1;
    campaign
        .readings
        .iter_mut()
        .enumerate()
        .filter(|(k, r)| r.station == 2 && *k >= at)
        .for_each(|(_, r)| r.station = last);
    let split = case.try_identify(&campaign, &IdentifyOptions::default()).unwrap();
    // The load of this plan is at one station; nothing contradicts anything.
    let findings = of_campaign(&campaign, &split).findings;
    let [Finding { grade: Grade::Message, subject: Subject::ByStation { names }, .. }] = findings.as_slice() else {
        panic!("{findings:?}")
    };
    assert_eq!(*names, ["load_kg"]);
}

#[test]
fn regress_an_interrupted_beam_is_told_from_a_moved_station_whatever_its_size() {
    let case = case();
    let own = places(case.campaign(), 1);
    let at = own[own.len() / 2];
    let interrupt = |size_m: f64| {
        move |(k, r): (usize, &mut RangeReading)| {
            if r.station == 1 && k >= at {
                r.length_m += size_m;
            }
        }
    };
    let (_, verdict, _) = judged(&case, interrupt(-80e-6));
    let [Cause::Step { station, readings, moved_m: None, dead_path_m, .. }] = rejected(&verdict).causes.as_slice()
    else {
        panic!("{}", rejected(&verdict))
    };
    assert_eq!((station.as_str(), *readings), ("S2", (at, at + 1)));
    assert!((dead_path_m - 80e-6).abs() < 10e-6, "{dead_path_m}");
    // Centimetres contradict the station's other lines.
    let mut campaign = case.campaign().clone();
    campaign.readings.iter_mut().enumerate().for_each(interrupt(0.013));
    let text = case.try_identify(&campaign, &IdentifyOptions::default()).unwrap_err().to_string();
    assert!(
        text.contains("the beam was interrupted") && text.contains(&format!("readings {at} and {}", at + 1)),
        "{text}"
    );
}

#[test]
fn regress_one_bad_line_and_one_bad_offset_are_named() {
    let case = case();
    let line = case.campaign().readings[places(case.campaign(), 3)[150]].line;
    let (_, verdict, campaign) = judged(&case, |(_, r)| {
        if r.line == line {
            r.length_m += 50e-6 * (1.0 + r.reading_m[0]);
        }
    });
    let [Cause::Lines { lines }] = rejected(&verdict).causes.as_slice() else { panic!("{}", rejected(&verdict)) };
    assert_eq!(lines[0].0, campaign.lines[line as usize]);
    // A reflector on its holder, a tenth of a millimetre off.
    let offset_m = case.campaign().readings.iter().map(|r| r.offset_m).find(|o| o[1] != 0.0).unwrap();
    let loose =
        |r: &RangeReading| if r.offset_m == offset_m { Vector3::new(0.0, 0.2e-3, 0.1e-3) } else { Vector3::zeros() };
    let stations_m = &case.simulated.truth.stations_m;
    let (_, verdict, _) = judged(&case, |(k, r)| {
        let sight = (Vector3::from(r.reading_m) - Vector3::from(stations_m[r.station as usize])).normalize();
        r.length_m += sight.dot(&loose(r)) * if k.is_multiple_of(2) { 1.0 } else { 0.3 };
    });
    assert!(verdict.is_refused());
    assert!(rejected(&verdict).causes.iter().any(|cause| matches!(cause, Cause::Offset { .. } | Cause::Lacks)));
}

/// A fit that takes up a part of a motion rejects some of the lines after it; these were told one by one, with a collision as their cause.
#[test]
fn regress_lines_on_one_side_of_an_instant_are_told_as_a_station_that_moved() {
    let case = case();
    let own = places(case.campaign(), 1);
    let mut lines: Vec<u32> = own.iter().map(|place| case.campaign().readings[*place].line).collect();
    lines.dedup();
    let from = lines.len() - 6;
    // The first, second, fourth and sixth of the last six lines: what is left of a motion in those that see it most.
    let off: Vec<u32> = [0, 1, 3, 5].iter().map(|k| lines[from + k]).collect();
    let (_, verdict, campaign) = judged(&case, |(k, r)| {
        if off.contains(&r.line) {
            r.length_m += if k.is_multiple_of(2) { 60e-6 } else { -50e-6 };
        }
    });
    let found = rejected(&verdict);
    let [Cause::OneSide { station, lines: named, is_after: true, suspects: (4, 4), .. }, Cause::Lines { .. }] =
        found.causes.as_slice()
    else {
        panic!("{found}")
    };
    let name = |line: u32| campaign.lines[line as usize].as_str();
    assert_eq!((station.as_str(), named.0.as_str()), ("S2", name(lines[from - 1])));
    assert_eq!(named.1, name(lines[from]));
    assert!(found.to_string().contains("Likely: station S2 moved, or its zero changed, at about"), "{found}");
}

/// Second and third offset of a campaign wrong by 0.1 mm: the refusal spoke of uncertainties and of effects alone.
#[test]
fn regress_a_misfit_where_there_are_several_offsets_names_them() {
    let case = case();
    let stations_m = case.simulated.truth.stations_m.clone();
    let (_, verdict, _) = judged(&case, |(_, r)| {
        let off_m = match r.offset_m {
            [x, ..] if x != 0.0 => Vector3::new(0.1e-3, 0.05e-3, -0.06e-3),
            [_, y, _] if y != 0.0 => Vector3::new(0.04e-3, -0.08e-3, 0.06e-3),
            _ => Vector3::zeros(),
        };
        let sight = (Vector3::from(r.reading_m) - Vector3::from(stations_m[r.station as usize])).normalize();
        r.length_m += sight.dot(&off_m);
    });
    let refusal = verdict.refusal().unwrap();
    assert!(refusal.contains("offsets is not what the campaign says"), "{refusal}");
    assert!(refusal.contains("--accept-misfit, and abbe diagnose after it"), "{refusal}");
}

#[test]
fn regress_lengths_in_micrometres_and_a_reversed_axis_are_among_the_causes_named() {
    let case = case();
    let text = error_with(&case, |_, r| r.length_m *= 1e3).to_string();
    assert!(text.contains("micrometres"), "{text}");
    let text = error_with(&case, |_, r| r.length_m = -r.length_m).to_string();
    assert!(text.contains("length_mm changes its sign"), "{text}");
    // Mirrored readings fit a mirrored station, but for the offsets: both are named, since the data cannot tell them apart.
    let text = error_with(&case, |_, r| r.reading_m[0] = 0.8 - r.reading_m[0]).to_string();
    assert!(text.contains("x_mm changes its sign") && text.contains("offset_x_mm changes its sign"), "{text}");
}

/// Campaigns without fault, small and large, with gross errors and noise that is not quite what was declared.
#[test]
fn regress_campaigns_without_fault_are_not_refused() {
    let truth = |seed| TruthRecipe { seed, ..TruthRecipe::default() }.bridge_xyz().unwrap();
    let gross = |share: f64| Some(Outliers { fraction: share, size_m: 50e-6 });
    for (seed, noise, outliers, part) in [
        (1, 1.0, None, 1),
        (2, 1.0, gross(0.01), 1),
        (3, 1.5, gross(0.01), 1),
        (4, 1.0 / 1.5, None, 1),
        (5, 1.5, gross(0.01), 8),
    ] {
        let mut case = Case::case_like(truth(seed), SPLINE, seed);
        let range = INSTRUMENT.range;
        let mut instrument = INSTRUMENT;
        instrument.range.constant_m = range.constant_m * noise;
        instrument.range.per_metre = range.per_metre * noise;
        instrument.repeatability_m = instrument.repeatability_m.map(|r| r * noise);
        instrument.outliers = outliers;
        case.config = SimulationConfig { instrument, ..case.config };
        case.simulated = simulate_campaign(&case.config).unwrap();
        let some: Vec<usize> = (0..case.campaign().readings.len()).step_by(part).collect();
        case.simulated.campaign = case.simulated.campaign.part(&some);
        let (fit, verdict, _) = judged(&case, |_| {});
        println!(
            "seed {seed}: {} of {}, χ² per degree of freedom {:.3}",
            fit.evidence.rejected.len(),
            some.len(),
            fit.evidence.chi2_per_dof
        );
        assert!(verdict.grade() < Some(Grade::Warning), "seed {seed}: {:?}", verdict.findings);
    }
}

/// Four stations, each with nine lines through a volume, of which so many of one station bear the name of the one before or after it.
fn mixed_up(seed: u64, from: u32, to: u32, lines: &[u32]) -> Campaign {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut between = |low: f64, high: f64| generator.random_range(low..high);
    let mut campaign =
        Campaign { stations: ["S1", "S2", "S3", "S4"].map(str::to_owned).to_vec(), ..Campaign::default() };
    for station in 0..4 {
        let place_m = Vector3::new(between(-0.3, 1.1), between(0.8, 1.4), between(-0.5, 0.9));
        let dead_path_m = between(0.2, 1.0);
        for line in 0..9 {
            let mut end = || Vector3::new(between(0.0, 0.8), between(0.0, 0.6), between(0.0, 0.6));
            let (first, last) = (end(), end());
            let index = campaign.lines.len() as u32;
            campaign.lines.push(format!("S{}-{line}", station + 1));
            for k in 0..12 {
                let point_m = first + (last - first) * (f64::from(k) / 11.0);
                let of_the_machine_m = 20e-6 * (point_m.x * 7.0).sin();
                let length_m = (point_m - place_m).norm() - dead_path_m + of_the_machine_m;
                let owner = if station == from && lines.contains(&line) { to } else { station };
                let time_s = campaign.readings.len() as f64;
                let (reading_m, offset_m) = (point_m.into(), [0.0; 3]);
                campaign.readings.push(RangeReading {
                    station: owner,
                    line: index,
                    time_s,
                    reading_m,
                    offset_m,
                    length_m,
                });
            }
        }
    }
    campaign
}

#[test]
fn lines_under_the_name_of_another_station_are_named_where_they_keep_it_from_being_placed() {
    let case = case();
    let mut lost = 0;
    for (seed, from, to, lines) in (0..40).flat_map(|seed| {
        [(seed, 2, 1, &[0][..]), (seed, 1, 2, &[8][..]), (seed, 2, 1, &[0, 1][..]), (seed, 1, 2, &[7, 8][..])]
    }) {
        let campaign = mixed_up(seed, from, to, lines);
        let own: Vec<(Vector3<f64>, f64)> = campaign
            .readings
            .iter()
            .filter(|reading| reading.station == to)
            .map(|reading| (reading.reading_m.into(), reading.length_m))
            .collect();
        lost += usize::from(start(&own, false).is_err());
        let error = case.try_identify(&campaign, &IdentifyOptions::default()).err().unwrap();
        let IdentifyError::Contradiction { line, station, explanation, .. } = &error else { panic!("{seed}: {error}") };
        let names: Vec<String> = lines.iter().map(|line| format!("S{}-{line}", from + 1)).collect();
        assert!(names.contains(line) && *station == format!("S{}", to + 1), "{seed}: {error}");
        let cause = format!("with station S{}: correct the station's name", from + 1);
        assert!(explanation.contains(&cause), "{seed}: {error}");
    }
    assert!(lost > 0, "in none of them was a station lost");
}
