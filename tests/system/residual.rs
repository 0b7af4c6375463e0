//! The residual model from end to end: residuals of a simulated machine, training, correction offline and live, a swap in
//! the running node, replay to the byte, and what must be refused.
//!
//! Place in the flow: only the command and its files. The machine has a field of position that no chain of rigid bodies
//! makes; its known points teach, others judge.

#[allow(dead_code)] // This one goes through one document.
use std::collections::BTreeSet;
use std::fs;
use std::sync::OnceLock;
use std::time::Duration;

use crate::common::assert_says;
use crate::common::files::{Bench, WHO, assert_names_who, machine, samples, text};
use crate::common::graph::{LaunchText, MEMORY, long_recording, stream_of, topic};
use crate::common::printed::{assert_printed, commands_of, follows, read, run_in, save_files};
use crate::common::program::{Started, abbe, run};
use abbe_msgs::{CorrectedCoordinates, ScaleReading, Sha256};
use serde_json::Value;

/// What no chain of rigid bodies makes.
const FIELD: [&str; 2] = [
    "undescribed seed=3 of=x_mm of_from=0 of_to=800 and=y_mm and_from=0 and_to=600 along=z size_um=3",
    "undescribed seed=4 of=y_mm of_from=0 of_to=600 and=z_mm and_from=0 and_to=600 along=x size_um=2",
];
/// A training that a test can wait for: kriging needs no epochs, and two of the network show that it runs.
const QUICK: &str = "seed = 5\nmethod = \"kriging\"\n";
const QUICK_NETWORK: &str =
    "seed = 5\nmethod = \"network\"\n[network]\nwidth = 8\nheads = 2\n[optimiser]\nepochs = 2\n[split]\nfolds = 3\n";
/// Share of the error after geometry that may be left: chains swallow most of such a field, and tips at other offsets see
/// another rest than the one learnt.
const LEFT: f64 = 0.8;
/// Samples of the run in which the residual model changes, at 1 kHz; the change comes after a third of it.
const LONG: u64 = 15_000;
const CHANGE_AFTER: Duration = Duration::from_secs(5);

/// The folder of all tests: `model.json`, `residuals.csv`, `residual.json`, `network.json`, and points that judge.
pub(crate) fn bench() -> &'static Bench {
    static BENCH: OnceLock<Bench> = OnceLock::new();
    BENCH.get_or_init(|| {
        let bench = Bench::simulated(9);
        let simulate = |out: &str, seed: &str| {
            let machine = text(&machine());
            let mut arguments = vec!["simulate", "--machine", &machine, "--seed", seed, "--out", out];
            FIELD.iter().for_each(|effect| arguments.extend(["--effect", effect]));
            run(arguments).ok();
        };
        simulate(&bench.text(""), "9");
        let (campaign, model) = (bench.text("campaign.csv"), bench.text("model.json"));
        run(["identify", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &model]).ok();
        // Two thirds of the known points teach, the others judge.
        let points = bench.read("verify.csv");
        let (header, rows) = points.split_once('\n').unwrap();
        let part = |keep: fn(usize) -> bool| {
            let rows = rows.lines().enumerate().filter(|(k, _)| keep(*k)).map(|(_, row)| row);
            format!("{header}\n{}\n", rows.collect::<Vec<_>>().join("\n"))
        };
        bench.write("teach.csv", part(|k| k % 3 != 0));
        bench.write("judge.csv", part(|k| k % 3 == 0));
        let said = run([
            "residuals",
            "--model",
            &model,
            "--campaign",
            &bench.text("teach.csv"),
            "--out",
            &bench.text("residuals.csv"),
        ])
        .ok();
        assert_says(&said, &["points with known actual position", "µm rms"]);
        train(&bench, QUICK, "residual.json").ok();
        train(&bench, QUICK_NETWORK, "network.json").ok();
        bench
    })
}

fn train(bench: &Bench, config: &str, out: &str) -> crate::common::program::Ran {
    let config = bench.write(&format!("{out}.toml"), config);
    let (who, residuals, out) = (bench.write("who.toml", WHO), bench.text("residuals.csv"), bench.text(out));
    let named = ["--identity", &who, "--measured", "2026-03-05"];
    run(["train", "--residuals", &residuals, "--config", &config, "--out", &out].iter().chain(&named))
}

