//! A node's handle to its gateway: endpoints that outlive the process behind them.
//!
//! Place in the flow: what a correcting node has in place of a participant. Endpoints are opened here, kept in a list, and
//! opened again in each new gateway. Nothing here waits for the gateway but the opening itself.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use abbe_msgs::standard::{DiagnosticArray, DiagnosticStatus};

use super::account::Account;
use super::keeper::{GatewayCommand, Keeper};
use super::protocol::{Channel, Endpoint, FromGateway, Join, SubscriptionBeat, ToGateway};
use crate::RunId;
use crate::ros::{Diagnostics, NameError, NodeIdentity, NodeOptions, RemapRule, RosError, TriggerOutcome, resolve};
use crate::transport::TransportError;
use crate::transport::shared_memory::{self, SharedMemory};

/// Longest that opening an endpoint may take.
const OPEN_WITHIN: Duration = Duration::from_secs(20);
/// Time between reports of the gateway on `/diagnostics`.
const REPORT_EVERY: Duration = Duration::from_secs(1);
/// How long a new start is worth a warning.
const RECENT: Duration = Duration::from_secs(60);

/// What a gateway starts with.
pub struct GatewayOptions {
    /// The node in the graph.
    pub node: NodeOptions,
    /// The run whose shared memory is used; none for one of the node's own.
    pub run: Option<RunId>,
    /// Samples a stream can be behind.
    pub depth: NonZeroUsize,
    /// Memory that its process may reserve.
    pub memory_limit_bytes: u64,
    /// What `/diagnostics` says of.
    pub hardware_id: String,
    /// Makes its command.
    pub command: GatewayCommand,
}

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

/// A node's place in the ROS 2 graph, held by another process. Clones, and all endpoints, share it; it leaves when the last
/// is dropped.
#[derive(Clone)]
pub struct GatewayNode(Arc<Inner>);

struct Inner {
    identity: NodeIdentity,
    remaps: Vec<RemapRule>,
    keeper: Option<JoinHandle<()>>,
    shared: Arc<Shared>,
    // Last: the node has left the run when its files go.
    _own_run: OwnRun,
}

/// What the handles and the keeper share.
pub(super) struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    leaving: AtomicBool,
    memory: SharedMemory,
    diagnostics: Mutex<Option<Diagnostics>>,
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
    Service(Sender<u64>),
}

/// The node's end of a publication.
#[derive(Default)]
pub(super) struct Publication {
    pub(super) sent: AtomicU64,
    account: Mutex<Account>,
}

/// What had to be refused for the node, over all gateways.
#[derive(Debug, Default)]
pub(super) struct SubscriptionState {
    pub(super) malformed: u64,
    /// Of the gateway that runs, what is in it already.
    of_this_life: u64,
    pub(super) last_reason: String,
}

impl GatewayNode {
    /// Starts a gateway that joins the graph under the node's name.
    ///
    /// # Errors
    /// When the shared memory cannot be joined, or the gateway cannot be started or cannot join the graph.
    pub fn start(options: GatewayOptions) -> Result<Self, TransportError> {
        let (run, own_run) = match options.run {
            Some(run) => (run, OwnRun(None)),
            None => {
                let own = RunId::unique();
                (own.clone(), OwnRun(Some(own)))
            }
        };
        let memory = SharedMemory::join(&run, options.depth)?.remembering(&options.node.identity.qualified());
        if let Some(name) = options.node.parameters.changeable() {
            let reason =
                format!("parameter '{name}' may change while the node runs, which only its gateway would hear of");
            return Err(RosError::Gateway { reason }.into());
        }
        let join = Join::new(&options.node, run.as_str(), options.depth.get(), options.memory_limit_bytes);
        let shared = Arc::new(Shared::new(memory));
        let keeper = Keeper { shared: Arc::clone(&shared), command: options.command, join };
        let first = keeper.first().map_err(|reason| RosError::Gateway { reason })?;
        let keeper = thread::Builder::new()
            .name("gateway-keeper".into())
            .spawn(move || keeper.keep(first))
            .map_err(|source| RosError::Thread { what: "the gateway's keeper", source })?;
        let NodeOptions { identity, remaps, .. } = options.node;
        let node = Self(Arc::new(Inner { identity, remaps, keeper: Some(keeper), shared, _own_run: own_run }));
        let diagnostics = node.diagnostics(&options.hardware_id);
        *lock(&node.0.shared.diagnostics) = Some(diagnostics);
        Ok(node)
    }

