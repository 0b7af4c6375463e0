//! `abbe diagnose` as a user meets it: the effect is named, the model that comes out corrects with it, verification
//! points only score, the same input gives the same bytes, and wrong input leaves the folder as it was.

use std::fs;
use std::thread;
use std::time::Duration;

use crate::common::assert_says;
use crate::common::files::{Bench, listing, machine, other_machine, text};
use crate::common::program::{Started, abbe, run, signal, wait_until_interruptible};
use crate::common::spoil::{Table, refused};
use abbe_files::ModelFile;
use rustix::process::Signal;
use serde_json::Value;

/// Exit code of a command that Ctrl-C ended.
const INTERRUPTED: i32 = 130;
/// Exit code where every row is extrapolated, rejected or lacks covariates.
const NOTHING_IN_VOLUME: i32 = 4;

/// A machine with play in Y, its campaign and the model that does not know of it.
fn with_backlash() -> Bench {
    identified(&["--effect", "backlash axis=y size_um=3"])
}

fn identified(effects: &[&str]) -> Bench {
    let bench = Bench::simulated(7);
    let (machine, out, campaign) = (text(&machine()), bench.text(""), bench.text("campaign.csv"));
    run([&["simulate", "--machine", &machine, "--seed", "7", "--out", &out], effects].concat()).ok();
    run(["identify", "--machine", &machine, "--campaign", &campaign, "--out", &bench.text("before.json")]).ok();
    bench
}

/// Diagnoses the bench's campaign into a folder of it.
fn diagnose(bench: &Bench, out: &str, more: &[&str]) -> String {
    let (model, campaign, out) = (bench.text("before.json"), bench.text("campaign.csv"), bench.text(out));
    let arguments = ["diagnose", "--model", &model, "--campaign", &campaign, "--out", &out, "--folds", "2"];
    run([&arguments, more].concat()).ok()
}

fn json(bench: &Bench, name: &str) -> Value {
    serde_json::from_str(&bench.read(name)).unwrap()
}

#[track_caller]
fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// A CSV file without one column.
fn without(table: &str, column: &str) -> String {
    let place = table.lines().next().unwrap().split(',').position(|name| name == column).unwrap();
    let cut = |line: &str| {
        let cells = line.split(',').enumerate().filter(|(k, _)| *k != place).map(|(_, cell)| cell);
        cells.collect::<Vec<_>>().join(",") + "\n"
    };
    table.lines().map(cut).collect()
}

/// The same with another text in one cell; the header is line 1.
fn with_cell(table: &str, line: usize, column: &str, text: &str) -> String {
    let place = table.lines().next().unwrap().split(',').position(|name| name == column).unwrap();
    let cells = |row: &str| row.split(',').map(str::to_owned).collect::<Vec<_>>();
    let mut rows: Vec<Vec<String>> = table.lines().map(cells).collect();
    rows[line - 1][place] = text.to_owned();
    rows.iter().map(|row| row.join(",") + "\n").collect()
}

#[test]
fn play_is_found_and_corrected_and_verification_points_only_score() {
    let bench = with_backlash();
    let words = diagnose(&bench, "scored", &["--verify", &bench.text("verify.csv")]);
    assert_says(&words, &["backlash of Y", "report.html", "verification error"]);

    let found = json(&bench, "scored/diagnosis.json");
    assert_eq!(found["consistent_with_noise"], false);
    let effect = &found["effects"][0];
    assert_eq!((&effect["name"], &effect["kind"]), (&"reversal".into(), &"attributed".into()));
    assert_eq!(effect["shape"]["axis"], "y");
    let play = &effect["parameters"][0];
    let (value, u) = (number(&play["value"]), number(&play["u"]));
    assert!((value.abs() - 3e-6).abs() < 4.0 * u, "{value} ± {u} m of 3 µm");
    assert_eq!((&play["unit"], &play["is_plausible"]), (&"m".into(), &true.into()));
    assert!(number(&effect["placebo"]["share_as_good"]) < 0.1);
    for figure in ["held_out_rms_um", "verify_rms_um", "verify_max_um", "chi2_per_dof"] {
        let (before, after) = (number(&found["before"][figure]), number(&found["after"][figure]));
        assert!(after < 0.8 * before, "{figure}: {before} to {after}");
    }
    let page = bench.read("scored/report.html");
    assert_says(&page, &["The model lacks: backlash of Y", "Residual before and after", "Real gain and placebo gain"]);
    assert!(
        !["src=\"http", "src=\"//", "<link", "@import"].iter().any(|out| page.contains(out)),
        "the page opens without network"
    );

    scoring_changes_nothing_else(&bench, found);
    the_model_corrects(&bench);
}

