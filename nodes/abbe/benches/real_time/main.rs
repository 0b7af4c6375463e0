//! Scale sample to corrected sample at 1 kHz beside bare iceoryx2, with and without `realtime`; then 10 kHz with counts of losses.
//!
//! Place in the flow: `just real-time [SECONDS] [loaded]`, for 10 s each if left out. Geometric and residual node run as processes
//! between the two ends, and beside them two relays of bare iceoryx2 that only hand on: as many processes, wake-ups and copies, and
//! nothing of Abbe. Both streams run at the same time, half a period apart, and one clock times both. Prints p50, p99, p99.9 in
//! µs, and the ratio. `loaded` keeps every core busy with ordinary work meanwhile.

#![allow(clippy::expect_used)] // a benchmark that cannot run should say so and end

mod bare;

use abbe_files::write_atomically;
use abbe_graph::driver::DriverConfig;
use abbe_graph::launch::{Edge, Launch, NodeName, Pace, RealtimeConfig, RecordConfig, Source, Stamps};
use abbe_graph::node::user_identity;
use abbe_graph::supervisor::Supervisor;
use abbe_graph::topics;
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, ScaleReading, Stamp, Text};
use abbe_runtime::realtime::{Realtime, online_cores, step_in};
use abbe_runtime::{Edges, EdgesConfig, RunId, Shutdown, TransportKind};
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

const PROGRAM: &str = env!("CARGO_BIN_EXE_abbe");
const PERIOD: Duration = Duration::from_millis(1);
const FAST_HZ: f64 = 10_000.0;
/// Samples at the start that are not counted: caches, first allocations.
const WARM_UP: usize = 1000;
const PARTS: [f64; 3] = [0.5, 0.99, 0.999];
/// Silence after which nothing more is expected.
const PATIENCE: Duration = Duration::from_secs(3);

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    if let [word, run, part, realtime] = words.as_slice()
        && word == bare::RELAY
    {
        return bare::relay(run, part.parse().expect("number of the relay"), realtime == "true");
    }
    let seconds: f64 = words.iter().find_map(|word| word.parse().ok()).unwrap_or(10.0);
    let is_loaded = words.iter().any(|word| word == "loaded");
    let folder = tempfile::tempdir().expect("temporary folder");
    prepare(folder.path());
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    println!("{} cores, load before: {}; {seconds} s each", online_cores().len(), load.trim());
    let done = AtomicBool::new(false);
    thread::scope(|scope| {
        if is_loaded {
            println!("every core is kept busy meanwhile");
            for _ in online_cores() {
                scope.spawn(|| {
                    while !done.load(Ordering::Relaxed) {
                        std::hint::spin_loop()
                    }
                });
            }
        }
        measure_all(folder.path(), seconds);
        done.store(true, Ordering::Relaxed);
    });
}

fn measure_all(folder: &Path, seconds: f64) {
    let plain = realtime();
    let refused = plain.try_out().err();
    if let Some(error) = &refused {
        println!("without realtime alone: {error}");
    }
    println!("{:>26} {:>9} {:>9} {:>9} {:>9} {:>7}", "1 kHz, µs", "p50", "p99", "p99.9", "max", "lost");
    delays(folder, false, seconds);
    if refused.is_none() {
        // Of this process as well: its ends are part of both ways.
        plain.begin().expect("real time");
        delays(folder, true, seconds);
    }
    println!("{FAST_HZ} Hz");
    losses(folder, false, seconds);
    if refused.is_none() {
        losses(folder, true, seconds);
    }
}

/// What `realtime = true` is; the ends of the benchmark are not part of a launch.
fn realtime() -> Realtime {
    Realtime { priority: RealtimeConfig::PRIORITY, cores: Vec::new(), threads: 1 }
}

/// A machine, a simulated campaign and its model.
fn prepare(folder: &Path) {
    let machine = include_bytes!("../../../../launch-config/machines/bridge_xyz.toml");
    write_atomically(&folder.join("machine.toml"), machine).expect("machine file");
    let run = |arguments: &[&str]| {
        let status =
            Command::new(PROGRAM).args(arguments).current_dir(folder).stdout(std::process::Stdio::null()).status();
        assert!(status.expect("abbe runs").success(), "abbe {arguments:?}");
    };
    run(&["simulate", "--machine", "machine.toml", "--seed", "1", "--out", "."]);
    run(&["identify", "--machine", "machine.toml", "--campaign", "campaign.csv", "--out", "model.json"]);
}

