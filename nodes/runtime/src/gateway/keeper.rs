//! Keeps a gateway running: starts its process, listens to it, starts it again when it ends or falls silent.
//!
//! Place in the flow: a thread of the node, beside the one that corrects. A gateway is never given up: it costs nobody
//! anything but itself, and what keeps it from working (a network that is down, a flood of packets) may pass. The first
//! new start comes after 0.1 s, later ones after up to 1 s while it keeps ending within 10 s.

use std::os::fd::OwnedFd;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use super::node::Shared;
use super::protocol::{Channel, FromGateway, Join, Received, ToGateway};

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

/// The keeper's own.
pub(super) struct Keeper {
    pub(super) shared: Arc<Shared>,
    pub(super) command: GatewayCommand,
    pub(super) join: Join,
}

/// A gateway's process.
struct Life {
    child: Child,
    channel: Arc<Channel>,
    since: Instant,
}

impl Keeper {
    /// Starts the first gateway.
    pub(super) fn first(&self) -> Result<FirstLife, String> {
        self.start().map(FirstLife)
    }

    /// Keeps a gateway running until the node is done with it.
    pub(super) fn keep(self, FirstLife(mut life): FirstLife) {
        let mut wait = FIRST_WAIT;
        loop {
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
            life = loop {
                if self.shared.sleep_unless_leaving(wait) {
                    return;
                }
                wait = (wait * 2).min(LONGEST_WAIT);
                // What the dead gateway held in shared memory becomes free for the next.
                self.shared.memory().remove_dead_nodes();
                match self.start() {
                    Ok(life) => break life,
                    Err(why) => {
                        self.shared.restarting(&why);
                        tracing::warn!("the gateway to DDS cannot be started: {why}; it is tried again");
                    }
                }
            };
        }
    }

    /// A gateway that has joined the graph and opened what the node has open.
    fn start(&self) -> Result<Life, String> {
        let (channel, theirs) = Channel::pair().map_err(|error| format!("no socket to it: {error}"))?;
        let mut child = spawn(&self.command, theirs)?;
        let channel = Arc::new(channel);
        let joined = channel
            .send(&ToGateway::Join(Box::new(self.join.clone())))
            .map_err(|error| format!("it cannot be spoken to: {error}"))
            .and_then(|()| self.await_joined(&channel));
        match joined {
            Ok(()) => {
                self.shared.up(&channel);
                Ok(Life { child, channel, since: Instant::now() })
            }
            Err(why) => {
                end(&mut child);
                Err(why)
            }
        }
    }

    fn await_joined(&self, channel: &Channel) -> Result<(), String> {
        let mut patience = Patience::new(JOIN_WITHIN);
        while !patience.is_over() && !self.shared.is_leaving() {
            match channel.receive(LISTEN) {
                Received::Packet(FromGateway::Joined) => return Ok(()),
                Received::Packet(FromGateway::Refused(why)) => return Err(why),
                Received::Packet(_) | Received::Nothing => {}
                Received::End => return Err("it ended before it had joined the graph".to_owned()),
            }
        }
        Err(format!("it has not joined the graph within {JOIN_WITHIN:?}"))
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

/// The first gateway, which has joined the graph.
pub(super) struct FirstLife(Life);

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
