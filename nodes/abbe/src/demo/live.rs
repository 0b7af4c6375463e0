//! The live part of the demo: nodes as processes, the recording played through them, the corrected topic taken.
//!
//! Place in the flow: the demo is a user of the graph; it takes what the residual node publishes over shared memory,
//! as any program on this host would. Where the loop is closed, the scale node goes on with the verification points, again and
//! again, until the model that a diagnosis found has corrected them; the tracer's readings come once.

use super::closing::{Loop, Watch};
use super::recording::Bag;
use super::taken::Taken;
use super::{Steps, finish, step};
use abbe_files::write_atomically;
use abbe_graph::driver::DriverConfig;
use abbe_graph::launch::{Edge, Launch, MonitorConfig, NodeName, Pace, RecordConfig, Source, Stamps};
use abbe_graph::node::{NodeSummary, user_identity};
use abbe_graph::supervisor::{Given, Supervisor};
use abbe_graph::topics;
use abbe_msgs::{CorrectedCoordinates, RangeResidual};
use abbe_runtime::{Edges, EdgesConfig, RunId, Shutdown, Subscribe, TransportKind};
use anyhow::{Context, bail, ensure};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Longest time without a new sample before the graph counts as stuck.
const SILENCE: Duration = Duration::from_secs(15);
/// Time for the monitor and the recorder to take the last samples.
const SETTLE: Duration = Duration::from_millis(300);
/// How often is looked how far the loop is.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// What the nodes say, in the output folder.
pub(super) const NODES_LOG: &str = "nodes.log";
/// Folder of the monitor's diagnoses in the output folder.
pub(super) const DIAGNOSES: &str = "diagnoses";

/// What to run.
pub(super) struct Run<'a> {
    pub(super) out: &'a Path,
    pub(super) machine_file: &'a Path,
    /// The model that the nodes use; a diagnosis puts another in its place.
    pub(super) model_file: &'a Path,
    pub(super) bag: &'a Bag,
    pub(super) rate_hz: f64,
    pub(super) dds: bool,
    /// Whether the loop is closed.
    pub(super) closes: bool,
}

/// What came out.
pub(super) struct Live {
    /// The verification points as the first model corrected them.
    pub(super) points: Vec<CorrectedCoordinates>,
    /// Samples that came back.
    pub(super) received: u64,
    /// Samples sent until the last of them.
    pub(super) sent: u64,
    /// From the instant each sample was due at the scale node to its corrected sample here, sorted (µs).
    pub(super) latencies_us: Vec<f64>,
    pub(super) lost: u64,
    pub(super) summaries: Vec<NodeSummary>,
    /// How the loop went; `None` where it was left out.
    pub(super) closing: Option<Loop>,
}

/// Runs the graph until every sample is back, and the loop is closed where that is wanted; stops it.
pub(super) fn run(run: &Run, shutdown: &Shutdown, steps: &mut Steps) -> anyhow::Result<Live> {
    let launch = launch(run);
    let launch_file = run.out.join("launch.toml");
    write_atomically(&launch_file, launch.to_text()?.as_bytes())?;
    for old in [run.out.join("corrected"), run.out.join(DIAGNOSES)].iter().filter(|path| path.exists()) {
        std::fs::remove_dir_all(old)
            .with_context(|| format!("{}: what an earlier run left cannot be replaced", old.display()))?;
    }
    let program = std::env::current_exe().context("the path of this program is unknown")?;
    // Between the steps of the demo their lines tell a reader nothing that a step does not; errors stay among them.
    let given = Given { log: Some(run.out.join(NODES_LOG)), ..Given::default() };
    let mut supervisor = Supervisor::start_with(&program, &launch_file, RunId::unique(), given)?;
    let mut config = EdgesConfig::new(user_identity(&launch.namespace, "demo")?);
    config.run = Some(supervisor.run().clone());
    let edges = Edges::open(config)?;
    let mut subscriber = edges.subscriber::<CorrectedCoordinates>(topics::CORRECTED, TransportKind::SharedMemory)?;
    let mut residuals = match run.closes {
        true => Some(edges.subscriber::<RangeResidual>(topics::RANGE_RESIDUAL, TransportKind::SharedMemory)?),
        false => None,
    };
    let mut taken = Taken::of(run.bag);
    let mut inputs = Inputs { corrected: subscriber.as_mut(), residuals: residuals.as_deref_mut() };
    let closing = collect(run, &mut supervisor, &mut inputs, shutdown, &mut taken, steps)?;
    let lost = subscriber.lost();
    drop((subscriber, residuals));
    drop(edges);
    ensure!(!shutdown.requested(), "stopped on request");
    shutdown.sleep(SETTLE);
    let stopped = supervisor.stop(shutdown)?;
    ensure!(stopped.problems.is_empty(), "the graph did not run well: {}", stopped.problems.join("; "));
    let summaries = stopped.summaries;
    let latencies_us = taken.latencies_us(&summaries, run.rate_hz);
    let Taken { first_points: points, count: received, next: sent, .. } = taken;
    Ok(Live { points, received, sent, latencies_us, lost, summaries, closing })
}

/// What is taken of the graph.
struct Inputs<'a> {
    corrected: &'a mut dyn Subscribe<CorrectedCoordinates>,
    /// Only where the loop is closed.
    residuals: Option<&'a mut (dyn Subscribe<RangeResidual> + 'static)>,
}

