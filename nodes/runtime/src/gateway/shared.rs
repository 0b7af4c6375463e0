//! What a node keeps for its gateway: everything it has open, to be opened again in the next one, and how the last one fared.
//!
//! Place in the flow: between the handles of the node and the keeper's thread. A gateway may die between any two statements;
//! what is kept here outlives it.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use abbe_msgs::standard::{DiagnosticArray, DiagnosticStatus};

use super::account::Account;
use super::protocol::{Asked, Channel, Endpoint, FromGateway, PARAMETERS, SubscriptionBeat, ToGateway};
use crate::lock::lock;
use crate::log_lines::LogLine;
use crate::ros::{Clock, Diagnostics, LifecycleState, Step, TriggerOutcome};
use crate::transport::shared_memory::SharedMemory;

/// Longest that opening an endpoint may take.
const OPEN_WITHIN: Duration = Duration::from_secs(20);
/// Time between reports of the gateway on `/diagnostics`.
const REPORT_EVERY: Duration = Duration::from_secs(1);
/// How long a new start is worth a warning.
const RECENT: Duration = Duration::from_secs(60);

/// How the gateway of a node has fared.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct GatewayFigures {
    /// How often it was started again.
    pub restarts: u64,
    /// Samples that were not published for want of a gateway, of all publications; an upper bound.
    pub missed: u64,
    /// Why it ended last; nothing if it never did.
    pub last_end: String,
}

/// What the handles and the keeper share.
pub(super) struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    leaving: AtomicBool,
    memory: SharedMemory,
    clock: Clock,
    diagnostics: Mutex<Option<Diagnostics>>,
    /// Where calls are answered that want parameters set.
    setting: Option<Sender<(u64, Asked)>>,
}

#[derive(Default)]
struct State {
    channel: Option<Arc<Channel>>,
    next: u32,
    endpoints: BTreeMap<u32, Known>,
    figures: GatewayFigures,
    ended_at: Option<Instant>,
    reported_at: Option<Instant>,
    is_proved: bool,
    reports_lost: u64,
}

struct Known {
    endpoint: Endpoint,
    /// What the gateway that runs says of it.
    opened: Option<Result<(), String>>,
    end: NodeEnd,
}

/// The node's end of an endpoint.
#[derive(Clone)]
pub(super) enum NodeEnd {
    Publication(Arc<Publication>),
    Subscription(Arc<Mutex<SubscriptionState>>),
    /// Of a service, and of a managed node: where its calls are answered.
    Service(Sender<(u64, Asked)>),
    Standing,
}

/// The node's end of a publication.
#[derive(Default)]
pub(super) struct Publication {
    pub(super) sent: AtomicU64,
    /// Publishers of its topic that are not this node's, as the last gateway said.
    pub(super) others: AtomicUsize,
    account: Mutex<Account>,
}

/// What had to be refused for the node, over all gateways.
#[derive(Debug, Default)]
pub(super) struct SubscriptionState {
    pub(super) malformed: u64,
    /// Publishers of the topic elsewhere, as the last gateway said.
    pub(super) publishers: usize,
    /// Of the gateway that runs, what is in it already.
    of_this_life: u64,
    pub(super) last_reason: String,
}

impl Publication {
    pub(super) fn dropped(&self) -> u64 {
        lock(&self.account).dropped(self.sent.load(Ordering::Relaxed))
    }

    pub(super) fn subscribers(&self) -> usize {
        lock(&self.account).subscribers()
    }

    fn given_up(&self) -> u64 {
        lock(&self.account).given_up()
    }

    fn missed(&self) -> u64 {
        lock(&self.account).missed(self.sent.load(Ordering::Relaxed))
    }
}

impl Known {
    fn given_up(&self) -> u64 {
        match &self.end {
            NodeEnd::Publication(publication) => publication.given_up(),
            NodeEnd::Subscription(_) | NodeEnd::Service(_) | NodeEnd::Standing => 0,
        }
    }
}

impl SubscriptionState {
    fn hear(&mut self, beat: SubscriptionBeat) {
        self.malformed += beat.malformed.saturating_sub(self.of_this_life);
        self.of_this_life = beat.malformed;
        self.publishers = beat.publishers;
        self.last_reason = beat.last_reason;
    }
}

impl Shared {
    pub(super) fn new(memory: SharedMemory, clock: Clock, setting: Option<Sender<(u64, Asked)>>) -> Shared {
        Shared {
            state: Mutex::default(),
            changed: Condvar::new(),
            leaving: AtomicBool::new(false),
            memory,
            clock,
            diagnostics: Mutex::default(),
            setting,
        }
    }

