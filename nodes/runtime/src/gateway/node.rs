//! A node's handle to its gateway: endpoints that outlive the process behind them.
//!
//! Place in the flow: what a correcting node has in place of a participant. Endpoints are opened here, kept in a list, and
//! opened again in each new gateway. Nothing here waits for the gateway but the opening itself, and that only while there is one.

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::companion::Standing;
use super::keeper::{GatewayCommand, Keeper};
use super::protocol::{Asked, Endpoint, Join};
use super::shared::{GatewayFigures, NodeEnd, Shared};
use crate::RunId;
use crate::lock::lock;
use crate::log_lines::hear_log_lines;
use crate::ros::{
    Clock, Diagnostics, LifecycleState, NameError, NodeIdentity, NodeOptions, ParameterValue, RemapRule, RosError,
    Step, Transition, TriggerOutcome, resolve,
};
use crate::transport::TransportError;
use crate::transport::shared_memory::{self, SharedMemory};

/// How long the thread of the log waits before it looks whether the node is still there.
const LOOK_UP: Duration = Duration::from_millis(200);
/// Least time between two lines.
const BETWEEN_LINES: Duration = Duration::from_millis(5);

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
    /// Whether the log of this process goes to `/rosout`.
    pub rosout: bool,
    /// Puts new values of parameters to use, all or none, or says why not; they are of the right type and in range. Runs on
    /// a thread of its own.
    pub on_change: Option<OnChange>,
}

/// Takes new values of parameters.
pub type OnChange = Box<dyn FnMut(&[(String, ParameterValue)]) -> TriggerOutcome + Send>;

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

impl GatewayNode {
    /// Starts a gateway that joins the graph under the node's name. Where it cannot join for a reason that may pass (the
    /// network is down, the system clock is before 1970), the node goes on without DDS, and it is tried again and again.
    ///
    /// # Errors
    /// When the shared memory cannot be joined, or the gateway cannot be started or is refused for good.
    pub fn start(options: GatewayOptions) -> Result<Self, TransportError> {
        let (run, own_run) = match options.run {
            Some(run) => (run, OwnRun(None)),
            None => {
                let own = RunId::unique();
                (own.clone(), OwnRun(Some(own)))
            }
        };
        let memory = SharedMemory::join(&run, options.depth)?;
        // A run of its own ends with this process, and what it remembered with it.
        let remembers = own_run.0.is_none();
        let memory = if remembers { memory.remembering(&options.node.identity.qualified()) } else { memory };
        if let (Some(name), None) = (options.node.parameters.changeable(), &options.on_change) {
            let reason =
                format!("parameter '{name}' may change while the node runs, which only its gateway would hear of");
            return Err(RosError::Gateway { reason }.into());
        }
        let join =
            Join::new(&options.node, run.as_str(), options.depth.get(), options.memory_limit_bytes, options.rosout);
        let uses_sim_time = options.node.parameters.uses_sim_time();
        let clock = if uses_sim_time { Clock::simulated() } else { Clock::of_system() };
        let join = Arc::new(Mutex::new(join));
        let (setting, asked) = channel();
        let shared = Arc::new(Shared::new(memory, clock, options.on_change.is_some().then_some(setting)));
        if let Some(mut on_change) = options.on_change {
            let join = Arc::clone(&join);
            answer(&shared, asked, move |asked| set(asked, &mut on_change, &join))?;
        }
        if options.rosout {
            publish_log(&shared)?;
        }
        let keeper = Keeper { shared: Arc::clone(&shared), command: options.command, join };
        let first = keeper.first().map_err(|reason| RosError::Gateway { reason })?;
        let keeper = thread::Builder::new()
            .name("gateway-keeper".into())
            .spawn(move || keeper.keep(first))
            .map_err(|source| RosError::Thread { what: "the gateway's keeper", source })?;
        let NodeOptions { identity, remaps, .. } = options.node;
        let node = Self(Arc::new(Inner { identity, remaps, keeper: Some(keeper), shared, _own_run: own_run }));
        node.0.shared.report_on(node.diagnostics(&options.hardware_id));
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
        Diagnostics::over(Box::new(send), &self.0.identity, hardware_id).by_clock(self.clock())
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
        answer(&self.0.shared, asked, move |_| handler())?;
        let held = self.open(Endpoint::Service(name.to_owned()), NodeEnd::Service(calls))?;
        Ok(GatewayService { _held: held })
    }

