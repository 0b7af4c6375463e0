//! The live part of the demo: nodes as processes, the recording played through them, the corrected topic taken.
//!
//! Place in the flow: the demo is a user of the graph; it takes what the residual node publishes over shared memory,
//! as any program on this host would.

use super::recording::Bag;
use abbe_files::write_atomically;
use abbe_graph::driver::DriverConfig;
use abbe_graph::launch::{Edge, Launch, MonitorConfig, NodeName, Pace, RecordConfig, Source};
use abbe_graph::node::{NodeSummary, STARTED, monotonic_s, user_identity};
use abbe_graph::supervisor::Supervisor;
use abbe_graph::topics;
use abbe_msgs::CorrectedCoordinates;
use abbe_runtime::{Edges, EdgesConfig, RunId, Shutdown, Subscribe, TransportKind};
use anyhow::{Context, bail, ensure};
use indicatif::ProgressBar;
use std::path::Path;
use std::time::{Duration, Instant};

/// Longest time without a new sample before the graph counts as stuck.
const SILENCE: Duration = Duration::from_secs(15);
/// Time for the monitor and the recorder to take the last samples.
const SETTLE: Duration = Duration::from_millis(300);

/// What to run.
pub(super) struct Run<'a> {
    pub(super) out: &'a Path,
    pub(super) machine_file: &'a Path,
    pub(super) bag: &'a Bag,
    pub(super) rate_hz: f64,
    pub(super) dds: bool,
}

/// What came out.
pub(super) struct Live {
    pub(super) corrected: Vec<CorrectedCoordinates>,
    /// From the instant each sample was due at the scale node to its corrected sample here, sorted (µs).
    pub(super) latencies_us: Vec<f64>,
    pub(super) lost: u64,
    pub(super) summaries: Vec<NodeSummary>,
}

/// Runs the graph until every sample is back, and stops it.
pub(super) fn run(run: &Run, shutdown: &Shutdown, bar: &ProgressBar) -> anyhow::Result<Live> {
    let launch = launch(run);
    let launch_file = run.out.join("launch.toml");
    write_atomically(&launch_file, launch.to_text()?.as_bytes())?;
    let recorded = run.out.join("corrected");
    if recorded.exists() {
        std::fs::remove_dir_all(&recorded)
            .with_context(|| format!("{}: the old recording cannot be replaced", recorded.display()))?;
    }
    let program = std::env::current_exe().context("the path of this program is unknown")?;
    let mut supervisor = Supervisor::start(&program, &launch_file, RunId::unique())?;
    let mut config = EdgesConfig::new(user_identity(&launch.namespace, "demo")?);
    config.run = Some(supervisor.run().clone());
    let edges = Edges::open(config)?;
    let mut subscriber = edges.subscriber::<CorrectedCoordinates>(topics::CORRECTED, TransportKind::SharedMemory)?;
    let received = collect(run, &mut supervisor, subscriber.as_mut(), shutdown, bar)?;
    let lost = subscriber.lost();
    drop(subscriber);
    drop(edges);
    ensure!(!shutdown.requested(), "stopped on request");
    shutdown.sleep(SETTLE);
    let stopped = supervisor.stop(shutdown)?;
    ensure!(stopped.problems.is_empty(), "the graph did not run well: {}", stopped.problems.join("; "));
    let summaries = stopped.summaries;
    let latencies_us = latencies_us(&received, &summaries, run.rate_hz);
    Ok(Live { corrected: received.into_iter().map(|(sample, _)| sample).collect(), latencies_us, lost, summaries })
}

/// Latencies of all samples, sorted; empty where the scale node did not say when it began.
fn latencies_us(received: &[Received], summaries: &[NodeSummary], rate_hz: f64) -> Vec<f64> {
    let scale = summaries.iter().find(|summary| summary.node == NodeName::Scale.name());
    let Some(started_s) = scale.and_then(|summary| summary.figures.get(STARTED)) else { return Vec::new() };
    let latency = |(sample, at_s): &Received| (at_s - started_s - sample.sequence as f64 / rate_hz) * 1e6;
    let mut latencies: Vec<f64> = received.iter().map(latency).collect();
    latencies.sort_by(f64::total_cmp);
    latencies
}

/// A sample and when it came, in seconds of the host's monotonic clock.
type Received = (CorrectedCoordinates, f64);

fn collect(
    run: &Run,
    supervisor: &mut Supervisor,
    subscriber: &mut dyn Subscribe<CorrectedCoordinates>,
    shutdown: &Shutdown,
    bar: &ProgressBar,
) -> anyhow::Result<Vec<Received>> {
    let mut corrected = Vec::with_capacity(run.bag.scale_readings);
    let mut heard = Instant::now();
    while corrected.len() < run.bag.scale_readings && !shutdown.requested() {
        if let Some(sample) = subscriber.take_within(Duration::from_millis(50))? {
            corrected.push((sample, monotonic_s()));
            heard = Instant::now();
            if corrected.len() % 50 == 0 {
                bar.set_message(format!("{} of {} samples", corrected.len(), run.bag.scale_readings));
            }
            continue;
        }
        supervisor.check()?;
        if heard.elapsed() > SILENCE {
            bail!("the corrected topic has been silent for {} s after {} samples", SILENCE.as_secs(), corrected.len());
        }
    }
    Ok(corrected)
}

/// The graph: shared memory between the nodes; DDS for everyone else where it is wanted.
fn launch(run: &Run) -> Launch {
    let play = |topic: &str| Source {
        driver: DriverConfig::Bag { file: run.bag.path.clone(), topic: format!("/{}/{topic}", run.bag.namespace) },
        pace: Pace::RateHz(run.rate_hz),
    };
    let memory =
        |from, to: &str| Edge { from, to: to.to_owned(), transport: TransportKind::SharedMemory.name().to_owned() };
    let mut edges = vec![
        memory(NodeName::Scale, "geometric"),
        memory(NodeName::Geometric, "residual"),
        memory(NodeName::Residual, "monitor"),
        memory(NodeName::Residual, "user"),
        memory(NodeName::Tracer, "monitor"),
    ];
    let recorded = [NodeName::Scale, NodeName::Tracer, NodeName::Geometric, NodeName::Residual, NodeName::Monitor];
    edges.extend(recorded.map(|node| memory(node, "recorder")));
    if run.dds {
        let everyone = |from| Edge { from, to: "*".to_owned(), transport: TransportKind::Dds.name().to_owned() };
        edges.extend([NodeName::Scale, NodeName::Residual, NodeName::Monitor].map(everyone));
    }
    Launch {
        namespace: run.bag.namespace.clone(),
        machine: run.machine_file.to_owned(),
        model: Some(run.out.join("model.json")),
        residual_model: None,
        nodes: NodeName::ALL.to_vec(),
        max_covariate_age_s: 10.0,
        wait_for_subscribers_s: 20.0,
        gateway_memory_mib: None,
        scale: Some(play(topics::SCALE_READING)),
        tracer: Some(play(topics::TRACER_READING)),
        monitor: Some(MonitorConfig::new(4.0, 200, 0.0005)),
        record: Some(RecordConfig::new(run.out.join("corrected"))),
        edges,
    }
}
