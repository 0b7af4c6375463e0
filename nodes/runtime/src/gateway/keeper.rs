//! Keeps a gateway running: starts its process, listens to it, starts it again when it ends or falls silent.
//!
//! Place in the flow: a thread of the node, beside the one that corrects. A gateway is never given up: it costs nobody
//! anything but itself, and what keeps it from working (a network that is down, a flood of packets) may pass. The first
//! new start comes after 0.1 s, later ones after up to 1 s while it keeps ending within 10 s. The same holds for the first
//! one; only what cannot pass (no program to start, a name that the graph refuses) ends the node.

use std::os::fd::OwnedFd;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use super::protocol::{Channel, FromGateway, Join, Received, ToGateway};
use super::shared::Shared;
use crate::lock::lock;

/// Makes the command that is a gateway.
pub type GatewayCommand = Arc<dyn Fn() -> Command + Send + Sync>;

/// Wait before the first new start, and the longest.
const FIRST_WAIT: Duration = Duration::from_millis(100);
const LONGEST_WAIT: Duration = Duration::from_secs(1);
/// A gateway that ran for so long is no longer one that keeps ending.
const RAN_WELL: Duration = Duration::from_secs(10);
/// Longest that joining the graph may take.
const JOIN_WITHIN: Duration = Duration::from_secs(15);
/// How long the keeper listens at a time.
const LISTEN: Duration = Duration::from_millis(50);
/// Silence after which a gateway is ended; only time in which this process itself ran counts.
const SILENT_TOO_LONG: Duration = Duration::from_secs(5);
const LONGEST_STEP: Duration = Duration::from_millis(100);
/// Longest that a gateway may take to leave the graph.
const LEAVE_WITHIN: Duration = Duration::from_secs(4);
/// How often the same reason why there is no gateway is told.
const SAY_EVERY: Duration = Duration::from_secs(60);

/// The keeper's own.
pub(super) struct Keeper {
    pub(super) shared: Arc<Shared>,
    pub(super) command: GatewayCommand,
    /// What the next gateway is to be; values of parameters may change.
    pub(super) join: Arc<Mutex<Join>>,
}

/// A gateway's process.
struct Life {
    child: Child,
    channel: Arc<Channel>,
    since: Instant,
}

/// Why there is no gateway.
struct NotStarted {
    why: String,
    /// Whether it may be otherwise at another try.
    may_pass: bool,
}

impl Keeper {
    /// Starts the first gateway.
    ///
    /// # Errors
    /// What will not pass. After a failure that may, [`Keeper::keep`] tries again.
    pub(super) fn first(&self) -> Result<FirstLife, String> {
        match self.start() {
            Ok(life) => Ok(FirstLife(Ok(life))),
            Err(NotStarted { why, may_pass: true }) => Ok(FirstLife(Err(why))),
            Err(NotStarted { why, may_pass: false }) => Err(why),
        }
    }

    /// Keeps a gateway running until the node is done with it.
    pub(super) fn keep(self, FirstLife(first): FirstLife) {
        let mut wait = FIRST_WAIT;
        let mut next = match first {
            Ok(life) => Some(life),
            Err(why) => self.start_again(&mut wait, Some(why)),
        };
        while let Some(mut life) = next {
            let why = self.listen(&life);
            self.shared.down();
            if self.shared.is_leaving() {
                self.see_off(life);
                return;
            }
            let ran_well = life.since.elapsed() >= RAN_WELL;
            let status = end(&mut life.child);
            self.shared.restarting(&why);
            tracing::warn!(status, "the gateway to DDS has ended: {why}; it is started again");
            wait = if ran_well { FIRST_WAIT } else { wait };
            next = self.start_again(&mut wait, None);
        }
    }

    /// Tries until a gateway has joined; none when the node leaves before. `failed` says why the try before this did not.
    fn start_again(&self, wait: &mut Duration, mut failed: Option<String>) -> Option<Life> {
        let mut said: Option<(String, Instant)> = None;
        loop {
            if let Some(why) = failed {
                self.shared.restarting(&why);
                if said.as_ref().is_none_or(|(before, at)| *before != why || at.elapsed() >= SAY_EVERY) {
                    tracing::warn!(
                        "no gateway to DDS: {why}; it is tried again, and the node works without DDS meanwhile"
                    );
                    said = Some((why, Instant::now()));
                }
            }
            if self.shared.sleep_unless_leaving(*wait) {
                return None;
            }
            *wait = (*wait * 2).min(LONGEST_WAIT);
            // What the dead gateway held in shared memory becomes free for the next.
            self.shared.memory().remove_dead_nodes();
            match self.start() {
                Ok(life) => {
                    said.inspect(|_| tracing::warn!("the gateway to DDS runs now"));
                    return Some(life);
                }
                Err(NotStarted { why, .. }) => failed = Some(why),
            }
        }
    }

