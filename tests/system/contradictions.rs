//! Data that contradict themselves or each other: refused with the likely causes, and what is accepted all the same is told
//! wherever it is used.

use std::fmt::Write as _;
use std::fs;

use crate::common::assert_says;
use crate::common::dds::{Listener, PATIENCE};
use crate::common::files::{Bench, machine, text};
use crate::common::graph::{DDS, MEMORY, long_recording, stream_of, user};
use crate::common::network::in_own_network;
use crate::common::program::{Ran, Started, abbe_in, run, signal, wait_until};
use crate::common::spoil::{Spoil, Table, identify_refused, refused};
use abbe_msgs::CorrectedCoordinates;
use abbe_msgs::standard::DiagnosticStatus;
use abbe_runtime::RunId;
use rustix::process::Signal;

/// A number in a cell, changed.
fn change(cell: &mut String, change: impl Fn(f64) -> f64) {
    *cell = format!("{}", change(cell.parse::<f64>().unwrap()));
}

/// Changes columns in all rows below the header.
fn change_columns(table: &mut Table, columns: &[&str], of: impl Fn(f64) -> f64) {
    let columns: Vec<usize> = columns.iter().map(|name| table.column(name)).collect();
    for row in table.0.iter_mut().skip(1) {
        columns.iter().for_each(|column| change(&mut row[*column], &of));
    }
}

const POSITION: [&str; 3] = ["x_mm", "y_mm", "z_mm"];

/// The beam of S2 is interrupted: its lengths shift by 60 µm from its 300th reading on.
fn interrupt(table: &mut Table) {
    let (station, length) = (table.column("station"), table.column("length_mm"));
    let own = table.0.iter_mut().filter(|row| row[station] == "S2");
    own.skip(300).for_each(|row| change(&mut row[length], |mm| mm + 0.06));
}

#[test]
fn regress_a_campaign_that_contradicts_itself_is_refused_with_its_likely_causes() {
    let bench = Bench::simulated(5);
    let good = bench.read("campaign.csv");
    let cases: [(&str, Spoil, &[&str]); 5] = [
        (
            "positions to a millimetre",
            |t| change_columns(t, &POSITION, f64::round),
            &["times the declared noise", "x_mm, y_mm, z_mm are rounded to 1 mm", "--accept-misfit"],
        ),
        (
            "interrupted beam",
            interrupt,
            &["contradict the others", "beam of station S2 was interrupted", "station name of their own"],
        ),
        (
            "inches",
            |t| {
                change_columns(t, &POSITION, |mm| mm / 25.4);
                change_columns(t, &["offset_x_mm", "offset_y_mm", "offset_z_mm", "length_mm"], |mm| mm / 25.4);
            },
            &["cover 3.", "of X", "inches"],
        ),
        ("length in µm", |t| change_columns(t, &["length_mm"], |mm| mm * 1e3), &["the lengths are in micrometres"]),
        (
            "reversed axis",
            |t| change_columns(t, &["x_mm"], |mm| 800.0 - mm),
            &["x_mm changes its sign", "offset_x_mm changes its sign"],
        ),
    ];
    for (name, spoil, says) in cases {
        println!("{name}");
        let mut table = Table::of(&good);
        spoil(&mut table);
        let campaign = bench.write("spoilt.csv", table.text());
        identify_refused(&bench, &text(&machine()), &campaign, &[says, &["spoilt.csv"]].concat());
    }
}

#[test]
fn regress_an_accepted_misfit_is_told_wherever_the_model_is_used_and_rejected_readings_are_capped() {
    let bench = Bench::simulated(5);
    let mut table = Table::of(&bench.read("campaign.csv"));
    interrupt(&mut table);
    let (machine, campaign, model) =
        (text(&machine()), bench.write("spoilt.csv", table.text()), bench.text("model.json"));
    let identify = ["identify", "--machine", &machine, "--campaign", &campaign, "--out", &model];
    // Who asks for JSON gets all of the refusal, on standard output.
    let refused = run(identify.into_iter().chain(["--json"]));
    let json: serde_json::Value = serde_json::from_slice(&refused.output).unwrap();
    assert_eq!((refused.code, &json["refused"]), (Some(1), &serde_json::Value::Bool(true)));
    assert!(json["evidence"]["rejected"].as_array().unwrap().len() > 200, "{json}");
    let said = run(identify.into_iter().chain(["--accept-misfit"])).ok();
    assert_says(
        &said,
        &["ACCEPTED", "beam of station S2 was interrupted", "widened", "more: all of them are in the model file"],
    );
    assert!(said.matches("  rejected          reading").count() <= 10, "{said}");
    let (points, out) = (bench.text("verify.csv"), bench.text("corrected.csv"));
    for arguments in [
        vec!["correct", "--model", &model, "--in", &points, "--out", &out],
        vec!["verify", "--model", &model, "--points", &points],
    ] {
        let ran = run(&arguments);
        assert_says(&ran.errors, &["WARN", "model.json", "made all the same", "beam of station S2 was interrupted"]);
        assert_eq!(ran.code, Some(0), "{}", ran.errors);
    }
}

