//! `abbe conformity` and `abbe export` as a user sees them: figures of shipped and simulated data, files, refusals.

use std::fs;
use std::path::Path;

use crate::common::assert_says;
use crate::common::files::{Bench, listing, machine, text};
use crate::common::program::run;
use serde_json::Value;

/// The deviations of Liang 2025, Table 2.
fn shipped_lengths() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config/data/liang2025_lengths.csv");
    text(&path.canonicalize().unwrap())
}

fn json(arguments: &[&str]) -> Value {
    serde_json::from_str(&run(arguments).ok()).unwrap()
}

#[test]
fn val_liang_2025_lengths_are_judged_against_their_limit_and_the_standard() {
    let folder = tempfile::tempdir().unwrap();
    let out = text(&folder.path().join("report"));
    let lengths = shipped_lengths();
    let arguments =
        ["conformity", "--lengths", &lengths, "--probing", "bidirectional", "--mpe", "0.5+L/400", "--out", &out];
    let words = run(arguments).ok();
    assert_says(
        &words,
        &[
            "-0.580 µm at 420.0000 mm on diagonal_d",
            "every error conforms",
            "simple acceptance",
            "52.5 %",
            "nothing is verified",
        ],
    );
    let figures: Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("report/conformity.json")).unwrap()).unwrap();
    assert_eq!(figures["against_limits"]["errors"], "conforms");
    assert_eq!(figures["against_limits"]["verified"], false);
    assert_eq!(figures["departures"].as_array().unwrap().len(), 5);
    // Worked out by hand in the figures of the papers: 0.12 µm over 160.0284 mm.
    let tightest = &figures["tightest_by_smallest_area"];
    assert!((tightest["um_per_mm"].as_f64().unwrap() - 0.12 / 160.0284).abs() < 1e-9, "{tightest}");
    let page = fs::read_to_string(folder.path().join("report/report.html")).unwrap();
    assert_says(&page, &["<svg", "measured − calibrated", "Not a whole test", "simple acceptance"]);
}

#[test]
fn regress_a_limit_that_is_too_tight_and_an_uncertainty_change_verdict_and_exit_code() {
    let lengths = shipped_lengths();
    let verdict = |mpe: &str, more: &[&str], code: i32| {
        let mut arguments =
            vec!["conformity", "--lengths", &lengths, "--probing", "bidirectional", "--json", "--mpe", mpe];
        arguments.extend(more);
        let ran = run(&arguments);
        assert_eq!(ran.code, Some(code), "{}", ran.errors);
        let figures: Value = serde_json::from_slice(&ran.output).unwrap();
        figures["against_limits"]["errors"].as_str().unwrap().to_owned()
    };
    // A script tells a machine that fails from a file that cannot be read (1) by the exit code.
    assert_eq!(verdict("0.58", &[], 0), "conforms");
    assert_eq!(verdict("0.58", &["--uncertainty", "0.07+L/4000"], 5), "undecided");
    assert_eq!(verdict("0.3", &["--uncertainty", "0.07+L/4000"], 3), "does_not_conform");
}

#[test]
fn regress_r0_names_its_own_rule_and_the_limit_that_would_do_does() {
    let folder = tempfile::tempdir().unwrap();
    let (lengths, out) = (shipped_lengths(), text(&folder.path().join("out")));
    let with = |mpe: &str, more: &[&str]| {
        let stated = ["--probing", "bidirectional", "--uncertainty", "0.07+L/4000", "--r0-limit-um", "0.31"];
        run([&["conformity", "--lengths", &lengths, "--mpe", mpe], &stated[..], more].concat())
    };
    let own = "simple acceptance: the uncertainty of the test is not taken into account; in a range of measurements of one gauge";
    let words = String::from_utf8(with("0.58+L/1000", &[]).output).unwrap();
    assert_says(
        &words,
        &["R0,MPL         0.310 µm: conforms", own, "ISO 14253-1", "the uncertainty of the test left out"],
    );
    let figures: Value = serde_json::from_slice(&with("0.58+L/1000", &["--json", "--out", &out]).output).unwrap();
    let against = &figures["against_limits"];
    assert_says(against["decision_rule"].as_str().unwrap(), &["ISO 14253-1"]);
    assert_says(against["repeatability_decision_rule"].as_str().unwrap(), &[own]);
    let page = fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    assert_says(&page, &[&format!("of the limit. Decision rule: {own}"), "Decision rule: ISO 14253-1"]);
    // The A that would do, and one that is less by a nanometre.
    let enough_um = against["smallest_constant_for_its_k_um"].as_f64().unwrap();
    let errors = |constant_um: f64| {
        let ran = with(&format!("{constant_um}+L/1000"), &["--json"]);
        let figures: Value = serde_json::from_slice(&ran.output).unwrap();
        (ran.code, figures["against_limits"]["errors"].as_str().unwrap().to_owned())
    };
    assert_eq!(errors(enough_um + 1e-6), (Some(0), "conforms".to_owned()));
    assert_eq!(errors(enough_um - 1e-3), (Some(5), "undecided".to_owned()));
    // Where the largest value of a limit is too small, no A and no K would do.
    let capped = with("min(0.58+L/1000, 0.6)", &[]);
    assert_says(
        &String::from_utf8(capped.output).unwrap(),
        &["its largest value would have to be", "whatever A and K"],
    );
}

