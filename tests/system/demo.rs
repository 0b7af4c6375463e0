//! The demo from the recorded campaign to the model that closes the loop; what it tells on the terminal, on the page and in
//! the data is the same. Where a machine lacks nothing, it says so and stays with its first model.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::time::Duration;

use crate::common::files::{Bench, machine, samples, text};
use crate::common::printed::follows;
use crate::common::program::{Started, abbe, run};
use crate::common::{assert_says, files::recorded};
use abbe_files::ModelFile;
use abbe_msgs::{CorrectedCoordinates, RangeResidual, Sha256, TracerReading};
use serde_json::Value;

/// A diagnosis takes half a minute of processor time; only a test that fails waits for this.
const LIMIT: Duration = Duration::from_secs(300);
const NAMESPACE: &str = "/bridge_xyz";
/// Readings of the shipped campaign, and of its recording with the verification points.
const READINGS: usize = 2817;
const RECORDED: u64 = 3217;

fn json(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

/// Rms length of the error vectors under `key` (µm).
fn rms_um(report: &Value, key: &str) -> f64 {
    let points = report["verification"].as_array().unwrap();
    let square = |point: &Value| -> f64 {
        let error = point[key].as_array().unwrap_or_else(|| panic!("no {key}: {point}"));
        error.iter().map(|v| v.as_f64().unwrap().powi(2)).sum()
    };
    (points.iter().map(square).sum::<f64>() / points.len() as f64).sqrt()
}

fn hash(model: &Path) -> Sha256 {
    Sha256::from_bytes(ModelFile::load(model).unwrap().1)
}

/// Each sample that was sent came back once, by the first model up to one place and by the second from there on.
fn assert_unbroken(out: &Path, report: &Value) {
    let [first, second] = ["model.json", "model_in_use.json"].map(|name| hash(&out.join(name)));
    assert_ne!(first, second);
    let corrected: Vec<CorrectedCoordinates> = samples(&out.join("corrected"), &format!("{NAMESPACE}/corrected"));
    let sequences =
        recorded(&out.join("corrected"))[&format!("{NAMESPACE}/corrected")].keys().copied().collect::<Vec<_>>();
    assert_eq!(sequences, (0..sequences.len() as u64).collect::<Vec<_>>());
    let in_use = &report["closing"]["in_use"];
    let from = usize::try_from(in_use["first_sample"].as_u64().unwrap()).unwrap();
    assert_eq!(in_use["model_hash"], second.to_hex());
    assert!(corrected[..from].iter().all(|sample| sample.model_sha256 == first));
    assert!(corrected[from..].iter().all(|sample| sample.model_sha256 == second));
    println!("{} samples, the new model from {from} on", corrected.len());
    let live = &report["live"];
    assert_eq!((&live["samples_received"], &live["samples_lost"]), (&live["samples_sent"], &Value::from(0)));
    assert!(live["samples_sent"].as_u64().unwrap() > RECORDED);
}

#[test]
fn the_demo_closes_the_loop_on_the_shipped_campaign_and_says_the_same_everywhere() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("demo");
    let ran = Started::start(abbe(["demo", "--out", &text(&out)])).finish_within(LIMIT);
    let steps = ran.errors.clone();
    let said = ran.ok();
    println!("{steps}\n{said}");
    follows(folder.path(), &said, "identify");
    // A line for each step, with or without a terminal.
    let told: Vec<&str> = steps.lines().filter_map(|line| line.split_whitespace().next()).collect();
    let at = |step: &str| told.iter().position(|word| *word == step).unwrap_or_else(|| panic!("no {step}: {steps}"));
    assert!(["identify", "record", "live", "monitor", "diagnose", "take", "report"].map(at).is_sorted(), "{steps}");
    // What the nodes remark is not between them, and not lost.
    assert!(!steps.contains(" WARN "), "{steps}");
    let remarks = fs::read_to_string(out.join("nodes.log")).unwrap();
    assert!(remarks.contains("the model lacks something"), "{remarks}");

    let report = json(&out.join("report.json"));
    let [before, geometry, after] = ["before_um", "after_um", "after_loop_um"].map(|key| rms_um(&report, key));
    println!("{before:.3} → {geometry:.3} → {after:.3} µm");
    assert!(before > 10.0 * geometry && geometry > 3.0 * after, "{before} {geometry} {after}");
    for (state, rms) in [("as indicated", before), ("after geometry", geometry), ("after the loop", after)] {
        let line = said.lines().find(|line| line.contains(state)).unwrap_or_else(|| panic!("no {state}: {said}"));
        // Three digits.
        let told: f64 = line.split_whitespace().skip_while(|word| *word != "rms").nth(1).unwrap().parse().unwrap();
        assert!((told / rms - 1.0).abs() < 5.1e-3, "{line}, {rms} in the JSON");
        let summary = report["verification_summary"].as_array().unwrap().iter().find(|own| own["state"] == state);
        assert!((summary.unwrap()["rms_um"].as_f64().unwrap() - rms).abs() < 1e-9, "{summary:?}");
    }
    assert_unbroken(&out, &report);

    // What the diagnosis says is what is told: the effect, its size with its uncertainty, what it could be confused with.
    let diagnosis = json(&out.join("diagnoses/0001/diagnosis.json"));
    assert_eq!(report["closing"]["effects"], diagnosis["effects"]);
    let effect = &diagnosis["effects"][0];
    assert_eq!(effect["kind"], "attributed");
    let html = fs::read_to_string(out.join("report.html")).unwrap();
    // The one that is there beyond most of its uncertainty.
    let surety = |own: &&Value| (own["value"].as_f64().unwrap() / own["u"].as_f64().unwrap()).abs();
    let all = effect["parameters"].as_array().unwrap().iter();
    let first = all.max_by(|a, b| surety(a).total_cmp(&surety(b))).unwrap();
    assert!(first["u"].as_f64().unwrap() > 0.0);
    for words in [effect["title"].as_str().unwrap(), first["name"].as_str().unwrap(), "(k = 1)"] {
        assert!(said.contains(words) && html.contains(words), "{words:?} is not told");
    }
    let rivals = effect["cannot_be_told_from"].as_array().unwrap();
    let confused = if rivals.is_empty() { "No other effect explains" } else { "cannot tell it from" };
    assert!(said.contains(confused) && html.contains(confused), "{confused:?} is not told");
    // The lead of the page is what stands on the picture.
    let lead = report["header"]["what"].as_str().unwrap();
    assert!(said.lines().filter(|line| line.contains("lacked")).all(|line| lead.contains(line)), "{lead}");

    // The tracer's readings were heard once each, however often the scales were played.
    let tracer: Vec<TracerReading> = samples(&out.join("corrected"), &format!("{NAMESPACE}/tracer/reading"));
    let residuals: Vec<RangeResidual> = samples(&out.join("corrected"), &format!("{NAMESPACE}/monitor/range_residual"));
    assert_eq!((tracer.len(), residuals.len()), (READINGS, READINGS));

    let models = ["model.json", "model_in_use.json"].map(|name| text(&out.join(name)));
    let bag = text(&out.join("corrected"));
    let replayed = run(["replay", "--bag", &bag, "--model", &models[0], "--model", &models[1]]).ok();
    assert_says(&replayed, &["corrected messages are identical"]);
}

