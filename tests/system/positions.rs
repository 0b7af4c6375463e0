//! Measured positions become a model, and a model becomes a map of its volumetric error, from the command line.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod common;

use common::assert_says;
use common::files::{Bench, listing, machine, text};
use common::program::run;
use serde_json::Value;

fn json(said: &str) -> Value {
    serde_json::from_str(said).unwrap()
}

/// Arguments of a fit of the bench's verification points.
fn fit<'a>(machine: &'a str, points: &'a str, out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["fit-points", "--machine", machine, "--points", points, "--out", out], more].concat()
}

#[test]
fn positions_make_a_model_that_corrects_and_can_be_mapped() {
    let bench = Bench::simulated(4);
    let (machine, points, model) = (text(&machine()), bench.text("verify.csv"), bench.text("model.json"));
    let said = run(fit(&machine, &points, &model, &["--u-um", "0.05", "--json"])).ok();
    let said = json(&said);
    let evidence = &said["evidence"];
    assert_eq!(evidence["rank"], evidence["unknowns"]);
    assert!((3..=8).contains(&evidence["polynomial_degree"].as_u64().unwrap()), "{evidence}");
    let verified = json(&run(["verify", "--model", &model, "--points", &points, "--json"]).ok());
    let (before, after) = (verified["before_rms_um"].as_f64().unwrap(), verified["after_rms_um"].as_f64().unwrap());
    assert!(after < 0.1 * before, "{verified}");
    let out = bench.text("volumetric");
    let mapped = json(
        &run(["volumetric", "--model", &model, "--out", &out, "--steps", "5", "--offset-mm", "0,0,-60", "--json"]).ok(),
    );
    assert_eq!(mapped["points"], 125);
    assert_eq!(mapped["diagonals"].as_array().unwrap().len(), 4);
    let map = bench.read("volumetric/map.csv");
    assert!(map.starts_with("x_mm,y_mm,z_mm,error_x_um,error_y_um,error_z_um,error_um,u_x_um,u_y_um,u_z_um,status\n"));
    assert_eq!(map.lines().count(), 126);
    assert!(bench.read("volumetric/report.html").contains("Volumetric error"));
    let diagonals = bench.read("volumetric/diagonals.csv");
    assert_eq!(diagonals.lines().count(), 1 + 4 * 11);
    // What the model predicts, given back as measured, differs by its rounding only.
    let rows = diagonals.lines().skip(1).map(|row| {
        let cells: Vec<&str> = row.split(',').collect();
        format!("{},{},{},0.1\n", cells[0], cells[1], cells[5])
    });
    let measured =
        bench.write("diagonals.csv", format!("diagonal,distance_mm,deviation_um,u_um\n{}", rows.collect::<String>()));
    let compared =
        ["volumetric", "--model", &model, "--out", &out, "--offset-mm", "0,0,-60", "--diagonals", &measured, "--json"];
    let compared = run(compared).ok();
    for diagonal in json(&compared)["compared"].as_array().unwrap() {
        assert!(diagonal["largest_difference_um"].as_f64().unwrap() < 0.001, "{diagonal}");
        assert_eq!(diagonal["outside_95_percent"], 0);
    }
}

#[test]
fn the_same_seed_gives_the_same_model_by_jade() {
    let bench = Bench::simulated(4);
    let (machine, points) = (text(&machine()), bench.text("verify.csv"));
    let models = ["one.json", "two.json"].map(|name| {
        let out = bench.text(name);
        let more = ["--u-um", "3", "--degree", "1", "--loss", "squares", "--method", "jade", "--seed", "5"];
        run(fit(&machine, &points, &out, &more)).ok();
        bench.read(name)
    });
    assert_eq!(models[0], models[1]);
    assert!(models[0].contains("\"seed\": 5"));
}

#[test]
fn wrong_input_is_refused_and_leaves_nothing() {
    let bench = Bench::simulated(4);
    let (machine, points, out) = (text(&machine()), bench.text("verify.csv"), bench.text("refused.json"));
    let lines: Vec<String> = bench.read("verify.csv").lines().map(str::to_owned).collect();
    let few = bench.write("few.csv", lines[..8].join("\n"));
    let twice = bench.write("twice.csv", [&lines[..], &lines[7..8]].concat().join("\n"));
    let cases: [(&str, &[&str], &[&str]); 7] = [
        (&points, &[], &["u_actual_um", "--u-um"]),
        (&points, &["--u-um", "0"], &["point 1", "uncertainty"]),
        (&points, &["--u-um", "0.1", "--degree", "11"], &["degree 1 to 10"]),
        (&points, &["--u-um", "0.1", "--method", "jade", "--population", "3"], &["population of 3"]),
        (&points, &["--u-um", "0.1", "--functions", "machine", "--degree", "3"], &["--degree belongs to"]),
        (&few, &["--u-um", "0.1"], &["7 points", "unknowns", "measure more points"]),
        (&twice, &["--u-um", "0.1"], &["point 401 repeats point 7"]),
    ];
    for (points, more, says) in cases {
        let before = listing(&bench.path(""));
        assert_says(&run(fit(&machine, points, &out, more)).refused(), says);
        assert_eq!(listing(&bench.path("")), before, "something was left behind by {more:?}");
    }
    let model = bench.text("missing.json");
    assert_says(&run(["volumetric", "--model", &model, "--out", &out]).refused(), &["missing.json"]);
}