/// Without verification points: the same model, and the same JSON but for their figures. Again: the same bytes.
fn scoring_changes_nothing_else(bench: &Bench, mut scored: Value) {
    for out in ["plain", "again"] {
        diagnose(bench, out, &[]);
    }
    let plain = json(bench, "plain/diagnosis.json");
    assert!(plain["before"]["verify_rms_um"].is_null() && plain["verification"].is_null());
    scored["verification"] = Value::Null;
    for state in ["before", "after"] {
        for figure in ["verify_rms_um", "verify_max_um", "verify_interval_um"] {
            scored[state][figure] = Value::Null;
        }
    }
    assert_eq!(scored, plain);
    let bytes = |name: &str| fs::read(bench.path(name)).unwrap();
    assert!(bytes("scored/model.json") == bytes("plain/model.json"), "scoring changed the model");
    for file in ["report.html", "diagnosis.json", "model.json"] {
        assert!(bytes(&format!("plain/{file}")) == bytes(&format!("again/{file}")), "{file} differs from run to run");
    }
}

/// With the covariate the play is corrected; without it the status says so.
fn the_model_corrects(bench: &Bench) {
    let correct = |input: &str, code: i32| {
        let (model, out) = (bench.text("scored/model.json"), bench.text("corrected.csv"));
        run(["correct", "--model", &model, "--in", input, "--out", &out]).ended(code);
        bench.read("corrected.csv")
    };
    let with = correct(&bench.text("verify.csv"), 0);
    assert!(with.lines().skip(1).all(|line| !line.contains("covariate_missing")));
    let bare = bench.write("bare.csv", without(&bench.read("verify.csv"), "dir_y"));
    let missing = correct(&bare, NOTHING_IN_VOLUME);
    assert!(missing.lines().skip(1).all(|line| line.contains("covariate_missing")));
}

/// The campaign with 800 kg on the table while S2 measured, which bend it by a micrometre, in a form that no candidate has.
fn with_a_load_at_one_station(bench: &Bench) -> String {
    let model = ModelFile::load(&bench.path("before.json")).unwrap().0.model;
    let station_m = model.station("S2").unwrap().1.position_m;
    let mut table = Table::of(&bench.read("campaign.csv"));
    for line in 2..=table.0.len() {
        let is_loaded = table.cell(line, "station") == "S2";
        *table.cell(line, "load_kg") = if is_loaded { "800" } else { "0" }.to_owned();
        if !is_loaded {
            continue;
        }
        let mut number = |column: &str| table.cell(line, column).parse::<f64>().unwrap();
        let reading_mm = ["x_mm", "y_mm", "z_mm"].map(&mut number);
        let offset_mm = ["offset_x_mm", "offset_y_mm", "offset_z_mm"].map(&mut number);
        let length_mm = number("length_mm");
        let sight: Vec<f64> = (0..3).map(|k| (reading_mm[k] + offset_mm[k]) * 1e-3 - station_m[k]).collect();
        let (u, v) = (2.0 * reading_mm[0] / 800.0 - 1.0, 2.0 * reading_mm[1] / 600.0 - 1.0);
        let sag_mm = -1e-3 * (u * v + 0.5 * u * u + 0.3 * v * v * u);
        let along = sight[2] / sight.iter().map(|m| m * m).sum::<f64>().sqrt();
        *table.cell(line, "length_mm") = (length_mm + sag_mm * along).to_string();
    }
    table.text()
}