#[test]
fn a_simulated_machine_is_better_after_correction_than_before() {
    let machine = text(&machine());
    let arguments = ["conformity", "--machine", &machine, "--seed", "4", "--mpe", "2+L/400", "--json"];
    let figures = json(&arguments);
    let largest = |when: &str| figures[when]["largest_error_um"].as_f64().unwrap().abs();
    assert!(largest("before") > 10.0 * largest("after"), "{} {}", largest("before"), largest("after"));
    for when in ["before", "after"] {
        assert_eq!(figures[when]["departures"].as_array().unwrap().len(), 0);
        assert_eq!(figures[when]["sets"].as_array().unwrap().len(), 35);
    }
    assert_eq!(figures["after"]["against_limits"]["verified"], true);
    assert_eq!(run(arguments).ok(), run(arguments).ok(), "the same seed gives the same bytes");
    let offset = json(&["conformity", "--machine", &machine, "--seed", "4", "--tool-offset-mm", "150", "--json"]);
    assert_eq!(
        (offset["after"]["test"].as_str(), offset["after"]["lines"].as_array().unwrap().len()),
        (Some("E150"), 2)
    );
}

/// What no chain of rigid bodies makes: sheets of 6 um over two pairs of axes.
const SHEETS: [&str; 2] = [
    "undescribed seed=1 of=x_mm of_from=0 of_to=800 and=y_mm and_from=0 and_to=600 along=z size_um=6",
    "undescribed seed=8 of=y_mm of_from=0 of_to=600 and=z_mm and_from=0 and_to=600 along=x size_um=6",
];

#[test]
fn a_residual_model_takes_away_length_error_that_geometry_leaves() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| text(&folder.path().join(name));
    let (machine, out, model, residual) =
        (text(&machine()), place("virtual"), place("model.json"), place("residual.json"));
    let simulated = ["--machine", &machine, "--seed", "1", "--effect", SHEETS[0], "--effect", SHEETS[1]];
    run([&["simulate"], &simulated[..], &["--out", &out]].concat()).ok();
    let campaign = format!("{out}/campaign.csv");
    run(["identify", "--machine", &machine, "--campaign", &campaign, "--out", &model]).ok();
    // Points whose position is known: what a multilateration or an artefact gives.
    let (known, vectors, config) = (format!("{out}/verify.csv"), place("residuals.csv"), place("kriging.toml"));
    run(["residuals", "--model", &model, "--campaign", &known, "--u-actual-um", "0.05", "--out", &vectors]).ok();
    fs::write(&config, "method = \"kriging\"\n").unwrap();
    run(["train", "--residuals", &vectors, "--config", &config, "--out", &residual]).ok();
    let figures = json(
        &[&["conformity"], &simulated[..], &["--model", &model, "--residual", &residual, "--json", "--out", &out]]
            .concat(),
    );
    let page = fs::read_to_string(format!("{out}/report.html")).unwrap();
    assert_says(&page, &["model.json, SHA-256 ", "residual.json, SHA-256 ", "bridge_xyz.toml, SHA-256 "]);
    for state in ["mark fB", "mark fM", "mark fA"] {
        assert!(page.contains(state), "the switch has something to act upon: {state}");
    }
    let largest = |stage: &str| figures[stage]["largest_error_um"].as_f64().unwrap().abs();
    let [before, geometric, after] = ["before", "geometric", "after"].map(largest);
    assert!(before > 10.0 * geometric && after < 0.85 * geometric, "{before} {geometric} {after}");
    // Without the residual model the same model gives the second of these three.
    let alone = json(&[&["conformity"], &simulated[..], &["--model", &model, "--json"]].concat());
    assert_eq!((&alone["after"], &alone["geometric"]), (&figures["geometric"], &Value::Null));
}

