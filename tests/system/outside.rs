//! Points outside what is known: every command that answers point by point says so, and ends with a code of its own where no
//! point is inside.

use std::fs;

use crate::common::assert_says;
use crate::common::files::{Bench, machine, text};
use crate::common::program::run;
use crate::common::spoil::{Table, refused};

const POINT_HEAD: &str = "x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm";
/// Exit code of an output without a row that is inside.
const NOTHING_INSIDE: i32 = 4;

#[test]
fn regress_rows_that_could_not_be_corrected_are_counted_with_their_cause_and_an_exit_code() {
    let bench = Bench::identified(5);
    let correct = |rows: &[&str]| {
        let points = bench.write("points.csv", format!("{POINT_HEAD}\n{}\n", rows.join("\n")));
        run(["correct", "--model", &bench.text("model.json"), "--in", &points, "--out", &bench.text("out.csv")])
    };
    let good = "100,100,100,0,0,-60";
    let ran = correct(&[good; 3]);
    let said: Vec<&str> = ran.errors.trim_end().lines().collect();
    assert_eq!(said[0], format!("abbe: {}: 3 rows, 3 corrected, 3 in volume", bench.text("points.csv")));
    // The campaign logged temperatures, these rows do not.
    assert!(said.len() == 2 && said[1].contains("no row has temp_air_c (19."), "{said:?}");
    ran.ok();
    let few = [[good; 19].as_slice(), &["2000,100,100,0,0,-60"]].concat();
    let ran = correct(&few);
    assert_says(&ran.errors, &["abbe: /", "20 rows, 19 corrected, 19 in volume, 1 rejected (first: line 21)"]);
    assert_says(
        &ran.errors,
        &["rejected, all of them: X is outside 0.0000 … 800.0000 mm, 2000.0000 mm at the furthest"],
    );
    ran.ok();
    // A large share is a warning; no row inside is an exit code of its own. The output says it row by row.
    let said = correct(&[good, "100,100,100,0,0,-300", "100,100,900,0,0,-400"]);
    assert_says(&said.errors, &["abbe: warning: ", "1 extrapolated (first: line 3), 1 rejected (first: line 4)"]);
    assert_says(
        &said.errors,
        &["extrapolated, all of them: the offset in Z is outside", "-300.0000 mm at the furthest"],
    );
    said.ok();
    let said = correct(&["100,100,100,0,0,-300", "2,100,100,0,0,-300"]).ended(NOTHING_INSIDE);
    assert_says(&said, &["0 in volume, 2 extrapolated (first: line 2)", "no row could be corrected inside"]);
    assert!(said.contains("the offset in Z is outside") && !said.contains("X is outside"), "not in all: {said}");
    assert_eq!(bench.read("out.csv").lines().count(), 3);
    // Metres under the name of millimetres.
    let metres = ["0.1,0.1,0.1,0,0,-60", "0.7,0.5,0.5,0,0,-60"];
    assert_says(&correct(&metres).ended(NOTHING_INSIDE), &["as metres the readings would lie inside"]);
    let out = bench.text("refused.csv");
    let none = bench.write("points.csv", format!("{POINT_HEAD}\n"));
    refused(
        &bench,
        &["correct", "--model", &bench.text("model.json"), "--in", &none, "--out", &out],
        &["points.csv", "header but no row"],
    );
}

/// Verification points with another offset than the campaign had, for rows that are to be moved.
fn moved(bench: &Bench, is_moved: impl Fn(usize) -> bool) -> String {
    let mut table = Table::of(&bench.read("verify.csv"));
    let [offset, actual] = ["offset_z_mm", "actual_z_mm"].map(|name| table.column(name));
    for (_, row) in table.0.iter_mut().enumerate().skip(1).filter(|(k, _)| is_moved(*k)) {
        for column in [offset, actual] {
            row[column] = format!("{}", row[column].parse::<f64>().unwrap() - 300.0);
        }
    }
    bench.write("moved.csv", table.text())
}

