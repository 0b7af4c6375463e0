//! End to end: scale sample to corrected sample at 1 kHz, over shared memory against the same graph over DDS.
//!
//! Place in the flow: `cargo bench -p abbe --bench end_to_end [-- SECONDS]`. The benchmark is both ends: it publishes
//! scale readings, the geometric and the residual node run as processes in between, and it takes the corrected
//! samples; so one clock times both. Prints p50, p99, p99.9 in µs for each transport, and their ratios.

#![allow(clippy::expect_used)] // a benchmark that cannot run should say so and end

use abbe_files::write_atomically;
use abbe_graph::launch::{Edge, Launch, NodeName, Stamps};
use abbe_graph::node::user_identity;
use abbe_graph::supervisor::Supervisor;
use abbe_graph::topics;
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, ScaleReading, Stamp, Text};
use abbe_runtime::ros::{NodeOptions, RosArgs, RosNode};
use abbe_runtime::{Edges, EdgesConfig, Publish, RunId, Shutdown, Subscribe, TransportKind};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

const PROGRAM: &str = env!("CARGO_BIN_EXE_abbe");
const RATE_HZ: f64 = 1000.0;
/// Samples at the start that are not counted: caches, discovery, first allocations.
const WARM_UP: usize = 1000;
const LOOPBACK: &str = "ROS_AUTOMATIC_DISCOVERY_RANGE";

fn main() {
    if std::env::var_os(LOOPBACK).is_none() {
        // The environment of the nodes is this process's; it is set for a fresh copy of the benchmark.
        let myself = std::env::current_exe().expect("path of the benchmark");
        let status = Command::new(myself)
            .args(std::env::args_os().skip(1))
            .env(LOOPBACK, "LOCALHOST")
            .env("ROS_DOMAIN_ID", "97")
            .status()
            .expect("benchmark starts again");
        std::process::exit(status.code().unwrap_or(1));
    }
    let seconds: f64 = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(10.0);
    let folder = tempfile::tempdir().expect("temporary folder");
    prepare(folder.path());
    println!("{:>14} {:>9} {:>9} {:>9} {:>9} {:>7}", "transport", "p50_us", "p99_us", "p99.9_us", "max_us", "lost");
    let memory = measure(folder.path(), TransportKind::SharedMemory, seconds);
    let dds = measure(folder.path(), TransportKind::Dds, seconds);
    let ratio = |share: f64| quantile(&dds, share) / quantile(&memory, share);
    println!("{:>14} {:>9.2} {:>9.2} {:>9.2}", "dds / memory", ratio(0.5), ratio(0.99), ratio(0.999));
}

/// A machine, a simulated campaign and its model.
fn prepare(folder: &Path) {
    let machine = include_bytes!("../../../launch-config/machines/bridge_xyz.toml");
    write_atomically(&folder.join("machine.toml"), machine).expect("machine file");
    let run = |arguments: &[&str]| {
        let status =
            Command::new(PROGRAM).args(arguments).current_dir(folder).stdout(std::process::Stdio::null()).status();
        assert!(status.expect("abbe runs").success(), "abbe {arguments:?}");
    };
    run(&["simulate", "--machine", "machine.toml", "--seed", "1", "--out", "."]);
    run(&["identify", "--machine", "machine.toml", "--campaign", "campaign.csv", "--out", "model.json"]);
}

fn launch(kind: TransportKind) -> Launch {
    let edge = |from, to: &str| Edge { from, to: to.to_owned(), transport: kind.name().to_owned() };
    Launch {
        autostart: true,
        namespace: "bench".to_owned(),
        machine: "machine.toml".into(),
        model: Some("model.json".into()),
        residual_model: None,
        nodes: vec![NodeName::Geometric, NodeName::Residual],
        max_covariate_age_s: 10.0,
        wait_for_subscribers_s: 20.0,
        realtime: None,
        gateway_memory_mib: None,
        scale: None,
        tracer: None,
        stamps: Some(Stamps::Recorded),
        publish_clock: false,
        visible_in_ros: false,
        commands_from_ros: true,
        covariates: Vec::new(),
        motion: None,
        lagged: Vec::new(),
        monitor: None,
        record: None,
        edges: vec![
            edge(NodeName::Scale, "geometric"),
            edge(NodeName::Geometric, "residual"),
            edge(NodeName::Residual, "user"),
        ],
    }
}