#[test]
fn regress_an_accepted_misfit_is_a_warning_on_diagnostics_while_its_model_is_in_use() {
    let test = "contradictions::regress_an_accepted_misfit_is_a_warning_on_diagnostics_while_its_model_is_in_use";
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        let good = bench.read("model.json");
        let mut table = Table::of(&bench.read("campaign.csv"));
        interrupt(&mut table);
        let (machine, campaign) = (text(&machine()), bench.write("spoilt.csv", table.text()));
        let (model, accepted) = (bench.text("model.json"), bench.text("accepted.json"));
        run(["identify", "--machine", &machine, "--campaign", &campaign, "--out", &accepted, "--accept-misfit"]).ok();
        fs::copy(&accepted, &model).unwrap();
        long_recording(&bench, 60_000);
        let launch = stream_of(&bench, |launch| launch.edge("residual", "user", MEMORY).edge("geometric", "*", DDS));
        let run_name = RunId::unique();
        let listener = Listener::on_diagnostics(domain);
        let graph = Started::start(abbe_in(domain, ["launch", &launch, "--run", run_name.as_str()]));
        let _taker = user::<CorrectedCoordinates>(&run_name, "corrected");
        let words = ["this model was refused and made all the same", "beam of station S2 was interrupted"];
        listener.hears_warnings("geometric: model", &words);
        // The warning goes with the model.
        fs::write(bench.path("next.json"), good).unwrap();
        fs::rename(bench.path("next.json"), &model).unwrap();
        wait_until("nothing is said against the good model", PATIENCE, || {
            let mut news = listener.news("geometric: model").into_iter();
            news.any(|status| status.level == DiagnosticStatus::OK && status.message == "model in use")
        });
        signal(graph.id(), Signal::INT);
        graph.finish().ok();
    });
}

/// Writes where the scales say into the columns of what was measured.
fn copy_readings(table: &mut Table) {
    for axis in ["x", "y", "z"] {
        let [reading, offset, actual] =
            [format!("{axis}_mm"), format!("offset_{axis}_mm"), format!("actual_{axis}_mm")]
                .map(|name| table.column(&name));
        for row in table.0.iter_mut().skip(1) {
            let [reading, offset] = [reading, offset].map(|column| row[column].parse::<f64>().unwrap());
            row[actual] = format!("{}", reading + offset);
        }
    }
}

#[test]
fn regress_actual_positions_that_are_not_those_of_the_readings_are_refused_by_all_who_take_them() {
    let bench = Bench::identified(5);
    let good = bench.read("verify.csv");
    const ACTUAL: [&str; 3] = ["actual_x_mm", "actual_y_mm", "actual_z_mm"];
    let cases: [(&str, Spoil, &str); 6] = [
        ("exchanged", |t| t.rename("actual_x_mm", "?"), "mirrored"),
        ("mirrored", |t| change_columns(t, &["actual_y_mm"], |mm| -mm), "mirrored"),
        ("metres", |t| change_columns(t, &ACTUAL, |mm| mm / 1e3), "metres"),
        ("inches", |t| change_columns(t, &ACTUAL, |mm| mm / 25.4), "inches"),
        ("copied", copy_readings, "a copy and no measurement"),
        ("one row", |t| change(t.cell(40, "actual_z_mm"), |mm| mm + 12.0), "point 39 by 1"),
    ];
    let (model, machine, out) = (bench.text("model.json"), text(&machine()), bench.text("refused"));
    for (name, spoil, says) in cases {
        println!("{name}");
        let mut table = Table::of(&good);
        spoil(&mut table);
        if name == "exchanged" {
            table.rename("actual_y_mm", "actual_x_mm");
            table.rename("?", "actual_y_mm");
        }
        let points = bench.write("spoilt.csv", table.text());
        let says = ["spoilt.csv", says];
        refused(&bench, &["verify", "--model", &model, "--points", &points], &says);
        refused(&bench, &["residuals", "--model", &model, "--campaign", &points, "--out", &out], &says);
        if name != "one row" {
            let u = ["fit-points", "--machine", &machine, "--points", &points, "--u-um", "0.1", "--out", &out];
            refused(&bench, &u, &says);
        }
    }
}

