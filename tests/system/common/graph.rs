//! Graphs of nodes for tests: launch files, the shared memory of a run, and what lies in it.

use std::fs;

use abbe_graph::node::user_identity;
use abbe_msgs::bag::BagWriter;
use abbe_msgs::{Message, ScaleReading, Stamp};
use abbe_runtime::{Edges, EdgesConfig, RunId, Subscribe, TransportKind};

use super::files::{Bench, machine, samples, text};
use super::program::run;

/// Namespace of the graphs of these tests.
pub(crate) const NAMESPACE: &str = "test";
pub(crate) const MEMORY: &str = "shared-memory";
pub(crate) const DDS: &str = "dds";

/// A launch file in the making: no nodes, no edges.
#[derive(Debug, Default)]
pub(crate) struct LaunchText {
    nodes: Vec<&'static str>,
    edges: String,
    record: String,
    residual: String,
    keys: String,
    tables: String,
}

impl LaunchText {
    pub(crate) fn nodes(mut self, nodes: &[&'static str]) -> Self {
        self.nodes.extend(nodes);
        self
    }

    pub(crate) fn edge(mut self, from: &str, to: &str, transport: &str) -> Self {
        self.edges += &format!("[[edges]]\nfrom = \"{from}\"\nto = \"{to}\"\ntransport = \"{transport}\"\n\n");
        self
    }

    pub(crate) fn record(mut self, bag: &str) -> Self {
        self.record = format!("record = \"{bag}\"\n");
        self
    }

    /// A further key of the whole launch.
    pub(crate) fn key(mut self, line: &str) -> Self {
        self.keys += &format!("{line}\n");
        self
    }

    /// The residual node adds this residual model.
    pub(crate) fn residual_model(mut self, file: &str) -> Self {
        self.residual = format!("residual_model = \"{file}\"\n");
        self
    }

    /// A source that plays a bag's topic, or a campaign where `topic` is none.
    pub(crate) fn source(mut self, node: &str, file: &str, topic: Option<&str>, rate_hz: f64) -> Self {
        let driver = match topic {
            Some(topic) => format!("kind = \"bag\", file = \"{file}\", topic = \"{topic}\""),
            None => format!("kind = \"campaign\", file = \"{file}\""),
        };
        self.tables += &format!("[{node}]\ndriver = {{ {driver} }}\npace = {{ rate_hz = {rate_hz:?} }}\n\n");
        self
    }

    /// The recording of the scales begins again at its end, until the graph is stopped.
    pub(crate) fn repeated(mut self) -> Self {
        self.tables = self.tables.replace("[scale]\n", "[scale]\nrepeat_from = 0\n");
        self
    }

    pub(crate) fn monitor(mut self) -> Self {
        self.tables += "[monitor]\nsingle_bound = 4.0\nwindow = 200\nmatch_within_s = 0.0005\n\n";
        self
    }

    /// Nodes without an edge over DDS are in no ROS graph, and recordings keep their stamps, unless a key says so: shared memory and comparing
    /// with the recording are what most tests are about.
    pub(crate) fn text(&self) -> String {
        let hidden = if self.keys.contains("visible_in_ros") { "" } else { "visible_in_ros = false\n" };
        let stamps = if self.keys.contains("stamps = ") { "" } else { "stamps = \"recorded\"\n" };
        format!(
            "namespace = \"{NAMESPACE}\"\nmachine = \"{}\"\nmodel = \"model.json\"\nnodes = {:?}\n\
             max_covariate_age_s = 10.0\nwait_for_subscribers_s = 20.0\n{hidden}{stamps}{}{}{}\n{}{}",
            text(&machine()),
            self.nodes,
            self.keys,
            self.residual,
            self.record,
            self.tables,
            self.edges
        )
    }

    /// Writes it into the folder and gives its path as an argument.
    pub(crate) fn write(&self, bench: &Bench) -> String {
        bench.write("launch.toml", self.text())
    }
}

/// A bag with the campaign's readings over and over, 1 ms apart.
pub(crate) fn long_recording(bench: &Bench, count: u64) {
    let (campaign, bag) = (bench.text("campaign.csv"), bench.text("campaign"));
    run(["convert", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &bag, "--namespace", NAMESPACE])
        .ok();
    let readings = samples::<ScaleReading>(&bench.path("campaign"), &topic("scale/reading"));
    let mut writer = BagWriter::create(bench.path("long")).unwrap();
    for (sequence, reading) in (0..count).zip(readings.iter().cycle()) {
        let stamp = Stamp::from_nanos(i64::try_from(sequence).unwrap() * 1_000_000).unwrap();
        writer.write(&topic("scale/reading"), &ScaleReading { stamp, sequence, ..*reading }, sequence).unwrap();
    }
    writer.finish().unwrap();
}

/// The correcting path over shared memory, fed at 1 kHz with [`long_recording`]; `more` adds edges.
pub(crate) fn stream_of(bench: &Bench, more: impl FnOnce(LaunchText) -> LaunchText) -> String {
    let long = bench.text("long");
    let launch = LaunchText::default()
        .nodes(&["scale", "geometric", "residual"])
        .edge("scale", "geometric", MEMORY)
        .edge("geometric", "residual", MEMORY)
        .source("scale", &long, Some(&topic("scale/reading")), 1000.0);
    more(launch).write(bench)
}

/// The same without an end: whoever is done first ends the graph.
pub(crate) fn endless_stream_of(bench: &Bench, more: impl FnOnce(LaunchText) -> LaunchText) -> String {
    if !bench.path("long").exists() {
        long_recording(bench, 2000);
    }
    stream_of(bench, |launch| more(launch.repeated()))
}

/// The same with a recorder in place of a user.
pub(crate) fn recorded_stream_of(bench: &Bench, bag: &str) -> String {
    stream_of(bench, |launch| launch.nodes(&["recorder"]).edge("residual", "recorder", MEMORY).record(bag))
}

/// The name of a topic of these graphs.
pub(crate) fn topic(name: &str) -> String {
    format!("/{NAMESPACE}/{name}")
}

/// A subscriber of the user's on this host: joins the run's shared memory beside the nodes.
pub(crate) fn user<M: Message>(run: &RunId, topic: &str) -> Box<dyn Subscribe<M>> {
    let mut config = EdgesConfig::new(user_identity(NAMESPACE, "test_user").unwrap());
    config.run = Some(run.clone());
    Edges::open(config).unwrap().subscriber(topic, TransportKind::SharedMemory).unwrap()
}

/// Everything in the places of shared memory that carries a run's name; `run` may be the beginning of one.
pub(crate) fn files_of_run(run: &str) -> Vec<String> {
    let of = |folder: &str| fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let paths = of("/dev/shm").chain(of("/tmp")).map(|path| path.display().to_string());
    paths.filter(|path| path.contains(&format!("/abbe_{run}"))).collect()
}
