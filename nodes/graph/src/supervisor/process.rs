//! One node as a child process: how it is started, what it says, how it is told to end.
//!
//! Place in the flow: under the supervisor. A node runs in a process group of its own, so that Ctrl-C in a terminal
//! reaches the launcher alone and the nodes end in the order that the launcher wants.

use super::SupervisorError;
use crate::launch::NodeName;
use crate::node::told::{PARAMETERS, STATE, rest};
use crate::node::{ALIVE, NodeSummary, READY};
use rustix::process::Signal;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, ChildStderr, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What begins a line that a node passes on from its gateway: such a line is not the node's own last word.
const GATEWAY: &str = "gateway: ";

/// How long the streams of a node that has ended are read on.
const LAST_WORDS: Duration = Duration::from_secs(1);

/// How a node ended.
#[derive(Debug)]
pub(super) struct Ended {
    pub(super) status: ExitStatus,
    /// Last words on its error stream.
    pub(super) words: String,
    pub(super) summary: Option<NodeSummary>,
    pub(super) orders: Orders,
}

/// How a node that was asked to stop came to its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stop {
    /// By itself.
    ByItself,
    /// It took too long, and was ended.
    TooSlow,
    /// Stopping was asked for a second time, and it was ended.
    Hurried,
}

impl Stop {
    /// What is said of a node that was ended.
    pub(super) fn told(self) -> Option<&'static str> {
        match self {
            Stop::ByItself => None,
            Stop::TooSlow => Some("did not stop in time and was ended"),
            Stop::Hurried => Some("was ended by the second signal"),
        }
    }
}

/// What a node was told while it ran, as it said: its next process is given the same.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Orders {
    /// Label of the state that a manager took it to.
    state: Option<String>,
    /// Values of parameters, as JSON.
    parameters: Option<String>,
}

impl Orders {
    /// Takes what is newer.
    pub(super) fn follow(&mut self, newer: Orders) {
        self.state = newer.state.or(self.state.take());
        self.parameters = newer.parameters.or(self.parameters.take());
    }

    /// Words for the command line of a node.
    pub(super) fn options(&self) -> Vec<&str> {
        let stays = self.state.as_deref().filter(|label| rest(label).is_some());
        let stays = stays.into_iter().flat_map(|label| ["--stays", label]);
        stays.chain(self.parameters.iter().flat_map(|json| ["--changed", json])).collect()
    }
}

/// What a node said on its standard output so far.
#[derive(Debug, Default)]
struct Said {
    ready: bool,
    alive: Option<Instant>,
    summary: Option<NodeSummary>,
    orders: Orders,
}

/// A running node.
pub(super) struct NodeProcess {
    name: NodeName,
    child: Child,
    said: Arc<Mutex<Said>>,
    started: Instant,
    /// They end with the streams of the node.
    errors: Option<JoinHandle<String>>,
    output: Option<JoinHandle<()>>,
}

impl NodeProcess {
    /// Starts `command`, which makes the node `name`; remarks of it go to `log` where there is one.
    pub(super) fn start(
        name: NodeName,
        mut command: Command,
        log: Option<Arc<File>>,
    ) -> Result<NodeProcess, SupervisorError> {
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).process_group(0);
        let mut child = command.spawn().map_err(|source| SupervisorError::Start {
            node: name.name(),
            program: command.get_program().into(),
            source,
        })?;
        let said = Arc::new(Mutex::new(Said::default()));
        let listening = Arc::clone(&said);
        let errors =
            child.stderr.take().map(|stream| std::thread::spawn(move || pass_on(name, stream, log.as_deref())));
        let output = child.stdout.take().map(|stream| std::thread::spawn(move || listen(stream, &listening)));
        Ok(NodeProcess { name, child, said, started: Instant::now(), errors, output })
    }

    pub(super) fn id(&self) -> u32 {
        self.child.id()
    }

    /// Whether it has said that it is ready.
    pub(super) fn is_ready(&self) -> bool {
        lock(&self.said).ready
    }

    /// How long its loop has not turned, as far as it is known here.
    pub(super) fn silent_for(&self) -> Duration {
        lock(&self.said).alive.unwrap_or(self.started).elapsed()
    }

    /// How it ended, if it has.
    pub(super) fn ended(&mut self) -> Result<Option<Ended>, SupervisorError> {
        let watch = |source| SupervisorError::Watch { node: self.name.name(), source };
        Ok(self.child.try_wait().map_err(watch)?.map(|status| self.collect(status)))
    }

    /// Asks it to stop, and ends it if it does not within `patience`, or sooner where there is a `hurry`.
    pub(super) fn end(
        &mut self,
        patience: Duration,
        hurry: &dyn Fn() -> bool,
    ) -> Result<(Ended, Stop), SupervisorError> {
        self.signal(Signal::TERM);
        // One that is stopped (Ctrl-Z, a debugger) hears nothing else.
        self.signal(Signal::CONT);
        let since = Instant::now();
        let stop = loop {
            if let Some(ended) = self.ended()? {
                return Ok((ended, Stop::ByItself));
            }
            if hurry() {
                break Stop::Hurried;
            }
            if since.elapsed() >= patience {
                break Stop::TooSlow;
            }
            std::thread::sleep(Duration::from_millis(5));
        };
        tracing::warn!(node = self.name.name(), "{}", stop.told().unwrap_or_default());
        let watch = |source| SupervisorError::Watch { node: self.name.name(), source };
        self.child.kill().map_err(watch)?;
        let status = self.child.wait().map_err(watch)?;
        Ok((self.collect(status), stop))
    }

    fn signal(&self, signal: Signal) {
        if let Some(pid) = i32::try_from(self.child.id()).ok().and_then(rustix::process::Pid::from_raw) {
            // It may have ended by itself in between; then there is nothing to ask.
            let _ = rustix::process::kill_process(pid, signal);
        }
    }

    fn collect(&mut self, status: ExitStatus) -> Ended {
        // What the node started may hold its streams for as long as it lives.
        let since = Instant::now();
        let is_read = |is_finished: bool| is_finished || since.elapsed() >= LAST_WORDS;
        while !(self.errors.as_ref().is_none_or(|thread| is_read(thread.is_finished()))
            && self.output.as_ref().is_none_or(|thread| is_read(thread.is_finished())))
        {
            std::thread::sleep(Duration::from_millis(1));
        }
        let errors = self.errors.take().filter(JoinHandle::is_finished);
        let words = errors.and_then(|thread| thread.join().ok()).unwrap_or_default();
        let output = self.output.take().filter(JoinHandle::is_finished);
        if output.is_some_and(|thread| thread.join().is_err()) {
            tracing::error!(node = self.name.name(), "the thread that reads its output panicked");
        }
        let mut said = lock(&self.said);
        Ended { status, words, summary: said.summary.take(), orders: std::mem::take(&mut said.orders) }
    }
}

