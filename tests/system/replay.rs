//! The main job end to end, and its evidence: what was recorded live comes out again byte for byte.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::assert_says;
use crate::common::files::{Bench, listing, machine, recorded, samples, text};
use crate::common::program::run;
use abbe_graph::driver::DriverConfig;
use abbe_graph::launch::{Launch, RecordConfig};
use abbe_msgs::ScaleReading;
use abbe_msgs::bag::{BagMessage, BagWriter, messages};
use serde_json::Value;

/// The demo on the campaign of this bench; gives its output folder.
fn demo_on(bench: &Bench) -> PathBuf {
    let (machine, campaign, verify) = (text(&machine()), bench.text("campaign.csv"), bench.text("verify.csv"));
    let (out, rate) = (bench.text("demo"), "1500");
    run([
        "demo",
        "--fast",
        "--machine",
        &machine,
        "--campaign",
        &campaign,
        "--verify",
        &verify,
        "--out",
        &out,
        "--rate-hz",
        rate,
    ])
    .ok();
    bench.path("demo")
}

fn replay(bag: &Path, model: &Path) -> crate::common::program::Ran {
    run(["replay", "--bag", &text(bag), "--model", &text(model)])
}

/// Rms length of the error vectors under `key` (µm).
fn rms_um(points: &[Value], key: &str) -> f64 {
    let square =
        |point: &Value| point[key].as_array().unwrap().iter().map(|v| v.as_f64().unwrap().powi(2)).sum::<f64>();
    (points.iter().map(square).sum::<f64>() / points.len() as f64).sqrt()
}

/// The page shows everything without a network: whatever it refers to lies in it.
fn assert_self_contained(html: &str) {
    const EMBEDDED: char = '\u{fffc}';
    let mut rest = html.to_owned();
    for (begins, ends) in [("\"data:", '"'), ("'data:", '\''), ("(data:", ')')] {
        let mut parts = rest.split(begins);
        let mut kept = parts.next().unwrap().to_owned();
        for part in parts {
            kept.push(begins.chars().next().unwrap());
            kept.push(EMBEDDED);
            kept += part.split_once(ends).expect("what is embedded ends").1;
        }
        rest = kept;
    }
    for outside in
        ["http:", "https:", "src=\"//", "href=\"//", "@import", "<link", "<iframe", "<object", "NaN", "undefined"]
    {
        assert!(!rest.contains(outside), "the page contains {outside:?}");
    }
    for attribute in ["src=\"", "href=\"", "url("] {
        for value in rest.split(attribute).skip(1) {
            assert!(value.starts_with([EMBEDDED, '#']), "{attribute}{value:.40} leads out of the page");
        }
    }
}

/// The report's three forms are whole, and the error after is below a tenth of the error before.
fn assert_reported(out: &Path) {
    let html = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(html.contains("<svg") && html.trim_end().ends_with("</html>"), "the page is not whole");
    assert_self_contained(&html);
    let png = fs::read(out.join("report.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG\r\n\x1a\n") && png[png.len() - 8..].starts_with(b"IEND"), "the picture is cut");
    let report: Value = serde_json::from_str(&fs::read_to_string(out.join("report.json")).unwrap()).unwrap();
    let points = report["verification"].as_array().unwrap();
    let (before_um, after_um) = (rms_um(points, "before_um"), rms_um(points, "after_um"));
    println!("{} points: {before_um:.3} µm before, {after_um:.3} µm after", points.len());
    assert!(points.len() == 400 && after_um < before_um / 10.0, "{before_um} µm before, {after_um} µm after");
    let live = &report["live"];
    assert_eq!((&live["samples_received"], &live["samples_lost"]), (&live["samples_sent"], &Value::from(0)));
    assert!(live["samples_sent"].as_u64().unwrap() > 3000);
}

#[test]
fn the_demo_on_the_shipped_campaign_reports_and_replays_to_the_byte() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("shipped");
    let said = run(["demo", "--fast", "--out", &text(&out)]).ok();
    assert_says(&said, &["as indicated", "corrected", "report.html"]);
    assert_reported(&out);
    let said = replay(&out.join("corrected"), &out.join("model.json")).ok();
    assert_says(&said, &["3217 of 3217 corrected messages are identical"]);
    let left = listing(folder.path());
    assert!(left.keys().all(|path| !text(path).contains(".abbe-")), "temporary files are left: {left:?}");
}

