//! Error fields without a model: points measured from several stations, solved, interpolated and scored by the commands.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod common;

use std::fmt::Write;
use std::fs;
use std::path::Path;

use common::assert_says;
use common::files::{machine, text};
use common::program::run;

/// Stations (mm): six around the volume, at two heights.
const STATIONS_MM: [[f64; 3]; 6] = [
    [-250.0, -270.0, -420.0],
    [1020.0, -250.0, -270.0],
    [1020.0, 900.0, -420.0],
    [-240.0, 850.0, -270.0],
    [400.0, -470.0, -420.0],
    [-260.0, 340.0, 700.0],
];

/// Six by five by four points (mm), each indicated so.
fn lattice() -> Vec<[f64; 3]> {
    let at =
        |k: usize| [(k % 6) as f64 * 80.0 + 100.0, (k / 6 % 5) as f64 * 80.0 + 100.0, (k / 30) as f64 * 80.0 + 100.0];
    (0..120).map(at).collect()
}

/// Error of the machine (µm): a ripple, which no shift of a station can pass for.
fn error_um(p: [f64; 3]) -> [f64; 3] {
    let wave = |a: f64, b: f64| 6.0 * (a / 60.0).sin() * (b / 70.0).cos();
    [wave(p[0], p[1]), wave(p[1], p[2]), wave(p[2], p[0])]
}

/// A campaign forward and in reverse from the first so many stations; the given reading (counted from 0) is 20 µm too long.
fn campaign(stations: usize, spoilt: Option<usize>) -> String {
    let mut csv = "station,time_s,x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm,length_mm\n".to_owned();
    let mut row = 0;
    for (k, station) in STATIONS_MM.iter().enumerate().take(stations) {
        for point in lattice().into_iter().chain(lattice().into_iter().rev()) {
            let error = error_um(point);
            let square: f64 = (0..3).map(|d| (point[d] + error[d] / 1e3 - station[d]).powi(2)).sum();
            let extra = if spoilt == Some(row) { 0.02 } else { 0.0 };
            let [x, y, z] = point;
            writeln!(csv, "S{k},{row},{x},{y},{z},0,0,0,{:.9}", square.sqrt() - 300.0 + extra).unwrap();
            row += 1;
        }
    }
    csv
}

fn write(folder: &Path, name: &str, content: &str) -> String {
    fs::write(folder.join(name), content).unwrap();
    text(&folder.join(name))
}

#[test]
fn points_are_solved_a_bad_pair_is_named_and_the_field_between_them_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let campaign = write(folder.path(), "campaign.csv", &campaign(6, Some(250)));
    let (machine, vectors) = (text(&machine()), text(&folder.path().join("vectors.csv")));
    let said = run(["points", "--machine", &machine, "--campaign", &campaign, "--out", &vectors]).ok();
    assert_says(&said, &["120 points solved, 0 not", "readings 251, 470 of station S1", "differ by 20.00 um"]);
    let solved = fs::read_to_string(&vectors).unwrap();
    let numbers = |line: &str| line.split(',').filter_map(|cell| cell.parse::<f64>().ok()).collect::<Vec<f64>>();
    let mut worst = 0.0_f64;
    for row in solved.lines().skip(1).map(numbers) {
        let truth = error_um([row[0], row[1], row[2]]);
        (0..3).for_each(|d| worst = worst.max((row[3 + d] - truth[d]).abs()));
        assert!(row[6..9].iter().all(|u| *u > 0.05 && *u < 10.0), "{row:?}");
    }
    // Stations from nominal points take up a part of the ripple of 6 µm.
    assert!(worst < 3.0, "{worst}");

    let said = run(["interpolate", "--vectors", &vectors, "--splits", "2", "--seed", "3"]).ok();
    assert_says(&said, &["120 points, 2 splits, 65 % interpolate", "kriging", "trilinear", "thin-plate"]);
    assert_eq!(said, run(["interpolate", "--vectors", &vectors, "--splits", "2", "--seed", "3"]).ok());

    let at = write(folder.path(), "at.csv", "x_mm,y_mm,z_mm\n140,180,220\n900,180,220\n");
    let out = text(&folder.path().join("answers.csv"));
    let said = run(["interpolate", "--vectors", &vectors, "--at", &at, "--out", &out]).ok();
    assert_says(&said, &["1 points among the measured ones, 1 beyond them"]);
    let answers = fs::read_to_string(&out).unwrap();
    let rows: Vec<&str> = answers.lines().collect();
    assert!(rows[1].ends_with(",interpolated") && rows[2].ends_with(",extrapolated"), "{answers}");
    let near = numbers(rows[1]);
    (0..3).for_each(|d| assert!((near[3 + d] - error_um([140.0, 180.0, 220.0])[d]).abs() < 3.0, "{answers}"));
}

#[test]
fn what_gives_no_field_is_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let few = write(folder.path(), "few.csv", &campaign(3, None));
    let (machine, out) = (text(&machine()), text(&folder.path().join("out.csv")));
    let said = run(["points", "--machine", &machine, "--campaign", &few, "--out", &out]).refused();
    assert_says(&said, &["few.csv", "3 stations", "at least 4"]);
    let good = "x_mm,y_mm,z_mm,res_x_um,res_y_um,res_z_um\n";
    let cases = [
        (format!("{good}{}", "1,2,3,1,1,1\n1,2,3,2,2,2\n".repeat(5)), "the same within a micrometre"),
        (format!("{good}1,2,3,1,1,1\n"), "too few"),
        (format!("{good}{}", (0..9).map(|k| format!("{k},{},0,1,1,1\n", k * k)).collect::<String>()), "plane"),
        (format!("{good}1,2,nan,1,1,1\n"), "line 2, column z_mm"),
    ];
    let at = write(folder.path(), "at.csv", "x_mm,y_mm,z_mm\n1,1,1\n");
    for (content, says) in cases {
        let vectors = write(folder.path(), "vectors.csv", &content);
        let said = run(["interpolate", "--vectors", &vectors, "--at", &at, "--out", &out]).refused();
        assert_says(&said, &["vectors.csv", says]);
    }
    assert!(!folder.path().join("out.csv").exists());
}
