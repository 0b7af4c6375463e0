//! Launch configuration: which nodes run, from which drivers, over which transports.
//!
//! Place in the flow: read by `abbe launch`, `abbe node` and the demo; one file describes the whole graph, so that
//! every node knows which transport its edges use. Unknown keys, dangling names and impossible edges are refused
//! with the file and the key.

mod check;
mod instead;
mod realtime;
mod record;

pub use instead::Instead;
pub use realtime::RealtimeConfig;
pub use record::RecordConfig;

use crate::driver::DriverConfig;
use crate::step::MonitorSettings;
use crate::topics;
use abbe_measurement::motion::MotionSettings;
use abbe_runtime::TransportKind;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// A node of the graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NodeName {
    /// Publishes scale readings.
    Scale,
    /// Publishes tracer readings.
    Tracer,
    /// Applies the identified model.
    Geometric,
    /// Adds the residual field.
    Residual,
    /// Compares predicted with measured range.
    Monitor,
    /// Records every topic it is given.
    Recorder,
}

impl NodeName {
    /// All nodes, consumers before producers: the order in which they are started.
    pub const ALL: [NodeName; 6] = [
        NodeName::Recorder,
        NodeName::Monitor,
        NodeName::Residual,
        NodeName::Geometric,
        NodeName::Tracer,
        NodeName::Scale,
    ];

    /// Name in files, on the command line and in the ROS graph.
    pub fn name(self) -> &'static str {
        match self {
            NodeName::Scale => "scale",
            NodeName::Tracer => "tracer",
            NodeName::Geometric => "geometric",
            NodeName::Residual => "residual",
            NodeName::Monitor => "monitor",
            NodeName::Recorder => "recorder",
        }
    }

    /// The topic this node publishes; the recorder publishes none.
    pub fn topic(self) -> Option<&'static str> {
        match self {
            NodeName::Scale => Some(topics::SCALE_READING),
            NodeName::Tracer => Some(topics::TRACER_READING),
            NodeName::Geometric => Some(topics::GEOMETRIC),
            NodeName::Residual => Some(topics::CORRECTED),
            NodeName::Monitor => Some(topics::RANGE_RESIDUAL),
            NodeName::Recorder => None,
        }
    }

    /// Topics of the standard message that is made of each of its samples for ROS 2.
    pub fn companions(self) -> &'static [&'static str] {
        match self {
            NodeName::Scale => &[topics::JOINT_STATE],
            NodeName::Residual => &[topics::CORRECTED_POINT, topics::FRAMES, topics::MARKERS],
            NodeName::Tracer | NodeName::Geometric | NodeName::Monitor | NodeName::Recorder => &[],
        }
    }

    /// Nodes whose output this one can take.
    pub(crate) fn inputs(self) -> &'static [NodeName] {
        match self {
            NodeName::Scale | NodeName::Tracer => &[],
            NodeName::Geometric => &[NodeName::Scale],
            NodeName::Residual => &[NodeName::Geometric, NodeName::Scale],
            NodeName::Monitor => &[NodeName::Residual, NodeName::Tracer, NodeName::Scale],
            NodeName::Recorder => {
                &[NodeName::Scale, NodeName::Tracer, NodeName::Geometric, NodeName::Residual, NodeName::Monitor]
            }
        }
    }

    /// Those of its inputs that this node does nothing without.
    fn needs(self) -> &'static [NodeName] {
        match self {
            NodeName::Residual => &[NodeName::Geometric],
            NodeName::Monitor => &[NodeName::Residual, NodeName::Tracer],
            NodeName::Recorder => &[],
            other => other.inputs(),
        }
    }
}

impl std::str::FromStr for NodeName {
    type Err = LaunchError;

    fn from_str(name: &str) -> Result<NodeName, LaunchError> {
        let known = || NodeName::ALL.map(NodeName::name).join(", ");
        NodeName::ALL
            .into_iter()
            .find(|node| node.name() == name)
            .ok_or_else(|| LaunchError::UnknownNode { name: name.to_owned(), known: known() })
    }
}