#[test]
fn a_recorded_run_played_through_the_nodes_again_gives_the_same_bytes() {
    let bench = Bench::simulated(5);
    let out = demo_on(&bench);
    assert_reported(&out);
    let first = out.join("corrected");
    let said = replay(&first, &out.join("model.json")).ok();
    assert_says(&said, &["corrected messages are identical"]);

    let mut launch = Launch::read(&out.join("launch.toml")).unwrap();
    launch.edges.retain(|edge| edge.to != "user");
    launch.record = Some(RecordConfig::new(bench.path("again")));
    for source in [launch.scale.as_mut(), launch.tracer.as_mut()].into_iter().flatten() {
        let DriverConfig::Bag { file, .. } = &mut source.driver else { panic!("the demo plays a bag") };
        file.clone_from(&first);
    }
    let file = bench.write("again.toml", launch.to_text().unwrap());
    let summaries = run(["launch", &file]).ok();
    for summary in summaries.lines().map(|line| serde_json::from_str::<Value>(line).unwrap()) {
        assert_eq!((&summary["lost"], &summary["dropped"]), (&Value::from(0), &Value::from(0)), "{summary}");
    }

    let (first, again) = (recorded(&first), recorded(&bench.path("again")));
    let counts = |bag: &std::collections::BTreeMap<String, std::collections::BTreeMap<u64, Vec<u8>>>| {
        bag.iter().map(|(topic, messages)| (topic.clone(), messages.len())).collect::<Vec<_>>()
    };
    assert_eq!(counts(&first), counts(&again));
    assert_eq!(first.len(), 5, "{:?}", counts(&first));
    for (topic, messages) in &first {
        let different = messages.iter().filter(|(sequence, cdr)| again[topic].get(sequence) != Some(cdr)).count();
        assert_eq!(different, 0, "{topic}: {different} of {} messages differ", messages.len());
    }
}

/// The corrected run of a bench with more behind it.
fn recording(bench: &Bench, out: &str, more: impl FnOnce(Vec<BagMessage>) -> Vec<BagMessage>) -> PathBuf {
    let first = messages(bench.path("corrected")).unwrap().map(Result::unwrap).collect();
    let mut writer = BagWriter::create(bench.path(out)).unwrap();
    more(first).iter().for_each(|message| writer.copy(message).unwrap());
    writer.finish().unwrap();
    bench.path(out)
}

#[test]
fn regress_what_other_recorders_pad_is_compared_by_its_fields() {
    let bench = Bench::identified(5);
    let (bag, model) = (bench.text("bag"), bench.text("model.json"));
    run(["convert", "--machine", &text(&machine()), "--campaign", &bench.text("campaign.csv"), "--out", &bag]).ok();
    run(["correct", "--model", &model, "--in", &bag, "--out", &bench.text("corrected")]).ok();
    // Fast DDS pads to four bytes, and says in the header by how much; the header alone may say so as well.
    let padded = |spoiled: bool| {
        recording(&bench, if spoiled { "spoiled" } else { "padded" }, |mut all| {
            let is_corrected = |message: &&mut BagMessage| message.topic().ends_with("/corrected");
            for (place, message) in all.iter_mut().filter(is_corrected).enumerate() {
                let padding = place % 4;
                message.cdr.extend(std::iter::repeat_n(0, padding));
                message.cdr[3] = padding as u8;
                // One bit of one coordinate, far from the strings at the end.
                message.cdr[64] ^= u8::from(spoiled && place == 7);
            }
            all
        })
    };
    replay(&padded(false), &bench.path("model.json")).ok();
    assert_says(&replay(&padded(true), &bench.path("model.json")).refused(), &["the first with sequence 7"]);
}

