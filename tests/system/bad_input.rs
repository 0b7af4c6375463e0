//! Input that is wrong: every command that meets it fails with exit code 1, names place and remedy, and leaves the
//! folder as it was.

use std::fs;

use crate::common::assert_says;
use crate::common::files::{Bench, machine, other_machine, samples, text};
use crate::common::graph::{LaunchText, MEMORY, topic};
use crate::common::program::run;
use crate::common::spoil::{Spoil, Table, identify_refused, refused};
use abbe_msgs::{RangeResidual, ResidualStatus, ScaleReading};

#[track_caller]
fn correct_refused(bench: &Bench, model: &str, input: &str, says: &[&str]) {
    refused(bench, &["correct", "--model", model, "--in", input, "--out", &bench.text("refused.csv")], says);
}

/// What can be wrong with a campaign, and what `identify` must say about it.
const CAMPAIGNS: [(&str, Spoil, &[&str]); 14] = [
    (
        "missing column",
        |t| t.without("length_mm"),
        &["line 1, column length_mm", "missing", "add the column length_mm"],
    ),
    (
        "misspelt column",
        |t| t.rename("length_mm", "lenght_mm"),
        &["line 1, column lenght_mm", "did you mean", "rename"],
    ),
    ("wrong unit", |t| t.rename("x_mm", "x_um"), &["line 1, column x_um", "millimetres", "convert the values"]),
    (
        "not a number",
        |t| *t.cell(21, "y_mm") = "NaN".into(),
        &["line 21, column y_mm", "not a finite number", "remove"],
    ),
    ("empty cell", |t| t.cell(22, "length_mm").clear(), &["line 22, column length_mm", "empty", "write a number"]),
    ("words", |t| *t.cell(23, "z_mm") = "12,5".into(), &["line 23", "cells", "complete the row"]),
    (
        "duplicate time",
        |t| *t.cell(21, "time_s") = t.cell(20, "time_s").clone(),
        &["line 21, column time_s", "same as", "remove the duplicate row"],
    ),
    (
        "unsorted time",
        |t| *t.cell(21, "time_s") = "1.0".into(),
        &["line 21, column time_s", "earlier than", "sort the rows"],
    ),
    ("one station", |t| t.keep(|_, row| row[0] == "S1"), &["1 station", "measure from at least 3 stations"]),
    (
        "fewer readings than unknowns",
        |t| t.keep(|number, _| number % 70 == 0),
        &["readings cannot determine", "unknowns", "measure more lines"],
    ),
    (
        "another machine",
        |t| *t.cell(40, "x_mm") = "900.0".into(),
        &["reading 39", "X = 900.0000 mm", "outside the stroke 0 … 800 mm", "another machine"],
    ),
    (
        "sign of one offset",
        |t| *t.cell(31, "offset_z_mm") = "60.0".into(),
        &["line 31, column offset_z_mm", "changes its sign", "correct it"],
    ),
    (
        "sign of the offset of a whole line",
        |t| {
            let (line, offset) = (t.column("line"), t.column("offset_z_mm"));
            let name = t.0[100][line].clone();
            for row in t.0.iter_mut().skip(1).filter(|row| row[line] == name) {
                row[offset] = format!("{}", -row[offset].parse::<f64>().unwrap());
            }
        },
        &["station S1", "disagrees", "correct the sign of offset_z_mm"],
    ),
    ("nothing", |t| t.0.clear(), &["empty", "give a header line"]),
];