#[test]
fn a_machine_that_lacks_nothing_keeps_its_model_and_the_demo_says_so() {
    let bench = Bench::simulated(5);
    let out = bench.text("demo");
    let files = [text(&machine()), bench.text("campaign.csv"), bench.text("verify.csv")];
    let [machine, campaign, verify] = &files;
    let arguments = ["--machine", machine, "--campaign", campaign, "--verify", verify, "--rate-hz", "1500"];
    let demo = abbe(["demo", "--out", &out].into_iter().chain(arguments));
    let said = Started::start(demo).finish_within(LIMIT).ok();
    assert_says(&said, &["as indicated", "corrected", "asked for no diagnosis"]);
    let report = json(&bench.path("demo/report.json"));
    assert_eq!((&report["closing"]["in_use"], &report["closing"]["verdict"]), (&Value::Null, &Value::Null));
    assert!(report["verification"].as_array().unwrap().iter().all(|point| point["after_loop_um"].is_null()));
    assert_eq!(hash(&bench.path("demo/model.json")), hash(&bench.path("demo/model_in_use.json")));
    assert!(!bench.path("demo/diagnoses").exists());
    let corrected: Vec<CorrectedCoordinates> =
        samples(&bench.path("demo/corrected"), &format!("{NAMESPACE}/corrected"));
    assert_eq!(corrected.iter().map(|sample| sample.model_sha256).collect::<BTreeSet<_>>().len(), 1);
}
