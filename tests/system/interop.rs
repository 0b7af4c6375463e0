//! Programs of others take part: Cyclone DDS feeds the graph and takes what it corrects, `rosbags` reads what was
//! recorded, and both see exactly what `abbe correct` computes from the same readings.

use std::collections::BTreeMap;
use std::process::Command;
use std::time::Duration;

use crate::common::files::{Bench, machine, samples, text};
use crate::common::graph::{DDS, LaunchText, NAMESPACE, topic};
use crate::common::network::in_own_network;
use crate::common::program::{Started, abbe_in, children, run, signal, wait_until};
use crate::common::python::python;
use abbe_msgs::bag::BagWriter;
use abbe_msgs::standard::PointStamped;
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, Message, ScaleReading, Stamp};
use abbe_runtime::ros::Domain;
use rustix::process::Signal;
use serde_json::{Value, json};

/// Readings of the campaign that are used: enough to see every station, few enough for a second.
const EVERY: usize = 6;

/// Readings with covariates all over the volume, then what must not be corrected: far outside the stroke, no number.
fn readings(bench: &Bench) -> Vec<ScaleReading> {
    let (campaign, bag) = (bench.text("campaign.csv"), bench.text("campaign"));
    let convert = ["convert", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &bag];
    run(convert.into_iter().chain(["--namespace", NAMESPACE])).ok();
    let all = samples::<ScaleReading>(&bench.path("campaign"), &topic("scale/reading"));
    let mut readings: Vec<ScaleReading> = all.into_iter().step_by(EVERY).collect();
    let mut outside = readings[0];
    outside.reading_m[1] = 2.0;
    let mut nowhere = readings[1];
    nowhere.reading_m[2] = f64::NAN;
    let mut extrapolated = readings[2];
    extrapolated.offset_m[2] *= 3.0;
    let last_ns = readings.last().unwrap().stamp.to_nanos();
    for (later_ns, reading) in (1..).zip([&mut outside, &mut nowhere, &mut extrapolated]) {
        reading.stamp = Stamp::from_nanos(last_ns + later_ns).unwrap();
    }
    readings.extend([outside, nowhere, extrapolated]);
    for (number, reading) in readings.iter_mut().enumerate() {
        reading.sequence = number as u64;
    }
    readings
}

/// What `abbe correct` makes of the readings.
fn corrected_offline(bench: &Bench, readings: &[ScaleReading]) -> Vec<CorrectedCoordinates> {
    let mut writer = BagWriter::create(bench.path("readings")).unwrap();
    for (time_ns, reading) in readings.iter().enumerate() {
        writer.write(&topic("scale/reading"), reading, time_ns as u64).unwrap();
    }
    writer.finish().unwrap();
    let [model, input, output] = ["model.json", "readings", "offline"].map(|name| bench.text(name));
    run(["correct", "--model", &model, "--in", &input, "--out", &output]).ok();
    samples(&bench.path("offline"), &topic("corrected"))
}

fn finish(mut command: Command) -> String {
    let output = command.output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}");
    text
}

/// The object a program of others should see.
fn seen<M: Message>(sample: &M) -> Value {
    serde_json::to_value(sample.to_ros()).unwrap()
}

/// Entries by sequence, each once.
fn by_sequence(entries: &Value) -> BTreeMap<u64, Value> {
    let entries = entries.as_array().unwrap();
    let map: BTreeMap<u64, Value> =
        entries.iter().map(|entry| (entry["sequence"].as_u64().unwrap(), entry.clone())).collect();
    assert_eq!(map.len(), entries.len(), "a sequence came twice");
    map
}

/// Starts the correcting nodes and the recorder, with DDS on every edge and the scale node left to others.
fn start_graph(bench: &Bench, domain: Domain) -> Started {
    let launch = LaunchText::default().nodes(&["geometric", "residual", "recorder"]).record("recorded");
    let launch = launch.edge("scale", "geometric", DDS).edge("geometric", "residual", DDS).edge("residual", "*", DDS);
    let recorded = ["scale", "geometric", "residual"];
    let launch = recorded.into_iter().fold(launch, |launch, node| launch.edge(node, "recorder", DDS));
    let mut graph = Started::start(abbe_in(domain, ["launch", &launch.write(bench)]));
    let id = graph.id();
    wait_until("three nodes run", Duration::from_secs(10), || {
        assert!(graph.is_running(), "the launch ended by itself");
        children(id).len() == 3
    });
    graph
}