/// It was found and set aside, U did not hold it, and where nothing else was found the model that was given came out.
#[test]
fn regress_a_load_that_is_found_and_not_told_stands_in_u_of_the_model_that_is_written() {
    let bench = identified(&[]);
    let campaign = bench.write("campaign.csv", with_a_load_at_one_station(&bench));
    let (machine, before) = (text(&machine()), bench.text("before.json"));
    run(["identify", "--machine", &machine, "--campaign", &campaign, "--out", &before]).ok();
    diagnose(&bench, "diagnosis", &[]);
    let record = json(&bench, "diagnosis/diagnosis.json");
    let is_held = |record: &Value| {
        let set_aside = record["set_aside"].as_array().unwrap().clone();
        set_aside
            .iter()
            .any(|own| own["name"] == "table_load" && own["because"].as_str().unwrap().ends_with("stands in U"))
    };
    assert!(is_held(&record) && record["effects"].as_array().unwrap().is_empty(), "{}", record["verdict"]);
    assert_eq!(record["model_out"]["is_the_one_given"], false);
    let head = "x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm";
    let at = |load: &str| format!("700,500,300,0,0,-60{load}\n");
    let loads = bench.write("loads.csv", format!("{head},load_kg\n{}{}", at(",800"), at(",0")));
    let bare = bench.write("bare.csv", format!("{head}\n{}", at("")));
    let corrected = |model: &str, input: &str| {
        run(["correct", "--model", model, "--in", input, "--out", &bench.text("corrected.csv")]).ok();
        let table = bench.read("corrected.csv");
        let row = |row: &str| row.split(',').rev().take(7).map(str::to_owned).collect::<Vec<_>>();
        table.lines().skip(1).map(row).collect::<Vec<_>>()
    };
    let after = bench.text("diagnosis/model.json");
    let (plain, held) = (corrected(&before, &loads), corrected(&after, &loads));
    // Status, U of Z, Y, X, and Z, Y, X from behind.
    let u_z = |row: &[String]| row[1].parse::<f64>().unwrap();
    assert!(plain[0][4..] == held[0][4..] && held[0][0] == "in_volume", "{plain:?} {held:?}");
    assert!(u_z(&held[0]) > 2.0 * u_z(&plain[0]) && u_z(&held[1]) < 1.5 * u_z(&plain[1]), "{plain:?} {held:?}");
    // Nothing is corrected by it, so that nobody has to log it.
    let bare = corrected(&after, &bare);
    assert!(bare[0][4..] == held[0][4..] && bare[0][0] == "in_volume" && u_z(&bare[0]) > u_z(&held[1]), "{bare:?}");
    // It is no effect of the model: the next diagnosis judges it anew.
    fs::copy(&after, &before).unwrap();
    diagnose(&bench, "again", &[]);
    assert!(is_held(&json(&bench, "again/diagnosis.json")));
}