#[test]
fn identify_names_what_is_wrong_with_a_campaign_and_leaves_nothing() {
    let bench = Bench::simulated(5);
    let good = bench.read("campaign.csv");
    for (name, spoil, says) in CAMPAIGNS {
        println!("{name}");
        let mut table = Table::of(&good);
        spoil(&mut table);
        let campaign = bench.write("spoilt.csv", table.text());
        identify_refused(&bench, &text(&machine()), &campaign, &[says, &["spoilt.csv"]].concat());
    }
    println!("cut off");
    let campaign = bench.write("spoilt.csv", &good[..good.len() / 2]);
    identify_refused(&bench, &text(&machine()), &campaign, &["spoilt.csv, line", "if the file was cut off"]);
    println!("machine of another stroke");
    let campaign = bench.text("campaign.csv");
    identify_refused(&bench, &text(&other_machine()), &campaign, &["campaign.csv", "fyxz", "another machine"]);
    println!("no such file");
    let none = bench.text("none.csv");
    identify_refused(&bench, &text(&machine()), &none, &["none.csv", "No such file"]);
    println!("no such folder");
    let out = bench.text("none/model.json");
    let arguments = ["identify", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &out];
    refused(&bench, &arguments, &["none/model.json", "there is no folder"]);
}

#[test]
fn identify_names_what_is_wrong_with_a_machine_file() {
    let bench = Bench::simulated(5);
    let good = fs::read_to_string(machine()).unwrap();
    let spoilt: [(&str, String, &[&str]); 6] = [
        ("garbage", "\u{1}[[[".into(), &["line 1", "correct this line"]),
        ("nothing", String::new(), &["missing field `name`", "add the key"]),
        (
            "misspelt key",
            good.replace("repeatability_um", "repeatbility_um"),
            &["key repeatbility_um", "expected one of", "`repeatability_um`", "correct the spelling"],
        ),
        ("unknown key", "colour = \"blue\"\n".to_owned() + &good, &["line 1, key colour", "remove the key"]),
        ("empty stroke", good.replace("[0.0, 800.0]", "[800.0, 0.0]"), &["key stroke_mm.X", "write [lower, upper]"]),
        ("cut off", good[..good.len() / 2].to_owned(), &["machine.toml"]),
    ];
    for (name, content, says) in spoilt {
        println!("{name}");
        let machine = bench.write("machine.toml", content);
        identify_refused(&bench, &machine, &bench.text("campaign.csv"), &[says, &["machine.toml"]].concat());
    }
}

#[test]
fn a_bag_that_is_cut_off_anywhere_and_a_bag_under_the_name_of_a_table_are_refused() {
    let bench = Bench::identified(5);
    let (bag, campaign) = (bench.text("whole.mcap"), bench.text("campaign.csv"));
    run(["convert", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &bag]).ok();
    let whole = fs::read(bench.path("whole.mcap")).unwrap();
    for length in [0, 1, 7, 100, whole.len() / 3, whole.len() / 2, whole.len() - 9, whole.len() - 1] {
        let cut = bench.write("cut.mcap", &whole[..length]);
        let says = ["cut.mcap", "cut off", "recover the bag"];
        identify_refused(&bench, &text(&machine()), &cut, &says);
        let out = bench.text("refused.mcap");
        refused(&bench, &["correct", "--model", &bench.text("model.json"), "--in", &cut, "--out", &out], &says);
    }
    for table in [bench.text("refused.csv"), "-".to_owned()] {
        let arguments = ["correct", "--model", &bench.text("model.json"), "--in", &bag, "--out", &table];
        refused(&bench, &arguments, &["is a bag", "name a folder, or a file ending in .mcap"]);
    }
    let saved = bench.text("saved.mcap");
    bench.write("cut.mcap", &whole[..whole.len() / 2]);
    let ran = run(["recover", "--bag", &bench.text("cut.mcap"), "--out", &saved]);
    assert_says(&String::from_utf8_lossy(&ran.output), &["messages saved", "damaged: bytes", "after "]);
    assert_says(&ran.refused(), &["messages may be lost", "saved.mcap"]);
    assert!(samples::<ScaleReading>(&bench.path("saved.mcap"), "/bridge_xyz/scale/reading").len() > 1000);
}

