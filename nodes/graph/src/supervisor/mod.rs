//! Starts the nodes of a launch as processes, watches them, starts them again, and leaves nothing behind.
//!
//! Place in the flow: used by `abbe launch` and the demo. Nodes are children that follow their launcher: when it
//! ends, however it ends, they end. What becomes of the graph when a node ends by itself stands in [`policy`]. Shared
//! memory of the run is removed at the end.

pub mod policy;
mod process;

use crate::launch::{Instead, Launch, LaunchError, NodeName};
use crate::node::NodeSummary;
use abbe_runtime::realtime::RealtimeError;
use abbe_runtime::transport::shared_memory::{self, CleanupError, SharedMemory};
use abbe_runtime::transport::{DEFAULT_DEPTH, TransportError};
use abbe_runtime::{Claim, ClaimError, RunId, Shutdown};
use policy::{Ending, Ends, Role, Verdict};
use process::{Ended, NodeProcess, Orders};
use std::fs::File;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};
use thiserror::Error;

/// How long a node may take to stop before it is ended.
const STOP_PATIENCE: Duration = Duration::from_secs(5);
/// How often the nodes are looked at.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// How long a signal to a group of processes takes to reach all.
const INTERRUPT_REACHES_ALL: Duration = Duration::from_millis(200);
/// A node whose loop has not turned for so long hangs, or is stopped.
pub const HANGS_AFTER: Duration = Duration::from_secs(5);