#[test]
fn a_clean_machine_is_consistent_with_noise_and_keeps_its_model() {
    let bench = identified(&[]);
    let printed = diagnose(&bench, "out", &["--json"]);
    assert_eq!(printed, bench.read("out/diagnosis.json"));
    let found = json(&bench, "out/diagnosis.json");
    assert_eq!(found["consistent_with_noise"], true, "{}", found["verdict"]);
    assert_eq!(found["effects"].as_array().unwrap().len(), 0);
    assert!(found["after"]["held_out_rms_um"].is_null() && found["held_out"]["missing_because"].is_string());
    assert_eq!(found["model_out"]["is_the_one_given"], true);
    assert_eq!(bench.read("out/model.json"), bench.read("before.json"));

    // Nothing logged: still a diagnosis, which says what it could not look for.
    let table = bench.read("campaign.csv");
    let header: Vec<&str> = table.lines().next().unwrap().split(',').collect();
    let bare = header[10..].iter().fold(table.clone(), |table, column| without(&table, column));
    let bare = bench.write("bare.csv", bare);
    run(["diagnose", "--model", &bench.text("before.json"), "--campaign", &bare, "--out", &bench.text("bare")]).ok();
    let found = json(&bench, "bare/diagnosis.json");
    let untestable: Vec<_> = found["untestable"].as_array().unwrap().iter().map(|u| u["name"].clone()).collect();
    for name in ["reversal", "scale_expansion", "table_load"] {
        assert!(untestable.contains(&name.into()), "{name} is not in {untestable:?}");
    }
    assert!(found["untestable"][0]["needs"].as_str().is_some_and(|needs| !needs.is_empty()));
    assert_eq!(found["model_out"]["is_the_one_given"], false, "other data, fitted anew");
}

#[test]
fn wrong_input_is_refused_with_place_and_remedy_and_the_folder_stays() {
    let bench = identified(&[]);
    let (model, campaign, out) = (bench.text("before.json"), bench.text("campaign.csv"), bench.text("out"));
    let good = bench.read("campaign.csv");
    fs::create_dir(bench.path("out")).unwrap();
    bench.write("out/diagnosis.json", "older");
    let diagnose = |model: &str, campaign: &str, says: &[&str]| {
        refused(&bench, &["diagnose", "--model", model, "--campaign", campaign, "--out", &out], says);
    };

    let foreign = bench.write("foreign.csv", with_cell(&good, 40, "x_mm", "900.0"));
    diagnose(&model, &foreign, &["foreign.csv", "X = 900.0000 mm", "outside the stroke", "another machine"]);
    let word = bench.write("nan.csv", with_cell(&good, 21, "y_mm", "NaN"));
    diagnose(&model, &word, &["nan.csv, line 21, column y_mm", "not a finite number"]);
    diagnose(&model, &bench.write("empty.csv", ""), &["empty.csv", "empty", "header"]);
    diagnose(&bench.text("none.json"), &campaign, &["none.json", "cannot be read"]);
    diagnose(&campaign, &campaign, &["campaign.csv", "abbe identify"]);
    let other = fs::read_to_string(other_machine()).unwrap();
    diagnose(&bench.write("machine.toml", other), &campaign, &["machine.toml", "abbe identify"]);

    let bad_points = bench.write("points.csv", without(&bench.read("verify.csv"), "actual_x_mm"));
    let arguments = ["diagnose", "--model", &model, "--campaign", &campaign, "--out", &out, "--verify", &bad_points];
    refused(&bench, &arguments, &["points.csv", "actual_x_mm", "missing"]);
    let to_file = ["diagnose", "--model", &model, "--campaign", &campaign, "--out", &campaign];
    refused(&bench, &to_file, &["this is a file", "name a folder"]);
    refused(&bench, &["diagnose", "--campaign", &campaign, "--out", &out], &["--model", "abbe identify"]);
    fs::create_dir(bench.path("same")).unwrap();
    let own = bench.write("same/model.json", bench.read("before.json"));
    let over = ["diagnose", "--model", &own, "--campaign", &campaign, "--out", &bench.text("same")];
    refused(&bench, &over, &["would overwrite", "another folder"]);
    let alone = ["diagnose", "--model", &model, "--campaign", &campaign, "--out", &out, "--folds", "1"];
    refused(&bench, &alone, &["--folds", "at least 2"]);
}

#[test]
fn a_model_whose_effect_the_campaign_cannot_feed_is_refused() {
    let bench = with_backlash();
    diagnose(&bench, "first", &[]);
    let bare = bench.write("bare.csv", without(&bench.read("campaign.csv"), "dir_y"));
    let arguments =
        ["diagnose", "--model", &bench.text("first/model.json"), "--campaign", &bare, "--out", &bench.text("second")];
    refused(&bench, &arguments, &["bare.csv", "reversal", "dir_y", "log it"]);
}

