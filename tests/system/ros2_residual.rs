//! A user on a real ROS 2 gives a running node another residual model: `ros2 param set`.

use std::fs;

use abbe_msgs::{CorrectedCoordinates, Sha256};
use rustix::process::Signal;
use serde_json::json;

use crate::common::assert_says;
use crate::common::files::{Bench, samples};
use crate::common::graph::{DDS, MEMORY, NAMESPACE, endless_stream_of, topic};
use crate::common::network::in_own_network;
use crate::common::program::{Started, abbe_in, signal};
use crate::common::python::{ros2, said};
use crate::residual;

#[test]
fn val_rclpy_sets_another_residual_model_while_its_node_runs_and_what_is_none_changes_nothing() {
    let test =
        "ros2_residual::val_rclpy_sets_another_residual_model_while_its_node_runs_and_what_is_none_changes_nothing";
    in_own_network(test, |domain| {
        let words = ["files", NAMESPACE, "residual", "residual_model", "nowhere.json", "model.json", "network.json"];
        let Some(user) = ros2(domain, &words) else { return };
        let (trained, bench) = (residual::bench(), Bench::empty());
        for file in ["campaign.csv", "model.json", "residual.json", "network.json"] {
            fs::copy(trained.path(file), bench.path(file)).unwrap();
        }
        let file = endless_stream_of(&bench, |launch| {
            let launch = launch.residual_model("residual.json").edge("residual", "*", DDS).nodes(&["recorder"]);
            launch.edge("residual", "recorder", MEMORY).record("run")
        });
        let graph = Started::start(abbe_in(domain, ["launch", &file]));
        let heard = said(user);
        signal(graph.id(), Signal::INT);
        graph.finish().ok();

        let [missing, stranger, second] = &heard["results"].as_array().unwrap()[..] else { panic!("{heard}") };
        for (refused, says) in [(missing, "nowhere.json"), (stranger, "abbe-model")] {
            assert_eq!((&refused[0], &refused[2]), (&json!(false), &json!("residual.json")), "{refused}");
            assert_says(refused[1].as_str().unwrap(), &[says, "stays in use"]);
        }
        assert_eq!((&second[0], &second[2]), (&json!(true), &json!("network.json")), "{second}");

        let samples: Vec<CorrectedCoordinates> = samples(&bench.path("run"), &topic("corrected"));
        assert!(samples.windows(2).all(|pair| pair[1].sequence == pair[0].sequence + 1));
        let mut used: Vec<Sha256> = samples.iter().map(|sample| sample.residual_model_sha256).collect();
        // The user took 200 before each file, and 200 after the last.
        let before = used.iter().take_while(|hash| **hash == used[0]).count();
        assert!(before >= 600 && used.len() - before >= 200, "{before} of {}", used.len());
        used.dedup();
        assert_eq!(used.len(), 2, "one after the other, and no sample without one");
        assert!(!used.contains(&Sha256::NONE));
    });
}
