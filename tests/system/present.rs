//! A recording that is played in the present: stamps of now, pairs that stay pairs, and a recording that replays as ever.

use std::time::{SystemTime, UNIX_EPOCH};

use crate::common::assert_says;
use crate::common::files::{Bench, samples};
use crate::common::graph::{DDS, LaunchText, MEMORY, NAMESPACE, files_of_run, long_recording, stream_of, topic};
use crate::common::network::in_own_network;
use crate::common::program::{Started, abbe_in, run, signal};
use crate::common::python::{ros2, said};
use abbe_msgs::{CorrectedCoordinates, RangeResidual, ScaleReading, Stamp};
use abbe_runtime::RunId;
use rustix::process::Signal;

const RATE_HZ: f64 = 1000.0;

fn now_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs_f64()
}

/// Scale and tracer of one campaign through all nodes, recorded.
fn whole_graph(bench: &Bench, stamps: &str) -> String {
    let nodes = ["recorder", "monitor", "residual", "geometric", "tracer", "scale"];
    let edges = [
        ("scale", "geometric"),
        ("geometric", "residual"),
        ("residual", "monitor"),
        ("tracer", "monitor"),
        ("scale", "recorder"),
        ("tracer", "recorder"),
        ("residual", "recorder"),
        ("monitor", "recorder"),
    ];
    let launch =
        edges.iter().fold(LaunchText::default().nodes(&nodes), |launch, (from, to)| launch.edge(from, to, MEMORY));
    let launch = launch.source("scale", "campaign.csv", None, RATE_HZ).source("tracer", "campaign.csv", None, RATE_HZ);
    launch.monitor().record("recorded").key(stamps).write(bench)
}

#[test]
fn what_is_played_now_has_stamps_of_now_stays_in_pairs_and_replays_bit_by_bit() {
    let bench = Bench::identified(5);
    let file = whole_graph(&bench, "stamps = \"now\"");
    let before_s = now_s();
    let run_name = RunId::unique();
    run(["launch", &file, "--run", run_name.as_str()]).ok();
    let after_s = now_s();
    assert_eq!(files_of_run(run_name.as_str()), Vec::<String>::new(), "what the sources agreed about is left behind");

    let bag = bench.path("recorded");
    let scales: Vec<ScaleReading> = samples(&bag, &topic("scale/reading"));
    let first_ns = scales[0].stamp.to_nanos();
    for reading in &scales {
        let stamp_s = reading.stamp.to_nanos() as f64 * 1e-9;
        assert!((before_s..after_s).contains(&stamp_s), "{stamp_s} is not between {before_s} and {after_s}");
        assert_eq!(reading.stamp.to_nanos() - first_ns, reading.sequence as i64 * 1_000_000);
    }
    // The recorded instant is kept.
    let campaign = bench.text("bag_of_campaign");
    let machine = crate::common::files::text(&crate::common::files::machine());
    run([
        "convert",
        "--machine",
        &machine,
        "--campaign",
        &bench.text("campaign.csv"),
        "--out",
        &campaign,
        "--namespace",
        NAMESPACE,
    ])
    .ok();
    let recorded: Vec<ScaleReading> = samples(&bench.path("bag_of_campaign"), &topic("scale/reading"));
    assert_eq!(recorded.len(), scales.len());
    for (recorded, played) in recorded.iter().zip(&scales) {
        let kept_s = played.covariates.get("time_s").unwrap().value;
        assert_eq!(Stamp::from_seconds(kept_s).unwrap(), recorded.stamp);
        assert_eq!((played.reading_m, played.offset_m), (recorded.reading_m, recorded.offset_m));
    }
    // Each tracer reading finds the scale reading of its instant, although two processes stamped them.
    let residuals: Vec<RangeResidual> = samples(&bag, &topic("monitor/range_residual"));
    assert_eq!(residuals.len(), scales.len());
    assert!(residuals.iter().all(|residual| residual.residual().is_some()));
    let square: f64 = residuals.iter().filter_map(RangeResidual::residual).map(|(r_m, u_m)| (r_m / u_m).powi(2)).sum();
    assert!((0.5..1.5).contains(&(square / residuals.len() as f64)), "mean square {square}");

    let said = run(["replay", "--bag", &bench.text("recorded"), "--model", &bench.text("model.json")]).ok();
    let count = samples::<CorrectedCoordinates>(&bag, &topic("corrected")).len();
    assert_says(&said, &[&format!("{count} of {count} corrected messages are identical")]);
}