#[test]
fn a_stop_leaves_the_folder_as_it_was() {
    let bench = with_backlash();
    let before = listing(&bench.path(""));
    let (model, campaign, out) = (bench.text("before.json"), bench.text("campaign.csv"), bench.text("out"));
    let started = Started::start(abbe(["diagnose", "--model", &model, "--campaign", &campaign, "--out", &out]));
    wait_until_interruptible(started.id());
    thread::sleep(Duration::from_millis(500));
    signal(started.id(), Signal::INT);
    // In its own words where it looks in time, in those of the program where a step takes longer.
    assert_says(&started.finish().ended(INTERRUPTED), &["stopped"]);
    assert_eq!(listing(&bench.path("")), before);
}

/// Runs of three axes that take a study a while: play, and a pitch error that is bent.
fn long_runs() -> String {
    let mut table = "axis,target_mm,direction,cycle,measured_mm,time_s\n".to_owned();
    let mut state = 7_u32;
    for (number, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
        for cycle in 1..=8 {
            for (direction, play_um) in [("+", 2.0), ("-", -2.0)] {
                for target in 0..31 {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    let noise_um = f64::from(state >> 16) / 65536.0 - 0.5;
                    let target_mm = f64::from(target) * 12.7 + f64::from(target * target % 7);
                    let error_um = play_um + 0.01 * target_mm + 3.0 * (target_mm / 90.0).sin() + noise_um;
                    let time_s =
                        f64::from(((number as i32 * 8 + cycle) * 2 + i32::from(direction == "-")) * 31 + target) * 5.0;
                    let measured_mm = target_mm + error_um / 1e3;
                    table += &format!("{axis},{target_mm},{direction},{cycle},{measured_mm:.6},{time_s}\n");
                }
            }
        }
    }
    table
}

/// Ctrl-C ended a study without a trace of what it had found.
#[test]
fn regress_a_study_that_is_stopped_keeps_what_it_found_and_says_that_it_is_partial() {
    let bench = Bench::simulated(7);
    let campaign = bench.write("runs.csv", long_runs());
    let (own, machine) = (bench.text("out"), text(&machine()));
    let arguments = ["diagnose", "--campaign", &campaign, "--machine", &machine, "--out", &own];
    // How long a machine takes to find the first effect is not known: a little later each time.
    let stopped = (1..40_u32).find_map(|tenths| {
        let started = Started::start(abbe(arguments));
        wait_until_interruptible(started.id());
        thread::sleep(Duration::from_millis(100) * tenths);
        signal(started.id(), Signal::INT);
        let said = started.finish().ended(INTERRUPTED);
        bench.path("out/diagnosis.json").exists().then_some(said)
    });
    assert_says(&stopped.unwrap(), &["what is done so far is being kept", "not judged on data left out"]);
    let found = json(&bench, "out/diagnosis.json");
    assert!(!found["effects"].as_array().unwrap().is_empty(), "{}", found["verdict"]);
    assert_says(&found["notes"].to_string(), &["stopped on request", "more may be missing"]);
    assert_says(&bench.read("out/model.json"), &["the study was stopped on request"]);
    assert_says(&bench.read("out/report.html"), &["stopped on request"]);
    let points = bench.write(
        "points.csv",
        "x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm,dir_x,dir_y,dir_z\n100,100,100,0,0,0,1,1,1\n",
    );
    run(["correct", "--model", &bench.text("out/model.json"), "--in", &points, "--out", &bench.text("corrected.csv")])
        .ok();
}

