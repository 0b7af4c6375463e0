//! A user on a real ROS 2 beside a live graph: rclpy on Fast DDS, and callers of services as Cyclone DDS writes them.
//! What they do stands habit by habit in `docs/src/reference/ros2.md`.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod common;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use abbe_graph::launch::NodeName;
use abbe_runtime::ros::Domain;
use common::assert_says;
use common::files::{Bench, text};
use common::graph::{DDS, MEMORY, NAMESPACE, long_recording, stream_of};
use common::network::in_own_network;
use common::program::{Started, abbe_in, program, signal};
use common::python::{python, ros2, ros2_prefix, said};
use rustix::process::Signal;
use serde_json::{Value, json};

/// Long enough for every peer here; whoever is done first ends the graph.
const SAMPLES: u64 = 60_000;

/// A graph whose scale and residual node are seen over DDS; `arguments` are those of the nodes.
fn graph(bench: &Bench, domain: Domain) -> Started {
    long_recording(bench, SAMPLES);
    let file = stream_of(bench, |launch| {
        let launch = launch.edge("scale", "*", DDS).edge("residual", "*", DDS);
        launch.nodes(&["recorder"]).edge("residual", "recorder", MEMORY).record("recorded")
    });
    Started::start(abbe_in(domain, ["launch", &file]))
}

/// Runs a program of others beside the graph, and gives what it said.
fn beside(graph: Started, program: std::process::Command) -> Value {
    let heard = said(program);
    signal(graph.id(), Signal::INT);
    let ran = graph.finish();
    assert!(!ran.errors.contains("panicked"), "{}", ran.errors);
    ran.ok();
    heard
}

#[test]
fn val_rclpy_a_subscriber_with_default_quality_of_service_gets_the_streams() {
    let test = "val_rclpy_a_subscriber_with_default_quality_of_service_gets_the_streams";
    in_own_network(test, |domain| {
        let Some(user) = ros2(domain, &["streams", NAMESPACE, "500"]) else { return };
        let bench = Bench::identified(5);
        let heard = beside(graph(&bench, domain), user);
        for topic in ["corrected_point", "scale/joint_states"] {
            for qos in ["default", "sensor_data"] {
                let stamps: Vec<f64> =
                    serde_json::from_value(heard["stamps_s"][format!("{topic} {qos}")].clone()).unwrap();
                assert!(stamps.len() >= 500, "{topic} with {qos}: {} samples", stamps.len());
                assert!(stamps.is_sorted(), "{topic} with {qos}: samples are out of order");
            }
        }
    });
}

#[test]
fn val_rclpy_lists_and_describes_parameters_and_may_not_set_what_is_fixed() {
    let test = "val_rclpy_lists_and_describes_parameters_and_may_not_set_what_is_fixed";
    in_own_network(test, |domain| {
        let Some(user) = ros2(domain, &["parameters", &format!("/{NAMESPACE}/scale"), "rate_hz", "5.0"]) else {
            return;
        };
        let bench = Bench::identified(5);
        let heard = beside(graph(&bench, domain), user);
        parameters_of_scale(&heard);
        assert_eq!(heard["set"]["successful"], false);
        assert_says(heard["set"]["reason"].as_str().unwrap(), &["rate_hz", "fixed while the node runs"]);
        assert_eq!(heard["after"], 1000.0);
    });
}

fn parameters_of_scale(heard: &Value) {
    let reading = format!("qos_overrides./{NAMESPACE}/scale/reading.publisher");
    let values = &heard["values"];
    assert_eq!(values["rate_hz"], 1000.0, "{heard}");
    assert_eq!(values["use_sim_time"], false, "{heard}");
    assert_eq!(values[format!("{reading}.reliability")], "reliable", "{heard}");
    assert_eq!(values[format!("{reading}.depth")], 4096, "{heard}");
    let read_only = heard["read_only"].as_object().unwrap();
    assert_eq!(read_only.len(), values.as_object().unwrap().len());
    assert!(read_only.values().all(|fixed| *fixed == json!(true)), "{heard}");
}

#[test]
fn val_rclpy_calls_a_service_of_a_node() {
    let test = "val_rclpy_calls_a_service_of_a_node";
    in_own_network(test, |domain| {
        let service = format!("/{NAMESPACE}/residual/reload_model");
        let Some(user) = ros2(domain, &["trigger", &service]) else { return };
        let bench = Bench::identified(5);
        let heard = beside(graph(&bench, domain), user);
        // Without a residual model there is none to load, and it says so.
        assert_eq!(heard["success"], false);
        assert_says(heard["message"].as_str().unwrap(), &["residual model"]);
    });
}