fn json(arguments: &[&str]) -> Value {
    serde_json::from_str(&run(arguments).ok()).unwrap()
}

#[test]
fn a_residual_model_brings_the_error_down_at_points_that_taught_nothing() {
    let bench = bench();
    let (model, residual, points) = (bench.text("model.json"), bench.text("residual.json"), bench.text("judge.csv"));
    let verified = json(&["verify", "--model", &model, "--residual", &residual, "--points", &points, "--json"]);
    let um = |key: &str| verified[key].as_f64().unwrap();
    println!("{} → {} µm rms", um("geometric_rms_um"), um("after_rms_um"));
    assert!(um("after_rms_um") < LEFT * um("geometric_rms_um"), "{verified}");
}

#[test]
fn training_again_gives_the_same_bytes_and_says_what_it_is_of() {
    let bench = bench();
    // Two epochs teach a network nothing, and held-out data say so: the next command is another one.
    for (config, first, next) in [(QUICK, "residual.json", "verify"), (QUICK_NETWORK, "network.json", "diagnose")] {
        let said = train(bench, config, "again.json").ok();
        assert_says(&said, &["again.json", "bridge_xyz"]);
        follows(&bench.path(""), &said, next);
        assert_eq!(bench.read("again.json"), bench.read(first), "{first}");
    }
    let html = bench.read("again.html");
    assert!(html.contains("<svg") && html.trim_end().ends_with("</html>"));
    // Its own hash, the temperatures beside the vectors, and words for the program's names of methods.
    assert_says(&html, &["again.json, SHA-256 ", "<dt>Temperature", "no residual model"]);
    assert!(!html.contains(">zero<") && !html.contains("kriging-network"), "{html}");
    assert_names_who(&html);
    assert_says(&html, &["<dt>Measured</dt><dd>2026-03-05</dd>"]);
}

#[test]
fn regress_a_page_of_corrected_or_verified_points_names_the_residual_model_with_its_hash() {
    let bench = bench();
    let (model, residual, points) = (bench.text("model.json"), bench.text("residual.json"), bench.text("judge.csv"));
    let [page, out] = ["hash.html", "hash.csv"].map(|name| bench.text(name));
    let own = ["--model", &model, "--residual", &residual, "--html", &page];
    let said = train(bench, QUICK, "hash.json").ok();
    let hash = said.lines().find_map(|line| line.trim().strip_prefix("residual model")).unwrap().trim();
    assert_eq!(hash.len(), 64, "{said}");
    let named = format!("residual.json, SHA-256 {hash}");
    run([&["verify", "--points", &points], &own[..]].concat()).ok();
    assert_says(&bench.read("hash.html"), &[&named]);
    run([&["correct", "--in", &points, "--out", &out], &own[..]].concat()).ok();
    assert_says(&bench.read("hash.html"), &[&named]);
}