/// Positioning runs of one axis with play of 4 µm, five cycles of eleven targets.
fn runs() -> String {
    let mut table = "axis,target_mm,direction,cycle,measured_mm,time_s\n".to_owned();
    let mut state = 1_u32;
    for cycle in 1..=5 {
        for (direction, play_um) in [("+", 2.0), ("-", -2.0)] {
            for target in 0..11 {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let noise_um = f64::from(state >> 16) / 65536.0 - 0.5;
                let target_mm = f64::from(target) * 50.0;
                let error_um = play_um + 0.01 * target_mm + 0.4 * noise_um;
                let time_s = f64::from((cycle * 2 + i32::from(direction == "-")) * 11 + target) * 5.0;
                let measured_mm = target_mm + error_um / 1e3;
                table += &format!("X,{target_mm},{direction},{cycle},{measured_mm:.6},{time_s}\n");
            }
        }
    }
    table
}

#[test]
fn positioning_runs_need_no_model() {
    let bench = Bench::simulated(7);
    let campaign = bench.write("runs.csv", runs());
    let words = run(["diagnose", "--campaign", &campaign, "--out", &bench.text("out")]).ok();
    assert_says(&words, &["report.html"]);
    let found = json(&bench, "out/diagnosis.json");
    assert!(!found["effects"].as_array().unwrap().is_empty(), "{}", found["verdict"]);
    assert!(number(&found["after"]["held_out_rms_um"]) < 0.3 * number(&found["before"]["held_out_rms_um"]));
    assert!(!bench.path("out/model.json").exists() && found["model_out"].is_null());
    let page = bench.read("out/report.html");
    assert_says(&page, &["What was measured", "Ladder", "Before and after what was found"]);
    assert!(
        page.contains("class=\"ln lB\"") && page.contains("class=\"ln lA\""),
        "the switch has something to act upon"
    );

    let model = bench.write("model.json", "{}");
    let arguments = ["diagnose", "--model", &model, "--campaign", &campaign, "--out", &bench.text("out")];
    refused(&bench, &arguments, &["need no model", "leave --model out"]);
}

#[test]
fn shipped_sphere_centres_are_told_by_their_header() {
    let bench = Bench::simulated(7);
    let centres = machine().with_file_name("../data/zhang2016_centres.csv");
    run(["diagnose", "--campaign", &text(&centres), "--out", &bench.text("out")]).ok();
    let found = json(&bench, "out/diagnosis.json");
    assert_says(found["data_kind"].as_str().unwrap(), &["sphere centres"]);
    let before = &found["before"];
    assert!(number(&before["residual_rms_um"]) > 100.0, "the paper's model leaves some 0.2 mm a coordinate: {before}");
    assert!(!found["next_measurements"].as_array().unwrap().is_empty(), "ten centres cannot decide everything");
}

/// Residual vectors over X, Y, Z that grow with a temperature.
fn vectors(unit: &str) -> String {
    let mut table = format!("x_mm,y_mm,z_mm,res_x_{unit},res_y_{unit},res_z_{unit},temp_c,block\n");
    let mut state = 1_u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state >> 16) / 65536.0 - 0.5
    };
    for k in 0..160_i32 {
        let [x, y, z] = [(k * 37) % 400, (k * 53) % 300, (k * 71) % 200];
        let warm = (f64::from(k) * 0.7).sin();
        let [a, b, c] = [3.0 * warm + noise(), noise(), noise()];
        table += &format!("{x},{y},{z},{a:.4},{b:.4},{c:.4},{:.3},{}\n", 20.0 + warm, k / 8);
    }
    table
}