impl Ended {
    /// Whether it ended with an error of its own.
    pub(super) fn gave_up(&self) -> bool {
        self.status.code().is_some_and(|code| code != 0)
    }

    /// Whether this is how a node ends that was asked to, also before it could handle the request.
    pub(super) fn is_in_order(&self) -> bool {
        self.status.success() || self.was_interrupted()
    }

    /// Whether it ended by SIGINT or SIGTERM, which a node handles as soon as it can.
    pub(super) fn was_interrupted(&self) -> bool {
        let asked = [Signal::INT, Signal::TERM].map(|signal| Some(signal.as_raw()));
        asked.contains(&self.status.signal())
    }

    /// Exit status and last words.
    pub(super) fn told(&self) -> String {
        let words = if self.words.is_empty() { "(it said nothing)" } else { &self.words };
        format!("{}: {words}", self.status)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Hands on what a node says as it says it: a full pipe would hold the node up in the middle of its work.
fn pass_on(name: NodeName, stream: ChildStderr, log: Option<&File>) -> String {
    let mut last = String::new();
    lines(stream, |words| {
        let line = format!("{}: {words}\n", name.name());
        // One write a line: all nodes share the file.
        let is_logged = log.is_some_and(|mut log| log.write_all(line.as_bytes()).is_ok());
        if !(is_logged && is_remark(words)) {
            // Not `eprint!`: it would end this thread where nobody reads the launcher's own words.
            let _ = std::io::stderr().write_all(line.as_bytes());
        }
        if !words.starts_with(GATEWAY) {
            last = words.to_owned();
        }
    });
    last
}

/// Whether a line of a node's log is a warning or less: `INSTANT LEVEL target: words`, after the name of the gateway where
/// the line is passed on from there. What has no level, such as the words of a panic, is none.
fn is_remark(line: &str) -> bool {
    let line = line.strip_prefix(GATEWAY).unwrap_or(line);
    line.split_whitespace().nth(1).is_some_and(|level| ["WARN", "INFO", "DEBUG", "TRACE"].contains(&level))
}

fn listen(stream: ChildStdout, said: &Mutex<Said>) {
    lines(stream, |words| {
        let mut said = lock(said);
        match words {
            READY => said.ready = true,
            ALIVE => said.alive = Some(Instant::now()),
            words if words.starts_with(STATE) => said.orders.state = words.strip_prefix(STATE).map(str::to_owned),
            words if words.starts_with(PARAMETERS) => {
                said.orders.parameters = words.strip_prefix(PARAMETERS).map(str::to_owned);
            }
            words => said.summary = serde_json::from_str(words).ok().or(said.summary.take()),
        }
    });
}

fn lines(stream: impl Read, mut each: impl FnMut(&str)) {
    let mut stream = BufReader::new(stream);
    let mut line = Vec::new();
    // What cannot be read is only missing from the log.
    while stream.read_until(b'\n', &mut line).is_ok_and(|bytes| bytes > 0) {
        let words = String::from_utf8_lossy(&line);
        if !words.trim_end().is_empty() {
            each(words.trim_end());
        }
        line.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::is_remark;

    #[test]
    fn warnings_and_below_are_remarks_and_nothing_else_is() {
        assert!(is_remark("2026-01-01T00:00:00Z  WARN abbe_graph::node: a pause"));
        assert!(is_remark("gateway: 2026-01-01T00:00:00Z  INFO abbe: words"));
        assert!(!is_remark("2026-01-01T00:00:00Z ERROR abbe_graph::node: broken"));
        assert!(!is_remark("thread 'main' panicked at src/x.rs:1:"));
        assert!(!is_remark("Error: the model WARN"));
    }
}
