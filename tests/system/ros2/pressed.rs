//! What managers and callers do that no manual foresees: two at once, floods of calls, processes that stand still.

use abbe_msgs::{CorrectedCoordinates, CorrectionStatus};
use serde_json::{Value, json};

use super::beside;
use crate::common::assert_says;
use crate::common::files::{Bench, samples};
use crate::common::graph::{DDS, MEMORY, endless_stream_of, topic};
use crate::common::network::in_own_network;
use crate::common::program::{Started, abbe_in, run};
use crate::common::python::{ros2, said};

/// How often each of two managers deactivates and activates the node.
const TIMES: usize = 20;

#[test]
fn val_rclpy_two_managers_a_flood_of_calls_and_processes_that_stand_still_leave_a_node_in_one_state() {
    let test = "ros2::pressed::val_rclpy_two_managers_a_flood_of_calls_and_processes_that_stand_still_leave_a_node_in_one_state";
    in_own_network(test, |domain| {
        let (bench, remote) = (Bench::identified(5), topic("geometric"));
        let manager = || ros2(domain, &["quarrel", &remote, &TIMES.to_string()]);
        let (Some(one), Some(other)) = (manager(), manager()) else { return };
        let file = endless_stream_of(&bench, |launch| {
            let launch = launch.key("visible_in_ros = true").edge("residual", "*", DDS);
            let launch = launch.edge("scale", "recorder", MEMORY).edge("residual", "recorder", MEMORY);
            launch.nodes(&["recorder"]).record("recorded")
        });
        let graph = Started::start(abbe_in(domain, ["launch", &file]));
        let (one, other) = std::thread::scope(|scope| {
            let one = scope.spawn(|| said(one));
            let other = said(other);
            (one.join().unwrap(), other)
        });
        for heard in [&one, &other] {
            assert_eq!(heard["outcomes"].as_array().unwrap().len(), 2 * TIMES, "every call is answered");
            follow_each_other(heard["events"].as_array().unwrap());
        }

        let heard = beside(graph, ros2(domain, &["press", &remote, &file]).unwrap());
        let number = |name: &str| heard[name].as_u64().unwrap();
        println!("{} of {} calls of a flood were answered", number("answered"), number("asked"));
        assert!(number("answered") > 0 && number("asked") > 1000, "{heard}");
        for (moment, state) in [
            ("at first", json!("active")),
            ("after the flood", json!("active")),
            ("while it stands", json!("active")),
            ("answered while it stands", json!(false)),
            ("answered when it goes on", json!(true)),
            ("then", json!("inactive")),
            ("gateways", json!(1)),
            ("of the next gateway", json!("inactive")),
            ("activated", json!(true)),
            ("at last", json!("active")),
        ] {
            assert_eq!(heard[moment], state, "{moment}: {heard}");
        }

        // Nobody on the network delays or loses a sample of those who correct, and each is what it would be again.
        let samples: Vec<CorrectedCoordinates> = samples(&bench.path("recorded"), &topic("corrected"));
        assert!(samples.windows(2).all(|pair| pair[1].sequence == pair[0].sequence + 1));
        let replayed = run(["replay", "--bag", &bench.text("recorded"), "--model", &bench.text("model.json")]);
        let count = samples.len();
        assert_says(
            &String::from_utf8_lossy(&replayed.output),
            &[&format!("{count} of {count} corrected messages are identical")],
        );
    });
}

#[test]
fn val_rclpy_a_node_whose_process_is_killed_comes_back_as_it_was_told() {
    let test = "ros2::pressed::val_rclpy_a_node_whose_process_is_killed_comes_back_as_it_was_told";
    in_own_network(test, |domain| {
        let (bench, other, remote) = (Bench::identified(5), Bench::identified(6), topic("geometric"));
        let file = endless_stream_of(&bench, |launch| {
            let launch = launch.key("visible_in_ros = true").edge("residual", "*", DDS);
            let launch = launch.edge("scale", "recorder", MEMORY).edge("geometric", "recorder", MEMORY);
            launch.nodes(&["recorder"]).record("recorded")
        });
        let model = other.text("model.json");
        let Some(user) = ros2(domain, &["kill", &remote, &file, &model]) else { return };
        let heard = beside(Started::start(abbe_in(domain, ["launch", &file])), user);
        for (moment, state) in [
            ("set", json!(true)),
            ("deactivated", json!(true)),
            ("state", json!("inactive")),
            ("model", json!(model)),
            ("activated", json!(true)),
        ] {
            assert_eq!(heard[moment], state, "{moment}: {heard}");
        }
        // Nothing is corrected between the command that stopped it and the one that let it go on, and the model stays the one that was
        // set.
        let samples: Vec<CorrectedCoordinates> = samples(&bench.path("recorded"), &topic("geometric/corrected"));
        let mut seen: Vec<_> =
            samples.iter().map(|sample| (sample.status == CorrectionStatus::Inactive, sample.model_sha256)).collect();
        seen.dedup();
        let is_inactive: Vec<bool> = seen.iter().map(|(is_inactive, _)| *is_inactive).collect();
        assert_eq!(is_inactive, [false, false, true, false], "{seen:?}");
        assert!(seen[0].1 != seen[1].1 && seen[1].1 == seen[3].1, "{seen:?}");
    });
}

/// Holds each step of a node to begin where the one before it ended.
#[track_caller]
fn follow_each_other(events: &[Value]) {
    assert!(events.len() > TIMES, "{events:?}");
    for pair in events.windows(2) {
        assert_eq!(pair[0][2], pair[1][0], "{} does not follow {}", pair[1], pair[0]);
    }
}