#[test]
fn regress_verification_points_outside_are_told_and_all_of_them_have_an_exit_code() {
    let bench = Bench::identified(5);
    let model = bench.text("model.json");
    let verify = |points: &str, more: &[&str]| {
        run(["verify", "--model", &model, "--points", points].iter().chain(more).copied().collect::<Vec<_>>())
    };
    let ran = verify(&bench.text("verify.csv"), &[]);
    assert_eq!(ran.errors, "", "points inside need no words");
    ran.ok();
    let ran = verify(&moved(&bench, |row| row <= 10), &[]);
    assert_says(&ran.errors, &["moved.csv: 400 rows, 400 corrected, 390 in volume, 10 extrapolated (first: line 2)"]);
    assert_says(&ran.errors, &["the offset in Z is outside"]);
    assert_says(&ran.ok(), &["400 points, 10 extrapolated"]);
    let all = moved(&bench, |_| true);
    for more in [&[][..], &["--json"]] {
        let ran = verify(&all, more);
        assert!(String::from_utf8_lossy(&ran.output).contains("extrapolated"), "the figures are given all the same");
        assert_says(
            &ran.ended(NOTHING_INSIDE),
            &["warning", "0 in volume, 400 extrapolated", "no row could be corrected"],
        );
    }
    // Where it would be learnt from, it is refused.
    let residuals = ["residuals", "--model", &model, "--campaign", &all, "--out", &bench.text("refused.csv")];
    refused(&bench, &residuals, &["warning", "moved.csv", "0 in volume", "no point is inside", "volume and offsets"]);
}

#[test]
fn regress_few_verification_points_are_said_to_flatter_and_points_on_a_line_are_refused() {
    let bench = Bench::identified(5);
    let (model, page) = (bench.text("model.json"), bench.text("verify.html"));
    let verify = |rows: &[String], more: &[&str]| {
        let points = bench.write("some.csv", [&bench_head(&bench), rows].concat().join("\n") + "\n");
        run(["verify", "--model", &model, "--points", &points].iter().chain(more).copied().collect::<Vec<_>>())
    };
    let rows: Vec<String> = bench.read("verify.csv").lines().skip(1).map(str::to_owned).collect();
    let few = "5 points are few: their alignment fits 6 of 15 numbers, so that each rms is about 0.77 of the true one";
    assert_says(&verify(&rows[..5], &["--html", &page]).ok(), &[few, "of 20 points 0.95 is left"]);
    assert_says(&std::fs::read_to_string(&page).unwrap(), &[few]);
    assert!(!verify(&rows[..20], &[]).ok().contains("points are few"));
    let said = verify(&rows[..5], &["--json"]).ok();
    assert_says(&said, &["\"rms_left_by_alignment\": 0.774"]);
    // The first point, moved along X and Y in both frames.
    let mut table = Table::of(&bench.read("verify.csv"));
    let columns = ["x_mm", "y_mm", "actual_x_mm", "actual_y_mm"].map(|name| table.column(name));
    let first = table.0.swap_remove(1);
    let inwards = |column: usize| if first[column].parse::<f64>().unwrap() < 300.0 { 20.0 } else { -20.0 };
    let moved = |k: u8| {
        let mut row = first.clone();
        for column in columns {
            row[column] = (first[column].parse::<f64>().unwrap() + inwards(column) * f64::from(k)).to_string();
        }
        row.join(",")
    };
    let line: Vec<String> = (0..6).map(moved).collect();
    let told = verify(&line, &[]).refused();
    assert_says(&told, &["some.csv", "the points lie on a line", "about which any rotation fits"]);
}

fn bench_head(bench: &Bench) -> [String; 1] {
    [bench.read("verify.csv").lines().next().unwrap().to_owned()]
}

#[test]
fn regress_maps_and_tables_for_a_tip_that_was_not_measured_have_an_exit_code() {
    let bench = Bench::identified(5);
    let (model, map, table) = (bench.text("model.json"), bench.text("map"), bench.text("table.csv"));
    let said = run(["volumetric", "--model", &model, "--out", &map, "--steps", "3"]).ended(NOTHING_INSIDE);
    assert_says(&said, &["warning", "27 of 27 points are outside", "an offset of 0 0 0 mm; see --offset-mm"]);
    assert!(bench.path("map/report.html").exists());
    let export = |offset: &str| {
        let step = ["--step-mm", "100", "--offset-mm", offset];
        let grid = ["export", "--model", &model, "--format", "volumetric-grid", "--out", &table];
        run(grid.into_iter().chain(step))
    };
    export("0,0,-60").ok();
    fs::remove_file(&table).unwrap();
    let said = export("0,0,-300").ended(NOTHING_INSIDE);
    assert_says(&said, &["table.csv: no node is inside", "the tip is at 0.0000 0.0000 -300.0000 mm", "--offset-mm"]);
    assert!(bench.path("table.csv").exists());
}