#[test]
fn regress_recover_goes_on_after_a_damaged_chunk_and_refuses_what_is_no_bag() {
    let bench = Bench::simulated(5);
    let (bag, campaign) = (bench.text("whole.mcap"), bench.text("campaign.csv"));
    run(["convert", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &bag]).ok();
    let mut bytes = fs::read(bench.path("whole.mcap")).unwrap();
    let tenth = bytes.len() / 10;
    let at = tenth + bytes[tenth..].windows(3).position(|window| window == b"lz4").unwrap() + 200;
    bytes[at] ^= 1;
    let damaged = bench.write("damaged.mcap", bytes);
    let ran = run(["recover", "--bag", &damaged, "--out", &bench.text("saved.mcap")]);
    assert_says(&String::from_utf8_lossy(&ran.output), &["damaged: bytes", "between", "chunks are whole"]);
    assert_says(&ran.refused(), &["messages are lost; the rest is in"]);
    let readings = |bag: &str| samples::<ScaleReading>(&bench.path(bag), "/bridge_xyz/scale/reading").len();
    assert!(readings("saved.mcap") + 100 > readings("whole.mcap"), "{}", readings("saved.mcap"));
    run(["recover", "--bag", &bag, "--out", &bench.text("again.mcap")]).ok();
    let out = bench.text("refused.mcap");
    refused(&bench, &["recover", "--bag", &campaign, "--out", &out], &["not a bag", "does not begin as MCAP does"]);
    let empty = bench.write("empty.mcap", "");
    refused(&bench, &["recover", "--bag", &empty, "--out", &out], &["not a bag", "the file is empty"]);
}

#[test]
fn convert_that_fails_midway_leaves_no_bag() {
    let bench = Bench::simulated(5);
    let long = format!("\n{}", "S".repeat(65));
    let campaign = bench.write("long.csv", bench.read("campaign.csv").replace("\nS5", &long));
    for out in ["bag", "bag.mcap"] {
        let out = bench.text(out);
        let arguments = ["convert", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &out];
        refused(&bench, &arguments, &["reading 2", "station", "65 bytes is longer than 64", "shorten it"]);
    }
}

#[test]
fn a_model_file_that_is_cut_off_or_changed_is_refused() {
    let bench = Bench::identified(5);
    let good = fs::read(bench.path("model.json")).unwrap();
    let points = bench.text("verify.csv");
    for length in [0, 1, 40, 200, good.len() / 3, good.len() / 2, good.len() - 3] {
        let model = bench.write("spoilt.json", &good[..length]);
        correct_refused(&bench, &model, &points, &["spoilt.json, line", "cut off", "copy it again"]);
    }
    // Digits of numbers: everywhere else a flipped bit would already be no JSON.
    let digits = (0..good.len()).filter(|at| good[*at].is_ascii_digit() && good[at - 1].is_ascii_digit());
    for at in digits.step_by(good.len() / 40) {
        let mut flipped = good.clone();
        flipped[at] ^= 1;
        let model = bench.write("spoilt.json", &flipped);
        correct_refused(&bench, &model, &points, &["spoilt.json"]);
    }
    let refused =
        ["--model", &bench.text("model.json"), "--machine", &text(&other_machine()), "--in", &points, "--out"];
    let out = bench.text("refused.csv");
    let arguments: Vec<&str> = ["correct"].into_iter().chain(refused).chain([out.as_str()]).collect();
    self::refused(&bench, &arguments, &["model.json", "bridge_xyz", "fyxz", "give the model of this machine"]);
}

const POINT_HEAD: &str = "x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm";

#[test]
fn correct_names_what_is_wrong_with_its_points() {
    let bench = Bench::identified(5);
    let model = bench.text("model.json");
    let spoilt: [(&str, String, &[&str]); 6] = [
        ("missing column", POINT_HEAD.replace("y_mm,z", "z") + "\n1,2,0,0,-60\n", &["line 1, column y_mm", "add"]),
        ("misspelt", POINT_HEAD.replace("offset_z", "ofset_z") + "\n1,2,3,0,0,-60\n", &["ofset_z_mm", "rename"]),
        ("unit", POINT_HEAD.replace("x_mm,y", "x_m,y") + "\n1,2,3,0,0,-60\n", &["column x_m", "millimetres"]),
        (
            "offset of the opposite sign",
            format!("{POINT_HEAD}\n100,100,100,0,0,-60\n100,100,100,0,0,60\n"),
            &["line 3, column offset_z_mm", "opposite sign", "correct its sign"],
        ),
        ("no number", format!("{POINT_HEAD}\n1,x,3,0,0,-60\n"), &["line 2, column y_mm", "not a number"]),
        ("nothing", String::new(), &["empty", "give a header line"]),
    ];
    for (name, content, says) in spoilt {
        println!("{name}");
        let points = bench.write("points.csv", content);
        correct_refused(&bench, &model, &points, &[says, &["points.csv"]].concat());
    }
    let points = bench.write("points.csv", format!("{POINT_HEAD}\n1,2,3,0,0,-60\n"));
    let out = bench.text("refused.mcap");
    refused(&bench, &["correct", "--model", &model, "--in", &points, "--out", &out], &["is CSV", ".csv"]);
}

