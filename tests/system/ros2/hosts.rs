//! Several hosts, between which multicast does not pass, named to each other in `ROS_STATIC_PEERS`.

use std::io::Read;
use std::process::Stdio;

use abbe_msgs::CorrectedCoordinates;
use rustix::process::Signal;
use serde_json::json;

use super::samples_of_each_stream;
use crate::common::files::{Bench, samples};
use crate::common::graph::{DDS, LaunchText, NAMESPACE, endless_stream_of, long_recording, stream_of, topic};
use crate::common::hosts::{Host, hosts};
use crate::common::network::{in_own_network, is_in_own_network};
use crate::common::program::{Started, abbe_in, signal};
use crate::common::python::{ros2, said};

#[test]
fn val_rclpy_hosts_that_multicast_does_not_reach_meet_where_one_of_them_names_the_other() {
    let test = "ros2::hosts::val_rclpy_hosts_that_multicast_does_not_reach_meet_where_one_of_them_names_the_other";
    in_own_network(test, |domain| {
        let Some(user) = ros2(domain, &["streams", NAMESPACE, "200"]) else { return };
        if !is_in_own_network() {
            return println!("SKIPPED: no network namespaces, so there are no other hosts");
        }
        let [machine, named, naming, stranger] = &hosts(4)[..] else { unreachable!() };
        let bench = Bench::identified(5);
        let launch = endless_stream_of(&bench, |launch| launch.edge("scale", "*", DDS).edge("residual", "*", DDS));
        let launch = abbe_in(domain, ["launch", &launch]);
        let peers = format!("{};no-such-host.invalid", named.address());
        let graph = Started::start(machine.runs_with_peers(&launch, &peers));

        // Whom nobody names, and who names nobody, looks as long as the others need.
        let looking = ros2(domain, &["strangers"]).unwrap();
        let mut looking = stranger.runs_with_peers(&looking, "");
        let mut looking = looking.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let first = std::thread::scope(|scope| {
            let first = scope.spawn(|| said(named.runs_with_peers(&user, "")));
            samples_of_each_stream(&said(naming.runs_with_peers(&user, &machine.address())), 200);
            first.join().unwrap()
        });
        samples_of_each_stream(&first, 200);
        drop(looking.stdin.take());
        let mut seen = String::new();
        looking.stdout.take().unwrap().read_to_string(&mut seen).unwrap();
        assert!(looking.wait().unwrap().success());
        assert_eq!(serde_json::from_str::<serde_json::Value>(&seen).unwrap()["nodes"], json!(["/a_users_program"]));

        signal(graph.id(), Signal::INT);
        // A name that nobody knows held up nobody. What is said of it comes when the resolver gives up, which may be later.
        graph.finish().ok();
    });
}

#[test]
fn graphs_on_two_hosts_whose_networks_know_no_multicast_hear_each_other_from_the_first_sample() {
    let test =
        "ros2::hosts::graphs_on_two_hosts_whose_networks_know_no_multicast_hear_each_other_from_the_first_sample";
    in_own_network(test, |domain| {
        if !is_in_own_network() {
            return println!("SKIPPED: no network namespaces, so there are no other hosts");
        }
        let [machine, elsewhere] = &hosts(2)[..] else { unreachable!() };
        [machine, elsewhere].into_iter().for_each(Host::knows_no_multicast);
        let bench = Bench::identified(5);
        long_recording(&bench, 500);
        let here = stream_of(&bench, |launch| launch.edge("residual", "recorder", DDS));
        let there = LaunchText::default().nodes(&["recorder"]).edge("residual", "recorder", DDS).record("recorded");
        let there = bench.write("elsewhere.toml", there.text());
        let [here, there] = [here, there].map(|file| abbe_in(domain, ["launch", &file]));
        let recording = Started::start(elsewhere.runs_with_peers(&there, ""));
        // It waits for who takes its samples, sends them, and ends.
        Started::start(machine.runs_with_peers(&here, &elsewhere.address())).finish().ok();
        signal(recording.id(), Signal::INT);
        recording.finish().ok();
        let taken: Vec<CorrectedCoordinates> = samples(&bench.path("recorded"), &topic("corrected"));
        let sequences: Vec<u64> = taken.iter().map(|sample| sample.sequence).collect();
        assert_eq!(sequences, (0..500).collect::<Vec<u64>>());
    });
}