    /// The services of a managed node that stands in `state`; that which changes it only where the node is `commanded`.
    /// `handler` follows a transition, and runs on a thread of its own.
    ///
    /// # Errors
    /// When the services cannot be made.
    pub fn lifecycle(
        &self,
        state: LifecycleState,
        commanded: bool,
        mut handler: impl FnMut(Transition) -> TriggerOutcome + Send + 'static,
    ) -> Result<GatewayLifecycle, TransportError> {
        let (calls, asked) = channel();
        let follow = move |asked| match asked {
            Asked::Change(transition) => handler(transition),
            Asked::Trigger | Asked::Set(_) => Err("this is no change of the state".to_owned()),
        };
        answer(&self.0.shared, asked, follow)?;
        Ok(GatewayLifecycle { held: self.open(Endpoint::Lifecycle(state, commanded), NodeEnd::Service(calls))? })
    }

    /// A message on `topic` that whoever joins later gets as well, as long as what is returned is held.
    ///
    /// # Errors
    /// When the name is wrong or the gateway cannot publish it.
    pub fn standing(&self, topic: &str, content: Standing) -> Result<GatewayStanding, TransportError> {
        let topic = self.resolve(topic).map_err(RosError::from)?;
        Ok(GatewayStanding { _held: self.open(Endpoint::Standing(topic, content), NodeEnd::Standing)? })
    }

    /// The time that the node goes by: the system's, or with `use_sim_time` that of `/clock`.
    #[must_use]
    pub fn clock(&self) -> Clock {
        self.0.shared.clock().clone()
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
        shared.await_open(id).map_err(|reason| RosError::Gateway { reason })?;
        Ok(held)
    }
}

impl std::fmt::Debug for GatewayNode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "GatewayNode({})", self.0.identity.qualified())
    }
}

/// Answers calls on a thread of its own. It ends with the sender of calls, which the endpoint holds; an answer may be under
/// way then.
fn answer(
    shared: &Arc<Shared>,
    asked: Receiver<(u64, Asked)>,
    mut handler: impl FnMut(Asked) -> TriggerOutcome + Send + 'static,
) -> Result<(), RosError> {
    let shared = Arc::downgrade(shared);
    let answering = move || {
        while let Ok((call, asked)) = asked.recv() {
            let outcome = handler(asked);
            let Some(shared) = shared.upgrade() else { return };
            shared.answer(call, outcome);
        }
    };
    let started = thread::Builder::new().name("service".into()).spawn(answering);
    started.map(drop).map_err(|source| RosError::Thread { what: "a service", source })
}

/// Hands the lines of the log to the gateway, on a thread of its own that ends with the node.
fn publish_log(shared: &Arc<Shared>) -> Result<(), RosError> {
    let (lines, shared) = (hear_log_lines(), Arc::downgrade(shared));
    let telling = move || {
        loop {
            let line = lines.recv_timeout(LOOK_UP);
            let Some(shared) = shared.upgrade() else { return };
            match line {
                Ok(line) => {
                    shared.log(line);
                    // A flood of lines leaves room for everything else.
                    thread::sleep(BETWEEN_LINES);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
    };
    let started = thread::Builder::new().name("rosout".into()).spawn(telling);
    started.map(drop).map_err(|source| RosError::Thread { what: "the log", source })
}

/// Has new values put to use, and keeps them for the next gateway.
fn set(asked: Asked, on_change: &mut OnChange, join: &Mutex<Join>) -> TriggerOutcome {
    let Asked::Set(values) = asked else { return Err("these are no values of parameters".to_owned()) };
    let typed: Vec<(String, ParameterValue)> =
        values.iter().map(|(name, value)| (name.clone(), value.clone().into())).collect();
    let said = on_change(&typed)?;
    lock(join).set(values);
    Ok(said)
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
        self.shared.leave();
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

/// A message that stands. Dropping it ends that.
pub struct GatewayStanding {
    _held: Held,
}

/// The services of a managed node. Dropping it ends them.
pub struct GatewayLifecycle {
    held: Held,
}

impl GatewayLifecycle {
    /// Tells that the node follows a transition from this state.
    pub fn begins(&self, transition: Transition, from: LifecycleState) {
        self.moved(from, transition.begins(from));
    }

    /// Tells that a transition has come to its end, in `state`.
    pub fn ends(&self, transition: Transition, state: LifecycleState, is_success: bool) {
        self.moved(state, transition.ends(state, is_success));
    }

    fn moved(&self, state: LifecycleState, step: Step) {
        self.held.node.0.shared.moved(self.held.id, state, step);
    }
}

/// A running service. Dropping it ends it.
pub struct GatewayService {
    _held: Held,
}
