//! Sphere, pose of a laser probe and errors of an axis, from files to files.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod common;

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use common::assert_says;
use common::files::text;
use common::program::run;
use serde_json::Value;
use tempfile::TempDir;

fn centres() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config/data/zhang2016_centres.csv").canonicalize().unwrap()
}

/// A file in a folder of its own.
fn file(content: &str) -> (TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.csv");
    fs::write(&path, content).unwrap();
    (folder, text(&path))
}

/// Twelve points on a sphere of 15 mm about (100, −20, 50) mm, all to the last digit of a double.
fn sphere() -> String {
    let mut content = "x_mm,y_mm,z_mm\n".to_owned();
    for k in 0..12 {
        let (up, around) = (f64::from(k) / 11.5 - 0.1, f64::from(k) * 2.4);
        let across = (1.0 - up * up).sqrt();
        let (x, y, z) = (100.0 + 15.0 * across * around.cos(), -20.0 + 15.0 * across * around.sin(), 50.0 + 15.0 * up);
        writeln!(content, "{x},{y},{z}").unwrap();
    }
    content
}

#[test]
fn a_sphere_is_fitted_and_a_wrong_radius_is_refused() {
    let (_folder, points) = file(&sphere());
    let found: Value = serde_json::from_str(&run(["sphere", "--points", &points, "--json"]).ok()).unwrap();
    let near = |value: &Value, expected: f64| assert!((value.as_f64().unwrap() - expected).abs() < 1e-9, "{value}");
    near(&found["centre_mm"][0], 100.0);
    near(&found["centre_mm"][1], -20.0);
    near(&found["radius_mm"], 15.0);
    assert_eq!(found["points"], 12);
    assert_says(&run(["sphere", "--points", &points]).ok(), &["12 points", "radius", "15.00000 mm", "condition"]);
    let refused = run(["sphere", "--points", &points, "--radius-mm", "30"]).refused();
    assert_says(&refused, &["data.csv", "15.0000 mm", "30.0000 mm", "unit"]);
    let (_folder, few) = file("x_mm,y_mm,z_mm\n1,2,3\n2,3,4\n");
    assert_says(&run(["sphere", "--points", &few]).refused(), &["2 points", "at least 4"]);
}

#[test]
fn the_shipped_centres_give_pose_table_and_report() {
    let folder = tempfile::tempdir().unwrap();
    let out = text(&folder.path().join("out"));
    let said = run(["probe-pose", "--centres", &text(&centres()), "--out", &out]).ok();
    assert_says(&said, &["10 centres in 5 poses", "S0 x", "-398.68 +- 0.74 mm", "0.999315", "centre left out"]);
    let table = fs::read_to_string(folder.path().join("out/compensation.csv")).unwrap();
    let lines: Vec<&str> = table.lines().collect();
    assert_eq!(lines.len(), 6);
    // Table 3 of the paper: x and z of the first pose, which hang on nothing that is in doubt.
    assert!(lines[1].starts_with("0.0000000,0.0000000,-0.3616"), "{}", lines[1]);
    assert!(lines[1].contains(",0.5306"), "{}", lines[1]);
    let json: Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("out/probe_pose.json")).unwrap()).unwrap();
    assert_eq!(json["unknowns"].as_array().unwrap().len(), 9);
    assert!(fs::read_to_string(folder.path().join("out/report.html")).unwrap().contains("Compensation by pose"));
    // Eq. 14 of the paper, S0 y: it takes the tenth unknown.
    let ten = run(["probe-pose", "--centres", &text(&centres()), "--beam", "one", "--axis-offset", "--json"]).ok();
    let ten: Value = serde_json::from_str(&ten).unwrap();
    for (name, value) in [("S0 y", -340.6652), ("axis offset y", -0.1045)] {
        let found = ten["unknowns"].as_array().unwrap().iter().find(|unknown| unknown["name"] == name).unwrap();
        assert!((found["value"].as_f64().unwrap() - value).abs() < 1e-4, "{found}");
    }
}

#[test]
fn regress_the_table_of_a_pose_does_not_replace_the_centres() {
    let folder = tempfile::tempdir().unwrap();
    let (out, own) = (text(folder.path()), text(&folder.path().join("compensation.csv")));
    fs::copy(centres(), &own).unwrap();
    assert_says(&run(["probe-pose", "--centres", &own, "--out", &out]).refused(), &["would be lost"]);
    assert_eq!(fs::read(&own).unwrap(), fs::read(centres()).unwrap());
}

#[test]
fn centres_that_do_not_determine_the_pose_say_what_is_missing() {
    let all = fs::read_to_string(centres()).unwrap();
    let one_distance: String = all.lines().filter(|line| !line.contains(",100,")).map(|l| format!("{l}\n")).collect();
    let (folder, path) = file(&one_distance);
    let out = text(&folder.path().join("out"));
    let refused = run(["probe-pose", "--centres", &path, "--out", &out]).refused();
    assert_says(&refused, &["data.csv", "6 of 9", "R_p, T_p", "two distances"]);
    assert!(!folder.path().join("out").exists(), "nothing is left");
    let turned = all.replace("\n-60,", "\n#60,").replace("\n60,", "\n-60,").replace("\n#60,", "\n60,");
    let (_folder, path) = file(&turned);
    assert_says(&run(["probe-pose", "--centres", &path]).refused(), &["A turned the other way"]);
}