fn launch(nodes: &[NodeName], edges: &[(NodeName, &str)], in_real_time: bool) -> Launch {
    let edge = |(from, to): &(NodeName, &str)| Edge {
        from: *from,
        to: (*to).to_owned(),
        transport: TransportKind::SharedMemory.name().to_owned(),
    };
    Launch {
        autostart: true,
        namespace: "bench".to_owned(),
        machine: "machine.toml".into(),
        model: Some("model.json".into()),
        residual_model: None,
        nodes: nodes.to_vec(),
        max_covariate_age_s: 10.0,
        wait_for_subscribers_s: 20.0,
        realtime: in_real_time.then_some(RealtimeConfig::PLAIN),
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
        edges: edges.iter().map(edge).collect(),
    }
}

fn start(folder: &Path, launch: &Launch) -> Supervisor {
    let file = folder.join("launch.toml");
    write_atomically(&file, launch.to_text().expect("launch text").as_bytes()).expect("launch file");
    Supervisor::start(Path::new(PROGRAM), &file, RunId::unique()).expect("nodes start")
}

/// When each sample was sent, and which came when.
type Way = (Vec<Instant>, Vec<(usize, Instant)>);

/// Both ways at the same time; prints a line for each, and the ratio.
fn delays(folder: &Path, in_real_time: bool, seconds: f64) {
    let edges = [(NodeName::Scale, "geometric"), (NodeName::Geometric, "residual"), (NodeName::Residual, "user")];
    let graph = start(folder, &launch(&[NodeName::Geometric, NodeName::Residual], &edges, in_real_time));
    let relays = bare::Relays::start(graph.run(), in_real_time);
    let samples = WARM_UP + (seconds / PERIOD.as_secs_f64()) as usize;
    let (abbe, rival) = exchange(&graph, &relays, samples);
    relays.end();
    let stopped = graph.stop(&Shutdown::manual()).expect("nodes stop");
    assert!(stopped.problems.is_empty(), "{:?}", stopped.problems);
    let kind = if in_real_time { "realtime" } else { "without" };
    let (abbe, rival) =
        (told(&format!("abbe, {kind}"), abbe, samples), told(&format!("bare iceoryx2, {kind}"), rival, samples));
    let ratio = PARTS.map(|part| format!("{:9.2}", quantile(&abbe, part) / quantile(&rival, part)));
    println!("{:>26} {}", "abbe / bare", ratio.join(" "));
}

fn exchange(graph: &Supervisor, relays: &bare::Relays, samples: usize) -> (Way, Way) {
    let mut config = EdgesConfig::new(user_identity("bench", "ends").expect("name"));
    config.run = Some(graph.run().clone());
    let edges = Edges::open(config).expect("edges");
    let memory = TransportKind::SharedMemory;
    let mut subscriber = edges.subscriber::<CorrectedCoordinates>(topics::CORRECTED, memory).expect("subscriber");
    let mut publisher = edges.publisher::<ScaleReading>(topics::SCALE_READING, &[memory]).expect("publisher");
    let take = move || {
        let _realtime = step_in().expect("real time");
        collect(samples, || {
            let taken = subscriber.take_within(Duration::from_millis(100)).expect("take")?;
            assert_eq!(taken.status, CorrectionStatus::InVolume);
            Some(taken.sequence)
        })
    };
    thread::scope(|scope| {
        let corrected = scope.spawn(take);
        let handed_on = scope.spawn(|| relays.collect(samples));
        let mut bare = relays.first();
        await_taker("the geometric node", || publisher.subscribers() > 0);
        await_taker("the relays", || relays.are_ready(&bare));
        let _realtime = step_in().expect("real time");
        let start = Instant::now() + PERIOD;
        let (mut sent, mut sent_bare) = (Vec::with_capacity(samples), Vec::with_capacity(samples));
        for number in 0..samples {
            let reading = reading(number);
            let due = start + PERIOD * u32::try_from(number).expect("samples of a bench");
            wait_until(due);
            sent.push(Instant::now());
            publisher.send(&reading).expect("send");
            wait_until(due + PERIOD / 2);
            sent_bare.push(Instant::now());
            bare.send(&reading);
        }
        let corrected = corrected.join().expect("taking thread");
        ((sent, corrected), (sent_bare, handed_on.join().expect("taking thread")))
    })
}