/// Sorted latencies (µs) of one run.
fn measure(folder: &Path, kind: TransportKind, seconds: f64) -> Vec<f64> {
    let file = folder.join(format!("{kind}.toml"));
    write_atomically(&file, launch(kind).to_text().expect("launch text").as_bytes()).expect("launch file");
    let supervisor = Supervisor::start(Path::new(PROGRAM), &file, RunId::unique()).expect("nodes start");
    let mut config = EdgesConfig::new(user_identity("bench", "ends").expect("name"));
    match kind {
        TransportKind::Dds => {
            let options = NodeOptions::new("bench", "ends", RosArgs::default(), []).expect("options");
            config.ros = Some(RosNode::start(options).expect("ROS node"));
        }
        _ => config.run = Some(supervisor.run().clone()),
    }
    let edges = Edges::open(config).expect("edges");
    let mut subscriber = edges.subscriber::<CorrectedCoordinates>(topics::CORRECTED, kind).expect("subscriber");
    let mut publisher = edges.publisher::<ScaleReading>(topics::SCALE_READING, &[kind]).expect("publisher");
    let since = Instant::now();
    while publisher.subscribers() < 1 {
        assert!(since.elapsed() < Duration::from_secs(20), "the geometric node did not come");
        std::thread::sleep(Duration::from_millis(5));
    }
    // A DDS reader may need a moment to know of the writer after the writer knows of it.
    std::thread::sleep(Duration::from_millis(500));
    let samples = WARM_UP + (seconds * RATE_HZ) as usize;
    let mut latencies = exchange(publisher.as_mut(), subscriber.as_mut(), samples);
    latencies.sort_by(f64::total_cmp);
    let [p50, p99, p999] = [0.5, 0.99, 0.999].map(|share| quantile(&latencies, share));
    let (most, lost) = (latencies.last().copied().unwrap_or(f64::NAN), samples - WARM_UP - latencies.len());
    println!("{:>14} {p50:>9.1} {p99:>9.1} {p999:>9.1} {most:>9.1} {lost:>7}", kind.name());
    drop((publisher, subscriber, edges));
    let stopped = supervisor.stop(&Shutdown::manual()).expect("nodes stop");
    assert!(stopped.problems.is_empty(), "{:?}", stopped.problems);
    latencies
}

/// Sends at 1 kHz on this thread, takes on another; latencies in µs after the warm-up.
fn exchange(
    publisher: &mut dyn Publish<ScaleReading>,
    subscriber: &mut dyn Subscribe<CorrectedCoordinates>,
    samples: usize,
) -> Vec<f64> {
    let start = Instant::now();
    let (sent, received) = std::thread::scope(|scope| {
        let taking = scope.spawn(move || take_all(subscriber, samples));
        let sent: Vec<Instant> = (0..samples).map(|number| send_one(publisher, number, start)).collect();
        (sent, taking.join().expect("taking thread"))
    });
    let counted = received.iter().filter(|(number, _)| *number >= WARM_UP);
    counted.map(|(number, at)| at.duration_since(sent[*number]).as_secs_f64() * 1e6).collect()
}

fn send_one(publisher: &mut dyn Publish<ScaleReading>, number: usize, start: Instant) -> Instant {
    let due = start + Duration::from_secs_f64(number as f64 / RATE_HZ);
    std::thread::sleep(due.saturating_duration_since(Instant::now()));
    let phase = number as f64 * 0.01;
    let reading = ScaleReading {
        stamp: Stamp::from_seconds(number as f64 / RATE_HZ).expect("stamp"),
        sequence: number as u64,
        reading_m: [0.4 + 0.3 * phase.sin(), 0.3 + 0.2 * phase.cos(), 0.3 + 0.2 * (1.7 * phase).sin()],
        offset_m: [0.0, 0.0, -0.06],
        frame_id: Text::new("bridge_xyz").expect("frame"),
        ..ScaleReading::default()
    };
    let now = Instant::now();
    publisher.send(&reading).expect("send");
    now
}

fn take_all(subscriber: &mut dyn Subscribe<CorrectedCoordinates>, samples: usize) -> Vec<(usize, Instant)> {
    let mut received = Vec::with_capacity(samples);
    let mut heard = Instant::now();
    while received.len() < samples && heard.elapsed() < Duration::from_secs(5) {
        if let Some(sample) = subscriber.take_within(Duration::from_millis(100)).expect("take") {
            heard = Instant::now();
            assert_eq!(sample.status, CorrectionStatus::InVolume);
            received.push((sample.sequence as usize, heard));
        }
    }
    received
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted
        .get(((sorted.len() as f64 * share) as usize).min(sorted.len().saturating_sub(1)))
        .copied()
        .unwrap_or(f64::NAN)
}
