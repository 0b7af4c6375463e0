//! What ROS 2 tools show of a machine: frames, description and markers, taken by programs of others that join late.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::common::files::{Bench, machine, samples};
use crate::common::graph::{DDS, MEMORY, NAMESPACE, long_recording, stream_of, topic};
use crate::common::network::in_own_network;
use crate::common::program::{Started, abbe_in, signal};
use crate::common::python::{python, ros2, said};
use abbe_files::{ModelFile, read_machine};
use abbe_graph::scene::urdf;
use abbe_graph::topics;
use abbe_msgs::CorrectedCoordinates;
use abbe_runtime::ros::Domain;
use rustix::process::Signal;
use serde_json::Value;

/// Long enough for every peer here; whoever is done first ends the graph.
const SAMPLES: u64 = 60_000;

/// A graph with its corrected samples recorded.
fn graph(bench: &Bench, domain: Domain) -> Started {
    long_recording(bench, SAMPLES);
    let file = stream_of(bench, |launch| {
        let launch = launch.edge("scale", "*", DDS).edge("residual", "*", DDS);
        launch.nodes(&["recorder"]).edge("residual", "recorder", MEMORY).record("recorded")
    });
    Started::start(abbe_in(domain, ["launch", &file]))
}

fn beside(graph: Started, program: std::process::Command) -> Value {
    let heard = said(program);
    signal(graph.id(), Signal::INT);
    let ran = graph.finish();
    assert!(!ran.errors.contains("panicked"), "{}", ran.errors);
    ran.ok();
    heard
}

fn moved_m(frame: &Value) -> [f64; 3] {
    serde_json::from_value(frame["moved_m"].clone()).unwrap()
}

#[test]
fn val_cyclone_frames_lead_to_the_tip_and_stations_stand_where_the_model_has_them() {
    let test = "scene::val_cyclone_frames_lead_to_the_tip_and_stations_stand_where_the_model_has_them";
    in_own_network(test, |domain| {
        let Some(mut user) = python("frames_user.py") else { return };
        user.args([&domain.id().to_string(), NAMESPACE, "300"]);
        let bench = Bench::identified(5);
        let heard = beside(graph(&bench, domain), user);
        let machine = read_machine(&machine()).unwrap().machine;
        let root = machine.frame_id.as_str();

        let corrected: BTreeMap<i64, CorrectedCoordinates> = samples(&bench.path("recorded"), &topic("corrected"))
            .into_iter()
            .map(|sample: CorrectedCoordinates| (sample.stamp.to_nanos(), sample))
            .collect();
        let moving = heard["moving"].as_array().unwrap();
        assert!(moving.len() >= 300);
        for frames in moving.iter().map(|frames| frames.as_array().unwrap()) {
            let sample = corrected[&frames[0]["stamp_ns"].as_i64().unwrap()];
            let names: Vec<_> = frames.iter().map(|frame| frame["child"].as_str().unwrap()).collect();
            let expected = ["x", "y", "ram", "tip", "tip_actual"].map(|part| format!("{root}/{part}"));
            assert_eq!(names, expected);
            // A tree: each stands in the one before, where the tip really is stands in the machine.
            let parents: Vec<_> = frames.iter().map(|frame| frame["parent"].as_str().unwrap()).collect();
            assert_eq!(parents, [root, &expected[0], &expected[1], &expected[2], root]);
            assert_eq!(moved_m(&frames[0]), [sample.reading_m[0], 0.0, 0.0]);
            assert_eq!(moved_m(&frames[1]), [0.0, sample.reading_m[1], 0.0]);
            assert_eq!(moved_m(&frames[2]), [0.0, 0.0, sample.reading_m[2]]);
            assert_eq!(moved_m(&frames[3]), sample.offset_m);
            assert_eq!(moved_m(&frames[4]), sample.corrected_m);
            assert!(frames.iter().all(|frame| frame["turned"] == serde_json::json!([0.0, 0.0, 0.0, 1.0])));
        }

        let standing: BTreeMap<&str, &Value> = heard["standing"]
            .as_array()
            .unwrap()
            .iter()
            .map(|frame| (frame["child"].as_str().unwrap(), frame))
            .collect();
        let (model, _) = ModelFile::load(&bench.path("model.json")).unwrap();
        let stations = &model.model.parts().stations;
        assert_eq!(standing.len(), 2 + stations.len(), "{standing:?}");
        for station in stations {
            let frame = standing[format!("{root}/station/{}", station.name).as_str()];
            let place_m = [station.position_m.x, station.position_m.y, station.position_m.z];
            assert_eq!((frame["parent"].as_str(), moved_m(frame)), (Some(root), place_m));
        }
        assert_eq!(heard["description"].as_str().unwrap(), urdf(&machine));
    });
}