/// How fast a recording is played.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Pace {
    /// So many readings a second, whatever the stamps say (Hz).
    RateHz(f64),
    /// As recorded, so many times faster.
    TimeFactor(f64),
    /// As they come: for live drivers, and for no other.
    AsTheyCome,
}

impl fmt::Display for Pace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Pace::RateHz(rate) => write!(f, "{rate} Hz"),
            Pace::TimeFactor(factor) => write!(f, "{factor} times its own pace"),
            Pace::AsTheyCome => f.write_str("the pace at which readings come"),
        }
    }
}

/// What a recording that is played is stamped with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stamps {
    /// The instants of the recording, whenever it is played.
    Recorded,
    /// The instants at which it is played.
    Now,
}

/// A node that plays a driver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// Where readings come from.
    pub driver: DriverConfig,
    /// How fast.
    pub pace: Pace,
    /// Sequence at which the recording begins again at its end, until the node is stopped; what goes out counts on. Without
    /// it the recording is played once. For the scale node only: a tracer's readings again would count twice as evidence.
    pub repeat_from: Option<u64>,
}

/// The monitor's bounds, and what it does when the model does not hold any more.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MonitorConfig {
    /// A single residual is out of bounds beyond this many standard uncertainties.
    pub single_bound: f64,
    /// Residuals over which the mean square is taken.
    pub window: usize,
    /// Stamps this close are the same instant (s).
    pub match_within_s: f64,
    /// Folder of diagnoses, relative to this file; each has a numbered folder in it. Without one there are none.
    pub diagnosis_folder: Option<PathBuf>,
    /// Readings that a diagnosis needs at least; [`MonitorConfig::LEAST_READINGS`] without it.
    pub diagnosis_readings: Option<usize>,
    /// Whether a diagnosis starts by itself, once for each model, when the model turns out degraded.
    #[serde(default)]
    pub diagnose_when_degraded: bool,
    /// Whether the model that a diagnosis gives takes the place of the model file.
    #[serde(default)]
    pub adopt_diagnosed_model: bool,
}

impl MonitorConfig {
    /// Readings that a diagnosis needs at least where the launch file does not say: fewer do not tell the stations of
    /// a tracer from the errors of a machine.
    pub const LEAST_READINGS: usize = 300;

    /// Readings that a diagnosis needs at least.
    pub fn least_readings(&self) -> usize {
        self.diagnosis_readings.unwrap_or(MonitorConfig::LEAST_READINGS)
    }

    /// A monitor with these bounds that diagnoses nothing.
    pub fn new(single_bound: f64, window: usize, match_within_s: f64) -> MonitorConfig {
        MonitorConfig {
            single_bound,
            window,
            match_within_s,
            diagnosis_folder: None,
            diagnosis_readings: None,
            diagnose_when_degraded: false,
            adopt_diagnosed_model: false,
        }
    }
}

/// How the motion is derived from the scale readings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotionConfig {
    /// Travel back from which an axis has turned (µm): above the noise of the scales and the tremble of a standing axis.
    pub reversal_um: f64,
    /// Time over which a feed is taken (s).
    pub window_s: f64,
}

impl MotionConfig {
    /// In SI.
    pub fn settings(self) -> MotionSettings {
        MotionSettings { reversal_m: self.reversal_um / 1e6, window_s: self.window_s }
    }
}

/// One edge: who gives, who takes, over what.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Edge {
    /// The publishing node; it may run outside this launch (a ROS 2 program that publishes the same topic).
    pub from: NodeName,
    /// The taking node, `user` for a program of the user's on this host, `*` for everyone who subscribes.
    pub to: String,
    /// Over what.
    pub transport: String,
}

