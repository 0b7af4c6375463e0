//! A user on a real ROS 2 beside a live graph: rclpy on Fast DDS, and callers of services as Cyclone DDS writes them.
//! What they do stands habit by habit in `docs/src/reference/ros2.md`.

mod descriptions;
mod hosts;
mod launched;
mod packages;
mod pressed;
mod qos;
mod round_trip;
mod timed;

use std::time::Duration;

use crate::common::assert_says;
use crate::common::files::{Bench, samples};
use crate::common::graph::{DDS, LaunchText, MEMORY, NAMESPACE, endless_stream_of, topic};
use crate::common::network::in_own_network;
use crate::common::program::{Started, abbe_in, run, signal};
use crate::common::python::{python, ros2, said};
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus};
use abbe_runtime::ros::Domain;
use rustix::process::Signal;
use serde_json::{Value, json};

/// A graph whose scale and residual node are seen over DDS; `arguments` are those of the nodes.
fn graph(bench: &Bench, domain: Domain) -> Started {
    let file = endless_stream_of(bench, |launch| {
        let launch = launch.edge("scale", "*", DDS).edge("residual", "*", DDS);
        launch.nodes(&["recorder"]).edge("residual", "recorder", MEMORY).record("recorded")
    });
    Started::start(abbe_in(domain, ["launch", &file]))
}

/// The same launch with a tracer and a monitor, each node in the ROS graph.
fn with_monitor(launch: LaunchText, bench: &Bench) -> LaunchText {
    let launch = launch.key("visible_in_ros = true").edge("residual", "*", DDS).nodes(&["tracer", "monitor"]).monitor();
    let launch = launch.source("tracer", &bench.text("campaign.csv"), None, 1.0);
    launch.edge("tracer", "monitor", MEMORY).edge("residual", "monitor", MEMORY)
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
    let test = "ros2::val_rclpy_a_subscriber_with_default_quality_of_service_gets_the_streams";
    in_own_network(test, |domain| {
        let Some(user) = ros2(domain, &["streams", NAMESPACE, "500"]) else { return };
        let bench = Bench::identified(5);
        let heard = beside(graph(&bench, domain), user);
        samples_of_each_stream(&heard, 500);
    });
}

/// Holds what a user took of both topics, with either quality of service, to `count` samples in order.
#[track_caller]
fn samples_of_each_stream(heard: &Value, count: usize) {
    for topic in ["corrected_point", "scale/joint_states"] {
        for qos in ["default", "sensor_data"] {
            let stamps = &heard["stamps_s"][format!("{topic} {qos}")];
            let stamps: Vec<f64> = serde_json::from_value(stamps.clone()).unwrap();
            assert!(stamps.len() >= count, "{topic} with {qos}: {} samples", stamps.len());
            assert!(stamps.is_sorted(), "{topic} with {qos}: samples are out of order");
        }
    }
}

