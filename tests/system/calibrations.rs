//! Sphere, pose of a laser probe and errors of an axis, from files to files.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::assert_says;
use crate::common::files::{WHO, assert_names_who, text};
use crate::common::printed::follows;
use crate::common::program::run;
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
    let (folder, points) = file(&sphere());
    let found: Value = serde_json::from_str(&run(["sphere", "--points", &points, "--json"]).ok()).unwrap();
    let near = |value: &Value, expected: f64| assert!((value.as_f64().unwrap() - expected).abs() < 1e-9, "{value}");
    near(&found["centre_mm"][0], 100.0);
    near(&found["centre_mm"][1], -20.0);
    near(&found["radius_mm"], 15.0);
    assert_eq!(found["points"], 12);
    let said = run(["sphere", "--points", &points]).ok();
    assert_says(&said, &["12 points", "radius", "15.00000 mm", "condition"]);
    follows(folder.path(), &said, "probe-pose");
    let refused = run(["sphere", "--points", &points, "--radius-mm", "30"]).refused();
    assert_says(&refused, &["data.csv", "15.0000 mm", "30.0000 mm", "unit"]);
    let (_folder, few) = file("x_mm,y_mm,z_mm\n1,2,3\n2,3,4\n");
    assert_says(&run(["sphere", "--points", &few]).refused(), &["2 points", "at least 4"]);
}

/// So many points on a sphere of 15 mm, off along the radius by about 0.5 um.
fn rough(count: u32) -> String {
    let mut content = "x_mm,y_mm,z_mm\n".to_owned();
    for k in 0..count {
        let (up, around) = (f64::from(k) / f64::from(count) - 0.1, f64::from(k) * 2.4);
        let (across, radius) = ((1.0 - up * up).sqrt(), 15.0 + 0.0007 * (1.7 * f64::from(k * k)).sin());
        let (x, y, z) = (radius * across * around.cos(), radius * across * around.sin(), radius * up);
        writeln!(content, "{x},{y},{z}").unwrap();
    }
    content
}

#[test]
fn regress_few_points_and_a_noise_declared_too_small_widen_the_uncertainty_of_a_sphere() {
    let json = |arguments: &[&str]| -> Value {
        serde_json::from_str(&run([&["sphere", "--json", "--points"], arguments].concat()).ok()).unwrap()
    };
    let (_folder, few) = file(&rough(5));
    // Student's t of one degree of freedom is 13.97 where it would be 2.
    let widened = json(&[&few])["uncertainty_from"]["widened_by"].as_f64().unwrap();
    assert!((widened - 6.984).abs() < 1e-3, "{widened}");
    assert_says(&run(["sphere", "--points", &few]).ok(), &["6.98 times", "1 degree of freedom only (Student)"]);
    let (_folder, many) = file(&rough(25));
    let u_um = |found: &Value| found["expanded_uncertainty_um"]["z"].as_f64().unwrap();
    let (own, declared) = (json(&[&many]), json(&[&many, "--u-um", "0.1"]));
    assert!((u_um(&declared) / u_um(&own) - 1.0).abs() < 0.1, "{own} {declared}");
    assert_says(&run(["sphere", "--points", &many, "--u-um", "0.1"]).ok(), &["WARNING", "declared noise alone"]);
    // Declared too large it is believed.
    assert!(u_um(&json(&[&many, "--u-um", "1"])) > 1.5 * u_um(&own));
}

