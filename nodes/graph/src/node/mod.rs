//! The nodes as processes: transports, readiness, health, and the way out.
//!
//! Place in the flow: `abbe node NAME` calls [`run`]. A node opens its publishers, waits until the nodes that take
//! from it are there, opens its subscribers and pumps samples through its step until told to stop.

mod changes;
mod correcting;
mod diagnosis_request;
mod frequency;
mod lifecycle;
mod links;
mod model;
mod monitor;
mod parameters;
mod realtime;
pub(crate) mod recorder;
pub(crate) mod recording;
mod remarks;
mod scenery;
mod schedule;
mod sensors;
mod source;
pub(crate) mod told;
mod traffic;

pub use schedule::monotonic_s;
pub use source::STARTED;
pub use told::AsTold;
pub(crate) use traffic::take;

use changes::Changes;
use lifecycle::Lifecycle;

use crate::driver::DriverError;
use crate::feed::FeedError;
use crate::launch::{Instead, Launch, LaunchError, NodeName};
use crate::{scene, topics};
use abbe_files::{FileError, MachineFile, read_machine};
use abbe_msgs::bag::BagError;
use abbe_msgs::{Message, MessageError};
use abbe_runtime::gateway::{Companion, Content, GatewayCommand, GatewayNode, GatewayOptions, OnChange};
use abbe_runtime::realtime::RealtimeError;
use abbe_runtime::ros::{
    ArgsError, Clock, Domain, Enclave, NodeIdentity, NodeOptions, ParameterTable, RosArgs, RosError, StaticPeers,
    offer_best_effort, resolve,
};
use abbe_runtime::transport::shared_memory;
use abbe_runtime::{
    Claim, ClaimError, Edges, EdgesConfig, Publish, RunId, Shutdown, ShutdownError, Subscribe, TransportError,
    TransportKind,
};
use serde::{Deserialize, Serialize};
use std::cell::Cell;
use std::io::Write;
use std::os::unix::process::parent_id;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use thiserror::Error;

/// How long a subscriber sleeps at most before it looks whether to stop.
const LOOK_UP: Duration = Duration::from_millis(50);

/// How often a node that a launcher started says that its loop turns.
const SAY_ALIVE_EVERY: Duration = Duration::from_millis(500);
/// Line on standard output of a node that a launcher started: it takes part in the graph.
pub const READY: &str = "ready";
/// Line on standard output of a node that a launcher started: its loop turns.
pub const ALIVE: &str = "alive";

/// What a node was asked to be.
#[derive(Debug, Clone)]
pub struct NodeCall {
    /// Which node.
    pub name: NodeName,
    /// Launch file.
    pub launch_file: PathBuf,
    /// Files to be used instead of those it names.
    pub instead: Instead,
    /// Run whose shared memory it joins.
    pub run: Option<RunId>,
    /// ROS arguments.
    pub ros_args: RosArgs,
    /// Process that started it, when its end should end the node.
    pub launcher_pid: Option<u32>,
    /// How often the launcher has started it before.
    pub life: u32,
    /// What it was told before the process ended whose place it takes.
    pub as_told: AsTold,
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
    /// Whether it ended because its recording did.
    #[serde(default)]
    pub recording_ended: bool,
    /// What went wrong, for the log and `/diagnostics`.
    #[serde(skip)]
    pub(crate) troubles: traffic::Troubles,
    /// Figures of this kind of node, by name.
    pub figures: std::collections::BTreeMap<String, f64>,
}

