//! Time as a real ROS 2 has it: simulated time that is slow, stands, leaps and is set back, and who was there first.

use abbe_msgs::{CorrectedCoordinates, ScaleReading};
use abbe_runtime::ros::Domain;
use serde_json::Value;

use super::beside;
use super::round_trip::{launch_file, position};
use crate::common::assert_says;
use crate::common::files::{Bench, samples};
use crate::common::graph::{DDS, LaunchText, MEMORY, NAMESPACE, endless_stream_of, long_recording, stream_of, topic};
use crate::common::network::in_own_network;
use crate::common::program::{Started, abbe_in, signal, wait_until};
use crate::common::python::{ros2_timed, said};
use rustix::process::Signal;
use std::process::Stdio;
use std::time::Duration;

const USE_SIM_TIME: [&str; 3] = ["--ros-args", "-p", "use_sim_time:=true"];
/// Simulated time begins here (s).
const START_S: f64 = 1_000_000.0;
/// How far it leaps (s): more readings than those who take them have room for.
const LEAP_S: f64 = 40.0;
const RATE_HZ: f64 = 200.0;
/// A stamp as f64 is good to this (s), so late after 1970.
const ROUNDING_S: f64 = 1e-6;

/// Samples, one a millisecond, that may be missed while both sides find each other on a loaded machine; where nothing else runs none are.
/// Before nodes waited for the endpoints of those who were there, the first 112 to 620 were lost: what is waited for then comes once a second.
const MAY_MISS: usize = 60;

/// What a program says that is there before a graph.
#[track_caller]
fn there_before(mut program: std::process::Command, bench: &Bench, domain: Domain, file: &str) -> Value {
    let program = program.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    wait_until("the program is there", Duration::from_secs(60), || bench.path("there").exists());
    let graph = Started::start(abbe_in(domain, ["launch", file]));
    let output = program.wait_with_output().unwrap();
    signal(graph.id(), Signal::INT);
    graph.finish().ok();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn regress_a_controller_that_was_there_first_loses_none_of_what_it_sends_as_soon_as_it_sees_a_subscriber() {
    const COUNT: usize = 1000;
    let test = "ros2::timed::regress_a_controller_that_was_there_first_loses_none_of_what_it_sends_as_soon_as_it_sees_a_subscriber";
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        let [x, y, z] = position(&bench);
        let words = ["first", NAMESPACE, &bench.text("there"), &x, &y, &z, &COUNT.to_string()];
        let Some(controller) = ros2_timed(domain, &words) else { return };
        let heard = there_before(controller, &bench, domain, &launch_file(&bench));
        let missing = heard["missing"].as_array().unwrap();
        assert!(missing.len() <= MAY_MISS, "{} of {COUNT} did not come: {missing:?}", missing.len());
    });
}

#[test]
fn regress_a_subscriber_that_was_there_first_hears_a_recording_from_its_beginning() {
    let test = "ros2::timed::regress_a_subscriber_that_was_there_first_hears_a_recording_from_its_beginning";
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        let Some(user) = ros2_timed(domain, &["hears", NAMESPACE, &bench.text("there"), "100"]) else { return };
        let file = endless_stream_of(&bench, |launch| launch.edge("residual", "*", DDS));
        let heard = there_before(user, &bench, domain, &file);
        let stamps_s: Vec<f64> = serde_json::from_value(heard["stamps_s"].clone()).unwrap();
        // The recording begins at 0 and has a reading each millisecond.
        assert!(stamps_s[0] <= MAY_MISS as f64 * 1e-3, "the first that came is of {} s", stamps_s[0]);
    });
}

/// A campaign that is played at simulated time, over and over.
fn played(bench: &Bench) -> String {
    let launch = LaunchText::default().nodes(&["scale", "geometric", "residual", "recorder"]);
    let edges = [("scale", "geometric"), ("geometric", "residual"), ("residual", "recorder")];
    let launch = edges.iter().fold(launch, |launch, (from, to)| launch.edge(from, to, MEMORY));
    let launch = launch.edge("scale", "*", DDS).edge("residual", "*", DDS).record("recorded").key("stamps = \"now\"");
    launch.source("scale", &bench.text("campaign.csv"), None, RATE_HZ).repeated().write(bench)
}