#[test]
fn predicted_points_are_the_ones_that_correction_adds() {
    let bench = bench();
    let (model, residual) = (bench.text("model.json"), bench.text("residual.json"));
    let [plain, whole] = ["plain.csv", "whole.csv"].map(|name| bench.text(name));
    run(["correct", "--model", &model, "--in", &bench.text("judge.csv"), "--out", &plain]).ok();
    run(["correct", "--model", &model, "--residual", &residual, "--in", &bench.text("judge.csv"), "--out", &whole])
        .ok();
    let column = |file: &str, name: &str| -> Vec<f64> {
        let text = bench.read(file);
        let mut lines = text.lines().filter(|line| !line.starts_with('#'));
        let place = lines.next().unwrap().split(',').position(|n| n == name).unwrap_or_else(|| panic!("no {name}"));
        lines.map(|line| line.split(',').nth(place).unwrap().parse().unwrap()).collect()
    };
    let axes = ["x", "y", "z"];
    let corrected = axes.map(|axis| column("plain.csv", &format!("corrected_{axis}_mm")));
    let rows =
        (0..corrected[0].len()).map(|k| format!("{k},{},{},{}\n", corrected[0][k], corrected[1][k], corrected[2][k]));
    let points = format!("point,x_mm,y_mm,z_mm\n{}", rows.collect::<String>());
    let (points, predicted) = (bench.write("points.csv", points), bench.text("predicted.csv"));
    let said = run(["predict", "--model", &residual, "--in", &points, "--out", &predicted]).ok();
    follows(&bench.path(""), &said, "verify");
    for (d, axis) in axes.iter().enumerate() {
        let with = column("whole.csv", &format!("corrected_{axis}_mm"));
        let added = column("predicted.csv", &format!("res_{axis}_um"));
        for k in 0..with.len() {
            // Coordinates in files have 0.1 nm, residuals as well.
            assert!((with[k] - corrected[d][k] - added[k] * 1e-3).abs() < 3e-7, "row {k}");
        }
    }
    assert_eq!(column("predicted.csv", "point").len(), corrected[0].len(), "other columns are handed through");
    let said = run(["predict", "--model", &residual, "--in", &bench.text("judge.csv"), "--out", &predicted]).refused();
    assert_says(&said, &["offset_x_mm", "abbe correct --residual"]);
}

#[test]
fn what_it_does_not_belong_to_is_refused() {
    let bench = bench();
    let residual = bench.text("residual.json");
    let other = Bench::identified(10);
    let correct = |model: &str, residual: &str| {
        run([
            "correct",
            "--model",
            model,
            "--residual",
            residual,
            "--in",
            &bench.text("judge.csv"),
            "--out",
            &bench.text("no.csv"),
        ])
        .refused()
    };
    assert_says(
        &correct(&other.text("model.json"), &residual),
        &["residual.json", "belongs_to", "trained on what model"],
    );
    assert_says(&correct(&bench.text("model.json"), &bench.text("model.json")), &["model.json", "abbe-residual"]);
    let flipped = bench.read("residual.json").replacen("\"seed\": 5", "\"seed\": 6", 1);
    assert_says(&correct(&bench.text("model.json"), &bench.write("flipped.json", flipped)), &["flipped.json", "hash"]);
    assert!(!bench.path("no.csv").exists());

    let unowned = bench
        .read("residuals.csv")
        .lines()
        .filter(|l| !l.starts_with('#'))
        .map(|l| format!("{l}\n"))
        .collect::<String>();
    let unowned = bench.write("unowned.csv", unowned);
    let config = bench.write("quick.toml", QUICK);
    let out = bench.text("unowned.json");
    run(["train", "--residuals", &unowned, "--config", &config, "--out", &out]).ok();
    assert_says(&correct(&bench.text("model.json"), &out), &["does not say which geometric model"]);
    let other_model = other.text("model.json");
    let said = run([
        "train",
        "--residuals",
        &bench.text("residuals.csv"),
        "--model",
        &other_model,
        "--config",
        &config,
        "--out",
        &out,
    ])
    .refused();
    assert_says(&said, &["residuals.csv", "model"]);
    let wrong = bench.write("wrong.toml", "epochs = 3\n");
    let said = run(["train", "--residuals", &unowned, "--config", &wrong, "--out", &out]).refused();
    assert_says(&said, &["wrong.toml", "epochs"]);
}

/// So many rows of a table, its head with them.
fn first(table: &str, rows: usize) -> String {
    let head = table.lines().take_while(|line| line.starts_with('#')).count() + 1;
    table.lines().take(head + rows).map(|line| format!("{line}\n")).collect()
}