#[test]
fn val_rclpy_a_machine_is_described_and_its_error_is_drawn() {
    let test = "scene::val_rclpy_a_machine_is_described_and_its_error_is_drawn";
    in_own_network(test, |domain| {
        let Some(user) = ros2(domain, &["scene", NAMESPACE]) else { return };
        let bench = Bench::identified(5);
        let heard = beside(graph(&bench, domain), user);
        let machine = read_machine(&machine()).unwrap().machine;
        let description = heard["description"].as_str().unwrap();
        assert_eq!(description, urdf(&machine));
        // What moves the machine in a tool are the joints of that description.
        for name in heard["joints"].as_array().unwrap() {
            let joint = format!("<joint name={name} type=\"prismatic\">");
            assert!(description.contains(&joint), "{joint}");
        }
        let corrected: Vec<CorrectedCoordinates> = samples(&bench.path("recorded"), &topic("corrected"));
        for markers in heard["markers"].as_array().unwrap() {
            let [volume, arrow, words] = [0, 1, 2].map(|k| &markers[k]);
            assert_eq!([&volume["ns"], &arrow["ns"], &words["ns"]], ["volume", "error", "words"]);
            assert!([volume, arrow, words].iter().all(|one| one["frame"] == machine.frame_id.as_str()));
            assert_eq!(volume["points"].as_array().unwrap().len(), 24);
            let stamp_s = arrow["stamp_s"].as_f64().unwrap();
            let sample = corrected.iter().find(|sample| (sample.stamp.to_seconds() - stamp_s).abs() < 1e-6).unwrap();
            let ends: Vec<[f64; 3]> = serde_json::from_value(arrow["points"].clone()).unwrap();
            for d in 0..3 {
                let error_m = (ends[1][d] - ends[0][d]) / 10_000.0;
                let expected_m = sample.corrected_m[d] - sample.reading_m[d] - sample.offset_m[d];
                // Positions of a metre as f64.
                assert!((error_m - expected_m).abs() < 1e-12, "{error_m} {expected_m}");
            }
            assert!(words["text"].as_str().unwrap().starts_with(sample.status.name()));
        }
    });
}

#[test]
fn val_rclpy_three_machines_stand_side_by_side_in_their_namespaces() {
    let test = "scene::val_rclpy_three_machines_stand_side_by_side_in_their_namespaces";
    in_own_network(test, |domain| {
        let names = ["left", "middle", "right"];
        let Some(user) = ros2(domain, &["machines", names[0], names[1], names[2]]) else { return };
        let bench = Bench::identified(5);
        long_recording(&bench, SAMPLES);
        let shipped = std::fs::read_to_string(machine()).unwrap();
        let graphs = names.map(|name| {
            let machine = format!("frame_id = \"{name}\"");
            let machine = bench.write(&format!("{name}.toml"), shipped.replace("frame_id = \"bridge_xyz\"", &machine));
            let text = format!(
                "namespace = \"{name}\"\nmachine = \"{machine}\"\nnodes = [\"scale\", \"geometric\", \"residual\"]\n\
                 max_covariate_age_s = 10.0\nwait_for_subscribers_s = 20.0\n\
                 [scale]\ndriver = {{ kind = \"campaign\", file = \"campaign.csv\" }}\npace = {{ rate_hz = 200.0 }}\nrepeat_from = 0\n{}{}{}{}",
                edge("scale", "geometric", MEMORY),
                edge("geometric", "residual", MEMORY),
                edge("scale", "*", DDS),
                edge("residual", "*", DDS),
            );
            // Each has a model of its own machine.
            let (model, campaign) = (bench.text(&format!("{name}.json")), bench.text("campaign.csv"));
            crate::common::program::run(["identify", "--machine", &machine, "--campaign", &campaign, "--out", &model]).ok();
            let text = text.replace("max_cov", &format!("model = \"{model}\"\nmax_cov"));
            Started::start(abbe_in(domain, ["launch", &bench.write(&format!("launch_{name}.toml"), text)]))
        });
        let heard = said(user);
        for graph in &graphs {
            signal(graph.id(), Signal::INT);
        }
        for graph in graphs {
            let ran = graph.finish();
            assert!(!ran.errors.contains("another"), "a machine hears of others: {}", ran.errors);
            ran.ok();
        }
        for name in names {
            assert_eq!(heard[name], serde_json::json!([name]));
        }
    });
}

fn edge(from: &str, to: &str, transport: &str) -> String {
    format!("[[edges]]\nfrom = \"{from}\"\nto = \"{to}\"\ntransport = \"{transport}\"\n")
}

#[test]
fn layouts_name_topics_and_frames_that_are_there() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config/ros2");
    let root = "/bridge_xyz/";
    let known = [
        topics::JOINT_STATE,
        topics::CORRECTED_POINT,
        topics::MARKERS,
        topics::ROBOT_DESCRIPTION,
        topics::CORRECTED,
        topics::RANGE_RESIDUAL,
    ];
    let mut named = BTreeSet::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let text = std::fs::read_to_string(entry.unwrap().path()).unwrap();
        for place in text.match_indices(root).map(|(at, _)| &text[at + root.len()..]) {
            let topic = known.iter().filter(|topic| place.starts_with(**topic)).max_by_key(|topic| topic.len());
            named.insert(*topic.unwrap_or_else(|| panic!("no topic is named {place:.40}")));
        }
    }
    assert!(named.len() >= 4, "{named:?}");
    assert_eq!(read_machine(&machine()).unwrap().machine.frame_id, "bridge_xyz");
}
