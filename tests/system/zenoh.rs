//! A graph with edges over Zenoh beside a user on `eclipse-zenoh`, who is the router as well, and programs without the transport.
//!
//! The user is `tests/system/peers/zenoh_user.py`, run by the Python that `ABBE_ZENOH_PYTHON` names (PyPI `eclipse-zenoh` and `rosbags`). What
//! wants Zenoh wants the feature `zenoh`; without one of these a test says that it was skipped.

use std::path::Path;
use std::process::{Command, Stdio};

use crate::common::assert_says;
use crate::common::files::{Bench, machine, samples, text};
use crate::common::graph::{LaunchText, MEMORY, NAMESPACE, topic};
use crate::common::network::in_own_network;
use crate::common::program::{Started, abbe_in, run, signal};
use crate::common::python::{keep_compiled, said};
use abbe_msgs::{CorrectedCoordinates, Message, ScaleReading, cdr, type_description};
use abbe_runtime::ros::Domain;
use abbe_runtime::transport::zenoh::IS_BUILT;
use rustix::process::Signal;
use serde_json::{Value, json};

const ZENOH: &str = "zenoh";
/// Readings of the campaign that are used.
const EVERY: usize = 3;

/// The user's program; none where this program has no Zenoh, or nobody is there to answer.
fn user(domain: Domain, readings: &Path) -> Option<Command> {
    if !IS_BUILT {
        println!("SKIPPED: this program is built without the feature zenoh");
        return None;
    }
    let Ok(interpreter) = std::env::var("ABBE_ZENOH_PYTHON") else {
        println!("SKIPPED: set ABBE_ZENOH_PYTHON to a Python with eclipse-zenoh and rosbags");
        return None;
    };
    let mut command = Command::new(interpreter);
    command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/system/peers/zenoh_user.py"));
    command.args([&domain.id().to_string(), NAMESPACE]).arg(readings);
    command.stdin(Stdio::null());
    keep_compiled(&mut command);
    Some(command)
}

/// Readings of the user's, corrected here, and given back.
fn graph() -> LaunchText {
    LaunchText::default()
        .nodes(&["geometric", "residual", "recorder"])
        .edge("scale", "geometric", ZENOH)
        .edge("geometric", "residual", MEMORY)
        .edge("residual", "recorder", MEMORY)
        .edge("residual", "*", ZENOH)
        .record("recorded")
}

#[test]
fn val_eclipse_zenoh_sends_readings_and_takes_coordinates_and_what_is_no_reading_is_refused_in_words() {
    let test =
        "zenoh::val_eclipse_zenoh_sends_readings_and_takes_coordinates_and_what_is_no_reading_is_refused_in_words";
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        let (campaign, bag) = (bench.text("campaign.csv"), bench.text("campaign"));
        let convert = ["convert", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &bag];
        run(convert.into_iter().chain(["--namespace", NAMESPACE])).ok();
        let readings: Vec<ScaleReading> = samples(&bench.path("campaign"), &topic("scale/reading"));
        let readings: Vec<_> = readings.iter().step_by(EVERY).collect();
        let hex = |bytes: Vec<u8>| bytes.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
        let sent: Vec<String> = readings.iter().map(|one| hex(cdr::encode(&one.to_ros()).unwrap())).collect();
        bench.write("readings.json", json!(sent).to_string());
        let Some(user) = user(domain, &bench.path("readings.json")) else { return };

        let graph = Started::start(abbe_in(domain, ["launch", &graph().write(&bench)]));
        let heard = said(user);
        signal(graph.id(), Signal::INT);
        let ran = graph.finish();
        assert!(!ran.errors.contains("panicked"), "{}", ran.errors);
        let refused = ["no attachment of rmw_zenoh", "none of rmw_zenoh", "not a abbe_msgs/msg/ScaleReading"];
        assert_says(&ran.errors, &refused);
        assert_says(&ran.errors, &["131072 bytes, more than any sample", "deletes instead"]);
        ran.ok();

        let recorded: Vec<CorrectedCoordinates> = samples(&bench.path("recorded"), &topic("corrected"));
        assert_eq!(recorded.len(), readings.len(), "every reading has one answer, and nothing else has");
        let taken = heard["taken"].as_array().unwrap();
        assert_eq!(taken.len(), recorded.len());
        for (number, (one, corrected)) in (1..).zip(taken.iter().zip(&recorded)) {
            assert_same(one, corrected);
            assert_eq!((&one["number"], &one["length"]), (&json!(number), &json!(16)));
            assert_eq!(one["gid"], taken[0]["gid"]);
            assert!((0.0..60.0).contains(&one["age_s"].as_f64().unwrap()), "{one}");
        }
        assert_tokens(&heard["tokens"], domain);
    });
}

fn assert_same(taken: &Value, corrected: &CorrectedCoordinates) {
    let bits = |values: &[f64]| json!(values.iter().map(|value| value.to_bits()).collect::<Vec<_>>());
    assert_eq!(taken["sequence"], corrected.sequence);
    assert_eq!(taken["corrected_m"], bits(&corrected.corrected_m));
    assert_eq!(taken["covariance_m2"], bits(&corrected.covariance_m2));
    assert_eq!(taken["status"], corrected.status as u8);
    assert_eq!(taken["frame"], corrected.frame_id.as_str());
}

/// What `ros2 node list` and `ros2 topic list` go by under rmw_zenoh.
fn assert_tokens(tokens: &Value, domain: Domain) {
    let ends = |end: String| tokens.as_array().unwrap().iter().any(|token| token.as_str().unwrap().ends_with(&end));
    let endpoint = |kind: &str, node: &str, topic: &str, name: &str, reliability: u8| {
        let hash = type_description::hash(&format!("abbe_msgs/msg/{name}")).unwrap();
        format!(
            "/{kind}/%/%{NAMESPACE}/{node}/%{NAMESPACE}%{topic}/abbe_msgs::msg::dds_::{name}_/{hash}/{reliability}:2:1,4096:,:,:,,"
        )
    };
    let mut expected: Vec<String> =
        ["geometric", "residual"].map(|node| format!("/0/0/NN/%/%{NAMESPACE}/{node}")).to_vec();
    expected.push(endpoint("MP", "residual", "corrected", "CorrectedCoordinates", 1));
    expected.push(endpoint("MS", "geometric", "scale%reading", "ScaleReading", 2));
    for end in expected {
        assert!(ends(end.clone()), "{end} is not in {tokens}");
    }
    assert!(tokens.to_string().contains(&format!("@ros2_lv/{}/", domain.id())));
}

#[test]
fn a_program_without_zenoh_refuses_the_launch_file_and_says_how_to_build_it() {
    if IS_BUILT {
        println!("SKIPPED: this program is built with the feature zenoh");
        return;
    }
    let bench = Bench::identified(5);
    let refused = run(["launch", &graph().write(&bench)]).refused();
    let build = "cargo build --release --features zenoh";
    assert_says(&refused, &["launch.toml: edges[0]", "built without zenoh", build]);
}
