//! The gateway's process: it joins the graph as its node, moves samples, and ends when DDS or its node does.
//!
//! Place in the flow: `abbe gateway`, started by the node with one end of a socket as standard input. The process may
//! die at any time; nothing that corrects is in it.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::{Duration, Instant};

use abbe_msgs::Stamp;
use abbe_msgs::standard::{DiagnosticArray, Log};
use rustix::process::{Resource, Rlimit, Signal, setrlimit};
use thiserror::Error;

use super::calls::Calls;
use super::clock::ClockReader;
use super::companion::stand;
use super::health::{Dead, Heartbeat};
use super::protocol::{Asked, Beat, Channel, Endpoint, FromGateway, Join, PARAMETERS, Progress, Received, ToGateway};
use super::streams::{Stream, World};
use crate::log_lines::LogLine;
use crate::ros::{
    Clock, Domain, LifecycleServices, QueuedPublisher, RosError, RosNode, TriggerService, diagnostics_qos, rosout_qos,
};
use crate::transport::TransportError;
use crate::transport::shared_memory::{self, SharedMemory};
use crate::transport::zenoh::{ZenohConfig, ZenohSession};
use crate::{RunId, RunIdError};

/// How long the first word of the node may take.
const FIRST_WORD: Duration = Duration::from_secs(10);
/// How long the loop waits for a word of the node.
const LOOK_UP: Duration = Duration::from_millis(20);
/// Time between beats to the node.
const BEAT_EVERY: Duration = Duration::from_millis(100);
/// What was published last needs a moment to leave.
const LAST_WORDS: Duration = Duration::from_millis(100);
/// Longest that leaving may take.
const LEAVE_WITHIN: Duration = Duration::from_secs(3);
/// Reports waiting to be published; older ones say nothing any more.
const REPORTS: NonZeroUsize = NonZeroUsize::MIN.saturating_add(31);
/// Lines of the log waiting to be published.
const LINES: NonZeroUsize = NonZeroUsize::MIN.saturating_add(255);
/// Exit code of a gateway that could not leave in time.
const STUCK_EXIT_CODE: i32 = 70;