fn wait_until(due: Instant) {
    thread::sleep(due.saturating_duration_since(Instant::now()));
}

fn await_taker(whom: &str, mut is_there: impl FnMut() -> bool) {
    let since = Instant::now();
    while !is_there() {
        assert!(since.elapsed() < Duration::from_secs(20), "{whom} did not come");
        thread::sleep(Duration::from_millis(5));
    }
}

/// Sequences as they come, until all have or none comes any more.
fn collect(samples: usize, mut next: impl FnMut() -> Option<u64>) -> Vec<(usize, Instant)> {
    let mut received = Vec::with_capacity(samples);
    // The first may need the nodes to start.
    let mut heard = Instant::now() + Duration::from_secs(20);
    while received.len() < samples && Instant::now().saturating_duration_since(heard) < PATIENCE {
        if let Some(sequence) = next() {
            heard = Instant::now();
            received.push((sequence as usize, heard));
        }
    }
    received
}

fn reading(number: usize) -> ScaleReading {
    let phase = number as f64 * 0.01;
    ScaleReading {
        stamp: Stamp::from_seconds(number as f64 * PERIOD.as_secs_f64()).expect("stamp"),
        sequence: number as u64,
        reading_m: [0.4 + 0.3 * phase.sin(), 0.3 + 0.2 * phase.cos(), 0.3 + 0.2 * (1.7 * phase).sin()],
        offset_m: [0.0, 0.0, -0.06],
        frame_id: Text::new("bridge_xyz").expect("frame"),
        ..ScaleReading::default()
    }
}

/// Prints one way; its delays in µs, sorted, after the warm-up.
fn told(name: &str, (sent, received): Way, samples: usize) -> Vec<f64> {
    let counted = received.iter().filter(|(number, _)| *number >= WARM_UP);
    let mut delays: Vec<f64> =
        counted.map(|(number, at)| at.duration_since(sent[*number]).as_secs_f64() * 1e6).collect();
    delays.sort_by(f64::total_cmp);
    let parts = PARTS.map(|part| format!("{:9.1}", quantile(&delays, part))).join(" ");
    let (most, lost) = (delays.last().copied().unwrap_or(f64::NAN), samples - WARM_UP - delays.len());
    println!("{name:>26} {parts} {most:9.1} {lost:7}");
    delays
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    let place = ((sorted.len() as f64 * share) as usize).min(sorted.len().saturating_sub(1));
    sorted.get(place).copied().unwrap_or(f64::NAN)
}

/// The whole graph with its recorder at 10 kHz; prints what each node lost.
fn losses(folder: &Path, in_real_time: bool, seconds: f64) {
    use NodeName::{Geometric, Recorder, Residual, Scale};
    let edges = [
        (Scale, "geometric"),
        (Geometric, "residual"),
        (Scale, "recorder"),
        (Geometric, "recorder"),
        (Residual, "recorder"),
    ];
    let kind = if in_real_time { "realtime" } else { "without" };
    let file = "campaign.csv".into();
    let scale = Source { driver: DriverConfig::Campaign { file }, pace: Pace::RateHz(FAST_HZ), repeat_from: Some(0) };
    let launch = Launch {
        scale: Some(scale),
        record: Some(RecordConfig::new(format!("fast_{kind}"))),
        ..launch(&[Scale, Geometric, Residual, Recorder], &edges, in_real_time)
    };
    let mut graph = start(folder, &launch);
    await_taker("the graph", || graph.is_healthy() || graph.check().is_err());
    let since = Instant::now();
    while since.elapsed().as_secs_f64() < seconds {
        graph.check().expect("the graph runs");
        thread::sleep(Duration::from_millis(20));
    }
    let stopped = graph.stop(&Shutdown::manual()).expect("nodes stop");
    println!("{kind:>26} {:>9} {:>9} {:>7} {:>7} {:>7}", "received", "sent", "lost", "dropped", "rests");
    for summary in &stopped.summaries {
        let rests = summary.figures.get("realtime_rests").copied().unwrap_or(0.0);
        let (name, lost, dropped) = (&summary.node, summary.lost, summary.dropped);
        println!("{name:>26} {:>9} {:>9} {lost:>7} {dropped:>7} {rests:>7}", summary.received, summary.sent);
    }
    for problem in &stopped.problems {
        println!("{kind:>26}: {problem}");
    }
}
