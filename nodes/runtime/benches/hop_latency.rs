//! Latency of one hop between two processes, over shared memory and over DDS in the same run.
//!
//! `cargo bench -p abbe-runtime` prints p50, p99, p99.9 and their ratio. Both streams run at 1 kHz
//! at the same time, half a period apart, so that the machine treats both alike. A latency is the
//! time from before `send` in one process to after the sample was taken, woken by it, in the other.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A benchmark fails by panicking.

#[path = "../tests/common/mod.rs"]
mod common;

use std::env;
use std::num::NonZeroUsize;
use std::process::{Child, Command};
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use abbe_msgs::{Message, ScaleReading, Stamp};
use abbe_runtime::ros::{DiscoveryRange, Domain, NodeIdentity, NodeOptions, ParameterTable, RosNode, StaticPeers};
use abbe_runtime::transport::shared_memory::cleanup;
use abbe_runtime::{Edges, EdgesConfig, RunId, Subscribe, TransportKind};
use common::network::{is_in_own_network, this_program_in_own_network};

const TOPIC: &str = "/scale/reading";
const PERIOD: Duration = Duration::from_millis(1);
const WARM_UP: u64 = 1000;
const SAMPLES: u64 = 20_000;
const KINDS: [TransportKind; 2] = [TransportKind::SharedMemory, TransportKind::Dds];

const PARTS: [f64; 4] = [0.5, 0.99, 0.999, 1.0];
const RECEIVE: &str = "receive";

fn main() {
    let arguments: Vec<String> = env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        [RECEIVE, run] => receive(&run.parse().unwrap()),
        [..] if !arguments.iter().any(|argument| argument == "--bench") => {
            println!("a benchmark; run it with cargo bench -p abbe-runtime");
        }
        _ if is_in_own_network() => send(),
        _ => match this_program_in_own_network(&["--bench"]) {
            Some(mut again) => assert!(again.status().unwrap().success()),
            None => send(),
        },
    }
}

fn edges(name: &str, run: &RunId) -> Edges {
    let identity = NodeIdentity::new("/", name).unwrap();
    let node = RosNode::start(NodeOptions {
        identity: identity.clone(),
        domain: Domain::new(100, DiscoveryRange::Localhost).unwrap(),
        remaps: Vec::new(),
        parameters: ParameterTable::default(),
        enclave: None,
        peers: StaticPeers::default(),
    });
    let mut config = EdgesConfig::new(identity);
    config.run = Some(run.clone());
    config.ros = Some(node.unwrap());
    config.depth = NonZeroUsize::new(4096).unwrap();
    Edges::open(config).unwrap()
}

fn now_nanos() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    i64::try_from(since.as_nanos()).unwrap()
}

/// The sending process: starts the receiver, sends both streams, cleans up.
fn send() {
    let run = RunId::unique();
    let mut receiver = start_receiver(&run);
    let edges = edges("sender", &run);
    let mut publishers = KINDS.map(|kind| edges.publisher(TOPIC, &[kind]).unwrap());
    while publishers.iter().any(|publisher| publisher.subscribers() == 0) {
        thread::sleep(Duration::from_millis(10));
    }
    thread::sleep(Duration::from_millis(500)); // until the receiver knows of us, too
    let mut costs_us = KINDS.map(|_| Vec::new());
    let start = Instant::now();
    for number in 0..WARM_UP + SAMPLES {
        for ((publisher, costs_us), half) in publishers.iter_mut().zip(&mut costs_us).zip(0..) {
            let due = PERIOD * u32::try_from(number).unwrap() + PERIOD / 2 * half;
            thread::sleep((start + due).saturating_duration_since(Instant::now()));
            let sample = sample(number);
            let sending = Instant::now();
            publisher.send(&sample).unwrap();
            costs_us.push(sending.elapsed().as_secs_f64() * 1e6);
        }
    }
    assert!(receiver.wait().unwrap().success());
    for (kind, mut costs_us) in KINDS.into_iter().zip(costs_us) {
        costs_us.sort_by(f64::total_cmp);
        let columns = PARTS.map(|part| format!("{:8.1}", quantile(&costs_us, part)));
        println!("{:13} {} µs for the caller of send", kind.name(), columns.join(" "));
    }
    drop((publishers, edges));
    cleanup(&run).unwrap();
}

fn start_receiver(run: &RunId) -> Child {
    let mut command = Command::new(env::current_exe().unwrap());
    command.args([RECEIVE, run.as_str()]).spawn().unwrap()
}

fn sample(sequence: u64) -> ScaleReading {
    let mut sample = common::samples::sample(sequence);
    sample.stamp = Stamp::from_nanos(now_nanos()).unwrap();
    sample
}

/// Latencies of one transport in microseconds, sorted, and what was lost.
struct Received {
    kind: TransportKind,
    latencies_us: Vec<f64>,
    lost: u64,
}

impl Received {
    fn quantile_us(&self, part: f64) -> f64 {
        quantile(&self.latencies_us, part)
    }
}

fn quantile(sorted: &[f64], part: f64) -> f64 {
    sorted[(part * (sorted.len() - 1) as f64).round() as usize]
}

/// The receiving process: one thread a transport, then the table.
fn receive(run: &RunId) {
    let edges = edges("receiver", run);
    let threads = KINDS.map(|kind| {
        let subscriber = edges.subscriber(TOPIC, kind).unwrap();
        thread::spawn(move || take_all(kind, subscriber))
    });
    report(&threads.map(|thread| thread.join().unwrap()));
}

fn take_all(kind: TransportKind, mut subscriber: Box<dyn Subscribe<ScaleReading>>) -> Received {
    let mut latencies_us = Vec::new();
    let mut patience = Duration::from_secs(60);
    while let Some(sample) = subscriber.take_within(patience).unwrap() {
        let latency_ns = now_nanos() - sample.stamp().to_nanos();
        patience = Duration::from_secs(2);
        if sample.sequence >= WARM_UP {
            latencies_us.push(latency_ns as f64 / 1000.0);
        }
        if sample.sequence == WARM_UP + SAMPLES - 1 {
            break;
        }
    }
    latencies_us.sort_by(f64::total_cmp);
    Received { kind, latencies_us, lost: subscriber.lost() }
}

fn report(received: &[Received; 2]) {
    println!("one hop between two processes, 1 kHz, {} bytes a sample", size_of::<ScaleReading>());
    println!("latency in µs     p50      p99    p99.9      max   samples  lost");
    for one in received {
        let columns = PARTS.map(|part| format!("{:8.1}", one.quantile_us(part))).join(" ");
        println!("{:13} {columns} {:9} {:5}", one.kind.name(), one.latencies_us.len(), one.lost);
    }
    let [memory, dds] = received;
    let ratios = PARTS.map(|part| format!("{:8.2}", dds.quantile_us(part) / memory.quantile_us(part)));
    println!("{:13} {}", "dds / memory", ratios.join(" "));
}