#[test]
fn regress_every_message_of_a_source_that_began_anew_with_another_model_is_compared() {
    let (bench, other) = (Bench::identified(5), Bench::identified(6));
    let (bag, model) = (bench.text("bag"), bench.text("model.json"));
    run(["convert", "--machine", &text(&machine()), "--campaign", &bench.text("campaign.csv"), "--out", &bag]).ok();
    for (model, out) in [(&model, "corrected"), (&other.text("model.json"), "anew")] {
        run(["correct", "--model", model, "--in", &bag, "--out", &bench.text(out)]).ok();
    }
    // Sequence and stamps begin again with the same readings.
    let anew: Vec<BagMessage> = messages(bench.path("anew")).unwrap().map(Result::unwrap).collect();
    let twice = recording(&bench, "twice", |mut first| {
        first.extend(anew.iter().cloned());
        first
    });
    let count = samples::<ScaleReading>(&bench.path("bag"), "/bridge_xyz/scale/reading").len();
    let half = replay(&twice, &bench.path("model.json"));
    assert_says(
        &String::from_utf8_lossy(&half.output),
        &[&format!("{count} of {} corrected", 2 * count), "anew 1 times"],
    );
    assert_says(&half.refused(), &[&format!("{count} cannot be compared"), "were not given"]);
    let both = ["replay", "--bag", &text(&twice), "--model", &model, "--model", &other.text("model.json")];
    assert_says(&run(both).ok(), &[&format!("{0} of {0} corrected messages are identical", 2 * count)]);

    let is_corrected = |message: &BagMessage| message.topic().ends_with("/corrected");
    let spoilt = |out: &str, spoil: fn(&mut Vec<BagMessage>, Vec<usize>), says: &[&str]| {
        let bag = recording(&bench, out, |mut messages| {
            let places = (0..messages.len()).filter(|place| is_corrected(&messages[*place])).collect();
            spoil(&mut messages, places);
            messages
        });
        assert_says(&replay(&bag, &bench.path("model.json")).refused(), says);
    };
    spoilt("missing", |all, places| drop(all.remove(places[7])), &["1 scale readings have no corrected", "sequence 7"]);
    spoilt("repeated", |all, places| all.push(all[places[7]].clone()), &["1 repeat an earlier message"]);
    spoilt("reordered", |all, places| all.swap(places[7], places[8]), &["1 are out of order"]);
    spoilt("additional", |all, places| drop(all.remove(places[7] - 1)), &["1 have no scale reading", "sequence 7"]);
    let wrong = |all: &mut Vec<BagMessage>, places: Vec<usize>| {
        let last = all[places[9]].cdr.len() - 80;
        all[places[9]].cdr[last] ^= 1;
    };
    spoilt("different", wrong, &["differ", "check that the model", "--max-covariate-age-s (10 here)"]);

    let file = bench.path("corrected").join("corrected_0.mcap");
    let cut = fs::read(&file).unwrap();
    fs::write(&file, &cut[..cut.len() / 2]).unwrap();
    let said = replay(&bench.path("corrected"), &bench.path("model.json")).refused();
    assert_says(&said, &["compared only as far as the bag can be read", "recover the bag"]);
}

#[test]
fn a_file_of_a_bag_in_sqlite_is_refused_with_the_command_that_converts_it() {
    let bench = Bench::empty();
    let (machine, bag) = (text(&machine()), bench.write("run_0.db3", b"SQLite format 3\0"));
    let commands = [
        format!("storage_id: mcap, all_topics: true}}]' > out.yaml\n  ros2 bag convert -i {bag} -o out.yaml"),
        format!("echo 'output_bags: [{{uri: \"{}\"", bench.text("run_0_mcap")),
    ];
    let commands = commands.each_ref().map(String::as_str);
    let [out, saved] = ["model.json", "saved"].map(|name| bench.text(name));
    assert_says(&run(["identify", "--machine", &machine, "--campaign", &bag, "--out", &out]).refused(), &commands);
    assert_says(&run(["recover", "--bag", &bag, "--out", &saved]).refused(), &commands);
}

#[test]
fn a_replay_with_another_model_fails_and_names_the_first_difference() {
    let (bench, other) = (Bench::identified(5), Bench::identified(6));
    let (bag, corrected) = (bench.text("bag"), bench.text("corrected"));
    run(["convert", "--machine", &text(&machine()), "--campaign", &bench.text("campaign.csv"), "--out", &bag]).ok();
    run(["correct", "--model", &bench.text("model.json"), "--in", &bag, "--out", &corrected]).ok();
    replay(&bench.path("corrected"), &bench.path("model.json")).ok();

    let said = replay(&bench.path("corrected"), &other.path("model.json")).refused();
    assert_says(
        &said,
        &["corrected", "cannot be compared", "sequence 0", "name models that were not given", "give each"],
    );
    let said = replay(&bench.path("bag"), &bench.path("model.json")).refused();
    assert_says(&said, &["have no corrected message (lost, or not recorded)", "sequence 0"]);
    BagWriter::create(bench.path("empty")).unwrap().finish().unwrap();
    let said = replay(&bench.path("empty"), &bench.path("model.json")).refused();
    assert_says(&said, &["empty", "holds no scale readings", "nothing was compared"]);

    let digit = bench.read("model.json").replacen("\"dead_path_m\": ", "\"dead_path_m\": 1", 1);
    bench.write("tampered.json", digit);
    let said = replay(&bench.path("corrected"), &bench.path("tampered.json")).refused();
    assert_says(&said, &["tampered.json"]);
}