/// Held to 14.98 mm the centre of the same points moves by several U; that was published, or the declared noise was blamed.
#[test]
fn regress_a_radius_that_the_points_contradict_is_refused_by_name() {
    let (_folder, points) = file(&rough(25));
    let with = |more: &[&str]| run([&["sphere", "--points", &points, "--radius-mm", "14.98"], more].concat());
    for declared in [&[][..], &["--u-um", "0.5"]] {
        let refused = with(declared).refused();
        assert_says(
            &refused,
            &["radius of 15.000", "± 0.000", "14.98 mm of --radius-mm", "--u-radius-um", "leave it out"],
        );
        assert!(!refused.contains("declared noise"), "{refused}");
        let accepted: Value =
            serde_json::from_str(&with(&[declared, &["--json", "--accept-misfit"]].concat()).ok()).unwrap();
        assert_eq!(accepted["findings"][0]["grade"], "refusal", "{accepted}");
        let off_um = accepted["centre_mm"][2].as_f64().unwrap().abs() * 1e3;
        assert!(off_um < accepted["expanded_uncertainty_um"]["z"].as_f64().unwrap(), "{accepted}");
    }
    assert_says(&with(&["--accept-misfit"]).ok(), &["ACCEPTED", "14.98 mm of --radius-mm"]);
    assert!(!with(&["--u-radius-um", "15"]).ok().contains("--radius-mm"), "within its uncertainty");
    let small: String = rough(25).lines().take(6).map(|line| format!("{line}\n")).collect();
    let (_folder, few) = file(&small);
    run(["sphere", "--points", &few, "--radius-mm", "15.001"]).ok();
}

/// Centres of a head whose A axis lies so far (mm) off its C axis along y, off by about 10 um, at three distances in six poses.
fn of_head(offset_mm: f64) -> String {
    let mut content = "a_deg,c_deg,d_mm,x_mm,y_mm,z_mm\n".to_owned();
    let poses = [(0, 0), (60, 45), (60, -45), (-60, 90), (30, 180), (45, -120)];
    for (pose, (a_deg, c_deg)) in poses.into_iter().enumerate() {
        let (a, c) = (f64::from(a_deg).to_radians(), f64::from(c_deg).to_radians());
        for (place, d) in [90.0, 95.0, 100.0].into_iter().enumerate() {
            let [x, y, z] = [0.01 * d - 10.9, 0.02 * d + 32.9, -1.0005 * d - 452.0];
            let [x, y, z] = [x, offset_mm + y * a.cos() - z * a.sin(), y * a.sin() + z * a.cos()];
            let off = |k: usize| 0.014 * (1.7 * ((9 * pose + 3 * place + k + 1) as f64).powi(2)).sin();
            let [x, y, z] = [-398.0 - (x * c.cos() - y * c.sin()), -340.0 - (x * c.sin() + y * c.cos()), -864.0 - z];
            writeln!(content, "{a_deg},{c_deg},{d},{},{},{}", x + off(0), y + off(1), z + off(2)).unwrap();
        }
    }
    content
}

#[test]
fn regress_an_offset_of_the_axes_that_was_not_fitted_is_named_with_its_option() {
    let (_folder, off) = file(&of_head(0.8));
    let refused = run(["probe-pose", "--centres", &off]).refused();
    assert_says(&refused, &["the A axis lies 0.8", "--axis-offset", "what a pose adds in common falls from"]);
    let folder = tempfile::tempdir().unwrap();
    let out = text(&folder.path().join("out"));
    let accepted = run(["probe-pose", "--centres", &off, "--accept-misfit", "--json", "--out", &out]).ok();
    let accepted: Value = serde_json::from_str(&accepted).unwrap();
    assert_eq!(accepted["findings"][0]["grade"], "refusal");
    let zero = &accepted["unknowns"][7];
    let off_mm = (zero["value"].as_f64().unwrap() - 32.9).abs();
    assert!(off_mm < zero["expanded_uncertainty"].as_f64().unwrap(), "{zero}");
    assert!(fs::read_to_string(folder.path().join("out/report.html")).unwrap().contains("--axis-offset"));
    assert!(!run(["probe-pose", "--centres", &off, "--axis-offset"]).ok().contains("--axis-offset"));
    let (_folder, on) = file(&of_head(0.0));
    assert!(!run(["probe-pose", "--centres", &on]).ok().contains("--axis-offset"));
}