#[test]
fn points_on_a_sphere_give_form_and_size() {
    let bench = Bench::simulated(1);
    // Corners of a cube and an octahedron: 14 points of radius 10 mm, but for one pole that is 1 um out.
    let mut points = "x_mm,y_mm,z_mm\n".to_owned();
    let s = 10.0 / 3.0_f64.sqrt();
    for x in [-s, s] {
        for y in [-s, s] {
            for z in [-s, s] {
                points += &format!("{x},{y},{z}\n");
            }
        }
    }
    points += "10.001,0,0\n-10,0,0\n0,10,0\n0,-10,0\n0,0,10\n0,0,-10\n";
    let sphere = bench.write("sphere.csv", points);
    let ran = run(["conformity", "--sphere", &sphere, "--diameter-mm", "20", "--form-limit-um", "0.5", "--json"]);
    assert_eq!(ran.code, Some(3), "{}", ran.errors);
    let figures: Value = serde_json::from_slice(&ran.output).unwrap();
    let form = figures["form_error_um"].as_f64().unwrap();
    assert!((0.5..1.0).contains(&form), "{form}");
    assert_eq!((figures["form"].as_str(), figures["size"].as_str()), (Some("does_not_conform"), None));
    assert!(figures["departures"][0]["text"].as_str().unwrap().contains("25 points are asked for, there are 14"));
    let mut command = vec!["conformity", "--sphere", &sphere, "--diameter-mm", "20", "--form-limit-um", "2.5"];
    command.extend(["--size-limit-um", "1.5", "--uncertainty", "0.3"]);
    let kept = "--diameter-mm 20 --form-limit-um 2.5 --size-limit-um 1.5 --uncertainty '0.3'";
    assert_says(&run(command).ok(), &["to certify it", kept]);
}

#[test]
fn runs_give_the_figures_of_axes_and_diagonals() {
    let bench = Bench::simulated(1);
    let mut rows = "axis,target_mm,direction,cycle,measured_mm\n".to_owned();
    for axis in ["X", "PPP"] {
        for step in 0..6 {
            for cycle in 1..6 {
                // Steps that differ, as the standard wants them.
                let target = f64::from(step) * 100.0 + f64::from(step * step % 7);
                rows += &format!("{axis},{target},+,{cycle},{}\n", target + 0.001);
                rows += &format!("{axis},{target},-,{cycle},{}\n", target - 0.002);
            }
        }
    }
    let runs = bench.write("runs.csv", rows);
    let figures = json(&["conformity", "--runs", &runs, "--json"]);
    for axis in [&figures["axes"][0], &figures["diagonals"][0]] {
        // Reversal 3 µm and no scatter: B = R = E = A = 3 µm.
        for figure in ["B_um", "R_um", "E_um", "A_um"] {
            assert!((axis[figure].as_f64().unwrap() - 3.0).abs() < 1e-6, "{figure} {axis}");
        }
        assert!(axis["M_um"].as_f64().unwrap().abs() < 1e-6);
    }
    assert_eq!(figures["departures_230_2"].as_array().unwrap().len(), 0);
    assert_eq!(figures["departures_230_6"].as_array().unwrap().len(), 3, "three body diagonals are missing");
}