#[test]
fn regress_few_vectors_are_sent_where_they_are_taken_and_few_folds_are_named_that_train() {
    let bench = bench();
    let own = Bench::identified(9);
    let (model, out) = (own.write("model.json", bench.read("model.json")), own.text("residuals.csv"));
    for (rows, next) in [(15, "abbe interpolate --vectors"), (40, "abbe train --residuals")] {
        let points = own.write("known.csv", first(&bench.read("teach.csv"), rows));
        let said = run(["residuals", "--model", &model, "--campaign", &points, "--out", &out]).ok();
        assert_says(&said, &[next]);
        assert_eq!(said.contains("too few for abbe train, which takes 20 or more"), rows == 15, "{said}");
        if rows == 15 {
            let train = run(["train", "--residuals", &out, "--out", &own.text("no.json")]).refused();
            assert_says(&train, &["15 points", "at least 20"]);
            let (at, answer) = (own.write("at.csv", "x_mm,y_mm,z_mm\n400,300,300\n"), own.text("errors.csv"));
            run(["interpolate", "--vectors", &out, "--at", &at, "--out", &answer]).ok();
        }
    }
    let few = own.write("few.csv", first(&bench.read("residuals.csv"), 21));
    let network = QUICK_NETWORK.replace("[split]\nfolds = 3\n", "");
    let with = |config: &str| {
        let config = own.write("config.toml", config);
        run(["train", "--residuals", &few, "--config", &config, "--out", &own.text("few.json")])
    };
    let said = with(&network).refused();
    assert_says(&said, &["21 points", "16 are needed", "these points train with folds = ", "28 points or more"]);
    let keys = said.split("these points train with ").nth(1).unwrap().split(" in [split]").next().unwrap();
    with(&format!("{network}[split]\n{}\n", keys.replace(" and ", "\n"))).ok();
}

#[test]
fn what_is_read_is_never_replaced_and_a_missing_folder_is_found_before_the_work() {
    let bench = bench();
    let own = Bench::identified(9);
    let copy = |name: &str| {
        fs::copy(bench.path(name), own.path(name)).unwrap();
        own.text(name)
    };
    let (residuals, residual, model) = (copy("residuals.csv"), copy("residual.json"), copy("model.json"));
    let points = copy("judge.csv");
    let page = own.text("page.html");
    let lost = "would be lost";
    for (arguments, says) in [
        (["train", "--residuals", &residuals, "--out", &residuals, "--model", &model], lost),
        (["train", "--residuals", &residuals, "--out", &model, "--model", &model], lost),
        (["train", "--residuals", &residuals, "--out", &page, "--model", &model], "two files"),
        (["predict", "--model", &residual, "--in", &points, "--out", &residual], lost),
        (["correct", "--model", &model, "--in", &points, "--out", &model], lost),
        (["residuals", "--model", &model, "--campaign", &points, "--out", &points], lost),
        (["train", "--residuals", &residuals, "--model", &model, "--out", &own.text("none/r.json")], "no folder"),
        (["export", "--model", &model, "--format", "csv", "--out", &model], lost),
    ] {
        assert_says(&run(arguments).refused(), &[says]);
    }
    for name in ["residuals.csv", "residual.json", "model.json", "judge.csv"] {
        assert_eq!(own.read(name), bench.read(name), "{name}");
    }
    assert!(!own.path("page.html").exists());
}

#[test]
fn a_graphics_card_is_refused_with_a_way_out_by_a_program_built_without() {
    if cfg!(feature = "wgpu") {
        return; // Then `graphics_card.rs` of the training crate says what must hold.
    }
    let bench = bench();
    let (residuals, out) = (bench.text("residuals.csv"), bench.text("card.json"));
    let said = run(["train", "--residuals", &residuals, "--device", "wgpu", "--out", &out]).refused();
    assert_says(&said, &["--device wgpu", "--features wgpu", "--device cpu"]);
    assert!(!bench.path("card.json").exists());
}

