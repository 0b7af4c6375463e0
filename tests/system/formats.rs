//! The same campaign and the same points in every form that a command takes: the outcome must not depend on it.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::process::Stdio;
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use crate::common::assert_says;
use crate::common::files::{Bench, machine, samples, text};
use crate::common::program::{abbe, run, run_with_input};
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus};
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
fn rows_corrected_side_by_side_are_those_corrected_one_by_one() {
    /// Several batches, and one that is not full.
    const ROWS: usize = 40_123;
    let bench = Bench::identified(5);
    let (model, output) = (bench.text("model.json"), bench.text("long_corrected.csv"));
    let text = bench.read("verify.csv");
    let (head, rows) = text.split_once('\n').unwrap();
    let mut long: Vec<String> = rows.lines().cycle().take(ROWS).map(str::to_owned).collect();
    // One without an answer, in the second batch.
    let columns: Vec<&str> = head.split(',').collect();
    let x = columns.iter().position(|name| *name == "x_mm").unwrap();
    let far = long[20_000].split(',').enumerate().map(|(k, cell)| if k == x { "9999" } else { cell });
    long[20_000] = far.collect::<Vec<_>>().join(",");
    let input = bench.write("long.csv", format!("{head}\n{}\n", long.join("\n")));
    let of_file = run(["correct", "--model", &model, "--in", &input, "--out", &output]);
    let of_stream = run(["correct", "--model", &model, "--in", &input, "--out", "-"]);
    assert_eq!(of_file.errors, of_stream.errors);
    assert_says(&of_file.errors, &["40123 rows, 40122 corrected", "line 20002"]);
    of_file.ok();
    assert!(bench.read("long_corrected.csv") == of_stream.ok(), "the rows differ");
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

/// Far longer than a row takes; only a test that fails waits for it.
const ROW_WITHIN: Duration = Duration::from_secs(20);

#[test]
fn regress_a_row_is_answered_while_the_input_stays_open() {
    let bench = Bench::identified(5);
    let points = bench.read("verify.csv");
    let mut command = abbe(["correct", "--model", &bench.text("model.json"), "--in", "-", "--out", "-"]);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut running = command.spawn().unwrap();
    let mut input = running.stdin.take().unwrap();
    let output = BufReader::new(running.stdout.take().unwrap());
    let (send, answers) = channel();
    let reading = thread::spawn(move || output.lines().for_each(|line| send.send(line.unwrap()).unwrap()));
    for (number, line) in points.lines().take(20).enumerate() {
        // A row that comes in two parts is one row.
        let (first, second) = line.split_at(line.len() / 2);
        input.write_all(first.as_bytes()).unwrap();
        input.write_all(format!("{second}\n").as_bytes()).unwrap();
        let answer = answers.recv_timeout(ROW_WITHIN).unwrap_or_else(|_| panic!("row {number} was held back"));
        assert!(answer.starts_with(&format!("{line},")), "{answer}");
    }
    drop(input);
    reading.join().unwrap();
    let ended = running.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(0));
    assert_says(&String::from_utf8_lossy(&ended.stderr), &["standard input: 19 rows, 19 corrected, 19 in volume"]);
}

#[test]
fn regress_the_tour_of_the_readme_follows_a_growing_file() {
    let bench = Bench::identified(5);
    let points = bench.read("verify.csv");
    let lines: Vec<&str> = points.lines().collect();
    let scales = bench.write("scales.csv", lines[..31].join("\n") + "\n");
    let follow = |options: &[&str]| {
        let mut tail = std::process::Command::new("tail");
        tail.args(options).arg(&scales).stdout(Stdio::piped()).spawn().unwrap()
    };
    // As printed: all lines from the first on, then those that come.
    let mut tail = follow(&["-n", "+1", "-f"]);
    let mut command = abbe(["correct", "--model", &bench.text("model.json"), "--in", "-", "--out", "-"]);
    command.stdin(tail.stdout.take().unwrap()).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut running = command.spawn().unwrap();
    let mut answers = BufReader::new(running.stdout.take().unwrap()).lines().map(Result::unwrap);
    assert_eq!((&mut answers).take(31).count(), 31);
    let mut growing = fs::OpenOptions::new().append(true).open(&scales).unwrap();
    writeln!(growing, "{}", lines[31]).unwrap();
    assert!(answers.next().unwrap().starts_with(lines[31]));
    tail.kill().unwrap();
    tail.wait().unwrap();
    assert_eq!((answers.next(), running.wait().unwrap().code()), (None, Some(0)));
    // The last ten lines have no column names: said, with what to do.
    let last = lines[20..31].join("\n");
    let said =
        run_with_input(["correct", "--model", &bench.text("model.json"), "--in", "-", "--out", "-"], last.as_bytes());
    assert_says(&said.refused(), &["standard input, line 1", "no column names", "tail -n +1 -f"]);
}

#[test]
fn regress_tables_of_excel_and_packed_tables_are_corrected_to_the_same_numbers() {
    let bench = Bench::identified(5);
    let model = bench.text("model.json");
    let plain = bench.read("verify.csv");
    let correct = |bytes: &[u8]| {
        let ran = run_with_input(["correct", "--model", &model, "--in", "-", "--out", "-"], bytes);
        (ran.errors.clone(), ran.ok())
    };
    let (said, expected) = correct(plain.as_bytes());
    assert!(!said.contains("columns between"), "a plain table needs no words: {said}");
    let european = |text: &str| format!("\u{feff}{}", text.replace(',', ";").replace('.', ",").replace('\n', "\r\n"));
    let (said, through) = correct(european(&plain).as_bytes());
    assert_says(&said, &["byte order mark, columns between semicolons, lines end with CR LF", "decimal commas, as"]);
    assert!(through == european(&expected), "the table comes out in its own dialect");
    let (said, unpacked) = correct(&zstd::encode_all(plain.as_bytes(), 3).unwrap());
    assert_says(&said, &["Zstandard"]);
    assert!(unpacked == expected);
    // The campaign too: the same model from the same numbers.
    let campaign =
        bench.write("european.csv.zst", zstd::encode_all(european(&bench.read("campaign.csv")).as_bytes(), 3).unwrap());
    let out = bench.text("again.json");
    run(["identify", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &out]).ok();
    assert!(model_alone(&bench.read("again.json")) == model_alone(&bench.read("model.json")), "the models differ");
    let packed = bench.text("corrected.csv.gz");
    let said = run(["correct", "--model", &model, "--in", &bench.text("verify.csv"), "--out", &packed]).refused();
    assert_says(&said, &["corrected.csv.gz", "written as they are", "| gzip >"]);
}