#[test]
fn a_model_is_exported_in_every_format_and_a_step_can_be_chosen_by_its_error() {
    let bench = Bench::identified(6);
    let model = bench.text("model.json");
    for (format, file) in [
        ("csv", ""),
        ("etalon-exchange", ""),
        ("isg-csv", ""),
        ("heidenhain-style", "Y.COM"),
        ("volumetric-grid", ""),
        ("eight-corners", ""),
    ] {
        let out = bench.text(format);
        let mut arguments = vec!["export", "--model", &model, "--format", format, "--out", &out, "--step-mm", "50"];
        if format.contains('-') && (format.starts_with('v') || format.starts_with("ei")) {
            arguments.extend(["--offset-mm", "0,0,-60"]);
        }
        assert_says(&run(arguments).ok(), &["misses the model by at most", format]);
        let path = bench.path(format);
        let text = fs::read_to_string(if file.is_empty() { path } else { path.join(file) }).unwrap();
        assert_says(&text, &["error = actual - indicated", "units:"]);
    }
    // Without a step: so fine that the table is no worse than what it is to correct. The step is said.
    let ran = run(["export", "--model", &model, "--format", "csv", "--out", &bench.text("default.csv")]);
    assert!(!ran.errors.contains("between the nodes"), "said once: {}", ran.errors);
    assert_says(&ran.ok(), &["  linear between the nodes", "steps of", "(asked for: 0.1 µm)\n"]);
    let stated = bench.read("default.csv");
    let missed = stated.lines().find_map(|line| line.split("by at most ").nth(1)).unwrap();
    assert!(missed.split(' ').next().unwrap().parse::<f64>().unwrap() <= 0.1, "{missed}");
    assert_says(missed, &["steps of"]);
    let out = bench.text("fine.csv");
    run(["export", "--model", &model, "--format", "csv", "--out", &out, "--within-um", "0.05"]).ok();
    let stated = bench.read("fine.csv");
    let missed = stated.lines().find_map(|line| line.split("by at most ").nth(1)).unwrap();
    assert!(missed.split(' ').next().unwrap().parse::<f64>().unwrap() <= 0.05, "{missed}");
}

#[test]
fn wrong_input_is_refused_with_its_place_and_leaves_nothing() {
    let bench = Bench::identified(6);
    let (model, lengths) = (bench.text("model.json"), shipped_lengths());
    let twice = bench.write("twice.csv", "line,calibrated_mm,repeat,deviation_um\nX,100,1,0.1\nX,100,1,0.2\n");
    let unit = bench.write("unit.csv", "line,calibrated_mm,repeat,deviation_um\nX,100,1,0.0002\nX,100,2,-0.0003\n");
    let line = bench.write("line.csv", "x_mm,y_mm,z_mm\n0,0,0\n1,0,0\n2,0,0\n3,0,0\n4,0,0\n5,0,0\n");
    let once = bench.write("once.csv", "axis,target_mm,direction,cycle,measured_mm\nX,0,+,1,0\nX,10,+,1,10\n");
    let spelt = bench.write("spelt.csv", "axis,target_mm,direction,cycle,measured_mm\nX,0,+,1,0\nx,10,+,1,10\n");
    let (out, folder) = (bench.text("out.txt"), bench.text("out"));
    let cases: [(&[&str], &[&str]); 12] = [
        (
            &["conformity", "--lengths", &twice, "--probing", "bidirectional", "--out", &folder],
            &["twice.csv", "line X, 100 mm, repeat 1", "stands twice"],
        ),
        (
            &["conformity", "--lengths", &unit, "--probing", "bidirectional"],
            &["unit.csv", "deviation_um", "multiply the numbers by 1000"],
        ),
        (
            &["conformity", "--lengths", &lengths, "--probing", "bidirectional", "--mpe", "0,5+L/400"],
            &["--mpe", "decimal comma", "0.5+L/400"],
        ),
        (
            &["conformity", "--lengths", &lengths, "--probing", "bidirectional", "--uncertainty", "0.1"],
            &["--uncertainty", "limit"],
        ),
        (&["conformity", "--sphere", &line, "--out", &folder], &["line.csv", "one plane"]),
        (&["conformity", "--runs", &once, "--out", &folder], &["once.csv", "axis X", "no scatter"]),
        (&["conformity", "--runs", &spelt, "--out", &folder], &["spelt.csv", "X and x are one axis", "one name"]),
        (
            &["export", "--model", &model, "--format", "fanuc", "--out", &out],
            &["fanuc", "no such format", "etalon-exchange"],
        ),
        (&["export", "--model", &model, "--format", "volumetric-grid", "--out", &out], &["--offset-mm", "tip"]),
        (
            &["export", "--model", &model, "--format", "csv", "--out", &out, "--step-mm", "0"],
            &["--step-mm", "above zero"],
        ),
        (
            &["export", "--model", &model, "--format", "heidenhain-style", "--out", &folder, "--step-mm", "2"],
            &["256", "larger step"],
        ),
        (
            &["export", "--model", &lengths, "--format", "csv", "--out", &out],
            &["liang2025_lengths.csv", "no model file"],
        ),
    ];
    let before = listing(&bench.path(""));
    for (arguments, says) in cases {
        assert_says(&run(arguments).refused(), says);
        assert_eq!(listing(&bench.path("")), before, "something was left behind by {arguments:?}");
    }
}