/// A whole graph.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Launch {
    /// Namespace of the machine: all topics are relative to it.
    pub namespace: String,
    /// Machine file, relative to this file.
    pub machine: PathBuf,
    /// Model file, relative to this file; without one, samples say that there is no model.
    pub model: Option<PathBuf>,
    /// Residual model file, relative to this file; without one the residual node passes samples on as they are.
    pub residual_model: Option<PathBuf>,
    /// Nodes that this launch starts.
    pub nodes: Vec<NodeName>,
    /// Age from which a covariate is stale (s).
    pub max_covariate_age_s: f64,
    /// Longest a node waits for the nodes that take from it (s).
    pub wait_for_subscribers_s: f64,
    /// Whether nodes configure and activate themselves; otherwise a manager of nodes does (`ros2 lifecycle`).
    #[serde(default = "by_themselves")]
    pub autostart: bool,
    /// Whether nodes without an edge over DDS or Zenoh are in the ROS graph as well, with their parameters, services and diagnostics.
    #[serde(default = "visible_in_ros")]
    pub visible_in_ros: bool,
    /// Whether services over ROS 2 may change what a node does. Without them the graph is only looked at from there.
    #[serde(default = "commands_from_ros")]
    pub commands_from_ros: bool,
    /// What recordings are stamped with while they are played; [`Launch::stamps`] says what holds where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stamps: Option<Stamps>,
    /// Whether the scale node gives the instants of its recording on `/clock`, for all that go by simulated time.
    #[serde(default)]
    pub publish_clock: bool,
    /// Real-time scheduling of the nodes on the path of a sample; none without it.
    #[serde(default, deserialize_with = "realtime::read")]
    pub realtime: Option<RealtimeConfig>,
    /// Memory that the gateway of each node with an edge over DDS may reserve (MiB);
    /// [`Launch::GATEWAY_MEMORY_MIB`] without it.
    pub gateway_memory_mib: Option<u64>,
    /// Driver of the scale node.
    pub scale: Option<Source>,
    /// Driver of the tracer node.
    pub tracer: Option<Source>,
    /// Sensors whose values become covariates of the scale readings.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub covariates: Vec<DriverConfig>,
    /// How side of approach, feed and acceleration are derived from the scale readings; not at all without it.
    pub motion: Option<MotionConfig>,
    /// Covariates that lag behind others, such as `temp_air_lag_1800s_c`, and sides over a travel, such as `dir_x_over_5000um`, to be made in the stream of scale readings.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lagged: Vec<String>,
    /// Bounds of the monitor node.
    pub monitor: Option<MonitorConfig>,
    /// What the recorder writes.
    pub record: Option<RecordConfig>,
    /// All edges.
    pub edges: Vec<Edge>,
}

/// Nodes start by themselves where the launch file does not say.
fn by_themselves() -> bool {
    true
}

/// A launch configuration that makes no graph.
#[derive(Debug, Error)]
pub enum LaunchError {
    /// The file cannot be read.
    #[error("{file}: {source}; check the path")]
    Read {
        /// The file.
        file: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Not TOML, an unknown key, a missing key, a wrong type.
    #[error("{file}: {problem}")]
    Parse {
        /// The file.
        file: PathBuf,
        /// What and where.
        problem: String,
    },
    /// A node name that does not exist.
    #[error("unknown node {name:?}; known are {known}")]
    UnknownNode {
        /// The name.
        name: String,
        /// All names.
        known: String,
    },
    /// A value out of range or a part that is missing.
    #[error("{file}: {key}: {problem}")]
    Value {
        /// The file.
        file: PathBuf,
        /// The key.
        key: String,
        /// What is wrong and what to do.
        problem: String,
    },
}

/// Where the launch file does not say.
fn visible_in_ros() -> bool {
    true
}

fn commands_from_ros() -> bool {
    true
}

impl Launch {
    /// Memory that a gateway may reserve where the launch file does not say (MiB).
    pub const GATEWAY_MEMORY_MIB: u64 = 1024;
    /// Less is not enough to start one (MiB).
    pub const LEAST_GATEWAY_MEMORY_MIB: u64 = 512;

    /// Memory that a gateway may reserve (bytes).
    pub fn gateway_memory_bytes(&self) -> u64 {
        self.gateway_memory_mib.unwrap_or(Launch::GATEWAY_MEMORY_MIB).saturating_mul(1 << 20)
    }