#[test]
fn val_rclpy_readings_and_diagnostics_follow_simulated_time_that_is_slow_stands_leaps_and_is_set_back() {
    let test = "ros2::timed::val_rclpy_readings_and_diagnostics_follow_simulated_time_that_is_slow_stands_leaps_and_is_set_back";
    in_own_network(test, |domain| {
        let words = ["sim_time", NAMESPACE, &START_S.to_string(), &LEAP_S.to_string()];
        let Some(user) = ros2_timed(domain, &words) else { return };
        let bench = Bench::identified(5);
        let file = played(&bench);
        let graph = Started::start(abbe_in(domain, ["launch", &file].into_iter().chain(USE_SIM_TIME)));
        let heard = said(user);
        signal(graph.id(), Signal::INT);
        let ran = graph.finish();
        assert_says(&ran.errors, &["/clock went back by"]);
        ran.ok();
        let points: Vec<(String, f64, f64)> = serde_json::from_value(heard["points"].clone()).unwrap();
        let of = |part: &str| points.iter().filter(|point| point.0 == part).collect::<Vec<_>>();
        for (part, stamp_s, now_s) in &points {
            // What was on its way when time was set back is of before.
            let was_before = part == "going back";
            let is_of_the_past = was_before || *stamp_s <= now_s + ROUNDING_S;
            assert!(*stamp_s >= START_S && is_of_the_past, "{part}: {stamp_s} came at {now_s}");
        }
        // By the host's time it would be four times as many.
        let slow_s = heard["slow_s"].as_f64().unwrap();
        let count = of("slow").len() as f64;
        assert!((0.5..1.2).contains(&(count / (slow_s * RATE_HZ))), "{count} in {slow_s} s of simulated time");
        assert_eq!(of("stands").len(), 0, "time stands still");
        assert_eq!(of("set back").len(), 0, "the source waits until time is where it was");
        let leapt_to_s = heard["leapt_to_s"].as_f64().unwrap();

        let reports: Vec<(String, String, u8, String, f64)> = serde_json::from_value(heard["reports"].clone()).unwrap();
        let frequency = format!("{NAMESPACE}/scale: Frequency Status");
        let told = |part: &str| {
            let of_scale = reports.iter().filter(|one| one.0 == part && one.1 == frequency);
            of_scale.map(|one| one.3.as_str()).collect::<Vec<_>>()
        };
        assert!(told("slow").contains(&"Desired frequency met"), "{:?}", told("slow"));
        assert!(told("stands").contains(&"No events recorded."), "{:?}", told("stands"));
        let is_simulated = |stamp_s: f64| (START_S..leapt_to_s + 1.0).contains(&stamp_s);
        // Before anything comes on /clock there is no time.
        let timed: Vec<_> = reports.iter().filter(|one| one.0 != "starting").collect();
        assert!(timed.iter().all(|one| is_simulated(one.4) || one.4 == 0.0) && timed.iter().any(|one| one.4 > 0.0));

        let recorded: Vec<CorrectedCoordinates> = samples(&bench.path("recorded"), &topic("corrected"));
        assert!(recorded.len() as f64 > LEAP_S * RATE_HZ);
        let is_whole = recorded.windows(2).all(|pair| pair[1].sequence == pair[0].sequence + 1);
        assert!(is_whole, "none of what was leapt over is lost");
        let spacing = |pair: &[CorrectedCoordinates]| pair[1].stamp.to_nanos() - pair[0].stamp.to_nanos();
        assert!(recorded.windows(2).all(|pair| spacing(pair) == 5_000_000), "stamps go by the pace alone");
    });
}