#[test]
fn val_rclpy_finds_no_service_that_changes_anything_where_the_launch_file_says_so() {
    let test = "val_rclpy_finds_no_service_that_changes_anything_where_the_launch_file_says_so";
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        long_recording(&bench, SAMPLES);
        for (key, is_offered) in [("commands_from_ros = true", true), ("commands_from_ros = false", false)] {
            let Some(user) = ros2(domain, &["services", NAMESPACE, "residual"]) else { return };
            let file = stream_of(&bench, |launch| launch.key(key).edge("residual", "*", DDS));
            let heard = beside(Started::start(abbe_in(domain, ["launch", &file])), user);
            let has = |name: &str| {
                let service = json!(format!("/{NAMESPACE}/residual/{name}"));
                heard["services"].as_array().unwrap().contains(&service)
            };
            assert!(has("list_parameters"), "{key}: {heard}");
            assert_eq!(has("reload_model"), is_offered, "{key}: {heard}");
        }
    });
}

#[test]
fn val_rclpy_sees_every_node_whatever_its_edges() {
    let test = "val_rclpy_sees_every_node_whatever_its_edges";
    in_own_network(test, |domain| {
        let names = ["scale", "geometric", "residual"];
        let Some(user) = ros2(domain, &["nodes", NAMESPACE, names[0], names[1], names[2]]) else { return };
        let bench = Bench::identified(5);
        long_recording(&bench, SAMPLES);
        // No edge of any node is over DDS.
        let file = stream_of(&bench, |launch| {
            launch
                .key("visible_in_ros = true")
                .nodes(&["recorder"])
                .edge("residual", "recorder", MEMORY)
                .record("recorded")
        });
        let heard = beside(Started::start(abbe_in(domain, ["launch", &file])), user);
        let listed = |node: &str| heard["parameters"][node].as_array().unwrap().clone();
        assert!(listed("geometric").contains(&json!("max_covariate_age_s")), "{heard}");
        assert!(listed("scale").contains(&json!("rate_hz")), "{heard}");
    });
}

#[test]
fn val_rclpy_its_clock_is_that_of_a_node_with_use_sim_time() {
    const SECONDS: &str = "1000000";
    let test = "val_rclpy_its_clock_is_that_of_a_node_with_use_sim_time";
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        let Some(user) = ros2(domain, &["clock", SECONDS, "bridge_xyz"]) else { return };
        long_recording(&bench, SAMPLES);
        let file = stream_of(&bench, |launch| launch.edge("residual", "*", DDS));
        let arguments = ["launch", &file, "--ros-args", "-p", "use_sim_time:=true"];
        let graph = Started::start(abbe_in(domain, arguments));
        let heard = beside(graph, user);
        // The one type that it has in ROS 2, and nobody who says else.
        assert_eq!(heard["types"], json!(["rosgraph_msgs/msg/Clock"]));
    });
}

#[test]
fn val_rclpy_diagnostics_are_those_of_diagnostic_updater_and_each_has_its_place_in_the_aggregator() {
    let test = "val_rclpy_diagnostics_are_those_of_diagnostic_updater_and_each_has_its_place_in_the_aggregator";
    in_own_network(test, |domain| {
        let names = ["scale", "geometric", "residual"];
        let Some(user) = ros2(domain, &["health", NAMESPACE, names[0], names[1], names[2]]) else { return };
        let bench = Bench::identified(5);
        long_recording(&bench, SAMPLES);
        let file = stream_of(&bench, |launch| {
            launch
                .key("visible_in_ros = true")
                .nodes(&["recorder"])
                .edge("residual", "recorder", MEMORY)
                .record("recorded")
        });
        let heard = beside(Started::start(abbe_in(domain, ["launch", &file])), user);
        let heard = heard.as_object().unwrap();
        for name in names {
            let status = &heard[&format!("{NAMESPACE}/{name}: Frequency Status")];
            let figure = |key: &str| status["values"][key].as_str().unwrap().parse::<f64>().unwrap();
            assert!(figure("Events in window") <= figure("Events since startup"));
            let rate_hz = figure("Events in window") / figure("Duration of window (s)");
            // The window is told to a millisecond.
            assert!((figure("Actual frequency (Hz)") / rate_hz.max(1e-9) - 1.0).abs() < 0.01 || rate_hz == 0.0);
            let bounds = (figure("Minimum acceptable frequency (Hz)"), figure("Maximum acceptable frequency (Hz)"));
            assert_eq!(bounds, if name == "scale" { (900.0, 1100.0) } else { (0.0, f64::INFINITY) });
        }
        let shipped = include_str!("../../launch-config/ros2/diagnostics.yaml").replace("bridge_xyz", NAMESPACE);
        let groups: Vec<Vec<&str>> = shipped
            .lines()
            .filter_map(|line| line.trim().strip_prefix("startswith: [")?.strip_suffix(']'))
            .map(|list| list.split(',').map(|word| word.trim().trim_matches('\'')).collect())
            .collect();
        assert_eq!(groups.len(), 4);
        for (name, status) in heard {
            assert_eq!(status["hardware"], "bridge_xyz", "{name}");
            assert!((0..=3).contains(&status["level"].as_i64().unwrap()), "{name}");
            let of = |group: &&Vec<&str>| group.iter().any(|prefix| name.starts_with(prefix));
            assert_eq!(groups.iter().filter(of).count(), 1, "{name} has no one place");
        }
    });
}

