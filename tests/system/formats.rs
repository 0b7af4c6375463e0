//! The same campaign and the same points in every form that a command takes: the outcome must not depend on it.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod common;

use std::fs;

use abbe_msgs::{CorrectedCoordinates, CorrectionStatus};
use common::files::{Bench, machine, samples, text};
use common::program::{run, run_with_input};
use serde_json::Value;

fn convert(bench: &Bench, out: &str) -> String {
    let (campaign, out) = (bench.text("campaign.csv"), bench.text(out));
    run(["convert", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &out]).ok();
    out
}

/// A model file without what tells where its data came from.
fn model_alone(text: &str) -> Value {
    let mut model: Value = serde_json::from_str(text).unwrap();
    model["sha256"].take();
    model["model"]["data"].take();
    model
}

#[test]
fn a_bag_identifies_the_same_model_to_the_bit_as_the_csv_it_was_made_of() {
    let bench = Bench::identified(5);
    let from_csv = model_alone(&bench.read("model.json"));
    assert!(from_csv["model"]["stations"].as_array().unwrap().len() == 5);
    for bag in ["folder", "file.mcap"] {
        let (campaign, out) = (convert(&bench, bag), bench.text("from_bag.json"));
        run(["identify", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &out]).ok();
        let from_bag = model_alone(&bench.read("from_bag.json"));
        assert!(from_bag == from_csv, "{bag}: the models differ");
    }
}

#[test]
fn the_same_input_gives_the_same_model_bytes() {
    let bench = Bench::identified(5);
    let (campaign, out) = (bench.text("campaign.csv"), bench.text("again.json"));
    run(["identify", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &out]).ok();
    assert!(bench.read("again.json") == bench.read("model.json"), "the model files differ");
}

#[test]
fn standard_input_and_output_give_the_bytes_of_files() {
    let bench = Bench::identified(5);
    let (model, input, output) = (bench.text("model.json"), bench.text("verify.csv"), bench.text("corrected.csv"));
    run(["correct", "--model", &model, "--in", &input, "--out", &output]).ok();
    let of_files = fs::read(bench.path("corrected.csv")).unwrap();
    assert_eq!(of_files.iter().filter(|byte| **byte == b'\n').count(), 401);
    let points = fs::read(bench.path("verify.csv")).unwrap();
    let both = run_with_input(["correct", "--model", &model, "--in", "-", "--out", "-"], &points);
    assert!(both.ok().into_bytes() == of_files, "through both pipes");
    let only_out = run(["correct", "--model", &model, "--in", &input, "--out", "-"]);
    assert!(only_out.ok().into_bytes() == of_files, "to standard output");
    let again = bench.text("again.csv");
    run_with_input(["correct", "--model", &model, "--in", "-", "--out", &again], &points).ok();
    assert!(fs::read(&again).unwrap() == of_files, "from standard input");
}

#[test]
fn a_bag_is_corrected_to_the_same_values_as_the_csv() {
    let bench = Bench::identified(5);
    let (model, bag, out) = (bench.text("model.json"), convert(&bench, "bag"), bench.text("corrected"));
    run(["correct", "--model", &model, "--in", &bag, "--out", &out]).ok();
    let from_bag = samples::<CorrectedCoordinates>(&bench.path("corrected"), "/bridge_xyz/corrected");

    let campaign = bench.text("campaign.csv");
    let table = run(["correct", "--model", &model, "--in", &campaign, "--out", "-"]).ok();
    let mut lines = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = lines.next().unwrap();
    let column = |name: &str| header.iter().position(|column| *column == name).unwrap();
    let rows: Vec<Vec<&str>> = lines.collect();
    assert_eq!(rows.len(), from_bag.len());
    for (row, sample) in rows.iter().zip(&from_bag) {
        let point_m = sample.corrected_point_in_machine_m().unwrap();
        let covariance_m2 = sample.covariance_of_corrected_m2().unwrap();
        for (d, axis) in ["x", "y", "z"].into_iter().enumerate() {
            assert_eq!(row[column(&format!("corrected_{axis}_mm"))], format!("{:.7}", point_m[d] * 1e3));
            let expanded_um = 2.0 * covariance_m2[4 * d].sqrt() * 1e6;
            assert_eq!(row[column(&format!("u_{axis}_um"))], format!("{expanded_um:.4}"));
        }
        assert_eq!(sample.status, CorrectionStatus::InVolume);
        assert_eq!(row[column("status")], "in_volume");
    }
}