#[test]
fn the_shipped_centres_give_pose_table_and_report() {
    let folder = tempfile::tempdir().unwrap();
    let out = text(&folder.path().join("out"));
    let said = run(["probe-pose", "--centres", &text(&centres()), "--out", &out]).ok();
    assert_says(&said, &["10 centres in 5 poses", "S0 x", "-398.68 ± 0.86 mm", "0.9993 ± 0.0", "centre left out"]);
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
    let html = fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    // Digits that the spread within a pose allows, poses that are told apart, and no column of dashes.
    assert_says(&html, &["direction of the beam, x", "none: outside the other poses", "<dt>Data</dt><dd>"]);
    assert!(!html.contains("class=\"missing\"") && !html.contains(">60.000<"), "{html}");
    // The error of each pose that the others predict is drawn, in both states.
    let picture =
        html.split("<h3>Error of each pose left out</h3>").nth(1).expect("no plot").split("</figure>").next().unwrap();
    assert!(picture.contains("<path class=\"mark fB\"") && picture.contains("<path class=\"mark fA\""), "{picture}");
    // What the terminal says of the uncertainties, and the scale of the distance reading.
    assert_says(&html, &["times what the scatter alone would give", "scale of the distance<", "± 0.0029"]);
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
    table(&[("P", 0.0, 0.0, 0.0), ("Q", 300.0, 0.0, 0.0), ("K", 150.0, aside_mm, 0.0)], 0.0, "")
}