/// Why a gateway ended, other than that it was to.
#[derive(Debug, Error)]
pub enum GatewayError {
    /// It was not started by a node.
    #[error("a gateway is started by its node; start the node")]
    NoNode,
    /// The operating system refuses.
    #[error("cannot {what}: {source}")]
    System {
        /// What.
        what: &'static str,
        /// Why.
        source: std::io::Error,
    },
    /// The name of the run.
    #[error(transparent)]
    Run(#[from] RunIdError),
    /// The graph.
    #[error(transparent)]
    Ros(#[from] RosError),
    /// Shared memory, or an endpoint.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// DDS does not work any more.
    #[error("DDS is dead: {reason}; its gateway ends, and is started again by its node")]
    Dead {
        /// What was found.
        reason: String,
    },
}

impl GatewayError {
    /// Whether another try may find it otherwise: the clock is set, the network comes up.
    fn may_pass(&self) -> bool {
        matches!(self, GatewayError::Ros(RosError::Clock { .. } | RosError::Participant { .. }))
    }
}

/// An endpoint that is open.
enum Open {
    Stream(Stream),
    Service(#[allow(dead_code)] TriggerService), // Held until it is closed.
    Standing(#[allow(dead_code)] Box<dyn Send>), // As well.
    Lifecycle(LifecycleServices),
}

struct Gateway {
    // In the order in which they go: endpoints, what they stand on, the node.
    open: BTreeMap<u32, Open>,
    reports: QueuedPublisher<DiagnosticArray>,
    /// The node's log, where it is published.
    log: Option<QueuedPublisher<Log>>,
    clock_reader: Option<ClockReader>,
    /// The time that the node goes by.
    clock: Clock,
    heartbeat: Heartbeat<BTreeMap<u32, Progress>>,
    proved: BTreeMap<u32, Progress>,
    calls: Calls,
    memory: SharedMemory,
    /// Opened with the first endpoint over Zenoh.
    zenoh: OnceCell<ZenohSession>,
    domain: Domain,
    node: RosNode,
    channel: Arc<Channel>,
}

/// Runs the gateway of the node that started this process, until the node ends or DDS does.
///
/// # Errors
/// When the graph cannot be joined, or DDS does not work any more.
pub fn serve() -> Result<(), GatewayError> {
    let system = |what| move |source| GatewayError::System { what, source };
    // A gateway that is stopped (Ctrl-Z, a debugger) when its node ends is woken, so that it ends as well.
    rustix::process::set_parent_process_death_signal(Some(Signal::CONT))
        .map_err(|error| system("follow the node")(error.into()))?;
    let channel = Arc::new(Channel::from_standard_input().map_err(system("hear the node"))?);
    let Received::Packet(ToGateway::Join(join)) = channel.receive(FIRST_WORD) else {
        return Err(GatewayError::NoNode);
    };
    let run: RunId = join.run.parse()?;
    let outcome = match Gateway::join(*join, &run, Arc::clone(&channel)) {
        Ok(gateway) => run_to_its_end(gateway),
        // The node says why, and what becomes of it; one that is gone needs to hear nothing.
        Err(error) => {
            let refused = FromGateway::Refused { reason: error.to_string(), may_pass: error.may_pass() };
            channel.send(&refused).or(Err(error))
        }
    };
    drop(channel);
    shared_memory::cleanup_by_the_last(&run);
    outcome
}

fn run_to_its_end(mut gateway: Gateway) -> Result<(), GatewayError> {
    let outcome = gateway.work();
    match &outcome {
        Ok(()) => gateway.leave()?,
        // Nothing of a dead library can be taken leave of; waiting for it would only cost time.
        Err(_) => std::mem::forget(gateway),
    }
    outcome
}

impl Gateway {
    fn join(join: Join, run: &RunId, channel: Arc<Channel>) -> Result<Gateway, GatewayError> {
        let limit = Some(join.memory_limit_bytes);
        setrlimit(Resource::As, Rlimit { current: limit, maximum: limit })
            .map_err(|error| GatewayError::System { what: "limit the memory", source: error.into() })?;
        let rosout = join.rosout;
        let depth = NonZeroUsize::new(join.depth).unwrap_or(NonZeroUsize::MIN);
        let memory = SharedMemory::join(run, depth)?;
        let options = join.node_options()?;
        let uses_sim_time = options.parameters.uses_sim_time();
        let domain = options.domain;
        let calls = Calls::new(&channel);
        let setting = calls.clone();
        let node =
            RosNode::start_asking(options, Arc::new(move |changes| setting.ask(PARAMETERS, Asked::Set(changes))))?;
        let heartbeat = Heartbeat::open(&node)?;
        let reports = node.publisher(super::DIAGNOSTICS, &diagnostics_qos(), REPORTS)?;
        let log = rosout.then(|| node.publisher(super::ROSOUT, &rosout_qos(), LINES)).transpose()?;
        let clock = if uses_sim_time { Clock::simulated() } else { Clock::of_system() };
        let reader = || ClockReader::open(&node, Arc::clone(&channel), clock.clone());
        let clock_reader = uses_sim_time.then(reader).transpose()?;
        // The node waits for this word.
        channel
            .send(&FromGateway::Joined)
            .map_err(|source| GatewayError::System { what: "answer the node", source })?;
        let (open, proved, zenoh) = (BTreeMap::new(), BTreeMap::new(), OnceCell::new());
        Ok(Gateway {
            open,
            reports,
            log,
            clock_reader,
            clock,
            heartbeat,
            proved,
            calls,
            memory,
            zenoh,
            domain,
            node,
            channel,
        })
    }

    /// Until the node says so or is gone, or DDS is dead.
    fn work(&mut self) -> Result<(), GatewayError> {
        let mut told = Instant::now();
        loop {
            match self.channel.receive(LOOK_UP) {
                Received::Packet(ToGateway::Leave) | Received::End => return Ok(()),
                Received::Packet(packet) => self.follow(packet),
                Received::Nothing => {}
            }
            self.calls.give_up_who_waits_too_long();
            let open = &self.open;
            let progress = || open.iter().filter_map(|(id, open)| Some((*id, open.stream()?.progress()))).collect();
            let back = self.heartbeat.turn(progress).map_err(|Dead(reason)| GatewayError::Dead { reason })?;
            let news = back.is_some();
            self.proved = back.unwrap_or(std::mem::take(&mut self.proved));
            if news || told.elapsed() >= BEAT_EVERY {
                told = Instant::now();
                // A node that does not read (a debugger stopped it) gets the next one.
                let _ = self.channel.send(&FromGateway::Beat(self.beat()));
            }
        }
    }

    fn follow(&mut self, packet: ToGateway) {
        match packet {
            ToGateway::Open(id, endpoint) => {
                let answer = match self.open(id, &endpoint) {
                    Ok(open) => {
                        self.open.insert(id, open);
                        FromGateway::Opened(id)
                    }
                    Err(error) => FromGateway::NotOpened(id, error.to_string()),
                };
                if let Err(error) = self.channel.send(&answer) {
                    tracing::warn!(%error, "the node cannot be answered");
                }
            }
            ToGateway::Close(id) => self.calls.close(id, || drop(self.open.remove(&id))),
            ToGateway::Report(report) => self.reports.publish(report),
            ToGateway::Log(line, stamp_ns) => self.log(line, stamp_ns),
            ToGateway::Answer(call, outcome) => self.calls.answer(call, outcome),
            ToGateway::Moved(id, state, step) => {
                if let Some(Open::Lifecycle(services)) = self.open.get(&id) {
                    services.moved(state, step);
                }
            }
            ToGateway::Join(_) | ToGateway::Leave => {}
        }
    }

    fn log(&self, line: LogLine, stamp_ns: i64) {
        let Some(log) = &self.log else { return };
        let stamp = Stamp::from_nanos(stamp_ns).unwrap_or_default().into();
        // As rclcpp names the logger of a node.
        let name = self.node.identity().qualified().trim_start_matches('/').replace('/', ".");
        let LogLine { level, text: msg, file, line } = line;
        log.publish(Log { stamp, level, name, msg, file, function: String::new(), line });
    }

    fn open(&self, id: u32, endpoint: &Endpoint) -> Result<Open, GatewayError> {
        let zenoh = || self.zenoh();
        let world = World { node: &self.node, memory: &self.memory, zenoh: &zenoh, clock: &self.clock };
        if let Some(stream) = Stream::open(&world, endpoint)? {
            return Ok(Open::Stream(stream));
        }
        let calls = self.calls.clone();
        match endpoint {
            Endpoint::Service(name) => {
                let service = self.node.trigger_service(name, move || calls.ask_and_wait(id, Asked::Trigger))?;
                Ok(Open::Service(service))
            }
            Endpoint::Lifecycle(state, commanded) => {
                let change = move |transition| calls.ask_and_wait(id, Asked::Change(transition));
                Ok(Open::Lifecycle(LifecycleServices::open(&self.node, *state, commanded.then_some(change))?))
            }
            Endpoint::Standing(topic, content) => Ok(Open::Standing(stand(&self.node, topic, content)?)),
            Endpoint::Publication { .. } | Endpoint::Subscription { .. } => Err(GatewayError::NoNode),
        }
    }

    /// The session over Zenoh.
    fn zenoh(&self) -> Result<ZenohSession, TransportError> {
        if let Some(session) = self.zenoh.get() {
            return Ok(session.clone());
        }
        let session = ZenohSession::open(self.node.identity(), self.domain, ZenohConfig::from_environment()?)?;
        Ok(self.zenoh.get_or_init(|| session).clone())
    }

    fn beat(&self) -> Beat {
        let mut beat = Beat { is_proved: self.heartbeat.is_proved(), ..Beat::default() };
        let has_topics = self.open.values().any(|open| open.stream().is_some_and(Stream::has_topic));
        let elsewhere = if has_topics { self.node.published_elsewhere() } else { Vec::new() };
        for (id, stream) in self.open.iter().filter_map(|(id, open)| Some((*id, open.stream()?))) {
            let proved = self.proved.get(&id).copied().unwrap_or_default();
            beat.publications.push((id, stream.publication(proved, &elsewhere)));
            beat.subscriptions.push((id, stream.subscription(&elsewhere)));
        }
        beat
    }

    /// Closes everything in order; ends the process where that takes too long.
    fn leave(self) -> Result<(), GatewayError> {
        let watch = || {
            std::thread::sleep(LEAVE_WITHIN);
            tracing::error!("could not leave the graph within {LEAVE_WITHIN:?}; exiting");
            std::process::exit(STUCK_EXIT_CODE);
        };
        std::thread::Builder::new()
            .name("leaving".into())
            .spawn(watch)
            .map_err(|source| GatewayError::System { what: "watch the way out", source })?;
        super::LEAVING.store(true, std::sync::atomic::Ordering::Relaxed);
        // Services that wait for the node hear that it is leaving.
        self.calls.clear();
        let Gateway { open, reports, log, clock_reader, heartbeat, memory, zenoh, node, .. } = self;
        drop((open, clock_reader));
        std::thread::sleep(LAST_WORDS);
        drop((reports, log, heartbeat, memory, zenoh));
        drop(node);
        Ok(())
    }
}

impl Open {
    fn stream(&self) -> Option<&Stream> {
        match self {
            Open::Stream(stream) => Some(stream),
            Open::Service(_) | Open::Standing(_) | Open::Lifecycle(_) => None,
        }
    }
}