#[test]
fn regress_a_length_test_by_a_model_of_other_offsets_proves_nothing() {
    let bench = Bench::identified(5);
    let (machine, model) = (text(&machine()), bench.text("model.json"));
    let test = ["conformity", "--machine", &machine, "--seed", "5", "--mpe", "50+L/100"];
    // The tip 400 mm from the ram axis: no reflector was there.
    let ran = run(test.into_iter().chain(["--model", &model, "--tool-offset-mm", "400"]));
    assert!(String::from_utf8_lossy(&ran.output).contains("After correction"));
    let said = ran.ended(NOTHING_INSIDE);
    assert_says(
        &said,
        &["warning: the length test: ", "0 in volume", "the offset in X is outside", "no row could be corrected"],
    );
    // By a model of its own campaign the same test is inside, and conforms.
    let ran = run(test);
    assert!(!ran.errors.contains("extrapolated"), "{}", ran.errors);
    ran.ok();
}

#[test]
fn regress_answers_between_measured_points_are_told_from_those_beyond() {
    let bench = Bench::simulated(5);
    let row = |k: usize| {
        let at = k as f64;
        let [x, y, z] = [1.3, 2.1, 0.7].map(|step| 300.0 + 250.0 * (step * at).sin());
        let [a, b] = [x, y].map(|mm| 2.0 * (mm / 90.0).sin());
        format!("{x:.3},{y:.3},{z:.3},{a:.4},{b:.4},{:.4}\n", a * b)
    };
    let rows: String = (0..60).map(row).collect();
    let vectors = bench.write("vectors.csv", format!("x_mm,y_mm,z_mm,res_x_um,res_y_um,res_z_um\n{rows}"));
    let config = bench.write("quick.toml", "seed = 5\nmethod = \"kriging\"\n");
    let (residual, out) = (bench.text("residual.json"), bench.text("out.csv"));
    run(["train", "--residuals", &vectors, "--config", &config, "--out", &residual]).ok();
    let commands = [["predict", "--model", &residual, "--in"], ["interpolate", "--vectors", &vectors, "--at"]];
    let (inside, beyond) = ("300,300,300\n", "1900,300,300\n");
    for command in commands {
        let of = |rows: &[&str]| {
            let points = bench.write("points.csv", format!("x_mm,y_mm,z_mm\n{}", rows.concat()));
            run(command.into_iter().chain([points.as_str(), "--out", &out]))
        };
        let ran = of(&[inside]);
        assert!(!ran.errors.contains("points.csv"), "{}", ran.errors);
        ran.ok();
        let ran = of(&[inside, beyond]);
        assert_says(&ran.errors, &["warning", "points.csv: 1 ", "of 2 points"]);
        ran.ok();
        let said = of(&[beyond, "1900,1900,300\n"]).ended(NOTHING_INSIDE);
        assert_says(&said, &["points.csv: 2 ", "of 2 points", "no point lies among the measured ones"]);
        assert_eq!(bench.read("out.csv").lines().filter(|line| !line.starts_with('#')).count(), 3);
    }
}

#[test]
fn regress_files_of_a_folder_replace_no_input_that_lies_there() {
    let bench = Bench::identified(5);
    let (model, out) = (bench.text("model.json"), bench.text("out"));
    let inside = |name: &str| text(&bench.path("out").join(name));
    fs::create_dir(&out).unwrap();
    let measured = "diagonal,distance_mm,deviation_um,u_um\nPPP,0,0,0.2\nPPP,100,1,0.2\n";
    fs::write(inside("diagonals.csv"), measured).unwrap();
    let said = run(["volumetric", "--model", &model, "--diagonals", &inside("diagonals.csv"), "--out", &out]);
    assert_says(&said.refused(), &["diagonals.csv", "would be lost"]);
    assert_eq!(fs::read_to_string(inside("diagonals.csv")).unwrap(), measured);
    fs::copy(&model, inside("head.txt")).unwrap();
    let said = run(["export", "--model", &inside("head.txt"), "--format", "linuxcnc-comp", "--out", &out]);
    assert_says(&said.refused(), &["head.txt", "would be lost"]);
    assert_eq!(fs::read(inside("head.txt")).unwrap(), fs::read(&model).unwrap());
}