impl NodeSummary {
    /// The summary of several lives of a node: counts of all, figures of the last.
    fn followed_by(self, later: NodeSummary) -> NodeSummary {
        NodeSummary {
            received: self.received + later.received,
            sent: self.sent + later.sent,
            lost: self.lost + later.lost,
            malformed: self.malformed + later.malformed,
            dropped: self.dropped + later.dropped,
            ..later
        }
    }
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
    /// Another process publishes what this node would.
    #[error(transparent)]
    Claim(#[from] ClaimError),
    /// ROS 2.
    #[error(transparent)]
    Ros(#[from] RosError),
    /// ROS arguments.
    #[error(transparent)]
    Args(#[from] ArgsError),
    /// Real-time scheduling.
    #[error(transparent)]
    Realtime(#[from] RealtimeError),
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
    #[error("the path of this program is unknown, so that it cannot be started for a diagnosis or as a gateway: {0}")]
    Program(#[source] std::io::Error),
    /// A name the ROS graph refuses.
    #[error("{0}")]
    Name(String),
    /// Recordings that are stamped with the present, and differ about it.
    #[error("stamps: {0}")]
    Present(String),
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
    run: Option<RunId>,
    /// The run, whether or not this node has an edge over its shared memory.
    whole_run: Option<RunId>,
    launcher_pid: Option<u32>,
    pub(crate) ros: Option<GatewayNode>,
    clock: Clock,
    /// Of the life that runs; raised with the process's.
    pub(crate) shutdown: Shutdown,
    pub(crate) lifecycle: Lifecycle,
    changes: Changes,
    /// How often the launcher has started this node before.
    pub(crate) life: u32,
    /// How often this process has been configured.
    configured: u32,
    /// Whether the launcher is still to be told that the node is ready.
    unready: Cell<bool>,
}

/// Runs a node until its source ends or it is told to stop.
pub fn run(call: NodeCall) -> Result<NodeSummary, NodeError> {
    let shutdown = Shutdown::on_signals()?;
    if let Some(pid) = call.launcher_pid {
        shutdown.follow_parent(pid)?;
    }
    let (run, launcher_pid) = (call.run.clone(), call.launcher_pid);
    if launcher_pid.is_some() {
        say_alive(shutdown.clone())?;
    }
    let outcome = NodeContext::open(call, shutdown).and_then(|context| {
        lifecycle::live(context, |context| match context.name {
            NodeName::Scale => source::scale(context),
            NodeName::Tracer => source::tracer(context),
            NodeName::Geometric => correcting::geometric(context),
            NodeName::Residual => correcting::residual(context),
            NodeName::Monitor => monitor::run(context),
            NodeName::Recorder => recorder::run(context),
        })
    });
    // In place of a launcher that was killed.
    if launcher_pid.is_some_and(|pid| parent_id() != pid)
        && let Some(run) = &run
    {
        shared_memory::cleanup_by_the_last(run);
    }
    outcome
}

/// Tells the launcher, as long as the process lives, that the loop of the node turns.
fn say_alive(shutdown: Shutdown) -> Result<(), NodeError> {
    let mut looks = 0;
    let telling = move || {
        loop {
            std::thread::sleep(SAY_ALIVE_EVERY);
            if shutdown.is_looked_at(&mut looks) {
                say(ALIVE);
            }
        }
    };
    std::thread::Builder::new().name("alive".into()).spawn(telling).map_err(NodeError::Thread)?;
    Ok(())
}

/// A line to the launcher; one that is gone needs to hear nothing.
fn say(word: &str) {
    let _ = writeln!(std::io::stdout(), "{word}");
}

/// Parameters of a node, which are in its launch file's values then: of the file, over them of ROS arguments, over these what was set while
/// the node ran, whatever was given at the first start.
fn parameter_table(
    call: &NodeCall,
    launch: &mut Launch,
    identity: &NodeIdentity,
    is_secured: bool,
) -> Result<ParameterTable, NodeError> {
    let out_of_name = call.ros_args.out_of_name(call.name.name(), identity);
    out_of_name.iter().for_each(|words| tracing::warn!("{words}"));
    let as_told = &call.as_told.parameters;
    parameters::apply(as_told.iter().map(|(name, value)| (name.as_str(), value)), launch, call.name);
    let mut assignments = call.ros_args.parameters.clone();
    assignments.retain(|one| !as_told.contains_key(&one.name));
    let qos = parameters::qos(launch, call.name, |topic| resolve(topic, identity, &call.ros_args.remaps));
    let mut qos = qos.map_err(RosError::from)?;
    if is_secured {
        offer_best_effort(&mut qos);
    }
    let table = parameters::table(launch, call.name, qos).map_err(RosError::from)?;
    let table = table.with_assignments(identity, &assignments).map_err(RosError::from)?;
    // One of the nodes says it for all.
    if call.launcher_pid.is_none() || launch.nodes.first() == Some(&call.name) {
        let strangers = parameters::strangers(launch, &call.ros_args)?;
        strangers.iter().for_each(|stranger| tracing::warn!("{stranger}"));
    }
    let table = if launch.commands_from_ros { table } else { table.fixed() };
    parameters::apply(table.values(), launch, call.name);
    Ok(table)
}

/// The time that a node goes by.
fn clock_of(ros: Option<&GatewayNode>, uses_sim_time: bool) -> Clock {
    match ros {
        Some(node) => node.clock(),
        // Nothing is ahead of a clock that says nothing, and nothing else asks for it.
        None if uses_sim_time => {
            tracing::warn!(
                "use_sim_time is set, but this node is not in the ROS graph and hears no /clock; leave out visible_in_ros = false"
            );
            Clock::simulated()
        }
        None => Clock::of_system(),
    }
}

impl NodeContext {
    fn open(call: NodeCall, shutdown: Shutdown) -> Result<NodeContext, NodeError> {
        let mut launch = Launch::read_with(&call.launch_file, &call.instead)?;
        realtime::begin(&launch, call.name)?;
        let base = call.launch_file.parent().map_or_else(PathBuf::new, Path::to_path_buf);
        let machine = read_machine(&base.join(&launch.machine))?;
        let identity = call
            .ros_args
            .identity(&launch.namespace, call.name.name())
            .map_err(|error| NodeError::Name(error.to_string()))?;
        let enclave = Enclave::from_environment(call.ros_args.enclave.as_deref());
        let table = parameter_table(&call, &mut launch, &identity, matches!(enclave, Ok(Some(_))))?;
        let uses_sim_time = table.uses_sim_time();
        let mut config = EdgesConfig::new(identity.clone());
        let has_launcher = call.launcher_pid.is_some();
        let changes = Changes::new(call.as_told.parameters.clone(), has_launcher);
        let ros = if launch.is_in_ros_graph(call.name) {
            let domain = Domain::from_environment().map_err(RosError::from)?;
            // Nothing of a node that is not in the graph needs keys.
            let enclave = enclave.map_err(RosError::from)?;
            let peers = StaticPeers::from_environment(domain.range).map_err(RosError::from)?;
            let remaps = call.ros_args.remaps.clone();
            Some(GatewayNode::start(GatewayOptions {
                command: gateway_command(&identity, call.run.as_ref(), launch.uses(call.name, TransportKind::Zenoh))?,
                node: NodeOptions { identity, domain, remaps, parameters: table, enclave, peers },
                run: call.run.clone(),
                depth: config.depth,
                memory_limit_bytes: launch.gateway_memory_bytes(),
                hardware_id: machine.machine.name.clone(),
                on_change: Some(on_change(&changes)),
                rosout: !call.ros_args.no_rosout,
            })?)
        } else {
            None
        };
        let clock = clock_of(ros.as_ref(), uses_sim_time);
        let lifecycle = Lifecycle::new(&shutdown, launch.autostart, call.as_told.stays, has_launcher);
        if let Some(node) = &ros {
            lifecycle.serve(node, &machine.machine.name, launch.commands_from_ros)?;
        }
        let NodeCall { name, life, launcher_pid, run: whole_run, ros_args, .. } = call;
        let run = whole_run.clone().filter(|_| launch.uses(name, TransportKind::SharedMemory));
        config.remaps = ros_args.remaps;
        config.run.clone_from(&run);
        config.gateway = ros.clone();
        config.remembers = true;
        let edges = Edges::open(config)?;
        let unready = Cell::new(has_launcher);
        Ok(NodeContext {
            name,
            launch,
            base,
            machine,
            edges,
            run,
            whole_run,
            launcher_pid,
            ros,
            clock,
            shutdown,
            lifecycle,
            changes,
            life,
            configured: 0,
            unready,
        })
    }

    /// The summary of a node that has done nothing yet.
    fn summary(&self) -> NodeSummary {
        let troubles = traffic::Troubles::by_clock(self.clock());
        NodeSummary { node: self.name.name().to_owned(), troubles, ..NodeSummary::default() }
    }

    /// The node's place in the ROS graph for services that change what it does; none where it takes no commands.
    fn commanded(&self) -> Option<&GatewayNode> {
        self.ros.as_ref().filter(|_| self.launch.commands_from_ros)
    }

    /// The time that the node goes by.
    pub(crate) fn clock(&self) -> Clock {
        self.clock.clone()
    }

    /// The summary with how the gateway has fared.
    fn with_gateway_figures(&self, mut summary: NodeSummary) -> NodeSummary {
        if let Some(node) = &self.ros {
            let figures = node.figures();
            summary.figures.insert("gateway_restarts".to_owned(), figures.restarts as f64);
            summary.figures.insert("gateway_missed".to_owned(), figures.missed as f64);
        }
        summary
    }

    /// Publisher of this node's own topic and what goes beside it, once the nodes that take from it are there.
    pub(crate) fn publisher<M: Message>(&self) -> Result<Box<dyn Publish<M>>, NodeError> {
        let topic = self.name.topic().ok_or(NodeError::Incomplete { node: self.name.name(), part: "a topic" })?;
        let kinds = self.launch.publishes_over(self.name);
        let claims = kinds.iter().map(|kind| self.claim(topic, *kind)).collect::<Result<_, _>>()?;
        let publisher = self.edges.publisher_with::<M>(topic, &kinds, &self.companions())?;
        let publisher = Claimed { publisher, sent: frequency::watch(self)?, _claims: claims };
        // One that starts again finds the others at work; who of them is gone for good is not waited for. A manager knows
        // whom it configures first.
        let is_first = self.life == 0 && self.lifecycle.starts_by_itself();
        let wanted = if is_first { self.launch.awaited(self.name) } else { 0 };
        let patience = Duration::from_secs_f64(self.launch.wait_for_subscribers_s);
        let since = Instant::now();
        while publisher.subscribers() < wanted && !self.shutdown.requested() {
            if since.elapsed() > patience {
                let (found, waited_s) = (publisher.subscribers(), self.launch.wait_for_subscribers_s);
                return Err(NodeError::Alone { node: self.name.name(), topic, found, wanted, waited_s });
            }
            self.shutdown.sleep(Duration::from_millis(2));
        }
        self.is_ready();
        Ok(Box::new(publisher))
    }

    /// What the gateway makes of each sample of this node's topic.
    fn companions(&self) -> Vec<Companion> {
        let machine = &self.machine.machine;
        let content = |topic: &str| match topic {
            topics::JOINT_STATE => Some(Content::JointState(scene::joint_names())),
            topics::CORRECTED_POINT => Some(Content::Point),
            topics::FRAMES => Some(Content::Frames(scene::frames(machine))),
            topics::MARKERS => Some(Content::Markers(scene::volume(machine))),
            _ => None,
        };
        let companion = |topic: &&str| Some(Companion { topic: (*topic).to_owned(), content: content(topic)? });
        let clock = (self.name == NodeName::Scale && self.launch.publish_clock)
            .then(|| Companion { topic: topics::CLOCK.to_owned(), content: Content::Clock });
        self.name.companions().iter().filter_map(companion).chain(clock).collect()
    }

    /// Holds the right to publish a topic where others on this host could publish it as well.
    fn claim(&self, topic: &str, kind: TransportKind) -> Result<Option<Claim>, NodeError> {
        let topic = self.edges.resolve(topic)?;
        Ok(match (kind, &self.run) {
            (TransportKind::SharedMemory, Some(run)) => Some(Claim::in_run(run, &topic)?),
            (TransportKind::Dds | TransportKind::Zenoh, _) => {
                Some(Claim::in_domain(Domain::from_environment().map_err(RosError::from)?, kind, &topic)?)
            }
            (TransportKind::SharedMemory | TransportKind::InProcess, _) => None,
        })
    }

    /// Whether this process has been configured, and cleaned up, before.
    pub(crate) fn is_configured_again(&self) -> bool {
        self.configured > 1
    }

    /// Tells the launcher, once, that the node takes part in the graph.
    fn is_ready(&self) {
        if self.unready.replace(false) {
            say(READY);
        }
    }

    /// Subscriber to what another node gives.
    pub(crate) fn subscriber<M: Message>(&self, from: NodeName) -> Result<Box<dyn Subscribe<M>>, NodeError> {
        let incomplete = NodeError::Incomplete { node: self.name.name(), part: "an edge from a node it takes from" };
        match (self.launch.takes_over(self.name.name(), from), from.topic()) {
            (Some(kind), Some(topic)) => {
                let subscriber = self.edges.subscriber(topic, kind)?;
                // What is published for others to wait for is opened first; here nobody is waited for.
                if self.launch.publishes_over(self.name).is_empty() {
                    self.is_ready();
                }
                Ok(subscriber)
            }
            _ => Err(incomplete),
        }
    }
}

fn on_change(changes: &Changes) -> OnChange {
    let changes = changes.clone();
    Box::new(move |values| changes.take(values))
}

/// This program again, as the gateway of a node; what it is told comes over a socket, the words are for who looks at
/// the list of processes.
pub(crate) fn gateway_command(
    node: &NodeIdentity,
    run: Option<&RunId>,
    has_zenoh: bool,
) -> Result<GatewayCommand, NodeError> {
    let program = std::env::current_exe().map_err(NodeError::Program)?;
    let mut words = vec!["gateway".to_owned(), "--of".to_owned(), node.qualified()];
    words.extend(run.into_iter().flat_map(|run| ["--run".to_owned(), run.to_string()]));
    Ok(Arc::new(move || {
        let mut command = Command::new(&program);
        command.args(&words);
        if has_zenoh {
            // The allocator reserves address space for each of the library's many threads; the gateway has not much of it.
            command.env("MALLOC_ARENA_MAX", "2");
        }
        command
    }))
}

/// A publisher of a topic that nobody else publishes on this host while it lives.
struct Claimed<M> {
    publisher: Box<dyn Publish<M>>,
    /// Samples sent so far.
    sent: Arc<AtomicU64>,
    _claims: Vec<Option<Claim>>,
}

impl<M: Message> Publish<M> for Claimed<M> {
    fn send(&mut self, sample: &M) -> Result<(), TransportError> {
        self.sent.fetch_add(1, Ordering::Relaxed);
        self.publisher.send(sample)
    }

    fn dropped(&self) -> u64 {
        self.publisher.dropped()
    }

    fn subscribers(&self) -> usize {
        self.publisher.subscribers()
    }

    fn others(&self) -> usize {
        self.publisher.others()
    }
}

/// Identity of a program of the user's in the machine's namespace.
pub fn user_identity(namespace: &str, name: &str) -> Result<NodeIdentity, NodeError> {
    NodeIdentity::new(namespace, name).map_err(|error| NodeError::Name(error.to_string()))
}