/// Why a graph could not be run.
#[derive(Debug, Error)]
pub enum SupervisorError {
    /// The launch file.
    #[error(transparent)]
    Launch(#[from] LaunchError),
    /// The run is in use.
    #[error(transparent)]
    Claim(#[from] ClaimError),
    /// The shared memory of the run.
    #[error(transparent)]
    Memory(#[from] TransportError),
    /// Real time that the system does not allow.
    #[error(transparent)]
    Realtime(#[from] RealtimeError),
    /// A node could not be started.
    #[error("node {node}: cannot start {program}: {source}")]
    Start {
        /// The node.
        node: &'static str,
        /// The program.
        program: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A node ended and is not started again; its own words stand in the log.
    #[error("node {node} ended with {told}{remedy}")]
    Failed {
        /// The node.
        node: &'static str,
        /// Exit status, and its last words.
        told: String,
        /// Why it is not started again.
        remedy: &'static str,
        /// Whether it was interrupted before it could handle that.
        interrupted: bool,
    },
    /// The file for what the nodes say.
    #[error("{path}: the log of the nodes cannot be written: {source}")]
    Log {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A node could not be watched.
    #[error("node {node}: cannot be watched: {source}")]
    Watch {
        /// The node.
        node: &'static str,
        /// Why.
        source: std::io::Error,
    },
}

/// What the nodes did, and what went wrong.
#[derive(Debug, Default)]
pub struct Stopped {
    /// The last words of each node that had any.
    pub summaries: Vec<NodeSummary>,
    /// Nodes that were given up, did not stop in time, or ended with an error: each a sentence. Nothing for a good run.
    pub problems: Vec<String>,
}

/// A node of this launch, running or not.
struct Node {
    name: NodeName,
    role: Role,
    state: State,
    ends: Ends,
    /// How often it has been started again.
    restarts: u32,
    was_ready: bool,
    told_hanging: bool,
    /// What it was told so far.
    orders: Orders,
    /// What it said at its end, if that was in order.
    summary: Option<NodeSummary>,
}

enum State {
    Running(NodeProcess),
    /// To be started again then.
    Due(Instant),
    Done,
    GivenUp,
}

/// What every node of a launch is given beside the launch file.
#[derive(Debug, Clone, Default)]
pub struct Given {
    /// Files to be used instead of those that the launch file names.
    pub instead: Instead,
    /// ROS arguments, as they stand after `--ros-args`.
    pub ros_words: Vec<String>,
    /// File that takes the remarks of the nodes (warnings and below) in place of the error stream; everything else they say
    /// goes to both.
    pub log: Option<PathBuf>,
}

fn open_log(path: &Path) -> Result<Arc<File>, SupervisorError> {
    let log = |source| SupervisorError::Log { path: path.to_owned(), source };
    File::create(path).map(Arc::new).map_err(log)
}

/// The nodes of one run.
pub struct Supervisor {
    nodes: Vec<Node>,
    run: RunId,
    /// Keeps others from a launch under this name.
    _claim: Claim,
    program: PathBuf,
    launch_file: PathBuf,
    given: Given,
    log: Option<Arc<File>>,
    /// The launcher takes part in the run, so that nobody removes its files while a node is being started again.
    memory: Option<SharedMemory>,
    problems: Vec<String>,
    /// A source runs outside this launch, so the end of those inside is not the end of the stream.
    fed_from_outside: bool,
}

impl Supervisor {
    /// Starts the nodes of a launch file, those that take before those that give.
    pub fn start(program: &Path, launch_file: &Path, run: RunId) -> Result<Supervisor, SupervisorError> {
        Supervisor::start_with(program, launch_file, run, Given::default())
    }

    /// The same, with what every node is given.
    pub fn start_with(
        program: &Path,
        launch_file: &Path,
        run: RunId,
        given: Given,
    ) -> Result<Supervisor, SupervisorError> {
        let launch = Launch::read_with(launch_file, &given.instead)?;
        // Before anything runs: nodes that are refused one after the other would say the same.
        if let Some(realtime) = launch.realtime() {
            realtime.try_out()?;
            launch.realtime_remark().inspect(|remark| tracing::warn!("{remark}"));
        }
        let claim = Claim::of_run(&run)?;
        remove_crashed(&run);
        let leftovers = shared_memory::remove_leftovers();
        if leftovers > 0 {
            tracing::info!(runs = leftovers, "removed what crashed runs had left in shared memory");
        }
        let depth = NonZeroUsize::MIN.saturating_add(DEFAULT_DEPTH - 1);
        let memory = Some(SharedMemory::join(&run, depth)?);
        let mut supervisor = Supervisor {
            nodes: Vec::new(),
            run,
            _claim: claim,
            program: program.to_owned(),
            launch_file: launch_file.to_owned(),
            log: given.log.as_deref().map(open_log).transpose()?,
            given,
            memory,
            problems: Vec::new(),
            fed_from_outside: launch.is_fed_from_outside(),
        };
        for name in NodeName::ALL.into_iter().filter(|name| launch.nodes.contains(name)) {
            let process = supervisor.spawn(name, 0, &Orders::default())?;
            supervisor.nodes.push(Node::new(name, Role::of(name, &launch), process));
        }
        Ok(supervisor)
    }

    /// The run's name.
    pub fn run(&self) -> &RunId {
        &self.run
    }

    /// Process ids of the nodes that run.
    pub fn process_ids(&self) -> Vec<(NodeName, u32)> {
        let running = self.nodes.iter().filter_map(|node| Some((node.name, node.process()?.id())));
        running.collect()
    }

    /// Whether this node has ended for good; looks after all nodes as [`Supervisor::check`] does.
    pub fn has_ended(&mut self, name: NodeName) -> Result<bool, SupervisorError> {
        self.check()?;
        Ok(self.is_over(name))
    }

    fn is_over(&self, name: NodeName) -> bool {
        let ended = |node: &Node| matches!(node.state, State::Done | State::GivenUp);
        self.nodes.iter().filter(|node| node.name == name).all(ended)
    }

    /// Looks after all nodes: starts again what has ended unasked, as its role wants it.
    ///
    /// # Errors
    /// When the launch is to end because of a node.
    pub fn check(&mut self) -> Result<(), SupervisorError> {
        for index in 0..self.nodes.len() {
            let node = &mut self.nodes[index];
            match &mut node.state {
                State::Running(process) => match process.ended()? {
                    Some(ended) => self.judge(index, ended)?,
                    None => node.look(),
                },
                State::Due(at) if Instant::now() >= *at => self.start_again(index)?,
                State::Due(_) | State::Done | State::GivenUp => {}
            }
        }
        Ok(())
    }

    /// Whether every node of the correcting path runs, has been ready and turns its loop; a source that is done counts.
    pub fn is_healthy(&self) -> bool {
        self.nodes.iter().filter(|node| node.role != Role::Beside).all(|node| match &node.state {
            State::Running(process) => node.was_ready && process.silent_for() < HANGS_AFTER,
            State::Done => true,
            State::Due(_) | State::GivenUp => false,
        })
    }

    /// Stops all nodes, those that give before those that take, and collects what they did. `shutdown` says when
    /// somebody is in a hurry.
    pub fn stop(mut self, shutdown: &Shutdown) -> Result<Stopped, SupervisorError> {
        self.end_all(&|| shutdown.is_urgent())?;
        let summaries = self.nodes.iter_mut().filter_map(Node::summary).collect();
        Ok(Stopped { summaries, problems: std::mem::take(&mut self.problems) })
    }

    /// Waits until every source has ended or `shutdown` is raised. A graph that is fed from outside, or has no
    /// source at all, waits for `shutdown` alone. `beside` runs with every look at the nodes.
    pub fn wait_for_sources(
        &mut self,
        shutdown: &Shutdown,
        mut beside: impl FnMut(&Supervisor),
    ) -> Result<(), SupervisorError> {
        let ends = !self.fed_from_outside && self.nodes.iter().any(|node| node.role.is_source());
        while !shutdown.requested() {
            match self.sources_have_ended() {
                Ok(true) if ends => break,
                Ok(_) => {}
                // Ctrl-C reaches a node that is just being started, and not yet in a group of its own, as well.
                Err(SupervisorError::Failed { interrupted: true, .. }) if shutdown.sleep(INTERRUPT_REACHES_ALL) => {
                    break;
                }
                Err(error) => return Err(error),
            }
            beside(self);
            shutdown.sleep(LOOK_EVERY);
        }
        Ok(())
    }

    fn sources_have_ended(&mut self) -> Result<bool, SupervisorError> {
        self.check()?;
        Ok([NodeName::Scale, NodeName::Tracer].into_iter().all(|name| self.is_over(name)))
    }

    /// Starts the process of a node; `life` is 0 for the first.
    fn spawn(&self, name: NodeName, life: u32, orders: &Orders) -> Result<NodeProcess, SupervisorError> {
        let mut command = Command::new(&self.program);
        command.args(["node", name.name(), "--launch"]).arg(&self.launch_file);
        command.args(["--run", self.run.as_str(), "--launcher-pid", &std::process::id().to_string()]);
        if life > 0 {
            command.args(["--life", &life.to_string()]);
        }
        command.args(orders.options());
        command.args(self.given.instead.options());
        if !self.given.ros_words.is_empty() {
            command.arg("--ros-args").args(&self.given.ros_words);
        }
        NodeProcess::start(name, command, self.log.clone())
    }

    fn judge(&mut self, index: usize, ended: Ended) -> Result<(), SupervisorError> {
        let node = &mut self.nodes[index];
        node.notice_ready();
        let recording_ended =
            ended.status.success() && ended.summary.as_ref().is_some_and(|summary| summary.recording_ended);
        let ending = Ending { recording_ended, gave_up: ended.gave_up(), was_ready: node.was_ready };
        let name = node.name.name();
        let interrupted = ended.was_interrupted();
        let failed = |remedy| Err(SupervisorError::Failed { node: name, told: ended.told(), remedy, interrupted });
        match node.ends.judge(node.role, ending, Instant::now()) {
            Verdict::Done => {
                node.state = State::Done;
                node.summary = ended.summary;
                Ok(())
            }
            Verdict::StartAgain(wait) => {
                tracing::warn!(node = name, "ended unasked with {}; it is started again in {wait:?}", ended.told());
                node.orders.follow(ended.orders);
                let orders = node.orders.options().join(" ");
                if !orders.is_empty() {
                    tracing::warn!(node = name, "is started as it was told while it ran: {orders}");
                }
                node.state = State::Due(Instant::now() + wait);
                Ok(())
            }
            Verdict::GoOnWithout => {
                let problem =
                    format!("node {name} was given up after {} ends: {}", policy::GIVEN_UP_AFTER, ended.told());
                tracing::error!("{problem}; the others go on without it");
                self.problems.push(problem);
                self.nodes[index].state = State::GivenUp;
                Ok(())
            }
            Verdict::EndLaunch => {
                node.state = State::GivenUp;
                failed(match (node.role, ending.was_ready) {
                    (_, false) => "",
                    (Role::Recording, _) => "; a source is not started again, because its recording would begin anew",
                    (Role::Live, _) if ending.gave_up => "",
                    _ => "; it was started again and ended again, and correction is not possible without it",
                })
            }
        }
    }

    fn start_again(&mut self, index: usize) -> Result<(), SupervisorError> {
        // The places of the dead become free for the new one.
        if let Some(memory) = &self.memory {
            memory.remove_dead_nodes();
        }
        let (name, life) = (self.nodes[index].name, self.nodes[index].restarts + 1);
        let process = self.spawn(name, life, &self.nodes[index].orders)?;
        let node = &mut self.nodes[index];
        (node.state, node.restarts) = (State::Running(process), life);
        Ok(())
    }

    /// Ends every node, givers first; what goes wrong is added to the problems. A hurry leaves the recorder its time: what it has must be a
    /// bag that can be read.
    fn end_all(&mut self, hurry: &dyn Fn() -> bool) -> Result<(), SupervisorError> {
        // Those that give before those that take, so that what is under way arrives.
        for name in NodeName::ALL.into_iter().rev() {
            let Some(node) = self.nodes.iter_mut().find(|node| node.name == name) else { continue };
            let State::Running(process) = &mut node.state else { continue };
            let hurry = || name != NodeName::Recorder && hurry();
            let (ended, stop) = process.end(STOP_PATIENCE, &hurry)?;
            node.notice_ready();
            // One that was still starting has nothing to lose: it may not look whether to stop, or miss others that have.
            let problem = match (node.was_ready, stop.told()) {
                (false, _) => None,
                (true, Some(words)) => Some(format!("node {} {words}", name.name())),
                (true, None) if ended.is_in_order() => None,
                (true, None) => Some(format!("node {} ended with {}", name.name(), ended.told())),
            };
            self.problems.extend(problem);
            (node.state, node.summary) = (State::Done, ended.summary);
        }
        Ok(())
    }
}

/// Removes what an earlier run of this name left when it crashed. While a process of it lives, such as a user's program
/// that waits for this launch, all of it stays.
fn remove_crashed(run: &RunId) {
    match shared_memory::cleanup(run) {
        Ok(()) => {}
        Err(error @ CleanupError::Alive { .. }) => tracing::debug!(%error, "what an earlier run left stays for now"),
        Err(error) => tracing::warn!(%error, "what an earlier run of this name left could not be removed"),
    }
}

impl Node {
    fn new(name: NodeName, role: Role, process: NodeProcess) -> Node {
        let (ends, state) = (Ends::default(), State::Running(process));
        Node {
            name,
            role,
            state,
            ends,
            restarts: 0,
            was_ready: false,
            told_hanging: false,
            orders: Orders::default(),
            summary: None,
        }
    }

    fn process(&self) -> Option<&NodeProcess> {
        match &self.state {
            State::Running(process) => Some(process),
            _ => None,
        }
    }

    fn notice_ready(&mut self) {
        self.was_ready |= self.process().is_some_and(NodeProcess::is_ready);
    }

    /// Notices that it is ready, and that it hangs.
    fn look(&mut self) {
        self.notice_ready();
        let silent = self.process().map_or(Duration::ZERO, NodeProcess::silent_for);
        let hangs = self.was_ready && silent >= HANGS_AFTER;
        if hangs && !self.told_hanging {
            tracing::warn!(node = self.name.name(), "has not looked up for {HANGS_AFTER:?}: it hangs, or is stopped");
        }
        self.told_hanging = hangs;
    }

    /// Its last words, with how often it was started again.
    fn summary(&mut self) -> Option<NodeSummary> {
        let mut summary = self.summary.take()?;
        summary.figures.insert("restarts".to_owned(), f64::from(self.restarts));
        Some(summary)
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        if let Err(error) = self.end_all(&|| false) {
            tracing::warn!(%error, "the nodes could not all be ended");
        }
        // The launcher leaves the run before its files go.
        self.memory = None;
        if let Err(error) = shared_memory::cleanup(&self.run) {
            tracing::warn!(%error, "shared memory of the run could not be removed");
        }
    }
}