#[test]
fn val_rclpy_lists_and_describes_parameters_and_may_not_set_what_is_fixed() {
    let test = "ros2::val_rclpy_lists_and_describes_parameters_and_may_not_set_what_is_fixed";
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
    let test = "ros2::val_rclpy_calls_a_service_of_a_node";
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

/// Services that every node has, in the order of their names: they change nothing where all parameters are fixed.
const LOOKS_ONLY: [&str; 11] = [
    "describe_parameters",
    "get_available_states",
    "get_available_transitions",
    "get_parameter_types",
    "get_parameters",
    "get_state",
    "get_transition_graph",
    "get_type_description",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
];

#[test]
fn val_rclpy_finds_no_service_that_changes_anything_where_the_launch_file_says_so() {
    let test = "ros2::val_rclpy_finds_no_service_that_changes_anything_where_the_launch_file_says_so";
    in_own_network(test, |domain| {
        let commands: [(&str, &[&str]); 5] = [
            ("scale", &["change_state"]),
            ("tracer", &["change_state"]),
            ("geometric", &["change_state", "reload_model"]),
            ("residual", &["change_state", "reload_model"]),
            ("monitor", &["change_state", "diagnose", "reload_model"]),
        ];
        let words: Vec<&str> = ["services", NAMESPACE].into_iter().chain(commands.map(|(node, _)| node)).collect();
        let bench = Bench::identified(5);
        for (key, is_offered) in [("commands_from_ros = true", true), ("commands_from_ros = false", false)] {
            let Some(user) = ros2(domain, &words) else { return };
            let file = endless_stream_of(&bench, |launch| with_monitor(launch.key(key), &bench));
            let heard = beside(Started::start(abbe_in(domain, ["launch", &file])), user);
            for (node, commands) in commands {
                let mut offered: Vec<&str> = heard[node].as_array().unwrap().iter().filter_map(Value::as_str).collect();
                let looks_only = |name: &&str| LOOKS_ONLY.contains(name);
                assert_eq!(offered.iter().copied().filter(looks_only).collect::<Vec<_>>(), LOOKS_ONLY, "{key}: {node}");
                offered.retain(|name| !looks_only(name));
                assert_eq!(offered, if is_offered { commands } else { &[] }, "{key}: {node}");
            }
        }
    });
}

#[test]
fn val_rclpy_sees_every_node_whatever_its_edges() {
    let test = "ros2::val_rclpy_sees_every_node_whatever_its_edges";
    in_own_network(test, |domain| {
        let names = ["scale", "geometric", "residual"];
        let Some(user) = ros2(domain, &["nodes", NAMESPACE, names[0], names[1], names[2]]) else { return };
        let bench = Bench::identified(5);
        // No edge of any node is over DDS.
        let file = endless_stream_of(&bench, |launch| {
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
    let test = "ros2::val_rclpy_its_clock_is_that_of_a_node_with_use_sim_time";
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        let Some(user) = ros2(domain, &["clock", SECONDS, "bridge_xyz"]) else { return };
        let file = endless_stream_of(&bench, |launch| launch.edge("residual", "*", DDS));
        let arguments = ["launch", &file, "--ros-args", "-p", "use_sim_time:=true"];
        let graph = Started::start(abbe_in(domain, arguments));
        let heard = beside(graph, user);
        // The one type that it has in ROS 2, and nobody who says else.
        assert_eq!(heard["types"], json!(["rosgraph_msgs/msg/Clock"]));
    });
}

#[test]
fn val_rclpy_diagnostics_are_those_of_diagnostic_updater_and_each_has_its_place_in_the_aggregator() {
    let test = "ros2::val_rclpy_diagnostics_are_those_of_diagnostic_updater_and_each_has_its_place_in_the_aggregator";
    in_own_network(test, |domain| {
        let names = ["scale", "geometric", "residual"];
        let Some(user) = ros2(domain, &["health", NAMESPACE, names[0], names[1], names[2]]) else { return };
        let bench = Bench::identified(5);
        let file = endless_stream_of(&bench, |launch| {
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
    let test = "ros2::regress_a_caller_on_cyclone_gets_parameters_and_services_and_garbage_is_dropped_in_few_words";
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

#[test]
fn val_rclpy_sets_what_may_change_while_nodes_run_and_nothing_else() {
    let test = "ros2::val_rclpy_sets_what_may_change_while_nodes_run_and_nothing_else";
    in_own_network(test, |domain| {
        let (bench, other) = (Bench::identified(5), Bench::identified(6));
        let model = other.text("model.json");
        let Some(user) = ros2(domain, &["change", NAMESPACE, &model]) else { return };
        let file = endless_stream_of(&bench, |launch| {
            let launch = with_monitor(launch, &bench).nodes(&["recorder"]);
            launch.edge("residual", "recorder", MEMORY).record("recorded")
        });
        let heard = beside(Started::start(abbe_in(domain, ["launch", &file])), user);
        assert_eq!(heard["changeable of geometric"], json!(["max_covariate_age_s", "model"]));
        let of_monitor = json!(["match_within_s", "max_covariate_age_s", "model", "single_bound", "window"]);
        assert_eq!(heard["changeable of monitor"], of_monitor);
        let refused = |what: &str, place: usize, says: &[&str]| {
            assert_eq!(heard[what][place][0], false, "{what}");
            assert_says(heard[what][place][1].as_str().unwrap(), says);
        };
        refused("no such file", 0, &["nowhere.json", "stays in use"]);
        refused("pipe", 0, &["no model file", "stays in use"]);
        refused("no age", 0, &["max_covariate_age_s"]);
        assert_eq!(heard["age"][0][0], true, "{heard}");
        refused("one of two", 0, &["window"]);
        refused("none of two", 0, &["window"]);
        assert_eq!((&heard["one of two"][1][0], &heard["both"][0][0]), (&json!(true), &json!(true)));
        assert_eq!(heard["values of geometric"], json!([model, 1.5]));
        assert_eq!(heard["values of monitor"], json!([7.0, 50]));
        let events = heard["events"].as_array().unwrap();
        for (name, value) in [("model", json!(model)), ("max_covariate_age_s", json!(1.5))] {
            assert!(events.contains(&json!([topic("geometric"), name, value])), "{events:?}");
        }
        assert_eq!(heard["old events"], json!(0));
        assert!(!events.iter().any(|event| event[2] == 6.0), "none of two that belong together: {events:?}");
        let samples: Vec<CorrectedCoordinates> = samples(&bench.path("recorded"), &topic("corrected"));
        let mut models: Vec<_> = samples.iter().map(|sample| sample.model_sha256).collect();
        models.dedup();
        assert_eq!(models.len(), 2, "one after the other, and none lost on the way");
        assert!(samples.windows(2).all(|pair| pair[1].sequence == pair[0].sequence + 1));
    });
}

#[test]
fn val_rclpy_the_log_of_a_node_is_on_rosout_for_who_joins_later_unless_it_is_not_wanted() {
    let test = "ros2::val_rclpy_the_log_of_a_node_is_on_rosout_for_who_joins_later_unless_it_is_not_wanted";
    in_own_network(test, |domain| {
        let Some(user) = ros2(domain, &["log", NAMESPACE, "geometric", "is active"]) else { return };
        let bench = Bench::identified(5);
        let file = endless_stream_of(&bench, |launch| launch.key("visible_in_ros = true").edge("residual", "*", DDS));
        let quiet = "--disable-stdout-logs";
        let words = ["launch", &file, "--ros-args", "--log-level", "INFO", quiet, "--log-config-file", "none"];
        let graph = Started::start(abbe_in(domain, words));
        let heard = said(user);
        signal(graph.id(), Signal::INT);
        let ran = graph.finish();
        assert!(!ran.errors.contains("is active"), "the terminal stays quiet: {}", ran.errors);
        ran.ok();
        assert_eq!(heard["level"], 20);
        assert!(
            heard["line"].as_u64() > Some(0) && heard["file"].as_str().unwrap().ends_with("lifecycle.rs"),
            "{heard}"
        );
        assert!((0.0..60.0).contains(&heard["age_s"].as_f64().unwrap()), "{heard}");
        let names: Vec<String> = serde_json::from_value(heard["names"].clone()).unwrap();
        assert!(names.iter().all(|name| name.starts_with("test.")), "{names:?}");
    });
}

#[test]
fn val_rclpy_a_manager_takes_nodes_through_their_states_and_what_was_paused_says_so_and_replays() {
    let test = "ros2::val_rclpy_a_manager_takes_nodes_through_their_states_and_what_was_paused_says_so_and_replays";
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        let (model, aside) = (bench.text("model.json"), bench.text("aside.json"));
        let Some(user) = ros2(domain, &["manage", NAMESPACE, &aside, &model]) else { return };
        std::fs::rename(&model, &aside).unwrap();
        let file = endless_stream_of(&bench, |launch| {
            let launch = launch.key("visible_in_ros = true").key("autostart = false").edge("residual", "*", DDS);
            let launch = launch.edge("scale", "recorder", MEMORY).edge("residual", "recorder", MEMORY);
            launch.nodes(&["recorder"]).record("recorded")
        });
        let heard = beside(Started::start(abbe_in(domain, ["launch", &file])), user);
        assert_managed(&heard, &model);
        let again: Vec<CorrectedCoordinates> = samples(&bench.path("recorded-2"), &topic("corrected"));
        assert!(again.len() >= 200, "a recorder that is configured again begins a bag of its own: {}", again.len());
        let samples: Vec<CorrectedCoordinates> = samples(&bench.path("recorded"), &topic("corrected"));
        let inactive = samples.iter().filter(|sample| sample.status == CorrectionStatus::Inactive);
        // Half a second and more of the geometric node, 0.3 s of the residual node.
        assert!(inactive.clone().count() >= 1000, "{}", inactive.count());
        let bag = bench.text("recorded");
        // Readings that came while a node was not configured have no answer; every answer is what it was.
        let replayed = run(["replay", "--bag", &bag, "--model", &model]);
        let count = samples.len();
        assert_says(
            &String::from_utf8_lossy(&replayed.output),
            &[&format!("{count} of {count} corrected messages are identical")],
        );
        assert_says(&replayed.refused(), &["scale readings have no corrected message"]);
    });
}

fn assert_managed(heard: &Value, model: &str) {
    let all = |state: &str| json!({"recorder": state, "residual": state, "geometric": state, "scale": state});
    assert_eq!(heard["at first"], all("unconfigured"));
    assert_eq!(heard["available at first"], json!(["configure", "shutdown"]));
    assert_eq!((heard["states"].as_u64(), heard["steps"].as_u64()), (Some(9), Some(19)));
    for refused in ["activated too early", "configured without a file", "cleaned up while active"] {
        assert_eq!(heard[refused], false, "{refused}");
    }
    assert_eq!(heard["state without a file"], "unconfigured");
    assert_says(heard["reason"].as_str().unwrap(), &["could not be configured", model]);
    let four = json!([true, true, true, true]);
    for all in ["all 1", "all 3", "recorder again"] {
        assert_eq!(heard[all], four, "{all}");
    }
    assert_eq!(heard["at work"], all("active"));
    for done in ["paused", "resumed", "residual paused", "residual resumed", "by label", "cleaned up"] {
        assert_eq!(heard[done], true, "{done}");
    }
    assert_eq!(heard["points while inactive"], 0);
    assert_eq!(heard["after cleaning"], "unconfigured");
    assert_eq!((&heard["again"], &heard["shut down"]), (&json!([true, true]), &json!([true, "finalized"])));
    let events = heard["events"].as_array().unwrap();
    let steps: [[&str; 3]; 5] = [
        ["configuring", "transition_failure", "unconfigured"],
        ["configuring", "transition_success", "inactive"],
        ["inactive", "activate", "activating"],
        ["active", "deactivate", "deactivating"],
        ["cleaningup", "transition_success", "unconfigured"],
    ];
    for step in steps {
        assert!(events.contains(&json!(step)), "{step:?} is not in {events:?}");
    }
    assert!(heard["ages_s"].as_array().unwrap().iter().all(|age_s| (0.0..120.0).contains(&age_s.as_f64().unwrap())));
}
