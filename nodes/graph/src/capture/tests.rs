//! Evidence for a capture without a socket: streams of a machine that stands, moves, and is disturbed.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

use super::*;
use crate::step::DerivedMotion;
use abbe_files::{Captured, JournalEntry, MachineFile, PathLine, PathStation, read_machine};
use abbe_msgs::{ScaleReading, Stamp, Text, TracerReading};
use std::path::Path;

const OFFSET_M: [f64; 3] = [0.0, 0.0, -0.06];
const OTHER_M: [f64; 3] = [0.05, 0.0, -0.06];
const STATION_M: [f64; 3] = [-0.3, -0.25, 0.05];
/// Where the tracer really is: not quite where it was planned.
const TRUE_M: [f64; 3] = [-0.302, -0.247, 0.049];
/// Interval of both streams (ns).
const EVERY_NS: i64 = 10_000_000;
const FIRST_NS: i64 = 1_700_000_000_000_000_000;

fn machine() -> MachineFile {
    read_machine(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config/machines/bridge_xyz.toml")).unwrap()
}

fn config(more: &str) -> CaptureConfig {
    let text = format!(
        "machine = \"m.toml\"\nplan = \"plan\"\n\
         scale = {{ kind = \"lines\", from = {{ tcp = \"a:1\" }}, columns = [\"x_mm\", \"y_mm\", \"z_mm\"], offset_mm = [0.0, 0.0, -60.0] }}\n\
         tracer = {{ kind = \"lines\", from = {{ tcp = \"a:2\" }}, columns = [\"station\", \"length_mm\"], u_length_um = 0.2 }}\n{more}"
    );
    toml::from_str(&text).unwrap()
}

fn line(name: &str, from_m: [f64; 3], to_m: [f64; 3], points: usize, offset_m: [f64; 3]) -> PathLine {
    let at =
        |k: usize| std::array::from_fn(|d| from_m[d] + (to_m[d] - from_m[d]) * k as f64 / (points - 1).max(1) as f64);
    PathLine { name: name.to_owned(), points_m: (0..points).map(at).collect(), offset_m, feed_m_s: None }
}

/// Lines of one station that fill a volume.
fn path() -> Vec<PathStation> {
    let lines = vec![
        line("A", [0.1, 0.1, 0.1], [0.6, 0.1, 0.1], 6, OFFSET_M),
        line("B", [0.6, 0.1, 0.2], [0.6, 0.5, 0.2], 5, OFFSET_M),
        line("C", [0.6, 0.5, 0.3], [0.1, 0.1, 0.5], 6, OFFSET_M),
    ];
    vec![PathStation { name: "S1".to_owned(), position_m: STATION_M, lines }]
}

fn stamp(ns: i64) -> Stamp {
    Stamp::from_nanos(ns).unwrap()
}

/// A machine, its tracer, and what came of them.
struct Rig {
    capturer: Capturer,
    ns: i64,
    at_m: [f64; 3],
    offset_m: [f64; 3],
    told_offset_m: [f64; 3],
    station: &'static str,
    true_m: [f64; 3],
    zero_m: f64,
    has_beam: bool,
    frozen_m: Option<f64>,
    tracer_late_ns: i64,
    told: Vec<Told>,
    samples: usize,
}

impl Rig {
    fn new(path: &[PathStation], config: &CaptureConfig) -> Rig {
        let machine = machine();
        let planned = Planned::new(path, &machine.machine, config.points.within_mm / 1e3).unwrap();
        Rig {
            capturer: Capturer::new(config, planned, &machine),
            ns: FIRST_NS,
            at_m: [0.0; 3],
            offset_m: OFFSET_M,
            told_offset_m: OFFSET_M,
            station: "S1",
            true_m: TRUE_M,
            zero_m: 0.713,
            has_beam: true,
            frozen_m: None,
            tracer_late_ns: 1_000_000,
            told: Vec::new(),
            samples: 0,
        }
    }

    fn noise(&mut self) -> f64 {
        self.samples += 1;
        2.0 * (((self.samples * 7919 + 17) % 1009) as f64 / 1008.0) - 1.0
    }

    fn tick(&mut self) {
        self.ns += EVERY_NS;
        let reading_m = self.at_m.map(|m| m + 2e-8 * self.noise());
        let scale =
            ScaleReading { stamp: stamp(self.ns), reading_m, offset_m: self.told_offset_m, ..ScaleReading::default() };
        self.told.extend(self.capturer.scale(scale));
        if !self.has_beam {
            return;
        }
        let away_m: f64 =
            (0..3).map(|d| (self.at_m[d] + self.offset_m[d] - self.true_m[d]).powi(2)).sum::<f64>().sqrt();
        let length_m = self.frozen_m.unwrap_or(away_m - self.zero_m + 1e-7 * self.noise());
        let station = Text::new(self.station).unwrap();
        self.told.extend(self.capturer.tracer(&TracerReading {
            stamp: stamp(self.ns + self.tracer_late_ns),
            length_m,
            station,
            ..TracerReading::default()
        }));
    }

    fn stand(&mut self, seconds: f64) {
        (0..(seconds * 100.0) as usize).for_each(|_| self.tick());
    }

    /// Goes there in 0.4 s, and stands for 1 s.
    fn visit(&mut self, to_m: [f64; 3]) {
        let from_m = self.at_m;
        for k in 1..=40 {
            self.at_m = std::array::from_fn(|d| from_m[d] + (to_m[d] - from_m[d]) * f64::from(k) / 40.0);
            self.tick();
        }
        self.stand(1.0);
    }

    /// Goes to points of the plan, one after the other.
    fn drive(&mut self, points: impl IntoIterator<Item = usize>) {
        for point in points {
            self.visit(self.capturer.planned().reading_m(point));
        }
    }

    /// What was told last, and away from the point.
    fn leave(&mut self) {
        let at_m = self.at_m.map(|m| m + 0.01);
        self.visit(at_m);
    }

    fn entries(&self) -> Vec<JournalEntry> {
        self.told
            .iter()
            .filter_map(|told| if let Told::Entry(entry) = told { Some(entry.clone()) } else { None })
            .collect()
    }

    fn warnings(&self) -> String {
        let words = |told: &Told| match told {
            Told::Warning(words) | Told::Ask(words) => Some(words.clone()),
            _ => None,
        };
        self.told.iter().filter_map(words).collect::<Vec<_>>().join("\n")
    }

    #[track_caller]
    fn says(&self, words: &[&str]) {
        let said = self.warnings();
        words.iter().for_each(|part| assert!(said.contains(part), "{part:?} is not in {said:?}"));
    }

    fn open(&self) -> Vec<usize> {
        let taken = self.capturer.taken();
        (0..taken.len()).filter(|point| taken[*point].is_none()).collect()
    }
}

#[test]
fn each_point_is_captured_once_with_its_mean_and_the_side_that_it_came_from() {
    let mut rig = Rig::new(&path(), &config(""));
    rig.drive(0..17);
    rig.leave();
    assert_eq!((rig.open(), rig.warnings()), (vec![], String::new()));
    let taken: Vec<Captured> = rig.capturer.taken().iter().flatten().cloned().collect();
    for (point, reading) in taken.iter().enumerate() {
        let at_m = rig.capturer.planned().reading_m(point);
        let away_m = (0..3).map(|d| (at_m[d] + OFFSET_M[d] - TRUE_M[d]).powi(2)).sum::<f64>().sqrt();
        assert!((reading.length_m - away_m + 0.713).abs() < 4.0 * reading.u_length_m + 1e-9, "{point}: {reading:?}");
        assert!((0..3).all(|d| (reading.reading_m[d] - at_m[d]).abs() < 2e-8) && reading.u_length_m < 5e-8);
        assert!(reading.stood_s > 0.5 && reading.lengths > 50);
    }
    assert_eq!(taken[3].covariates["dir_x"], 1.0);
    assert_eq!(taken[14].covariates["dir_x"], -1.0);
    assert!(taken[3].covariates["speed_mm_s"] > 100.0);
    assert!(rig.told.contains(&Told::AllDone));
    assert_eq!(rig.told.iter().filter(|told| matches!(told, Told::LineDone(_))).count(), 3);
    // Driven again, nothing is captured twice.
    let before = rig.entries().len();
    rig.drive(0..17);
    rig.leave();
    assert_eq!(rig.entries().len(), before);
}

#[test]
fn a_jump_of_the_zero_is_told_at_the_first_reading_and_named_and_nothing_is_lost() {
    let mut rig = Rig::new(&path(), &config(""));
    rig.drive(0..8);
    rig.leave();
    assert_eq!(rig.warnings(), "");
    rig.zero_m += 900e-6;
    rig.drive([8]);
    rig.leave();
    rig.says(&["point 3 of 5 of line B differs by -", "does not count until"]);
    rig.drive(9..17);
    rig.leave();
    rig.says(&["the zero of the tracer jumped by -9", "at point 3 of 5 of line B", "a station of its own"]);
    assert_eq!(rig.open(), Vec::<usize>::new());
    let captured = campaign_of(rig.capturer.planned(), rig.capturer.taken(), false);
    assert_eq!(captured.campaign.stations, ["S1", "S1-zero2"]);
    assert_eq!(captured.campaign.lines, ["A", "B", "B-zero2", "C-zero2"]);
    assert_eq!((captured.campaign.readings.len(), captured.left_out.len()), (17, 0));
    // The journal says the same to whoever goes on.
    let mut again = Rig::new(&path(), &config(""));
    again.capturer.restore(&rig.entries()).unwrap();
    assert_eq!(again.capturer.taken(), rig.capturer.taken());
}

#[test]
fn a_reading_that_is_off_alone_does_not_count_and_its_point_stays_open() {
    let mut rig = Rig::new(&path(), &config(""));
    rig.drive(0..8);
    rig.zero_m += 2e-3;
    rig.drive([8]);
    rig.zero_m -= 2e-3;
    rig.drive(9..17);
    rig.leave();
    rig.says(&["point 3 of 5 of line B: not captured", "to be measured again"]);
    assert_eq!(rig.open(), [8]);
    rig.drive([8]);
    rig.leave();
    assert_eq!(rig.open(), Vec::<usize>::new());
    assert_eq!(rig.capturer.taken()[8].as_ref().unwrap().zero, 0);
}

#[test]
fn a_model_of_the_campaign_so_far_tells_a_jump_of_micrometres() {
    // A perfect machine, whose model is known: what `learn` is for.
    let machine = machine();
    let layout = abbe_geometry::layout::Layout::new(&machine.machine, OFFSET_M).unwrap();
    let (count, quality) = (
        layout.len(),
        abbe_geometry::model::FitQuality {
            readings: 500,
            rejected: 0,
            chi2_per_dof: 1.0,
            residual_rms_m: 2e-7,
            unexplained_m: [0.0; 3],
            wanders: None,
            unseen_expansions: Default::default(),
        },
    );
    let covariance = (0..count).flat_map(|a| (0..=a).map(move |b| if a == b { 1e-16 } else { 0.0 })).collect();
    let model = abbe_geometry::model::MachineModel::new(abbe_geometry::model::ModelParts {
        machine: machine.machine.clone(),
        coefficients: vec![0.0; count],
        offset_centre_m: OFFSET_M,
        effects: Vec::new(),
        stations: Vec::new(),
        covariance,
        chord_covariance: Vec::new(),
        identified: abbe_geometry::model::IdentifiedVolume {
            reading_m: machine.machine.stroke_m,
            offset_m: OFFSET_M.map(|m| (m, m)),
            covariates: Default::default(),
            differences: Vec::new(),
        },
        quality,
    })
    .unwrap();
    for (learns, is_told) in [(false, false), (true, true)] {
        let mut rig = Rig::new(&path(), &config(""));
        rig.drive(0..14);
        if learns {
            rig.capturer.learn(model.clone());
        }
        rig.zero_m += 12e-6;
        rig.drive(14..17);
        rig.leave();
        assert_eq!(rig.warnings().contains("the zero of the tracer jumped"), is_told, "{}", rig.warnings());
    }
}

#[test]
fn a_beam_that_is_lost_or_an_old_length_is_no_reading_and_the_point_is_taken_when_it_comes_back() {
    let mut rig = Rig::new(&path(), &config(""));
    rig.drive(0..3);
    rig.has_beam = false;
    rig.drive([3]);
    rig.stand(3.0);
    rig.says(&["point 4 of 6 of line A is not captured yet", "no length came while the machine stood"]);
    rig.has_beam = true;
    rig.stand(3.0);
    assert_eq!(rig.open()[0], 4);
    rig.frozen_m = Some(0.123);
    rig.drive([4]);
    rig.stand(3.0);
    rig.says(&["the same to the last digit", "lengths.step_um"]);
    rig.frozen_m = None;
    rig.drive([5]);
    rig.leave();
    assert_eq!(rig.open()[..2], [4, 6]);
}

#[test]
fn creep_and_vibration_give_no_reading_though_the_machine_is_at_the_point() {
    let mut rig = Rig::new(&path(), &config(""));
    rig.drive([0]);
    let at_m = rig.capturer.planned().reading_m(1);
    rig.visit([at_m[0] - 1e-4, at_m[1], at_m[2]]);
    rig.leave();
    let before = rig.capturer.done();
    rig.at_m = at_m;
    for k in 0..1000 {
        // 5 um/s, and then 10 um to and fro.
        rig.at_m[0] = if k < 500 { at_m[0] + 5e-8 * f64::from(k) } else { at_m[0] + 1e-5 * f64::from(k % 2) };
        rig.tick();
    }
    assert_eq!(rig.capturer.done(), before);
    rig.at_m = at_m;
    rig.stand(2.0);
    rig.leave();
    assert_eq!(rig.capturer.done(), 2, "within a tenth of a millimetre it is the same point");
}

#[test]
fn a_reflector_that_sits_elsewhere_is_told_by_the_driver_or_by_the_lengths() {
    let mut two = path();
    two[0].lines.push(line("D", [0.1, 0.5, 0.1], [0.6, 0.5, 0.1], 6, OTHER_M));
    // The driver says another offset than the plan.
    let mut rig = Rig::new(&two, &config(""));
    rig.drive(0..3);
    rig.told_offset_m = OTHER_M;
    rig.drive([3]);
    rig.leave();
    rig.says(&["measured with the reflector at 0.000, 0.000, -60.000 mm", "says 50.000, 0.000, -60.000 mm"]);
    // The driver says what is planned, and nobody has moved the reflector.
    let mut rig = Rig::new(&two, &config(""));
    rig.drive(0..17);
    rig.told_offset_m = OTHER_M;
    rig.drive(17..23);
    rig.leave();
    rig.says(&["point 1 of 6 of line D differs", "it would agree with the reflector at 0.000, 0.000, -60.000 mm"]);
    assert!(!rig.warnings().contains("jumped"), "{}", rig.warnings());
    assert_eq!(rig.capturer.done(), 17, "no wrong reading counts");
}

#[test]
fn a_moved_machine_another_station_and_a_clock_that_goes_back_are_told() {
    let mut rig = Rig::new(&path(), &config(""));
    rig.drive(0..2);
    let at_m = rig.capturer.planned().reading_m(2);
    rig.visit(at_m.map(|m| m + 0.002));
    rig.leave();
    rig.says(&["the machine stands 3.464 mm from point 3 of 6 of line A", "0.500 mm are allowed (points.within_mm)"]);
    rig.station = "S9";
    rig.drive([2]);
    rig.leave();
    rig.says(&["the tracer names station S9, which is not in the plan (S1)"]);
    rig.station = "S1";
    rig.ns -= 3_600_000_000_000;
    rig.drive([2]);
    rig.leave();
    rig.says(&["the stamps of the scales go back", "the stamps of the tracer go back", "set the clock right"]);
    assert_eq!(rig.capturer.done(), 2);
}

#[test]
fn a_controller_in_another_unit_or_frame_is_told_after_a_few_standstills() {
    let mut rig = Rig::new(&path(), &config(""));
    for point in 0..6 {
        let at_m = rig.capturer.planned().reading_m(point);
        rig.visit(at_m.map(|m| m / 25.4));
    }
    rig.leave();
    rig.says(&["4 standstills in a row were at no point of the plan", "the unit and the frame of the plan"]);
    assert_eq!(rig.capturer.done(), 0);
}

#[test]
fn clocks_that_differ_are_told_as_such() {
    let mut rig = Rig::new(&path(), &config(""));
    rig.tracer_late_ns = -30_000_000_000;
    rig.drive(0..2);
    rig.leave();
    rig.says(&["lengths come, but are stamped -30 s beside the scales: the clocks differ"]);
    assert_eq!(rig.capturer.done(), 0);
}

#[test]
fn a_line_that_begins_where_the_one_before_ends_needs_no_second_reading_there() {
    let mut own = path();
    own[0].lines[1].points_m[0] = own[0].lines[0].points_m[5];
    let mut rig = Rig::new(&own, &config(""));
    assert_eq!(rig.capturer.wanted(), 16);
    rig.drive(0..17);
    rig.leave();
    assert!(rig.told.contains(&Told::AllDone) && rig.capturer.is_done(6));
    assert_eq!((rig.open(), rig.capturer.done()), (vec![6], 16));
}

#[test]
fn where_nobody_tells_the_set_up_somebody_is_asked_and_nothing_is_taken_before() {
    let mut two = path();
    let other = [0.9, -0.3, 0.1];
    let own = |l: PathLine| PathLine { name: format!("2{}", l.name), ..l };
    two.push(PathStation {
        name: "S2".to_owned(),
        position_m: other,
        lines: path()[0].lines.clone().into_iter().map(own).collect(),
    });
    let mut silent = config("");
    let text = toml::to_string(&silent).unwrap().replace("\"station\", ", "\"-\", ");
    silent = toml::from_str(&text).unwrap();
    assert!(!silent.tells_station() && silent.tells_offset() && silent.check().is_ok());
    let mut rig = Rig::new(&two, &silent);
    rig.drive(0..17);
    rig.leave();
    rig.says(&["station S2 at 900.000, -300.000, 100.000 mm"]);
    rig.drive(17..20);
    rig.leave();
    assert_eq!(rig.capturer.done(), 17, "the tracer has not been moved, for all that is known");
    (rig.true_m, rig.zero_m) = (other, 0.2);
    let confirmed = rig.capturer.confirm(stamp(rig.ns));
    rig.told.extend(confirmed);
    rig.drive(17..34);
    rig.leave();
    assert_eq!(rig.open(), Vec::<usize>::new());
    assert_eq!(campaign_of(rig.capturer.planned(), rig.capturer.taken(), false).campaign.stations, ["S1", "S2"]);
}

#[test]
fn lines_that_cross_and_points_that_are_left_out_keep_their_places() {
    let lines = vec![
        line("A", [0.1, 0.3, 0.1], [0.5, 0.3, 0.1], 5, OFFSET_M),
        line("B", [0.3, 0.1, 0.1], [0.3, 0.5, 0.1], 5, OFFSET_M),
    ];
    let own = vec![PathStation { name: "S1".to_owned(), position_m: STATION_M, lines }];
    let mut rig = Rig::new(&own, &config(""));
    // Line A without its second point, driven twice; only then B, whose middle is that of A.
    rig.drive([0, 2, 3, 4]);
    rig.drive([0, 1, 2, 3, 4]);
    rig.leave();
    assert_eq!(rig.open(), [5, 6, 7, 8, 9]);
    rig.drive(5..10);
    rig.leave();
    assert_eq!(rig.open(), Vec::<usize>::new());
}

#[test]
fn a_trigger_takes_the_reading_of_the_controller() {
    let triggered = config("points = { takes = \"trigger\", trigger_s = 0.2 }\n");
    let mut rig = Rig::new(&path(), &triggered);
    for point in 0..17 {
        rig.at_m = rig.capturer.planned().reading_m(point);
        for k in 0..60 {
            let mut told = Vec::new();
            if k == 30 {
                let scale = ScaleReading {
                    stamp: stamp(rig.ns),
                    reading_m: rig.at_m,
                    offset_m: OFFSET_M,
                    ..ScaleReading::default()
                };
                told = rig.capturer.scale(scale);
            }
            rig.ns += EVERY_NS;
            let away_m = (0..3).map(|d| (rig.at_m[d] + OFFSET_M[d] - TRUE_M[d]).powi(2)).sum::<f64>().sqrt();
            let length_m = away_m - 0.713 + 1e-7 * rig.noise();
            let station = Text::new("S1").unwrap();
            told.extend(rig.capturer.tracer(&TracerReading {
                stamp: stamp(rig.ns),
                length_m,
                station,
                ..TracerReading::default()
            }));
            rig.told.extend(told);
        }
    }
    assert_eq!((rig.open(), rig.warnings()), (vec![], String::new()));
    assert!(rig.capturer.taken().iter().flatten().all(|reading| reading.lengths > 30));
}

#[test]
fn what_cannot_be_captured_is_refused_before_anything_is_measured() {
    let machine = machine();
    let refused = |path: &[PathStation]| Planned::new(path, &machine.machine, 0.5e-3).unwrap_err();
    let with = |lines: Vec<PathLine>| vec![PathStation { name: "S1".to_owned(), position_m: STATION_M, lines }];
    let outside = with(vec![line("A", [0.1, 0.1, 0.1], [1.6, 0.1, 0.1], 6, OFFSET_M)]);
    assert!(refused(&outside).contains("outside of the stroke"), "{}", refused(&outside));
    let near = with(vec![line("A", [0.1, 0.1, 0.1], [0.101, 0.1, 0.1], 6, OFFSET_M)]);
    assert!(
        refused(&near).contains("too near to be told apart") && refused(&near).contains("less than 0.100"),
        "{}",
        refused(&near)
    );
    let twice = [path(), path()].concat();
    assert!(refused(&twice).contains("station S1 is left and comes again"));
    let lines = with(vec![path()[0].lines[0].clone(), path()[0].lines[0].clone()]);
    assert!(refused(&lines).contains("line A stands twice"));
    // The same place twice in one line is where the machine comes back to.
    assert!(Planned::new(&with(vec![line("A", [0.1; 3], [0.1; 3], 4, OFFSET_M)]), &machine.machine, 0.5e-3).is_ok());
}

#[test]
fn keys_that_give_no_reading_are_refused_by_name() {
    for (more, words) in [
        ("standstill = { shortest_s = 0.0 }", "standstill.shortest_s: must be a number above 0"),
        ("standstill = { longest_s = 0.1 }", "standstill.longest_s"),
        ("standstill = { margin_s = 0.4 }", "standstill.margin_s"),
        ("standstill = { pause_s = 30.0 }", "standstill.pause_s"),
        ("lengths = { fewest = 1 }", "lengths.fewest"),
        ("lengths = { step_um = -1.0 }", "lengths.step_um"),
        ("points = { within_mm = nan }", "points.within_mm"),
        ("check = { raw_error_um = inf }", "check.raw_error_um"),
        ("max_covariate_age_s = 0.0", "max_covariate_age_s"),
        ("motion = { reversal_um = 0.0, window_s = 0.1 }", "motion.reversal_um"),
    ] {
        let told = config(more).check().unwrap_err().to_string();
        assert!(told.contains(words), "{more}: {told}");
    }
    assert!(config("").check().is_ok());
    assert!(
        toml::from_str::<CaptureConfig>("machine = \"a\"\nno_such = 1\n")
            .unwrap_err()
            .to_string()
            .contains("unknown field")
    );
    let server = "kind = \"ippdme\", server = \"a:1\", reads = \"moves\", offset_mm = [0.0, 0.0, 0.0]";
    let text = toml::to_string(&config("")).unwrap();
    let mut moving: CaptureConfig = toml::from_str(&text).unwrap();
    moving.scale = toml::from_str::<std::collections::BTreeMap<String, crate::driver::DriverConfig>>(&format!(
        "scale = {{ {server} }}"
    ))
    .unwrap()["scale"]
        .clone();
    assert!(moving.check().unwrap_err().to_string().contains("scale.reads: must be \"polled\""));
    moving.scale = crate::driver::DriverConfig::Campaign { file: "a.csv".into() };
    assert!(moving.check().unwrap_err().to_string().contains("scale.kind: is a recording"));
}

#[cfg(feature = "opcua")]
#[test]
fn a_server_of_opc_ua_that_is_silent_at_standstill_is_refused_and_the_plan_tells_offsets() {
    let with = |keys: &str| {
        let server = format!(
            "kind = \"opcua\"\nserver = \"opc.tcp://a:1\"\naxes = {{ x_mm = \"i=1\", y_mm = \"i=2\", z_mm = \"i=3\" }}\n{keys}"
        );
        CaptureConfig { scale: toml::from_str(&server).unwrap(), ..config("") }
    };
    let told = with("joined = \"held\"").check().unwrap_err().to_string();
    assert!(told.contains("scale.reads: must be \"polled\""), "{told}");
    for (keys, tells) in [("joined = \"held\"\nreads = \"polled\"", false), ("offset_mm = [0.0, 0.0, -60.0]", true)] {
        assert_eq!((with(keys).check(), with(keys).tells_offset()), (Ok(()), tells));
    }
}

/// The one function that derives the motion is the one of the live nodes.
#[test]
fn the_motion_is_that_of_the_live_nodes() {
    let config = config("");
    let mut live = DerivedMotion::new(config.motion.settings());
    let mut rig = Rig::new(&path(), &config);
    rig.drive(0..3);
    rig.leave();
    let taken = rig.capturer.taken()[2].clone().unwrap();
    let mut same = Rig::new(&path(), &config);
    let mut reading = ScaleReading::default();
    for point in 0..3 {
        let (from_m, to_m) = (same.at_m, rig.capturer.planned().reading_m(point));
        for k in 1..=140 {
            same.at_m = std::array::from_fn(|d| from_m[d] + (to_m[d] - from_m[d]) * f64::from(k.min(40)) / 40.0);
            same.ns += EVERY_NS;
            reading = ScaleReading { stamp: stamp(same.ns), reading_m: same.at_m, ..ScaleReading::default() };
            live.fill(&mut reading);
        }
    }
    for name in ["dir_x", "speed_mm_s"] {
        let value = reading.covariates.get(name).unwrap().value;
        assert!((value / taken.covariates[name] - 1.0).abs() < 1e-3, "{name}");
    }
}