/// The same with these targets (mm), ranges off by about so much (mm), and 0.1 mm more in the row that begins so.
fn table(targets: &[(&str, f64, f64, f64)], noise_mm: f64, spoilt: &str) -> String {
    let mut content = "position_mm,target,range_mm,azimuth_deg,elevation_deg\n".to_owned();
    let mut rows = 0;
    for k in 0..5 {
        let (position, yaw) = (100.0 * f64::from(k), 1e-5 * f64::from(k));
        for &(name, x, y, z) in targets {
            let (x, y): (f64, f64) = (x * f64::cos(yaw) - y * f64::sin(yaw), x * f64::sin(yaw) + y * f64::cos(yaw));
            let (x, y, z): (f64, f64, f64) = (1000.0 + position + x, 500.0 + y, -200.0 + z);
            let flat = x.hypot(y);
            let (azimuth, elevation) = (y.atan2(x).to_degrees(), z.atan2(flat).to_degrees());
            rows += 1;
            let start = format!("{position},{name},");
            let extra = if !spoilt.is_empty() && start.starts_with(spoilt) { 0.1 } else { 0.0 };
            let range = flat.hypot(z) + noise_mm * (1.7 * f64::from(rows * rows)).sin() + extra;
            writeln!(content, "{start}{range},{azimuth},{elevation}").unwrap();
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
    assert_says(&run(&arguments).ok(), &["5 positions", "EXX", "ECX", "ECX          40 ± 30 µrad", "χ²"]);
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
    // A refusal that was accepted is no mere warning, and the errors stand with their uncertainties.
    assert_says(&report, &["Failed — Refused, and accepted all the same", "Errors and their uncertainty by position"]);
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
fn regress_a_gross_reading_of_a_target_is_named_and_left_out() {
    let six = [
        ("A", 0.0, 0.0, 0.0),
        ("B", 300.0, 20.0, 0.0),
        ("C", 150.0, 250.0, 10.0),
        ("D", 20.0, 200.0, 180.0),
        ("E", 280.0, 230.0, 120.0),
        ("F", 130.0, 40.0, 200.0),
    ];
    let tracker = ["--axis", "x", "--u-range", "1,0.5", "--u-across", "2,1"];
    let of = |content: &str, targets: &str, says: &[&str]| -> f64 {
        let (_folder, points) = file(content);
        let arguments = |last: &'static str| [&["guideway", "--points", &points], &tracker[..], &[last]].concat();
        assert_says(&run(arguments("--accept-misfit")).ok(), says);
        let found: Value =
            serde_json::from_str(&run([arguments("--json"), vec!["--accept-misfit"]].concat()).ok()).unwrap();
        assert_eq!(found["positions"][2]["targets"].to_string(), targets, "{found}");
        found["positions"][2]["errors"]["ECX_urad"].as_f64().unwrap()
    };
    // Line 17: a header, two positions of six targets, and the fourth.
    let off = "line 17: target D at 200 mm is 1";
    let found = of(&table(&six, 0.001, "200,D"), "5", &[off, "1 of 30 readings"]);
    assert!((found - 20.0).abs() < 10.0, "{found}");
    let everywhere = ["line 5: target D at 0 mm is ", "its target is not used", "1 of 30 readings"];
    of(&table(&six, 0.001, "0,D"), "5", &everywhere);
    // A note on the terminal is one on the page, and temperatures beside the readings stand in its head.
    let logged: String = table(&six, 0.001, "200,D")
        .lines()
        .enumerate()
        .map(|(k, line)| {
            format!("{line},{}\n", if k == 0 { "temp_scale_x_c".to_owned() } else { format!("20.{k:02}") })
        })
        .collect();
    let (folder, points) = file(&logged);
    let out = text(&folder.path().join("out"));
    let who = text(&folder.path().join("who.toml"));
    fs::write(&who, WHO).unwrap();
    let named = ["--identity", &who, "--measured", "2026-03-05", "--out", &out];
    let said = run([&["guideway", "--points", &points], &tracker[..], &named].concat()).ok();
    follows(folder.path(), &said, "plan");
    let page = fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    assert_names_who(&page);
    assert_says(&page, &["<dt>Measured</dt><dd>2026-03-05</dd>"]);
    assert_says(&page, &["Note — Left out", "Note — What the data say of themselves", "20.0 to 20.3 °C"]);
    assert_eq!(page.matches("Warning —").count(), said.matches("WARNING").count(), "{said}");
    of(&table(&six, 0.001, ""), "6", &["5 positions"]);
    // Of three nothing tells which: the position says so, and has an uncertainty of its own.
    let three = ["at 200 mm the targets contradict each other", "measure that position again"];
    of(&table(&[six[0], six[1], six[2]], 0.001, "200,B"), "3", &three);
}

#[test]
fn targets_that_cannot_tell_the_errors_are_refused() {
    let (_folder, line) = file(&guideway(0.0));
    assert_says(&run(["guideway", "--points", &line, "--axis", "x"]).refused(), &["on a line", "aside"]);
    let (_folder, good) = file(&guideway(200.0));
    assert_says(&run(["guideway", "--points", &good, "--axis", "y"]).refused(), &["off the Y axis"]);
    // A frame 1 degree off the motion: the cosine of 400 mm is 61 um.
    let tilted: String = (0..15)
        .map(|k| {
            let (position, (name, y)) =
                (100.0 * f64::from(k / 3), [("P", 0.0), ("Q", 5.0), ("K", 200.0)][k as usize % 3]);
            let (along, turn) = (1000.0 + position + 150.0 * f64::from(k % 3), 1f64.to_radians());
            let noise = 0.002 * (1.7 * f64::from(k * k)).sin();
            format!("{position},{name},{},{},{}\n", along * turn.cos() + noise, along * turn.sin(), y - noise)
        })
        .collect();
    let (_folder, tilted) = file(&format!("position_mm,target,x_mm,y_mm,z_mm\n{tilted}"));
    let said = run(["guideway", "--points", &tilted, "--axis", "x"]).refused();
    assert_says(&said, &["1.00 degrees off the X axis", "EXX", "60.9 µm", "--frame along-motion"]);
    assert_says(&run(["guideway", "--points", &tilted, "--axis", "x", "--frame", "along-motion"]).ok(), &["EXX"]);
    let (_folder, twice) = file(&guideway(200.0).replace("100,Q,", "100,P,"));
    assert_says(&run(["guideway", "--points", &twice, "--axis", "x"]).refused(), &["twice", "100 mm"]);
    let (_folder, steep) = file("position_mm,target,range_mm,azimuth_deg,elevation_deg\n0,P,2000,0,95\n");
    let refused = run(["guideway", "--points", &steep, "--axis", "x"]).refused();
    assert_says(&refused, &["data.csv, line 2, column elevation_deg"]);
    let refused = run(["guideway", "--points", &good, "--axis", "x", "--u-range", "1", "--u-across", "5,2"]).refused();
    assert_says(&refused, &["--u-range", "2 numbers"]);
}

/// Centres of a head without errors, each off by noise of some micrometres: 25 poses, two distances.
fn noise_alone() -> String {
    let mut content = "a_deg,c_deg,d_mm,x_mm,y_mm,z_mm\n".to_owned();
    let (mut seed, mut count) = (1_u64, 0);
    let mut noise_mm = || {
        // The sum of twelve uniform numbers of a linear congruence.
        let mut uniform = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1_u64 << 53) as f64
        };
        0.004 * ((0..12).map(|_| uniform()).sum::<f64>() - 6.0)
    };
    for a_deg in [-60.0_f64, -30.0, 0.0, 30.0, 60.0] {
        for c_deg in [0.0_f64, 72.0, 144.0, 216.0, 288.0] {
            for d_mm in [40.0, 60.0] {
                let ((sa, ca), (sc, cc)) = (a_deg.to_radians().sin_cos(), c_deg.to_radians().sin_cos());
                let [x, y, z] = [3.1 + 0.02 * d_mm, -2.2 - 0.03 * d_mm, -150.4 - d_mm];
                let [y, z] = [ca * y - sa * z, sa * y + ca * z];
                let centre = [512.3 - (cc * x - sc * y), -200.4 - (sc * x + cc * y), 88.8 - z];
                let [x, y, z] = centre.map(|v| v + noise_mm());
                writeln!(content, "{a_deg},{c_deg},{d_mm},{x:.5},{y:.5},{z:.5}").unwrap();
                count += 1;
            }
        }
    }
    assert_eq!(count, 50);
    content
}

#[test]
fn regress_a_table_of_noise_is_not_given() {
    let (folder, path) = file(&noise_alone());
    let out = text(&folder.path().join("out"));
    let ran = run(["probe-pose", "--centres", &path, "--out", &out]);
    assert_says(
        &ran.errors,
        &["abbe: warning: ", "data.csv", "the table corrects nothing", "no compensation.csv is written"],
    );
    ran.ok();
    assert!(!folder.path().join("out/compensation.csv").exists());
    let html = fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    assert_says(&html, &["No table is given", "NOT to be added to anything"]);
    assert!(!html.contains("Compensation by pose"));
    let json: Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("out/probe_pose.json")).unwrap()).unwrap();
    assert!(json["table"].as_array().unwrap().is_empty(), "{}", json["table"]);
    assert!(json["table_withheld"].as_str().unwrap().contains("corrects nothing"), "{}", json["table_withheld"]);
    // The table of other data would pass for that of these.
    fs::write(folder.path().join("out/compensation.csv"), "a_deg\n").unwrap();
    assert_says(&run(["probe-pose", "--centres", &path, "--out", &out]).refused(), &["compensation.csv", "remove it"]);
    // What a pose does add is given as ever.
    let good = text(&folder.path().join("good"));
    let ran = run(["probe-pose", "--centres", &text(&centres()), "--out", &good]);
    assert!(!ran.errors.contains("corrects nothing"), "{}", ran.errors);
    ran.ok();
    let json: Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("good/probe_pose.json")).unwrap()).unwrap();
    assert!(json["table_withheld"].is_null() && json["table"].as_array().unwrap().len() == 5);
}

/// A table with each of these columns divided by a thousand.
fn in_metres(table: &str, columns: &[usize]) -> String {
    let row = |line: &str| {
        let scaled = |(k, cell): (usize, &str)| match (columns.contains(&k), cell.parse::<f64>()) {
            (true, Ok(value)) => format!("{}", value / 1e3),
            _ => cell.to_owned(),
        };
        line.split(',').enumerate().map(scaled).collect::<Vec<_>>().join(",") + "\n"
    };
    table.lines().filter(|line| !line.starts_with('#')).map(row).collect()
}

#[test]
fn regress_metres_under_the_name_of_millimetres_are_refused() {
    let (_folder, path) = file(&in_metres(&sphere(), &[0, 1, 2]));
    assert_says(&run(["sphere", "--points", &path]).refused(), &["data.csv", "0.015000 mm", "check the unit"]);
    let all = fs::read_to_string(centres()).unwrap();
    let (_folder, path) = file(&in_metres(&all, &[2, 3, 4, 5]));
    assert_says(
        &run(["probe-pose", "--centres", &path]).refused(),
        &["data.csv", "mm from the A axis", "check the unit"],
    );
}