    /// The node leaves the graph, and so does its gateway.
    pub(super) fn leave(&self) {
        self.leaving.store(true, Ordering::Relaxed);
        self.changed.notify_all();
    }

    pub(super) fn is_leaving(&self) -> bool {
        self.leaving.load(Ordering::Relaxed)
    }

    /// Sleeps; whether the node leaves.
    pub(super) fn sleep_unless_leaving(&self, duration: Duration) -> bool {
        let state = lock(&self.state);
        let slept = self.changed.wait_timeout_while(state, duration, |_| !self.is_leaving());
        drop(slept.unwrap_or_else(PoisonError::into_inner));
        self.is_leaving()
    }

    /// A gateway has joined the graph: everything the node has open is opened there.
    pub(super) fn up(&self, channel: &Arc<Channel>) {
        let mut state = lock(&self.state);
        state.channel = Some(Arc::clone(channel));
        state.is_proved = false;
        for (id, known) in &mut state.endpoints {
            known.opened = None;
            tell(channel, &ToGateway::Open(*id, known.endpoint.clone()));
        }
    }

    /// The gateway is gone.
    pub(super) fn down(&self) {
        let mut state = lock(&self.state);
        state.channel = None;
        for known in state.endpoints.values_mut() {
            known.opened = None;
            match &known.end {
                NodeEnd::Publication(publication) => lock(&publication.account).gone(),
                NodeEnd::Subscription(subscription) => lock(subscription).of_this_life = 0,
                NodeEnd::Service(_) | NodeEnd::Standing => {}
            }
        }
        drop(state);
        // Nobody waits for what the next one opens.
        self.changed.notify_all();
    }

    pub(super) fn restarting(&self, why: &str) {
        let mut state = lock(&self.state);
        state.figures.restarts += 1;
        state.figures.last_end = why.to_owned();
        state.ended_at = Some(Instant::now());
    }

    pub(super) fn hear(&self, packet: FromGateway) {
        match packet {
            FromGateway::Opened(id) => self.opened(id, Ok(())),
            FromGateway::NotOpened(id, reason) => {
                tracing::warn!(reason, "the gateway cannot open an endpoint");
                self.opened(id, Err(reason));
            }
            FromGateway::Beat(beat) => {
                let mut state = lock(&self.state);
                state.is_proved = beat.is_proved;
                for (id, beat) in beat.publications {
                    if let Some(NodeEnd::Publication(publication)) = state.endpoints.get(&id).map(|known| &known.end) {
                        publication.others.store(beat.others, Ordering::Relaxed);
                        lock(&publication.account).beat(beat);
                    }
                }
                for (id, beat) in beat.subscriptions {
                    if let Some(NodeEnd::Subscription(subscription)) = state.endpoints.get(&id).map(|known| &known.end)
                    {
                        lock(subscription).hear(beat);
                    }
                }
                drop(state);
                self.report_own();
            }
            // What is being closed answers nobody.
            FromGateway::Call(call, PARAMETERS, asked) => {
                let _ = self.setting.as_ref().map(|calls| calls.send((call, asked)));
            }
            FromGateway::Call(call, service, asked) => {
                let state = lock(&self.state);
                if let Some(NodeEnd::Service(calls)) = state.endpoints.get(&service).map(|known| &known.end) {
                    let _ = calls.send((call, asked));
                }
            }
            FromGateway::Clock(nanos) => self.clock.set(nanos),
            FromGateway::Joined | FromGateway::Refused { .. } => {}
        }
    }

    fn opened(&self, id: u32, outcome: Result<(), String>) {
        let mut state = lock(&self.state);
        if let Some(known) = state.endpoints.get_mut(&id) {
            if let (NodeEnd::Publication(publication), Ok(())) = (&known.end, &outcome) {
                lock(&publication.account).ready(publication.sent.load(Ordering::Relaxed));
            }
            known.opened = Some(outcome);
        }
        drop(state);
        self.changed.notify_all();
    }

    pub(super) fn add(&self, endpoint: Endpoint, end: NodeEnd) -> u32 {
        let mut state = lock(&self.state);
        let id = state.next;
        state.next += 1;
        if let Some(channel) = &state.channel {
            tell(channel, &ToGateway::Open(id, endpoint.clone()));
        }
        state.endpoints.insert(id, Known { endpoint, opened: None, end });
        id
    }

    pub(super) fn remove(&self, id: u32) {
        let mut state = lock(&self.state);
        if let Some(Known { end: NodeEnd::Publication(publication), .. }) = state.endpoints.remove(&id) {
            state.figures.missed += publication.missed();
        }
        if let Some(channel) = &state.channel {
            tell(channel, &ToGateway::Close(id));
        }
    }