#[test]
fn regress_residuals_a_thousand_times_too_large_are_refused_by_all_who_take_them() {
    let bench = Bench::simulated(5);
    let row = |k: usize| {
        let at = k as f64;
        let (x, y, z) =
            (400.0 + 390.0 * (1.3 * at).sin(), 300.0 + 290.0 * (2.1 * at).cos(), 300.0 + 290.0 * (0.7 * at).sin());
        format!(
            "{x:.3},{y:.3},{z:.3},{:.2},{:.2},{:.2}\n",
            2e3 * (x / 90.0).sin(),
            1e3 * (y / 90.0).cos(),
            1e3 * (z / 90.0).sin()
        )
    };
    let rows: String = (0..60).map(row).collect();
    let residuals = bench.write("residuals.csv", format!("x_mm,y_mm,z_mm,res_x_um,res_y_um,res_z_um\n{rows}"));
    let out = bench.text("refused.json");
    let says = ["residuals.csv", "check the unit"];
    for arguments in [
        vec!["train", "--residuals", &residuals, "--out", &out],
        vec!["compare", "--residuals", &residuals],
        vec!["interpolate", "--vectors", &residuals, "--splits", "2"],
        vec!["diagnose", "--residuals", &residuals, "--out", &out],
    ] {
        refused(&bench, &arguments, &says);
    }
}

/// A command on some data, with further arguments.
type Command = dyn Fn(&[&str]) -> Ran;

/// What a command says of data that hold together, are to be looked at, and are refused, in this order; and of the last where
/// that is accepted.
fn graded(kinds: [&Command; 3], warned: &[&str], why: &[&str]) {
    let [clean, doubtful, refused] = kinds;
    let said = clean(&[]).ok();
    // What few degrees of freedom cannot exclude is said of good data as well.
    let is_note = |line: &str| line.starts_with("  note ") && !line.contains("uncertainties are");
    assert!(!said.contains("WARNING") && !said.lines().any(is_note), "{said}");
    let said = doubtful(&[]).ok();
    assert_says(&said, &["WARNING"]);
    assert_says(&said, warned);
    assert_says(&refused(&[]).refused(), &[why, &["refused", "--accept-misfit"]].concat());
    assert_says(&refused(&["--accept-misfit"]).ok(), &[why, &["ACCEPTED"]].concat());
}

/// Evenly spread numbers between −1 and 1, the same in every run.
fn spread(k: usize) -> f64 {
    2.0 * ((k + 1) as f64 * 0.618_033_988_75).fract() - 1.0
}

/// Thirty points over the upper half of a sphere of 12.5 mm, with 1 µm of scatter; some of them are off it (line, mm).
fn on_a_sphere(off: &[(usize, f64)]) -> String {
    let mut content = "x_mm,y_mm,z_mm\n".to_owned();
    for k in 0..30 {
        let (up, around) = (k as f64 / 30.0, k as f64 * 2.4);
        let across = (1.0 - up * up).sqrt();
        let moved: f64 = off.iter().filter(|(line, _)| *line == k + 2).map(|(_, mm)| mm).sum();
        let radius = 12.5 + 0.001 * 3_f64.sqrt() * spread(k) + moved;
        let (x, y, z) = (radius * across * around.cos(), radius * across * around.sin(), radius * up);
        writeln!(content, "{:.6},{:.6},{:.6}", 100.0 + x, y - 20.0, 50.0 + z).unwrap();
    }
    content
}