    /// The name of the node in the graph.
    #[must_use]
    pub fn identity(&self) -> &NodeIdentity {
        &self.0.identity
    }

    /// The absolute name of what the node calls `name`, after remapping.
    ///
    /// # Errors
    /// When it is not a ROS 2 name.
    pub fn resolve(&self, name: &str) -> Result<String, NameError> {
        resolve(name, &self.0.identity, &self.0.remaps)
    }

    /// `/diagnostics`, for the health of this node.
    #[must_use]
    pub fn diagnostics(&self, hardware_id: &str) -> Diagnostics {
        let shared = Arc::downgrade(&self.0.shared);
        let send = move |report| {
            if let Some(shared) = shared.upgrade() {
                shared.report(report);
            }
        };
        Diagnostics::over(Box::new(send), &self.0.identity, hardware_id)
    }

    /// A service of type `std_srvs/srv/Trigger`. `handler` runs on a thread of its own.
    ///
    /// # Errors
    /// When the name is wrong or the service cannot be made.
    pub fn trigger_service(
        &self,
        name: &str,
        mut handler: impl FnMut() -> TriggerOutcome + Send + 'static,
    ) -> Result<GatewayService, TransportError> {
        let (calls, asked) = channel();
        let shared = Arc::downgrade(&self.0.shared);
        // Ends with the sender of calls, which the endpoint holds; an answer may be under way then.
        let answering = move || {
            while let Ok(call) = asked.recv() {
                let outcome = handler();
                let Some(shared) = shared.upgrade() else { return };
                shared.answer(call, outcome);
            }
        };
        thread::Builder::new()
            .name("service".into())
            .spawn(answering)
            .map_err(|source| RosError::Thread { what: "a service", source })?;
        let held = self.open(Endpoint::Service(name.to_owned()), NodeEnd::Service(calls))?;
        Ok(GatewayService { _held: held })
    }

    /// How the gateway has fared.
    #[must_use]
    pub fn figures(&self) -> GatewayFigures {
        self.0.shared.figures()
    }

    /// A name in shared memory that no other node has, and no earlier life of this one: gateways of the dead may linger.
    pub(super) fn link_name(&self, topic: &str) -> String {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        format!("{topic}@{}.{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed))
    }

    pub(super) fn memory(&self) -> &SharedMemory {
        self.0.shared.memory()
    }

    /// Opens an endpoint in the gateway, and in every one that comes after it.
    pub(super) fn open(&self, endpoint: Endpoint, end: NodeEnd) -> Result<Held, TransportError> {
        let shared = &self.0.shared;
        let id = shared.add(endpoint, end);
        let held = Held { id, node: self.clone() };
        let reason = match shared.await_open(id) {
            Some(Ok(())) => return Ok(held),
            Some(Err(reason)) => reason,
            None => format!("the gateway has not opened it within {OPEN_WITHIN:?}"),
        };
        Err(RosError::Gateway { reason }.into())
    }
}

impl std::fmt::Debug for GatewayNode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "GatewayNode({})", self.0.identity.qualified())
    }
}

/// A run that nobody else knows; its files go with it.
struct OwnRun(Option<RunId>);

impl Drop for OwnRun {
    fn drop(&mut self) {
        if let Some(run) = &self.0
            && let Err(error) = shared_memory::cleanup(run)
        {
            tracing::warn!(%error, "shared memory of the gateway could not be removed");
        }
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        self.shared.leaving.store(true, Ordering::Relaxed);
        self.shared.changed.notify_all();
        if self.keeper.take().is_some_and(|keeper| keeper.join().is_err()) {
            tracing::error!("the keeper of the gateway panicked");
        }
    }
}