#[test]
fn val_rclpy_what_carries_no_stamp_arrives_by_simulated_time_or_is_refused() {
    let test = "ros2::timed::val_rclpy_what_carries_no_stamp_arrives_by_simulated_time_or_is_refused";
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        let [x, y, z] = position(&bench);
        let words = ["arrivals", NAMESPACE, &START_S.to_string(), &x, &y, &z];
        let Some(user) = ros2_timed(domain, &words) else { return };
        launch_file(&bench);
        let text = bench.read("launch.toml").replace("nodes = [", "record = \"recorded\"\nnodes = [\"recorder\", ");
        let sensor = "kind = \"ros\"\ntopic = \"/air\"\nmessage = \"float64\"\ncovariate = \"temp_air_c\"\nstamp = \"arrival\"\n";
        let edge = "[[edges]]\nfrom = \"scale\"\nto = \"recorder\"\ntransport = \"shared-memory\"\n";
        let file = bench.write("launch.toml", format!("{text}{edge}[[covariates]]\n{sensor}"));
        let graph = Started::start(abbe_in(domain, ["launch", &file].into_iter().chain(USE_SIM_TIME)));
        said(user);
        signal(graph.id(), Signal::INT);
        let ran = graph.finish();
        assert_says(&ran.errors, &["no time has come on /clock", "start what publishes"]);
        ran.ok();
        let readings: Vec<ScaleReading> = samples(&bench.path("recorded"), &topic("scale/reading"));
        let ages_s: Vec<Option<f64>> =
            readings.iter().map(|reading| Some(reading.covariates.get("temp_air_c")?.age_s)).collect();
        assert!(ages_s.contains(&None) && ages_s.contains(&Some(0.5)), "{ages_s:?}");
        assert!(ages_s.iter().all(|age_s| age_s.is_none_or(|age_s| age_s == 0.5)), "{ages_s:?}");
    });
}

#[test]
fn a_graph_whose_positions_would_arrive_by_simulated_time_is_refused() {
    let test = "ros2::timed::a_graph_whose_positions_would_arrive_by_simulated_time_is_refused";
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        launch_file(&bench);
        let text = bench
            .read("launch.toml")
            .replace("message = \"joint_state\"", "message = \"joint_state\", stamp = \"arrival\"");
        let file = bench.write("launch.toml", text);
        let graph = Started::start(abbe_in(domain, ["launch", &file].into_iter().chain(USE_SIM_TIME)));
        assert_says(
            &graph.finish().refused(),
            &["driver.stamp", "/clock stands between its ticks", "leave out use_sim_time"],
        );
    });
}

#[test]
fn val_rclpy_a_node_with_use_sim_time_goes_by_the_clock_of_a_recording() {
    let test = "ros2::timed::val_rclpy_a_node_with_use_sim_time_goes_by_the_clock_of_a_recording";
    in_own_network(test, |domain| {
        let Some(user) = ros2_timed(domain, &["follows", NAMESPACE, "500"]) else { return };
        let bench = Bench::identified(5);
        long_recording(&bench, 60_000);
        let file = stream_of(&bench, |launch| {
            launch.edge("scale", "*", DDS).edge("residual", "*", DDS).key("publish_clock = true")
        });
        let heard = beside(Started::start(abbe_in(domain, ["launch", &file])), user);
        assert_eq!(heard["is_active"], true);
        // The recording begins at 0 and has a reading each millisecond.
        let recorded_s = 0.0..60.0;
        let pairs: Vec<(f64, f64)> = serde_json::from_value(heard["heard_s"].clone()).unwrap();
        let ticks: Vec<f64> = serde_json::from_value(heard["ticks_s"].clone()).unwrap();
        assert!(pairs.iter().any(|(_, now_s)| *now_s > 0.0));
        assert!(pairs.iter().all(|(stamp_s, now_s)| recorded_s.contains(stamp_s) && recorded_s.contains(now_s)));
        assert!(ticks.is_sorted() && ticks.iter().all(|second| recorded_s.contains(second)), "{ticks:?}");
    });
}