#[test]
fn the_scatter_on_a_sphere_is_graded_against_what_was_declared() {
    let bench = Bench::empty();
    let points = bench.write("points.csv", on_a_sphere(&[]));
    let with = |u_um: &'static str| {
        let points = points.clone();
        move |more: &[&str]| {
            run(["sphere", "--points", &points, "--u-um", u_um].iter().chain(more).copied().collect::<Vec<_>>())
        }
    };
    let small = ["times the declared noise", "declared uncertainties are too small", "k = 1 or k = 2"];
    graded([&with("1"), &with("0.2"), &with("0.05")], &small, &small);
    let large = ["times smaller than the declared noise", "declared uncertainties are too large", "computed"];
    graded([&with("1"), &with("5"), &with("30")], &large, &large);
}

#[test]
fn regress_points_off_the_sphere_are_named_left_out_and_counted() {
    let bench = Bench::empty();
    let sphere = |name: &str, off: &[(usize, f64)], more: &[&str]| {
        let points = bench.write(name, on_a_sphere(off));
        run(["sphere", "--points", &points].iter().chain(more).copied().collect::<Vec<_>>())
    };
    let json = |ran: Ran| serde_json::from_str::<serde_json::Value>(&ran.ok()).unwrap();
    let clean = json(sphere("clean.csv", &[], &["--json"]));
    assert_eq!(clean["rejected"], serde_json::json!([]));
    for off_mm in [1.2, -1.6, 2.0, 0.02] {
        let said = sphere("one.csv", &[(7, off_mm)], &[]).ok();
        assert_says(&said, &["1 of 30 points", "contradict the others", "rejected  line 7: "]);
        let found = json(sphere("one.csv", &[(7, off_mm)], &["--json"]));
        assert_eq!(found["rejected"][0]["line"], 7);
        assert!((found["rejected"][0]["off_mm"].as_f64().unwrap() - off_mm).abs() < 0.005, "{found}");
        for d in 0..3 {
            let moved_mm = found["centre_mm"][d].as_f64().unwrap() - clean["centre_mm"][d].as_f64().unwrap();
            assert!(moved_mm.abs() < 0.001, "{moved_mm}");
        }
    }
    let many = [(3, 0.5), (8, -0.7), (13, 0.9), (18, -1.1), (23, 1.3), (28, -0.4)];
    let said = sphere("many.csv", &many, &[]).refused();
    assert_says(&said, &["many.csv: refused", "6 of 30 points", "contradict the others", "--accept-misfit"]);
    assert_says(&sphere("many.csv", &many, &["--accept-misfit"]).ok(), &["ACCEPTED", "rejected  line 18: -1.09"]);
}

/// Four targets on a table that moves along x in eleven steps and errs by a micrometre or two, as points with scatter (µm).
fn guideway(scatter_um: f64) -> String {
    let mut content = "position_mm,target,x_mm,y_mm,z_mm,u_um\n".to_owned();
    let targets = [("P", 0.0, 0.0, 0.0), ("Q", 300.0, 0.0, 10.0), ("K", 150.0, 200.0, 0.0), ("L", 20.0, 180.0, 90.0)];
    for step in 0..11 {
        for (j, (name, x, y, z)) in targets.iter().enumerate() {
            let position = 50.0 * step as f64;
            let off = |d: usize| 1e-3 * 3_f64.sqrt() * scatter_um * spread(12 * step + 3 * j + d);
            let bow = 2e-3 * (position / 160.0).sin();
            let (x, y, z) = (1000.0 + position + x + off(0), 500.0 + y + bow + off(1), z - 200.0 + off(2));
            writeln!(content, "{position},{name},{x:.7},{y:.7},{z:.7},1").unwrap();
        }
    }
    content
}

#[test]
fn what_targets_of_a_guideway_disagree_by_is_graded_against_what_was_declared() {
    let bench = Bench::empty();
    let with = |scatter_um: f64| {
        let points = bench.write(&format!("{scatter_um}.csv"), guideway(scatter_um));
        move |more: &[&str]| {
            run(["guideway", "--points", &points, "--axis", "x"].iter().chain(more).copied().collect::<Vec<_>>())
        }
    };
    let small = ["times the declared noise", "declared uncertainties are too small"];
    graded([&with(1.0), &with(5.0), &with(20.0)], &small, &small);
    let large = ["times smaller than the declared noise", "declared uncertainties are too large"];
    graded([&with(1.0), &with(0.2), &with(0.03)], &large, &large);
}