/// An endpoint that is open as long as this is held.
pub(super) struct Held {
    id: u32,
    // Last: the node leaves the graph after its endpoints.
    node: GatewayNode,
}

impl Drop for Held {
    fn drop(&mut self) {
        self.node.0.shared.remove(self.id);
    }
}

/// A running service. Dropping it ends it.
pub struct GatewayService {
    _held: Held,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Publication {
    pub(super) fn dropped(&self) -> u64 {
        lock(&self.account).dropped(self.sent.load(Ordering::Relaxed))
    }

    pub(super) fn subscribers(&self) -> usize {
        lock(&self.account).subscribers()
    }

    fn missed(&self) -> u64 {
        lock(&self.account).missed(self.sent.load(Ordering::Relaxed))
    }
}

impl SubscriptionState {
    fn hear(&mut self, beat: SubscriptionBeat) {
        self.malformed += beat.malformed.saturating_sub(self.of_this_life);
        self.of_this_life = beat.malformed;
        self.last_reason = beat.last_reason;
    }
}

impl Shared {
    fn new(memory: SharedMemory) -> Shared {
        Shared {
            state: Mutex::default(),
            changed: Condvar::new(),
            leaving: AtomicBool::new(false),
            memory,
            diagnostics: Mutex::default(),
        }
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
                NodeEnd::Service(_) => {}
            }
        }
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
            FromGateway::Call(call, service) => {
                let state = lock(&self.state);
                if let Some(NodeEnd::Service(calls)) = state.endpoints.get(&service).map(|known| &known.end) {
                    // A service that is being closed answers nobody.
                    let _ = calls.send(call);
                }
            }
            FromGateway::Joined | FromGateway::Refused(_) => {}
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

    fn add(&self, endpoint: Endpoint, end: NodeEnd) -> u32 {
        let mut state = lock(&self.state);
        let id = state.next;
        state.next += 1;
        if let Some(channel) = &state.channel {
            tell(channel, &ToGateway::Open(id, endpoint.clone()));
        }
        state.endpoints.insert(id, Known { endpoint, opened: None, end });
        id
    }

    fn remove(&self, id: u32) {
        let mut state = lock(&self.state);
        if let Some(Known { end: NodeEnd::Publication(publication), .. }) = state.endpoints.remove(&id) {
            state.figures.missed += publication.missed();
        }
        if let Some(channel) = &state.channel {
            tell(channel, &ToGateway::Close(id));
        }
    }

    fn await_open(&self, id: u32) -> Option<Result<(), String>> {
        let opened = |state: &State| state.endpoints.get(&id).and_then(|known| known.opened.clone());
        let state = lock(&self.state);
        let waited = self.changed.wait_timeout_while(state, OPEN_WITHIN, |state| opened(state).is_none());
        opened(&waited.unwrap_or_else(PoisonError::into_inner).0)
    }

    fn answer(&self, call: u64, outcome: TriggerOutcome) {
        if let Some(channel) = &lock(&self.state).channel {
            tell(channel, &ToGateway::Answer(call, outcome));
        }
    }

    fn report(&self, report: DiagnosticArray) {
        let mut state = lock(&self.state);
        // A report that finds no gateway, or one that does not listen, is out of date when there is one again.
        let sent = state.channel.as_ref().is_some_and(|channel| channel.send(&ToGateway::Report(report)).is_ok());
        state.reports_lost += u64::from(!sent);
    }

    fn figures(&self) -> GatewayFigures {
        let state = lock(&self.state);
        let publications = state.endpoints.values().filter_map(|known| match &known.end {
            NodeEnd::Publication(publication) => Some(publication.missed()),
            _ => None,
        });
        let open: u64 = publications.sum();
        GatewayFigures { missed: state.figures.missed + open, ..state.figures.clone() }
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
            ("reports lost", reports_lost.to_string()),
            ("last end", figures.last_end),
        ];
        let diagnostics = lock(&self.diagnostics);
        let Some(diagnostics) = diagnostics.as_ref() else { return };
        if let Err(error) = diagnostics.report("gateway", level, message, values) {
            tracing::warn!(%error, "the gateway cannot be reported on");
        }
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
