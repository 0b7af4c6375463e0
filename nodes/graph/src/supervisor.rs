//! Starts the nodes of a launch as processes, watches them, and leaves nothing behind.
//!
//! Place in the flow: used by `abbe launch` and the demo. Nodes are children that follow their launcher: when it
//! ends, however it ends, they end. Shared memory of the run is removed at the end.

use crate::launch::{Launch, LaunchError, NodeName};
use crate::node::NodeSummary;
use abbe_runtime::{RunId, Shutdown, transport::shared_memory};
use rustix::process::Signal;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use thiserror::Error;

/// How long a node may take to stop before it is ended.
const STOP_PATIENCE: Duration = Duration::from_secs(5);

/// Why a graph could not be run.
#[derive(Debug, Error)]
pub enum SupervisorError {
    /// The launch file.
    #[error(transparent)]
    Launch(#[from] LaunchError),
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
    /// A node ended with an error; its own words stand in the log.
    #[error("node {node} ended with {status}: {words}")]
    Failed {
        /// The node.
        node: &'static str,
        /// Exit status.
        status: String,
        /// Last words on its error stream.
        words: String,
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

struct Running {
    name: NodeName,
    child: Child,
    ended: bool,
    /// Passes on what the node says, and gives its last words when its error stream ends.
    words: Option<JoinHandle<String>>,
}

/// The nodes of one run.
pub struct Supervisor {
    running: Vec<Running>,
    run: RunId,
    /// A source runs outside this launch, so the end of those inside is not the end of the stream.
    fed_from_outside: bool,
}

impl Supervisor {
    /// Starts the nodes of a launch file, those that take before those that give.
    pub fn start(program: &Path, launch_file: &Path, run: RunId) -> Result<Supervisor, SupervisorError> {
        let launch = Launch::read(launch_file)?;
        let mut supervisor = Supervisor { running: Vec::new(), run, fed_from_outside: launch.is_fed_from_outside() };
        for name in NodeName::ALL.into_iter().filter(|name| launch.nodes.contains(name)) {
            let mut child = Command::new(program)
                .args(["node", name.name(), "--launch"])
                .arg(launch_file)
                .args(["--run", supervisor.run.as_str(), "--launcher-pid", &std::process::id().to_string()])
                .stdin(Stdio::null())
                .stdout(Stdio::piped())
                .stderr(Stdio::piped())
                .spawn()
                .map_err(|source| SupervisorError::Start { node: name.name(), program: program.to_owned(), source })?;
            let words = child.stderr.take().map(|stream| std::thread::spawn(move || pass_on(name, stream)));
            supervisor.running.push(Running { name, child, ended: false, words });
        }
        Ok(supervisor)
    }

    /// The run's name.
    pub fn run(&self) -> &RunId {
        &self.run
    }

    /// Process ids of the nodes.
    pub fn process_ids(&self) -> Vec<(NodeName, u32)> {
        self.running.iter().map(|node| (node.name, node.child.id())).collect()
    }

    /// Whether this node has ended by itself; a failure is an error.
    pub fn has_ended(&mut self, name: NodeName) -> Result<bool, SupervisorError> {
        self.check()?;
        Ok(self.running.iter().filter(|node| node.name == name).all(|node| node.ended))
    }

    /// Looks after all nodes; a failure of one is an error.
    pub fn check(&mut self) -> Result<(), SupervisorError> {
        for node in self.running.iter_mut().filter(|node| !node.ended) {
            let watch = |source| SupervisorError::Watch { node: node.name.name(), source };
            if let Some(status) = node.child.try_wait().map_err(watch)? {
                node.ended = true;
                if !status.success() && !was_asked_to_stop(status) {
                    let words = node.words.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
                    let words = if words.is_empty() { "(it said nothing)".to_owned() } else { words };
                    return Err(SupervisorError::Failed { node: node.name.name(), status: status.to_string(), words });
                }
            }
        }
        Ok(())
    }

    /// Stops all nodes, those that give before those that take, and collects what they did.
    pub fn stop(mut self) -> Result<Vec<NodeSummary>, SupervisorError> {
        let order = [
            NodeName::Scale,
            NodeName::Tracer,
            NodeName::Geometric,
            NodeName::Residual,
            NodeName::Monitor,
            NodeName::Recorder,
        ];
        let mut summaries = Vec::new();
        for name in order {
            if let Some(node) = self.running.iter_mut().find(|node| node.name == name) {
                node.end();
                let words = rest(node.child.stdout.take());
                summaries.extend(words.lines().filter_map(|line| serde_json::from_str::<NodeSummary>(line).ok()));
            }
        }
        Ok(summaries)
    }

    /// Waits until every source has ended or `shutdown` is raised. A graph that is fed from outside, or has no
    /// source at all, waits for `shutdown` alone.
    pub fn wait_for_sources(&mut self, shutdown: &Shutdown) -> Result<(), SupervisorError> {
        let sources = [NodeName::Scale, NodeName::Tracer];
        let ends = !self.fed_from_outside && self.running.iter().any(|node| sources.contains(&node.name));
        while !shutdown.requested() {
            if self.has_ended(NodeName::Scale)? && self.has_ended(NodeName::Tracer)? && ends {
                break;
            }
            shutdown.sleep(Duration::from_millis(20));
        }
        Ok(())
    }
}

impl Running {
    /// Asks the process to stop, and ends it if it does not.
    fn end(&mut self) {
        if self.ended {
            return;
        }
        if let Some(pid) = i32::try_from(self.child.id()).ok().and_then(rustix::process::Pid::from_raw) {
            // It may have ended by itself in between; then there is nothing to ask.
            let _ = rustix::process::kill_process(pid, Signal::TERM);
        }
        let since = Instant::now();
        while since.elapsed() < STOP_PATIENCE {
            if !matches!(self.child.try_wait(), Ok(None)) {
                self.ended = true;
                return;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        tracing::warn!(node = self.name.name(), "did not stop in time and is ended");
        let _ = self.child.kill();
        let _ = self.child.wait();
        self.ended = true;
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        self.running.iter_mut().for_each(Running::end);
        if let Err(error) = shared_memory::cleanup(&self.run) {
            tracing::warn!(%error, "shared memory of the run could not be removed");
        }
    }
}

/// Whether a node ended by a request to stop that came before it could handle one (Ctrl-C while it starts).
fn was_asked_to_stop(status: ExitStatus) -> bool {
    [Signal::INT, Signal::TERM].map(|signal| Some(signal.as_raw())).contains(&status.signal())
}

/// Hands on what a node says as it says it: a full pipe would hold the node up in the middle of its work.
fn pass_on(name: NodeName, stream: ChildStderr) -> String {
    let mut last = String::new();
    let mut stream = BufReader::new(stream);
    let mut line = Vec::new();
    // What cannot be read is only missing from the log.
    while stream.read_until(b'\n', &mut line).is_ok_and(|bytes| bytes > 0) {
        let words = String::from_utf8_lossy(&line).trim_end().to_owned();
        if !words.is_empty() {
            // Not `eprintln!`: it would end this thread where nobody reads the launcher's own words.
            let _ = writeln!(std::io::stderr(), "{}: {words}", name.name());
            last = words;
        }
        line.clear();
    }
    last
}

fn rest(stream: Option<impl Read>) -> String {
    let mut text = Vec::new();
    if let Some(mut stream) = stream {
        // What cannot be read is only missing from a report.
        let _ = stream.read_to_end(&mut text);
    }
    String::from_utf8_lossy(&text).into_owned()
}