#[test]
fn what_lies_outside_is_flagged_and_what_lies_far_outside_is_rejected_with_empty_cells() {
    let bench = Bench::identified(5);
    let rows = ["100,100,100,0,0,-60", "2,100,100,0,0,-60", "100,100,100,0,0,-400", "2000,100,100,0,0,-60"];
    let points = bench.write("points.csv", format!("{POINT_HEAD}\n{}\n", rows.join("\n")));
    let output = run(["correct", "--model", &bench.text("model.json"), "--in", &points, "--out", "-"]).ok();
    let table = Table::of(&output);
    let statuses: Vec<&String> = table.0.iter().map(|row| row.last().unwrap()).collect();
    assert_eq!(statuses, ["status", "in_volume", "extrapolated", "extrapolated", "rejected"]);
    for (row, given) in table.0[1..].iter().zip(rows) {
        assert_eq!(row[..6].join(","), given, "the row itself must not change");
        let rejected = row[12] == "rejected";
        assert!(row[6..12].iter().all(|cell| cell.is_empty() == rejected), "{row:?}");
    }
}

#[test]
fn a_station_that_the_model_does_not_know_is_reported_as_such_and_nothing_is_predicted() {
    let bench = Bench::identified(5);
    let strange = bench.read("campaign.csv").replace("\nS5,", "\nS9,");
    let mut table = Table::of(&strange);
    table.keep(|number, _| number % 5 == 0);
    let campaign = bench.write("strange.csv", table.text());
    let launch = LaunchText::default()
        .nodes(&["scale", "tracer", "geometric", "residual", "monitor", "recorder"])
        .record("watched")
        .edge("scale", "geometric", MEMORY)
        .edge("geometric", "residual", MEMORY)
        .edge("residual", "monitor", MEMORY)
        .edge("tracer", "monitor", MEMORY)
        .edge("monitor", "recorder", MEMORY)
        .source("scale", &campaign, None, 1000.0)
        .source("tracer", &campaign, None, 1000.0)
        .monitor();
    run(["launch", &launch.write(&bench)]).ok();
    let residuals = samples::<RangeResidual>(&bench.path("watched"), &topic("monitor/range_residual"));
    let (unknown, known): (Vec<RangeResidual>, Vec<RangeResidual>) =
        residuals.iter().partition(|residual| residual.station.as_str() == "S9");
    assert!(unknown.len() > 50 && known.len() > 200, "{} and {}", unknown.len(), known.len());
    assert!(unknown.iter().all(|r| r.status == ResidualStatus::UnknownStation && !r.residual_valid));
    assert!(known.iter().all(|r| r.status != ResidualStatus::UnknownStation && r.residual_valid));
    let outside = known.iter().filter(|r| r.status == ResidualStatus::OutOfBounds).count();
    assert!(outside * 50 < known.len(), "{outside} of {} are out of bounds", known.len());
}