#[test]
fn residual_vectors_of_other_software_are_diagnosed_and_checked() {
    let bench = Bench::simulated(7);
    let good = bench.write("residuals.csv", vectors("um"));
    let out = bench.text("out");
    run(["diagnose", "--residuals", &good, "--out", &out]).ok();
    let page = fs::read_to_string(format!("{out}/report.html")).unwrap();
    assert!(page.contains("<h3>Residual vectors in space</h3>") && page.contains("<h3>Residual over "), "no picture");
    assert!(page.contains("Residual by component, before and after what was found"));
    assert!(page.contains("vec lB") && page.contains("vec lA"), "vectors before and after");
    let found = json(&bench, "out/diagnosis.json");
    let effect = &found["effects"][0];
    assert_eq!(effect["kind"], "empirical", "{}", found["verdict"]);
    assert!(effect["covariates"].as_array().unwrap().contains(&"temp_c".into()), "{effect}");

    let refuse = |name: &str, content: String, says: &[&str]| {
        let file = bench.write(name, content);
        refused(&bench, &["diagnose", "--residuals", &file, "--out", &out], says);
    };
    refuse("inches.csv", vectors("in"), &["inches.csv", "res_x_"]);
    refuse("nan.csv", with_cell(&vectors("um"), 2, "temp_c", "NaN"), &["nan.csv", "line 2", "finite"]);
    refuse("empty.csv", String::new(), &["empty.csv", "empty"]);
    let (good, model) = (good.as_str(), bench.text("campaign.csv"));
    let both = ["diagnose", "--residuals", good, "--campaign", &model, "--out", &out];
    let code = run(both).code;
    assert_eq!(code, Some(2), "one kind of data at a time");
}

/// The rows of a table that are kept, counted from 0; what stands above them stays.
fn kept(table: &str, keep: impl Fn(usize, &str) -> bool) -> String {
    let first = table.lines().position(|line| !line.starts_with('#')).unwrap() + 1;
    let rows = table.lines().enumerate().filter(|(k, line)| *k < first || keep(*k - first, line));
    rows.map(|(_, line)| format!("{line}\n")).collect()
}

#[test]
fn data_that_fix_no_study_are_refused_by_their_file_with_a_remedy_and_nothing_is_written() {
    let bench = Bench::empty();
    let out = bench.text("out");
    let refuse = |option: &str, content: String, says: &[&str]| {
        let file = bench.write("data.csv", content);
        refused(&bench, &["diagnose", option, &file, "--out", &out], &[says, &["data.csv"]].concat());
    };
    let runs = runs();
    refuse("--campaign", kept(&runs, |k, _| k < 44), &["axis X has 2 cycles, at least 3", "five cycles"]);
    refuse("--campaign", kept(&runs, |_, line| line.starts_with("X,100,")), &["one target only", "several targets"]);
    refuse("--campaign", kept(&runs, |_, _| false), &["no row"]);
    refuse("--campaign", runs.replace("X,100,+,2", "X,100,?,2"), &["column direction"]);
    let centres = fs::read_to_string(machine().with_file_name("../data/zhang2016_centres.csv")).unwrap();
    refuse("--campaign", kept(&centres, |k, _| k < 6), &["3 poses of A and C, at least", "further angles"]);
    refuse("--campaign", kept(&centres, |k, _| k % 2 == 0), &["two distances"]);
    let vectors = vectors("um");
    refuse("--residuals", kept(&vectors, |k, _| k < 5), &["5 residual vectors, at least", "more points"]);
    refuse("--residuals", kept(&vectors, |k, _| k < 16), &["2 blocks, at least", "column block"]);
    let in_a_point = |row: &dyn Fn(usize) -> String| {
        let rows: String = (0..30).map(row).collect();
        format!("{}\n{rows}", vectors.lines().next().unwrap())
    };
    refuse("--residuals", in_a_point(&|k| format!("1,2,3,{k},2,3,20,0\n")), &["1 blocks, at least"]);
    let copies = in_a_point(&|_| "1,2,3,1,2,3,20,0\n".to_owned());
    refuse("--residuals", copies, &["1 residual vectors, at least", "more points"]);
    let model = bench.write("model.json", "{}");
    let file = bench.write("data.csv", &vectors);
    refused(&bench, &["diagnose", "--residuals", &file, "--model", &model, "--out", &out], &["model.json"]);
}
