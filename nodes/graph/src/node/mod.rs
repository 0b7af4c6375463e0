//! The nodes as processes: transports, readiness, health, and the way out.
//!
//! Place in the flow: `abbe node NAME` calls [`run`]. A node opens its publishers, waits until the nodes that take
//! from it are there, opens its subscribers and pumps samples through its step until told to stop.

mod correcting;
mod diagnosis;
mod model;
mod monitor;
mod parameters;
mod recorder;
mod source;

pub use source::{STARTED, monotonic_s};

use crate::driver::DriverError;
use crate::feed::FeedError;
use crate::launch::{Launch, LaunchError, NodeName};
use abbe_files::{FileError, MachineFile, read_machine};
use abbe_msgs::bag::BagError;
use abbe_msgs::{Message, MessageError};
use abbe_runtime::ros::{ArgsError, Domain, NodeIdentity, NodeOptions, RosArgs, RosError, RosNode};
use abbe_runtime::transport::shared_memory::{self, CleanupError};
use abbe_runtime::{
    Edges, EdgesConfig, Publish, RunId, Shutdown, ShutdownError, Subscribe, TransportError, TransportKind,
};
use serde::{Deserialize, Serialize};
use std::os::unix::process::parent_id;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use thiserror::Error;

/// How long a subscriber sleeps at most before it looks whether to stop.
const LOOK_UP: Duration = Duration::from_millis(50);

/// What a node was asked to be.
#[derive(Debug, Clone)]
pub struct NodeCall {
    /// Which node.
    pub name: NodeName,
    /// Launch file.
    pub launch_file: PathBuf,
    /// Run whose shared memory it joins.
    pub run: Option<RunId>,
    /// ROS arguments.
    pub ros_args: RosArgs,
    /// Process that started it, when its end should end the node.
    pub launcher_pid: Option<u32>,
}

/// What a node did, printed as its last line.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct NodeSummary {
    /// Name of the node.
    pub node: String,
    /// Samples taken.
    pub received: u64,
    /// Samples given.
    pub sent: u64,
    /// Samples lost before they were taken.
    pub lost: u64,
    /// Samples that arrived but could not be used.
    pub malformed: u64,
    /// Samples that could not be handed to a transport.
    pub dropped: u64,
    /// Figures of this kind of node, by name.
    pub figures: std::collections::BTreeMap<String, f64>,
}