    /// A gateway that has joined the graph and opened what the node has open.
    fn start(&self) -> Result<Life, NotStarted> {
        let for_good = |why| NotStarted { why, may_pass: false };
        let pair = Channel::pair().map_err(|error| for_good(format!("no socket to it: {error}")));
        let (channel, theirs) = pair?;
        let mut child = spawn(&self.command, theirs).map_err(for_good)?;
        let channel = Arc::new(channel);
        let joined = channel
            .send(&ToGateway::Join(Box::new(lock(&self.join).clone())))
            .map_err(|error| NotStarted { why: format!("it cannot be spoken to: {error}"), may_pass: true })
            .and_then(|()| self.await_joined(&channel));
        match joined {
            Ok(()) => {
                self.shared.up(&channel);
                Ok(Life { child, channel, since: Instant::now() })
            }
            Err(failure) => {
                end(&mut child);
                Err(failure)
            }
        }
    }

    fn await_joined(&self, channel: &Channel) -> Result<(), NotStarted> {
        let not_yet = |why: String| NotStarted { why, may_pass: true };
        let mut patience = Patience::new(JOIN_WITHIN);
        while !patience.is_over() && !self.shared.is_leaving() {
            match channel.receive(LISTEN) {
                Received::Packet(FromGateway::Joined) => return Ok(()),
                Received::Packet(FromGateway::Refused { reason: why, may_pass }) => {
                    return Err(NotStarted { why, may_pass });
                }
                Received::Packet(_) | Received::Nothing => {}
                Received::End => return Err(not_yet("it ended before it had joined the graph".to_owned())),
            }
        }
        Err(not_yet(format!("it has not joined the graph within {JOIN_WITHIN:?}")))
    }

    /// Hears the gateway until it ends, falls silent, or is not wanted any more. Says why.
    fn listen(&self, life: &Life) -> String {
        let mut patience = Patience::new(SILENT_TOO_LONG);
        loop {
            if self.shared.is_leaving() {
                return "the node is stopping".to_owned();
            }
            match life.channel.receive(LISTEN) {
                Received::Packet(packet) => {
                    patience = Patience::new(SILENT_TOO_LONG);
                    self.shared.hear(packet);
                }
                Received::Nothing if patience.is_over() => {
                    return format!("it has been silent for {SILENT_TOO_LONG:?}");
                }
                Received::Nothing => {}
                Received::End => return "its own words stand above".to_owned(),
            }
        }
    }

    /// Lets the last gateway take its leave of the graph.
    fn see_off(&self, Life { mut child, channel, .. }: Life) {
        // Where the socket is full, its end says the same.
        let _ = channel.send(&ToGateway::Leave);
        drop(channel);
        let since = Instant::now();
        while since.elapsed() < LEAVE_WITHIN {
            if !matches!(child.try_wait(), Ok(None)) {
                return;
            }
            thread::sleep(Duration::from_millis(5));
        }
        tracing::warn!("the gateway to DDS does not end, and is ended");
        end(&mut child);
    }
}

/// The first gateway, which has joined the graph, or why it has not yet.
pub(super) struct FirstLife(Result<Life, String>);

fn spawn(command: &GatewayCommand, socket: OwnedFd) -> Result<Child, String> {
    let mut command = command();
    command.stdin(Stdio::from(socket)).stdout(Stdio::null());
    let program = command.get_program().to_owned();
    command.spawn().map_err(|error| format!("{}: {error}", program.display()))
}

/// Ends the process if it has not ended itself; says how it ended.
fn end(child: &mut Child) -> String {
    // A moment for its own exit code.
    for _ in 0..20 {
        match child.try_wait() {
            Ok(Some(status)) => return status.to_string(),
            Ok(None) => thread::sleep(Duration::from_millis(5)),
            Err(_) => break,
        }
    }
    let _ = child.kill();
    child.wait().map_or_else(|error| error.to_string(), |status| status.to_string())
}

/// Time that passes only while this process runs: one that was stopped itself has waited for nobody.
struct Patience {
    left: Duration,
    looked_at: Instant,
}

impl Patience {
    fn new(left: Duration) -> Patience {
        Patience { left, looked_at: Instant::now() }
    }

    fn is_over(&mut self) -> bool {
        let step = self.looked_at.elapsed().min(LONGEST_STEP);
        self.looked_at = Instant::now();
        self.left = self.left.saturating_sub(step);
        self.left.is_zero()
    }
}