#[test]
fn what_would_tear_pairs_apart_or_says_nothing_is_refused() {
    let bench = Bench::empty();
    let refused = |text: &str| {
        let launch = bench.write("launch.toml", text);
        run(["launch", &launch]).refused()
    };
    let base = LaunchText::default().nodes(&["scale"]).edge("scale", "user", MEMORY).key("stamps = \"now\"");
    let text = base.source("scale", "campaign.csv", None, 100.0).text();
    let tracer = "[tracer]\ndriver = { kind = \"campaign\", file = \"campaign.csv\" }\npace = { rate_hz = 50.0 }\n";
    assert_says(&refused(&format!("{text}{tracer}")), &["launch.toml", "stamps", "the same pace"]);
    let bag =
        text.replace("kind = \"campaign\", file = \"campaign.csv\"", "kind = \"bag\", file = \"a\", topic = \"/a\"");
    assert_says(&refused(&bag), &["stamps", "time_factor"]);
    let clock = text.replace("stamps = \"now\"", "stamps = \"now\"\npublish_clock = true");
    assert_says(&refused(&clock), &["publish_clock", "recorded"]);
    let hidden = text.replace("stamps = \"now\"", "publish_clock = true");
    assert_says(&refused(&hidden), &["publish_clock", "visible_in_ros"]);
    // A parameter can set them apart after the file was read.
    let bench = Bench::identified(5);
    let file = whole_graph(&bench, "stamps = \"now\"");
    let said = run(["launch", &file, "--ros-args", "-p", "tracer:rate_hz:=500.0"]).refused();
    assert_says(&said, &["stamps", "the same pace"]);
}

#[test]
fn val_rclpy_what_is_played_now_comes_when_its_stamp_says() {
    let test = "present::val_rclpy_what_is_played_now_comes_when_its_stamp_says";
    in_own_network(test, |domain| {
        let Some(user) = ros2(domain, &["delays", NAMESPACE, "500"]) else { return };
        let bench = Bench::identified(5);
        long_recording(&bench, 60_000);
        let file = stream_of(&bench, |launch| launch.edge("residual", "*", DDS).key("stamps = \"now\""));
        let text = bench.read("launch.toml").replace("rate_hz = 1000.0", "time_factor = 1.0");
        bench.write("launch.toml", text);
        let before_s = now_s();
        let graph = Started::start(abbe_in(domain, ["launch", &file]));
        let heard = said(user);
        signal(graph.id(), Signal::INT);
        graph.finish().ok();
        let list = |key: &str| serde_json::from_value::<Vec<f64>>(heard[key].clone()).unwrap();
        let (stamps_s, came_s) = (list("stamps_s"), list("came_s"));
        assert!(stamps_s.is_sorted());
        for (stamp_s, came_s) in stamps_s.iter().zip(&came_s) {
            // Not before its instant (a stamp as f64 is good to a microsecond), and not of another time than the run's.
            assert!(*stamp_s >= before_s && *stamp_s <= came_s + 1e-6, "{stamp_s} came at {came_s}");
        }
    });
}

#[test]
fn val_rclpy_the_clock_of_a_recording_is_that_of_its_stamps() {
    let test = "present::val_rclpy_the_clock_of_a_recording_is_that_of_its_stamps";
    in_own_network(test, |domain| {
        let Some(user) = ros2(domain, &["heard_clock", "300"]) else { return };
        let bench = Bench::identified(5);
        long_recording(&bench, 60_000);
        let file = stream_of(&bench, |launch| {
            launch.edge("scale", "*", DDS).edge("residual", "*", DDS).key("publish_clock = true")
        });
        let graph = Started::start(abbe_in(domain, ["launch", &file]));
        let heard = said(user);
        signal(graph.id(), Signal::INT);
        graph.finish().ok();
        assert_eq!(heard["types"], serde_json::json!(["rosgraph_msgs/msg/Clock"]));
        let heard_s: Vec<f64> = serde_json::from_value(heard["heard_s"].clone()).unwrap();
        // The recording begins at 0 and has a reading each millisecond.
        assert!(heard_s.is_sorted() && heard_s.iter().all(|second| (0.0..60.0).contains(second)), "{heard_s:?}");
        let is_stamp = |second: &f64| (second * 1e3 - (second * 1e3).round()).abs() < 1e-6;
        assert!(heard_s.iter().all(is_stamp));
    });
}