#[test]
fn launch_files_that_make_no_graph_are_refused_by_key() {
    let bench = Bench::identified(5);
    let good = LaunchText::default()
        .nodes(&["scale", "geometric"])
        .edge("scale", "geometric", MEMORY)
        .edge("geometric", "user", MEMORY)
        .source("scale", "campaign.csv", None, 1000.0)
        .text();
    let with_record = |record: &str| format!("record = {record}\n{good}");
    let spoilt: [(&str, String, &[&str]); 16] = [
        ("no TOML", "nodes = [".into(), &["launch.toml"]),
        ("unknown key", "colour = 1\n".to_owned() + &good, &["colour", "expected one of"]),
        ("unknown node", good.replace("\"scale\", \"geometric\"", "\"scales\""), &["scales", "scale"]),
        ("unknown transport", good.replace(MEMORY, "pigeon"), &["edges[0]", "pigeon", "shared-memory"]),
        ("impossible edge", good.replace("to = \"geometric\"", "to = \"tracer\""), &["edges[0]", "does not take"]),
        ("unknown taker", good.replace("to = \"user\"", "to = \"usr\""), &["edges[1]", "usr"]),
        ("rate", good.replace("1000.0", "0.0"), &["scale.pace", "above 0"]),
        ("no driver", good.replace("[scale]", "[tracer]"), &["scale", "add a table with driver"]),
        ("endless rate", good.replace("1000.0", "1e-300"), &["scale.pace", "1e-6 at least"]),
        ("wait", good.replace("subscribers_s = 20.0", "subscribers_s = 1e300"), &["wait_for_subscribers_s", "1e9"]),
        ("record a number", with_record("7"), &["record", "the path of a bag, or a table"]),
        ("record unknown", with_record("{ bag = \"a\", colour = 1 }"), &["colour", "split_mib"]),
        ("record split file", with_record("{ bag = \"a.mcap\", split_s = 9.0 }"), &["record.bag", "name a folder"]),
        ("record split time", with_record("{ bag = \"a\", split_s = nan }"), &["record.split_s", "from 1 to 1e9"]),
        (
            "record no room",
            with_record("{ bag = \"a\", least_free_mib = 3 }"),
            &["record.least_free_mib", "16 or more"],
        ),
        ("no bag", good.replace("\"geometric\"]", "\"geometric\", \"recorder\"]"), &["record", "no bag"]),
    ];
    for (name, content, says) in spoilt {
        println!("{name}");
        let file = bench.write("launch.toml", content);
        refused(&bench, &["launch", &file], &[says, &["launch.toml"]].concat());
    }
    let file = bench.write("launch.toml", good.replace("\"model.json\"", "\"none.json\""));
    refused(&bench, &["launch", &file], &["node geometric", "none.json", "No such file"]);
    refused(&bench, &["launch", &bench.text("none.toml")], &["none.toml", "No such file", "check the path"]);
}

#[test]
fn regress_a_file_of_no_or_one_row_is_not_taken_for_a_plate() {
    let bench = Bench::simulated(5);
    let (machine, out) = (text(&machine()), bench.text("refused.json"));
    let rows = bench.read("verify.csv");
    for (count, said) in
        [(0, "the file holds a header but no row"), (1, "the file holds 1 row;"), (3, "the file holds 3 rows;")]
    {
        let few: String = rows.lines().take(1 + count).map(|line| format!("{line}\n")).collect();
        let few = bench.write("few.csv", few);
        let fit = ["fit-points", "--machine", &machine, "--points", &few, "--u-um", "0.05", "--out", &out];
        refused(&bench, &fit, &["few.csv", said]);
    }
}

#[test]
fn regress_copies_of_rows_are_refused_wherever_points_count() {
    let bench = Bench::identified(5);
    let (model, out) = (bench.text("model.json"), bench.text("refused.csv"));
    let rows = bench.read("verify.csv");
    // Rows 2 to 11 once more, at the end.
    let again: String = rows.lines().skip(1).take(10).map(|line| format!("{line}\n")).collect();
    let last = rows.lines().count() + 1;
    let points = bench.write("copied.csv", rows.clone() + &again);
    let said = format!("copied.csv, line {last}: the row repeats line 2 to the last digit");
    for arguments in [
        vec!["verify", "--model", &model, "--points", &points],
        vec!["residuals", "--model", &model, "--campaign", &points, "--out", &out],
    ] {
        refused(&bench, &arguments, &[&said, "remove it"]);
    }
}