/// Takes samples until all of the recording are back and the loop is closed.
fn collect(
    run: &Run,
    supervisor: &mut Supervisor,
    inputs: &mut Inputs,
    shutdown: &Shutdown,
    taken: &mut Taken,
    steps: &mut Steps,
) -> anyhow::Result<Option<Loop>> {
    let (begun, bar) = (Instant::now(), step("live"));
    let mut watch = run.closes.then(|| Watch::new(&run.out.join(DIAGNOSES), monitor_of(supervisor), bar.clone()));
    let (mut heard, mut looked) = (Instant::now(), Instant::now());
    while !shutdown.requested() {
        match inputs.corrected.take_within(Duration::from_millis(50))? {
            Some(sample) => {
                taken.take(sample);
                heard = Instant::now();
            }
            None if heard.elapsed() > SILENCE => {
                bail!("the corrected topic has been silent for {} s after {} samples", SILENCE.as_secs(), taken.count);
            }
            None => {}
        }
        let all_are_back = watch.is_none() && taken.is_played();
        if !all_are_back && looked.elapsed() < LOOK_EVERY {
            continue;
        }
        looked = Instant::now();
        while let Some(residuals) = &mut inputs.residuals
            && residuals.take_within(Duration::ZERO)?.is_some()
        {
            taken.residuals += 1;
        }
        supervisor.check()?;
        match &mut watch {
            None if all_are_back => {
                finish(&bar, &format!("{} of {} corrected samples received", taken.count, run.bag.scale_readings));
                steps.push(("play through the nodes", begun.elapsed().as_secs_f64()));
                return Ok(None);
            }
            None => bar.set_message(format!("{} of {} samples", taken.count, run.bag.scale_readings)),
            Some(watch) => {
                if watch.look(taken, monitor_of(supervisor), steps)? {
                    break;
                }
                watch.bar().set_message(format!("{} samples corrected", taken.count));
            }
        }
    }
    Ok(watch.map(Watch::end))
}

/// Process of the monitor.
fn monitor_of(supervisor: &Supervisor) -> Option<u32> {
    supervisor.process_ids().into_iter().find(|(name, _)| *name == NodeName::Monitor).map(|(_, id)| id)
}

/// The graph: shared memory between the nodes; DDS for everyone else where it is wanted.
fn launch(run: &Run) -> Launch {
    let play = |topic: &str, repeat_from| Source {
        driver: DriverConfig::Bag { file: run.bag.path.clone(), topic: format!("/{}/{topic}", run.bag.namespace) },
        pace: Pace::RateHz(run.rate_hz),
        repeat_from,
    };
    let memory =
        |from, to: &str| Edge { from, to: to.to_owned(), transport: TransportKind::SharedMemory.name().to_owned() };
    let mut edges = vec![
        memory(NodeName::Scale, "geometric"),
        memory(NodeName::Scale, "monitor"),
        memory(NodeName::Geometric, "residual"),
        memory(NodeName::Residual, "monitor"),
        memory(NodeName::Residual, "user"),
        memory(NodeName::Tracer, "monitor"),
    ];
    let recorded = [NodeName::Scale, NodeName::Tracer, NodeName::Geometric, NodeName::Residual, NodeName::Monitor];
    edges.extend(recorded.map(|node| memory(node, "recorder")));
    if run.closes {
        edges.push(memory(NodeName::Monitor, "user"));
    }
    if run.dds {
        let everyone = |from| Edge { from, to: "*".to_owned(), transport: TransportKind::Dds.name().to_owned() };
        edges.extend([NodeName::Scale, NodeName::Residual, NodeName::Monitor].map(everyone));
    }
    Launch {
        autostart: true,
        namespace: run.bag.namespace.clone(),
        machine: run.machine_file.to_owned(),
        model: Some(run.model_file.to_owned()),
        residual_model: None,
        nodes: NodeName::ALL.to_vec(),
        max_covariate_age_s: 10.0,
        wait_for_subscribers_s: 20.0,
        realtime: None,
        gateway_memory_mib: None,
        scale: Some(play(topics::SCALE_READING, run.closes.then_some(run.bag.first_point))),
        tracer: Some(play(topics::TRACER_READING, None)),
        stamps: Some(Stamps::Recorded),
        publish_clock: false,
        visible_in_ros: false,
        commands_from_ros: true,
        covariates: Vec::new(),
        motion: None,
        lagged: Vec::new(),
        monitor: Some(monitor(run)),
        record: Some(RecordConfig::new(run.out.join("corrected"))),
        edges,
    }
}

/// The monitor's bounds; where the loop is closed, it starts a diagnosis by itself and puts its model into use.
fn monitor(run: &Run) -> MonitorConfig {
    let bounds = MonitorConfig::new(4.0, 200, 0.0005);
    match run.closes {
        false => bounds,
        true => MonitorConfig {
            diagnosis_folder: Some(PathBuf::from(run.out).join(DIAGNOSES)),
            diagnosis_readings: Some(run.bag.diagnosed_readings()),
            diagnose_when_degraded: true,
            adopt_diagnosed_model: true,
            ..bounds
        },
    }
}