#[test]
fn regress_a_caller_on_cyclone_gets_parameters_and_services_and_garbage_is_dropped_in_few_words() {
    let test = "regress_a_caller_on_cyclone_gets_parameters_and_services_and_garbage_is_dropped_in_few_words";
    in_own_network(test, |domain| {
        let Some(mut user) = python("cyclone_caller.py") else { return };
        user.args([&domain.id().to_string(), &format!("/{NAMESPACE}/scale"), &format!("/{NAMESPACE}/residual")]);
        let bench = Bench::identified(5);
        let graph = graph(&bench, domain);
        let heard = said(user);
        // What the log says of 1000 requests that are none.
        std::thread::sleep(Duration::from_millis(500));
        signal(graph.id(), Signal::INT);
        let ran = graph.finish();
        assert_says(&ran.errors, &["dropped a request", "/test/scale/get_parameters"]);
        let told = ran.errors.matches("dropped a request").count();
        assert!((1..=12).contains(&told), "told {told} times: {}", ran.errors);
        ran.ok();
        parameters_of_scale(&heard);
        assert_eq!(heard["garbage"], 1000);
        assert_eq!(heard["trigger"]["success"], false);
        assert_says(heard["trigger"]["message"].as_str().unwrap(), &["residual model"]);
    });
}

/// What the launch files say, each in its own words.
const LAUNCH_FILES: [&str; 3] = ["py", "xml", "yaml"];

#[test]
fn the_launch_files_of_the_package_have_the_same_arguments() {
    for kind in LAUNCH_FILES {
        let file = std::fs::read_to_string(package().join(format!("launch/bridge_xyz_virtual.launch.{kind}"))).unwrap();
        let words = [
            "model",
            "Model file, as `abbe identify` writes it",
            "machine",
            "bridge_xyz.toml",
            "Machine file that the model belongs to",
            "namespace",
            "Namespace of all topics",
            "bridge_xyz_virtual.toml",
            "--machine",
            "--model",
        ];
        assert_says(&file, &words);
        assert_eq!(
            file.matches("default").count(),
            2,
            "{kind}: machine and namespace have defaults, the model has none"
        );
    }
}

/// The folder of the package of a ROS 2 workspace.
fn package() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../packaging/ros")
}

/// Builds the package as colcon does, with the program of the tests, and installs it; nothing where there is no ROS 2.
fn install_package(bench: &Bench) -> Option<()> {
    let tools = ros2_prefix()?;
    let [build, prefix] = ["build", "install"].map(|name| bench.text(name));
    let folder = text(&package());
    let python = format!("-DPython3_EXECUTABLE={}", tools.join("bin/python").display());
    let program = format!("-DABBE_PROGRAM={}", program().display());
    let to = format!("-DCMAKE_INSTALL_PREFIX={prefix}");
    cmake(&tools, &["-S", &folder, "-B", &build, "-G", "Unix Makefiles", &python, &program, &to]);
    cmake(&tools, &["--build", &build]);
    cmake(&tools, &["--install", &build]);
    Some(())
}

fn cmake(tools: &Path, words: &[&str]) {
    let mut command = Command::new(tools.join("bin/cmake"));
    command.args(words).env("CMAKE_PREFIX_PATH", tools).env("AMENT_PREFIX_PATH", tools);
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cmake {words:?}: {}{said}", String::from_utf8_lossy(&output.stdout));
}

#[test]
fn val_ament_the_package_is_found_runs_nodes_and_launches_the_machine_that_it_is_told() {
    let test = "val_ament_the_package_is_found_runs_nodes_and_launches_the_machine_that_it_is_told";
    in_own_network(test, |domain| {
        let Some(user) = ros2(domain, &["streams", "other", "200"]) else { return };
        let bench = Bench::identified(5);
        install_package(&bench).unwrap();
        let [share, programs] = ["install/share/abbe", "install/lib/abbe"].map(|name| bench.path(name));
        assert!(bench.path("install/share/ament_index/resource_index/packages/abbe").is_file());
        for node in NodeName::ALL {
            let mut command = Command::new(programs.join(node.name()));
            command.args(["--launch", "none.toml"]);
            assert_says(&Started::start(command).finish().refused(), &["none.toml"]);
        }

        let config = share.join("launch-config");
        let mut command = Command::new(programs.join("abbe"));
        command.arg("launch").arg(config.join("bridge_xyz_virtual.toml"));
        command
            .arg("--machine")
            .arg(config.join("machines/bridge_xyz.toml"))
            .arg("--model")
            .arg(bench.path("model.json"));
        command.args(["--ros-args", "-r", "__ns:=/other"]).env("ROS_DOMAIN_ID", domain.id().to_string());
        command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
        let heard = beside(Started::start(command), user);
        let stamps = heard["stamps_s"]["corrected_point default"].as_array().unwrap();
        assert!(stamps.len() >= 200, "{} corrected points of the model that was named", stamps.len());
    });
}