    /// Waits until the gateway has opened an endpoint, or says why not. Where there is no gateway just now, the next one
    /// opens it, and nobody waits.
    pub(super) fn await_open(&self, id: u32) -> Result<(), String> {
        let opened = |state: &State| state.endpoints.get(&id).and_then(|known| known.opened.clone());
        let is_pending = |state: &mut State| state.channel.is_some() && opened(state).is_none();
        let waited = self.changed.wait_timeout_while(lock(&self.state), OPEN_WITHIN, is_pending);
        let state = waited.unwrap_or_else(PoisonError::into_inner).0;
        match (opened(&state), &state.channel) {
            (Some(outcome), _) => outcome,
            (None, None) => Ok(()),
            (None, Some(_)) => Err(format!("the gateway has not opened it within {OPEN_WITHIN:?}")),
        }
    }

    pub(super) fn answer(&self, call: u64, outcome: TriggerOutcome) {
        if let Some(channel) = &lock(&self.state).channel {
            tell(channel, &ToGateway::Answer(call, outcome));
        }
    }

    /// A line of the log. Nothing is said of one that cannot be handed on: that would be the next line.
    pub(super) fn log(&self, line: LogLine) {
        let stamp_ns = self.clock.now_ns().and_then(|now_ns| i64::try_from(now_ns).ok()).unwrap_or_default();
        if let Some(channel) = &lock(&self.state).channel {
            let _ = channel.send(&ToGateway::Log(line, stamp_ns));
        }
    }

    /// A managed node has come one step further; the next gateway hears where it stands.
    pub(super) fn moved(&self, id: u32, state_now: LifecycleState, step: Step) {
        let mut state = lock(&self.state);
        if let Some(Known { endpoint: Endpoint::Lifecycle(stands, _), .. }) = state.endpoints.get_mut(&id) {
            *stands = state_now;
        }
        if let Some(channel) = &state.channel {
            tell(channel, &ToGateway::Moved(id, state_now, step));
        }
    }

    pub(super) fn report(&self, report: DiagnosticArray) {
        let mut state = lock(&self.state);
        // A report that finds no gateway, or one that does not listen, is out of date when there is one again.
        let sent = state.channel.as_ref().is_some_and(|channel| channel.send(&ToGateway::Report(report)).is_ok());
        state.reports_lost += u64::from(!sent);
    }

    pub(super) fn figures(&self) -> GatewayFigures {
        let state = lock(&self.state);
        let publications = state.endpoints.values().filter_map(|known| match &known.end {
            NodeEnd::Publication(publication) => Some(publication.missed()),
            _ => None,
        });
        let open: u64 = publications.sum();
        GatewayFigures { missed: state.figures.missed + open, ..state.figures.clone() }
    }

    /// From now on tells how the gateway fares.
    pub(super) fn report_on(&self, diagnostics: Diagnostics) {
        *lock(&self.diagnostics) = Some(diagnostics);
    }

    /// How the gateway fares, on `/diagnostics`.
    fn report_own(&self) {
        let mut state = lock(&self.state);
        if state.reported_at.is_some_and(|at| at.elapsed() < REPORT_EVERY) {
            return;
        }
        state.reported_at = Some(Instant::now());
        let is_recent = state.ended_at.is_some_and(|at| at.elapsed() < RECENT);
        let (is_proved, reports_lost) = (state.is_proved, state.reports_lost);
        let given_up: u64 = state.endpoints.values().map(|known| known.given_up()).sum();
        drop(state);
        let figures = self.figures();
        let (level, message) = match (is_recent, is_proved) {
            (true, _) => (DiagnosticStatus::WARN, "was started again within the last minute"),
            (false, true) => (DiagnosticStatus::OK, "heartbeats come back through DDS"),
            (false, false) => (DiagnosticStatus::OK, "runs; no heartbeat has come back through DDS on this network"),
        };
        let values = [
            ("restarts", figures.restarts.to_string()),
            ("missed", figures.missed.to_string()),
            ("readers given up", given_up.to_string()),
            ("reports lost", reports_lost.to_string()),
            ("last end", figures.last_end),
        ];
        let diagnostics = lock(&self.diagnostics);
        let Some(diagnostics) = diagnostics.as_ref() else { return };
        diagnostics.report("gateway", level, message, values);
    }

    /// The time that the node goes by.
    pub(super) fn clock(&self) -> &Clock {
        &self.clock
    }

    pub(super) fn memory(&self) -> &SharedMemory {
        &self.memory
    }
}

fn tell(channel: &Channel, packet: &ToGateway) {
    if let Err(error) = channel.send(packet) {
        tracing::warn!(%error, "the gateway does not listen");
    }
}