#[test]
fn regress_centres_with_a_and_c_exchanged_are_refused() {
    let exchanged =
        fs::read_to_string(centres()).unwrap().replace("a_deg", "?").replace("c_deg", "a_deg").replace('?', "c_deg");
    let (_folder, path) = file(&exchanged);
    assert_says(
        &run(["probe-pose", "--centres", &path]).refused(),
        &["data.csv", "A and C exchanged", "exchange the columns"],
    );
}

/// Three targets on a table that moves along x and yaws by 1e-5 rad per 100 mm about the first, seen from the origin.
fn guideway(aside_mm: f64) -> String {
    let mut content = "position_mm,target,range_mm,azimuth_deg,elevation_deg\n".to_owned();
    for k in 0..5 {
        let (position, yaw) = (100.0 * f64::from(k), 1e-5 * f64::from(k));
        for (name, x, y, z) in [("P", 0.0, 0.0, 0.0), ("Q", 300.0, 0.0, 0.0), ("K", 150.0, aside_mm, 0.0)] {
            let (x, y): (f64, f64) = (x * f64::cos(yaw) - y * f64::sin(yaw), x * f64::sin(yaw) + y * f64::cos(yaw));
            let (x, y, z): (f64, f64, f64) = (1000.0 + position + x, 500.0 + y, -200.0 + z);
            let flat = x.hypot(y);
            let (azimuth, elevation) = (y.atan2(x).to_degrees(), z.atan2(flat).to_degrees());
            writeln!(content, "{position},{name},{},{azimuth},{elevation}", flat.hypot(z)).unwrap();
        }
    }
    content
}

#[test]
fn tracker_readings_give_the_six_errors_by_position() {
    let (folder, points) = file(&guideway(200.0));
    let out = text(&folder.path().join("out"));
    let mut arguments = vec!["guideway", "--points", &points, "--axis", "x", "--reference-mm", "1000,500,-200"];
    arguments.extend(["--u-range", "0.5,0.5", "--u-across", "5,2", "--out", &out]);
    assert_says(&run(&arguments).refused(), &["smaller than the declared noise", "computed"]);
    // They are computed, and that is meant.
    arguments.push("--accept-misfit");
    assert_says(&run(&arguments).ok(), &["5 positions", "EXX", "ECX", "ECX          40 +- 30 urad", "chi2"]);
    let csv = fs::read_to_string(folder.path().join("out/errors.csv")).unwrap();
    let lines: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(lines[0][..7], ["position_mm", "EXX_um", "EYX_um", "EZX_um", "EAX_urad", "EBX_urad", "ECX_urad"]);
    assert!(lines.iter().all(|line| line.len() == 15));
    assert_eq!(lines[1][7..13], [""; 6], "at the lowest position there is no uncertainty, not one of zero");
    let last: Vec<f64> = lines[5][..13].iter().map(|cell| cell.parse().unwrap()).collect();
    assert!(last[1..6].iter().all(|error| error.abs() < 1e-3) && (last[6] - 40.0).abs() < 1e-3, "{last:?}");
    assert!(last[7..].iter().all(|u| *u > 0.0));
    let report = fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    assert_says(&report, &["Errors of the X axis", "What the arrangement of the targets does"]);
    let figures: Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("out/guideway.json")).unwrap()).unwrap();
    let by_spread = &figures["uncertainty_by_spread_of_targets"];
    let place = |spread: f64| by_spread["spread"].as_array().unwrap().iter().position(|s| *s == spread).unwrap();
    let u = |how: &str, spread: f64, k: usize| by_spread[how][place(spread)][k].as_f64().unwrap();
    for k in 0..6 {
        // As measured, but for the tracker's uncertainty, which is a little larger at the next position.
        let measured: f64 = lines[2][7 + k].parse().unwrap();
        assert!((u("in_all_directions", 1.0, k) / measured - 1.0).abs() < 0.05, "{k}: {by_spread}");
        assert_eq!(u("in_all_directions", 1.0, k), u("across_the_motion", 1.0, k));
    }
    for angle in 3..6 {
        assert!((u("in_all_directions", 2.0, angle) / u("in_all_directions", 1.0, angle) - 0.5).abs() < 1e-9);
    }
    // Roll rests on what lies across the motion, pitch hardly.
    assert!((u("across_the_motion", 2.0, 3) / u("across_the_motion", 1.0, 3) - 0.5).abs() < 0.05, "{by_spread}");
    assert!(u("across_the_motion", 2.0, 4) > 0.8 * u("across_the_motion", 1.0, 4), "{by_spread}");
}

#[test]
fn targets_that_cannot_tell_the_errors_are_refused() {
    let (_folder, line) = file(&guideway(0.0));
    assert_says(&run(["guideway", "--points", &line, "--axis", "x"]).refused(), &["on a line", "aside"]);
    let (_folder, good) = file(&guideway(200.0));
    assert_says(&run(["guideway", "--points", &good, "--axis", "y"]).refused(), &["off the Y axis"]);
    let (_folder, twice) = file(&guideway(200.0).replace("100,Q,", "100,P,"));
    assert_says(&run(["guideway", "--points", &twice, "--axis", "x"]).refused(), &["twice", "100 mm"]);
    let (_folder, steep) = file("position_mm,target,range_mm,azimuth_deg,elevation_deg\n0,P,2000,0,95\n");
    let refused = run(["guideway", "--points", &steep, "--axis", "x"]).refused();
    assert_says(&refused, &["data.csv, line 2, column elevation_deg"]);
    let refused = run(["guideway", "--points", &good, "--axis", "x", "--u-range", "1", "--u-across", "5,2"]).refused();
    assert_says(&refused, &["--u-range", "2 numbers"]);
}