/// Why a node could not run.
#[derive(Debug, Error)]
pub enum NodeError {
    /// Launch file.
    #[error(transparent)]
    Launch(#[from] LaunchError),
    /// Machine or model file.
    #[error(transparent)]
    File(#[from] FileError),
    /// The thread that takes new versions of a file.
    #[error(transparent)]
    Feed(#[from] FeedError),
    /// Driver.
    #[error(transparent)]
    Driver(#[from] DriverError),
    /// Transport.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// ROS 2.
    #[error(transparent)]
    Ros(#[from] RosError),
    /// ROS arguments.
    #[error(transparent)]
    Args(#[from] ArgsError),
    /// Signals.
    #[error(transparent)]
    Shutdown(#[from] ShutdownError),
    /// A message that cannot be made.
    #[error(transparent)]
    Message(#[from] MessageError),
    /// Bag.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// A thread that the system refuses.
    #[error("a thread cannot be started: {0}; let this user start more threads")]
    Thread(#[source] std::io::Error),
    /// The path of this program.
    #[error("the path of this program is unknown, so that it cannot be started for a diagnosis: {0}")]
    Program(#[source] std::io::Error),
    /// A name the ROS graph refuses.
    #[error("{0}")]
    Name(String),
    /// A part of the launch file that this node needs.
    #[error("node {node}: the launch file lacks {part}")]
    Incomplete {
        /// The node.
        node: &'static str,
        /// What it needs.
        part: &'static str,
    },
    /// A node that takes from this one did not come.
    #[error(
        "node {node}: {found} of {wanted} takers of {topic} came within {waited_s} s; start them, or correct the edges \
         of the launch file"
    )]
    Alone {
        /// The node.
        node: &'static str,
        /// Its topic.
        topic: &'static str,
        /// Takers that came.
        found: usize,
        /// Takers the launch file names.
        wanted: usize,
        /// How long it waited (s).
        waited_s: f64,
    },
}

/// Everything a node's loop needs.
pub(crate) struct NodeContext {
    pub(crate) name: NodeName,
    pub(crate) launch: Launch,
    pub(crate) base: PathBuf,
    pub(crate) machine: MachineFile,
    pub(crate) edges: Edges,
    pub(crate) ros: Option<RosNode>,
    pub(crate) shutdown: Shutdown,
}

/// Runs a node until its source ends or it is told to stop.
pub fn run(call: NodeCall) -> Result<NodeSummary, NodeError> {
    let shutdown = Shutdown::on_signals()?;
    if let Some(pid) = call.launcher_pid {
        shutdown.follow_parent(pid)?;
    }
    let (run, launcher_pid) = (call.run.clone(), call.launcher_pid);
    let outcome = NodeContext::open(call, shutdown).and_then(|context| match context.name {
        NodeName::Scale => source::scale(&context),
        NodeName::Tracer => source::tracer(&context),
        NodeName::Geometric => correcting::geometric(&context),
        NodeName::Residual => correcting::residual(&context),
        NodeName::Monitor => monitor::run(&context),
        NodeName::Recorder => recorder::run(&context),
    });
    if launcher_pid.is_some_and(|pid| parent_id() != pid) {
        remove_shared_memory(run.as_ref());
    }
    outcome
}

/// In place of a launcher that was killed: the last node of the run to leave removes what is left of it.
fn remove_shared_memory(run: Option<&RunId>) {
    match run.map(shared_memory::cleanup) {
        // Others are still there; the last of them removes the files.
        Some(Err(CleanupError::Alive { .. })) | Some(Ok(())) | None => {}
        Some(Err(error)) => tracing::warn!(%error, "shared memory of the run could not be removed"),
    }
}

impl NodeContext {
    fn open(call: NodeCall, shutdown: Shutdown) -> Result<NodeContext, NodeError> {
        let mut launch = Launch::read(&call.launch_file)?;
        let base = call.launch_file.parent().map_or_else(PathBuf::new, Path::to_path_buf);
        let machine = read_machine(&base.join(&launch.machine))?;
        let identity = call
            .ros_args
            .identity(&launch.namespace, call.name.name())
            .map_err(|error| NodeError::Name(error.to_string()))?;
        let table = parameters::table(&launch, call.name).map_err(RosError::from)?;
        let table = table.with_assignments(&identity, &call.ros_args.parameters).map_err(RosError::from)?;
        parameters::apply(&table, &mut launch, call.name);
        let remaps = call.ros_args.remaps;
        let ros = if launch.uses(call.name, TransportKind::Dds) {
            let domain = Domain::from_environment().map_err(RosError::from)?;
            let options = NodeOptions { identity: identity.clone(), domain, remaps: remaps.clone(), parameters: table };
            Some(RosNode::start(options)?)
        } else {
            None
        };
        let mut config = EdgesConfig::new(identity);
        config.remaps = remaps;
        config.run = if launch.uses(call.name, TransportKind::SharedMemory) { call.run } else { None };
        config.ros = ros.clone();
        Ok(NodeContext { name: call.name, launch, base, machine, edges: Edges::open(config)?, ros, shutdown })
    }

    /// Publisher of this node's own topic, once the nodes that take from it are there.
    pub(crate) fn publisher<M: Message>(&self) -> Result<Box<dyn Publish<M>>, NodeError> {
        let topic = self.name.topic().ok_or(NodeError::Incomplete { node: self.name.name(), part: "a topic" })?;
        let kinds = self.launch.publishes_over(self.name);
        let publisher = self.edges.publisher::<M>(topic, &kinds)?;
        let wanted = self.launch.awaited(self.name);
        let patience = Duration::from_secs_f64(self.launch.wait_for_subscribers_s);
        let since = Instant::now();
        while publisher.subscribers() < wanted && !self.shutdown.requested() {
            if since.elapsed() > patience {
                let (found, waited_s) = (publisher.subscribers(), self.launch.wait_for_subscribers_s);
                return Err(NodeError::Alone { node: self.name.name(), topic, found, wanted, waited_s });
            }
            self.shutdown.sleep(Duration::from_millis(2));
        }
        Ok(publisher)
    }

    /// Subscriber to what another node gives.
    pub(crate) fn subscriber<M: Message>(&self, from: NodeName) -> Result<Box<dyn Subscribe<M>>, NodeError> {
        let incomplete = NodeError::Incomplete { node: self.name.name(), part: "an edge from a node it takes from" };
        match (self.launch.takes_over(self.name.name(), from), from.topic()) {
            (Some(kind), Some(topic)) => Ok(self.edges.subscriber(topic, kind)?),
            _ => Err(incomplete),
        }
    }
}

/// The next sample; malformed ones are counted and told, the stream goes on.
pub(crate) fn take<M: Message>(
    subscriber: &mut dyn Subscribe<M>,
    within: Duration,
    summary: &mut NodeSummary,
) -> Result<Option<M>, NodeError> {
    match subscriber.take_within(within) {
        Ok(sample) => {
            summary.received += u64::from(sample.is_some());
            Ok(sample)
        }
        Err(error @ TransportError::Malformed { .. }) => {
            summary.malformed += 1;
            tracing::warn!(%error, "sample refused");
            Ok(None)
        }
        Err(error) => Err(error.into()),
    }
}

/// Identity of a program of the user's in the machine's namespace.
pub fn user_identity(namespace: &str, name: &str) -> Result<NodeIdentity, NodeError> {
    NodeIdentity::new(namespace, name).map_err(|error| NodeError::Name(error.to_string()))
}