#[test]
fn a_residual_model_changes_in_the_running_node_and_all_is_replayed_to_the_byte() {
    let bench = bench();
    long_recording(bench, LONG);
    fs::copy(bench.path("residual.json"), bench.path("live.json")).unwrap();
    let recorder = |launch: LaunchText| launch.nodes(&["recorder"]).edge("residual", "recorder", MEMORY).record("run");
    let launch = stream_of(bench, |launch| recorder(launch).residual_model("live.json"));
    let mut launch = Started::start(abbe(["launch", &launch]));
    // While it runs, another residual model takes the place of the first.
    std::thread::sleep(CHANGE_AFTER);
    assert!(launch.is_running());
    fs::copy(bench.path("network.json"), bench.path("swap.json")).unwrap();
    fs::rename(bench.path("swap.json"), bench.path("live.json")).unwrap();
    let said = launch.finish().ok();
    let residual: Value =
        said.lines().map(|l| serde_json::from_str(l).unwrap()).find(|s: &Value| s["node"] == "residual").unwrap();
    assert_eq!((&residual["lost"], &residual["sent"]), (&Value::from(0), &Value::from(LONG)));
    assert_eq!(residual["figures"]["residual_models_loaded"], Value::from(2.0), "{residual}");
    assert_eq!(residual["figures"]["without_residual"], Value::from(0.0));

    let corrected: Vec<CorrectedCoordinates> = samples(&bench.path("run"), &topic("corrected"));
    let hashes: Vec<Sha256> = corrected.iter().map(|sample| sample.residual_model_sha256).collect();
    let changes = hashes.windows(2).filter(|pair| pair[0] != pair[1]).count();
    let distinct: BTreeSet<String> = hashes.iter().map(|hash| hash.to_hex()).collect();
    assert_eq!((corrected.len() as u64, changes, distinct.len()), (LONG, 1, 2), "one switch, visible by hash");

    // The recorder takes the corrected stream; the readings are those of the bag that was played.
    let both = bench.path("both");
    let mut writer = abbe_msgs::bag::BagWriter::create(&both).unwrap();
    for reading in samples::<ScaleReading>(&bench.path("long"), &topic("scale/reading")) {
        writer.write(&topic("scale/reading"), &reading, reading.sequence).unwrap();
    }
    for sample in &corrected {
        writer.write(&topic("corrected"), sample, sample.sequence).unwrap();
    }
    writer.finish().unwrap();
    let (bag, model) = (text(&both), bench.text("model.json"));
    let [first, second] = ["residual.json", "network.json"].map(|name| bench.text(name));
    let said = run(["replay", "--bag", &bag, "--model", &model, "--residual", &first, "--residual", &second]).ok();
    assert_says(
        &said,
        &["15000 of 15000 corrected messages are identical", "15000 of them with a residual correction"],
    );
    let said = run(["replay", "--bag", &bag, "--model", &model, "--residual", &first]).refused();
    assert_says(&said, &["cannot be compared", "not given"]);

    // Offline on the same bag: the same bytes as the nodes gave with that residual model.
    let offline = bench.text("offline");
    run(["correct", "--model", &model, "--residual", &first, "--in", &bench.text("long"), "--out", &offline]).ok();
    let before: Vec<CorrectedCoordinates> = samples(&bench.path("offline"), &topic("corrected"));
    let same = before.iter().zip(&corrected).take_while(|(a, b)| a == b).count();
    assert_eq!(same, hashes.iter().take_while(|hash| **hash == hashes[0]).count(), "up to the switch");
}

/// As printed but for what trains: on fewer readings and points, and by kriging alone, which needs no epochs.
#[test]
fn the_tutorial_of_the_residual_model_runs() {
    let folder = tempfile::tempdir().unwrap();
    save_files(&read("docs/src/tutorials/your-machine.md"), folder.path());
    fs::write(folder.path().join("quick.toml"), QUICK).unwrap();
    let text = read("docs/src/tutorials/residual-model.md");
    let printed = commands_of(&text);
    assert_eq!(printed.len(), 6, "{printed:?}");
    let quick = |command: String| match command.split_whitespace().nth(1) {
        Some("residuals") => vec![command.clone(), command + " --readings 800 --points 200"],
        Some("train") => vec![command + " --config quick.toml"],
        _ => vec![command],
    };
    let said = run_in(folder.path(), &printed.into_iter().flat_map(quick).collect::<Vec<String>>());
    assert_printed(&text, &said);
    assert_says(&said, &["by geometry", "corrected"]);
    for file in ["sheet/residual.json", "sheet/residual.html", "sheet/corrected.csv"] {
        assert!(folder.path().join(file).is_file(), "the tutorial leaves no {file}");
    }
}