    /// Reads and checks a launch file.
    pub fn read(path: &Path) -> Result<Launch, LaunchError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| LaunchError::Read { file: path.to_owned(), source })?;
        Launch::parse(&text, path)
    }

    /// Checks the text of a launch file; `path` names it in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Launch, LaunchError> {
        let launch: Launch = toml::from_str(text)
            .map_err(|error| LaunchError::Parse { file: path.to_owned(), problem: error.to_string() })?;
        launch.check(path)?;
        Ok(launch)
    }

    /// The text of a launch file.
    pub fn to_text(&self) -> Result<String, LaunchError> {
        toml::to_string(self)
            .map_err(|error| LaunchError::Parse { file: PathBuf::from("(generated)"), problem: error.to_string() })
    }

    /// Transports over which a node publishes, each once.
    pub fn publishes_over(&self, node: NodeName) -> Vec<TransportKind> {
        let mut kinds: Vec<TransportKind> =
            self.edges.iter().filter(|edge| edge.from == node).filter_map(|edge| edge.transport.parse().ok()).collect();
        kinds.sort();
        kinds.dedup();
        kinds
    }

    /// Transport over which `node` takes what `from` gives; `None` where it does not.
    pub fn takes_over(&self, node: &str, from: NodeName) -> Option<TransportKind> {
        let edge = self.edges.iter().find(|edge| edge.from == from && edge.to == node)?;
        edge.transport.parse().ok()
    }

    /// Names of the covariates that scale readings can hold, where this file alone tells: not of recordings, of drivers and sensors that
    /// name what they say themselves, nor of what is derived from the motion.
    pub fn covariate_names(&self) -> Option<Vec<String>> {
        let is_open = !self.covariates.is_empty() || self.motion.is_some();
        let source = self.scale.as_ref().filter(|_| !is_open)?;
        Some(source.driver.covariate_names()?.into_iter().chain(self.lagged.iter().cloned()).collect())
    }

    /// Named takers of a node's output that are sure to come: they are waited for.
    pub fn awaited(&self, node: NodeName) -> usize {
        self.edges.iter().filter(|edge| edge.from == node && edge.to != "*").count()
    }

    /// Whether a node that this launch does not start feeds one that it does.
    pub fn is_fed_from_outside(&self) -> bool {
        let starts = |name: &str| self.nodes.iter().any(|node| node.name() == name);
        self.edges.iter().any(|edge| !self.nodes.contains(&edge.from) && starts(&edge.to))
    }

    /// Whether any edge of this node uses that transport.
    pub fn uses(&self, node: NodeName, kind: TransportKind) -> bool {
        let touches = |edge: &&Edge| edge.from == node || edge.to == node.name();
        self.edges.iter().filter(touches).any(|edge| edge.transport == kind.name())
    }

    /// Whether this node is in the ROS graph.
    pub fn is_in_ros_graph(&self, node: NodeName) -> bool {
        let behind_gateway = |kind: TransportKind| kind.is_behind_gateway() && self.uses(node, kind);
        self.visible_in_ros || TransportKind::ALL.into_iter().any(behind_gateway) || self.takes_from_ros(node)
    }

    /// Whether a driver of this node takes topics of other ROS 2 programs.
    fn takes_from_ros(&self, node: NodeName) -> bool {
        let (source, beside): (&Option<Source>, &[DriverConfig]) = match node {
            NodeName::Scale => (&self.scale, &self.covariates),
            NodeName::Tracer => (&self.tracer, &[]),
            _ => (&None, &[]),
        };
        let mut drivers = source.iter().map(|source| &source.driver).chain(beside);
        drivers.any(|driver| matches!(driver, DriverConfig::Ros(_)))
    }

    /// Sources of scale and tracer readings that play a recording.
    pub(crate) fn played(&self) -> impl Iterator<Item = &Source> {
        [&self.scale, &self.tracer].into_iter().flatten().filter(|source| !source.driver.is_live())
    }

    /// What recordings are stamped with: the present, unless the file says otherwise or gives the time of the recording on `/clock`.
    pub fn stamps(&self) -> Stamps {
        self.stamps.unwrap_or(if self.publish_clock { Stamps::Recorded } else { Stamps::Now })
    }

    /// The monitor's settings.
    pub fn monitor_settings(&self) -> Option<MonitorSettings> {
        self.monitor.as_ref().map(|m| MonitorSettings {
            single_bound: m.single_bound,
            window: m.window,
            match_within_s: m.match_within_s,
        })
    }
}