#[test]
fn cyclone_feeds_the_graph_and_gets_what_abbe_correct_computes_and_rosbags_reads_the_recording() {
    let test = "interop::cyclone_feeds_the_graph_and_gets_what_abbe_correct_computes_and_rosbags_reads_the_recording";
    in_own_network(test, |domain| {
        let (Some(user), Some(reader)) = (python("dds_user.py"), python("read_bag.py")) else { return };
        let bench = Bench::identified(5);
        let readings = readings(&bench);
        let offline = corrected_offline(&bench, &readings);
        assert_eq!(offline.len(), readings.len());

        let graph = start_graph(&bench, domain);
        corrected_over_dds(&bench, domain, user, &readings, &offline);
        signal(graph.id(), Signal::INT);
        let summaries = graph.finish().ok();
        for summary in summaries.lines().map(|line| serde_json::from_str::<Value>(line).unwrap()) {
            let faults = ["lost", "dropped", "malformed"].map(|fault| summary[fault].as_u64().unwrap());
            assert_eq!(faults, [0; 3], "{summary}");
        }
        recorded_for_rosbags(&bench, reader, &readings, &offline);
    });
}

fn corrected_over_dds(
    bench: &Bench,
    domain: Domain,
    mut user: Command,
    readings: &[ScaleReading],
    offline: &[CorrectedCoordinates],
) {
    let sent: Vec<Value> = readings.iter().map(seen).collect();
    let (input, output) = (bench.write("readings.json", Value::from(sent).to_string()), bench.text("taken.json"));
    // The geometric node and the recorder take the readings.
    user.args([&domain.id().to_string(), NAMESPACE, &input, &output, "2"]);
    println!("{}", finish(user));
    let taken: Value = serde_json::from_str(&bench.read("taken.json")).unwrap();

    let corrected = by_sequence(&taken["corrected"]);
    for expected in offline {
        assert_eq!(corrected.get(&expected.sequence), Some(&seen(expected)), "sequence {}", expected.sequence);
    }
    assert_eq!(corrected.len(), offline.len());

    let points: Vec<Value> = offline
        .iter()
        .filter_map(PointStamped::from_corrected)
        .map(|point| serde_json::to_value(point).unwrap())
        .collect();
    assert_eq!(taken["points"].as_array().unwrap().len(), points.len());
    assert_eq!(taken["points"], Value::from(points));

    let model: Value = serde_json::from_str(&bench.read("model.json")).unwrap();
    assert!(offline.iter().all(|sample| model["sha256"] == sample.model_sha256.to_hex().as_str()));
    let statuses: Vec<CorrectionStatus> = offline.iter().rev().take(3).map(|sample| sample.status).collect();
    use CorrectionStatus::{Extrapolated, Rejected};
    assert_eq!(statuses, [Extrapolated, Rejected, Rejected]);
    assert_eq!(points_missing(offline), 2, "what was not corrected has no point");
}

fn points_missing(corrected: &[CorrectedCoordinates]) -> usize {
    corrected.iter().filter(|sample| PointStamped::from_corrected(sample).is_none()).count()
}

fn recorded_for_rosbags(
    bench: &Bench,
    mut reader: Command,
    readings: &[ScaleReading],
    offline: &[CorrectedCoordinates],
) {
    println!(
        "{}",
        finish({
            reader.args([bench.text("recorded"), bench.text("recorded.json")]);
            reader
        })
    );
    let mut found: Vec<Value> = serde_json::from_str(&bench.read("recorded.json")).unwrap();
    // The user's first readings only found out whether everyone was connected.
    found.retain(|message| message["fields"]["sequence"].as_u64().unwrap() < readings.len() as u64);
    let expect = |name: &str, ros_type: &str, samples: Vec<(i64, Value)>| {
        let topic = topic(name);
        let of_topic: Vec<&Value> = found.iter().filter(|message| message["topic"] == topic.as_str()).collect();
        assert_eq!(of_topic.len(), samples.len(), "{topic}");
        for (message, (stamp_ns, fields)) in of_topic.into_iter().zip(samples) {
            let expected = json!({"topic": topic, "type": ros_type, "log_time_ns": stamp_ns, "fields": fields});
            assert_eq!(message, &expected);
        }
    };
    let scales = readings.iter().map(|sample| (sample.stamp().to_nanos(), seen(sample))).collect();
    expect("scale/reading", "abbe_msgs/msg/ScaleReading", scales);
    let corrected: Vec<(i64, Value)> = offline.iter().map(|sample| (sample.stamp().to_nanos(), seen(sample))).collect();
    // No residual field yet: what enters the residual node leaves it.
    expect("geometric/corrected", "abbe_msgs/msg/CorrectedCoordinates", corrected.clone());
    expect("corrected", "abbe_msgs/msg/CorrectedCoordinates", corrected);
    assert_eq!(found.len(), 3 * readings.len());
}