/// The campaign as a bag, with a column changed in every row.
fn bag(bench: &Bench, name: &str, column: &str, change: impl Fn(f64) -> f64) -> String {
    let mut table = Table::of(&bench.read("campaign.csv"));
    let column = table.column(column);
    for row in table.0.iter_mut().skip(1) {
        row[column] = change(row[column].parse().unwrap()).to_string();
    }
    let (campaign, bag) = (bench.write("moved.csv", table.text()), bench.text(name));
    run(["convert", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &bag]).ok();
    bag
}

#[test]
fn regress_a_bag_is_judged_as_the_table_it_came_from() {
    let bench = Bench::identified(5);
    let (model, out) = (bench.text("model.json"), bench.text("out.mcap"));
    let correct = |bag: &str, more: &[&str]| {
        run(["correct", "--model", &model, "--in", bag, "--out", &out].iter().chain(more).copied().collect::<Vec<_>>())
    };
    let whole = bag(&bench, "whole.mcap", "x_mm", |mm| mm);
    for age in ["nan", "-1", "0"] {
        let age = format!("--max-covariate-age-s={age}");
        assert_says(&correct(&whole, &[&age]).refused(), &["--max-covariate-age-s must be above 0"]);
    }
    let ran = correct(&whole, &[]);
    assert_says(&ran.errors, &["whole.mcap: ", " rows, ", " in volume"]);
    ran.ok();
    fs::remove_file(&out).unwrap();
    let said = correct(&bag(&bench, "far.mcap", "x_mm", |mm| mm + 5000.0), &[]).ended(NOTHING_INSIDE);
    assert_says(&said, &["warning: ", "far.mcap: ", "0 corrected", "rejected (first: reading 1)", "X is outside"]);
    fs::remove_file(&out).unwrap();
    let said = correct(&bag(&bench, "sign.mcap", "offset_z_mm", |mm| -mm), &[]).refused();
    assert_says(&said, &["sign.mcap, reading 1 (/", "the offset along z", "opposite sign", "correct its sign"]);
    assert!(!bench.path("out.mcap").exists(), "nothing is left of it");
}

#[test]
fn regress_what_a_point_is_rejected_for_is_named() {
    let bench = Bench::identified(5);
    let told = |row: &str| {
        let points = bench.write("points.csv", format!("{POINT_HEAD}\n{row}\n"));
        let out = bench.text("out.csv");
        run(["correct", "--model", &bench.text("model.json"), "--in", &points, "--out", &out]).ended(NOTHING_INSIDE)
    };
    let cause = |row: &str| told(row).lines().find(|line| line.contains("rejected, all of them")).unwrap().to_owned();
    assert_says(&cause("100,100,100,0,0,-6000"), &["the offset in Z is outside", "-6000.0000 mm"]);
    // A reading a little beyond the stroke is no reason of its own.
    let both = cause("801,100,100,0,0,-6000");
    assert!(both.contains("the offset in Z is outside") && !both.contains("X is outside"), "{both}");
}

#[test]
fn regress_verify_refuses_an_offset_of_the_wrong_sign_and_tells_points_in_metres() {
    let bench = Bench::identified(5);
    let verify = |change: &dyn Fn(&str, f64) -> f64| {
        let mut table = Table::of(&bench.read("verify.csv"));
        let head = table.0[0].clone();
        for row in table.0.iter_mut().skip(1) {
            for (name, cell) in head.iter().zip(row).filter(|(name, _)| name.ends_with("_mm")) {
                *cell = change(name, cell.parse().unwrap()).to_string();
            }
        }
        let points = bench.write("changed.csv", table.text());
        run(["verify", "--model", &bench.text("model.json"), "--points", &points]).refused()
    };
    let said = verify(&|name, mm| if name == "offset_z_mm" { -mm } else { mm });
    assert_says(&said, &["changed.csv, line 2, column offset_z_mm", "opposite sign"]);
    let said = verify(&|_, mm| mm / 1e3);
    assert_says(&said, &["changed.csv", "mm apart at the most", "if the numbers are metres"]);
}
