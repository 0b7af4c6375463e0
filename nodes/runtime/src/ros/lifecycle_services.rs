//! The services and the topic of a managed node: `ros2 lifecycle`, and managers of nodes.
//!
//! Place in the flow: in the gateway of a node. What the state is, the node says; a request to change it goes to the node
//! and waits for its word, on a thread of its own, so that the state can be asked for meanwhile.

use std::num::NonZeroUsize;
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{SystemTime, UNIX_EPOCH};

use abbe_msgs::standard::{State, Transition as TransitionMessage, TransitionEvent};
use futures::channel::oneshot;
use futures::future;
use serde::{Deserialize, Serialize};

use super::lifecycle::{LifecycleState, Step, Transition};
use super::service::{EmptyRequest, Service};
use super::{QueuedPublisher, RosError, RosNode, TriggerOutcome, diagnostics_qos};
use crate::lock::lock;

const PACKAGE: &str = "lifecycle_msgs";
/// Events waiting to be published.
const DEPTH: NonZeroUsize = NonZeroUsize::MIN.saturating_add(31);

#[derive(Debug, Serialize, Deserialize)]
struct ChangeStateRequest {
    transition: TransitionMessage,
}

#[derive(Debug, Serialize, Deserialize)]
struct ChangeStateReply {
    success: bool,
}

#[derive(Debug, Serialize, Deserialize)]
struct GetStateReply {
    current_state: State,
}

#[derive(Debug, Serialize, Deserialize)]
struct GetAvailableStatesReply {
    available_states: Vec<State>,
}

#[derive(Debug, Serialize, Deserialize)]
struct TransitionDescription {
    transition: TransitionMessage,
    start_state: State,
    goal_state: State,
}

#[derive(Debug, Serialize, Deserialize)]
struct GetAvailableTransitionsReply {
    available_transitions: Vec<TransitionDescription>,
}

/// Where a node stands, as it said last.
#[derive(Debug, Clone)]
struct Standing {
    state: LifecycleState,
    /// What tools are told: on the way, the state of the transition.
    shown: State,
}

/// The open services and the topic. Dropping it closes them.
pub(crate) struct LifecycleServices {
    standing: Arc<Mutex<Standing>>,
    // First of what follows: its thread lets go of the publisher before the node can leave.
    events: QueuedPublisher<TransitionEvent>,
    threads: Vec<Serving>,
    // Last: the node leaves after its services.
    _node: RosNode,
}

impl LifecycleServices {
    /// Opens them for a node in this state; `change` hands a transition to the node, and waits for its outcome. Without it
    /// no service changes the state.
    pub(crate) fn open(
        node: &RosNode,
        state: LifecycleState,
        change: Option<impl Fn(Transition) -> TriggerOutcome + Send + 'static>,
    ) -> Result<Self, RosError> {
        let standing = Arc::new(Mutex::new(Standing { state, shown: state.message() }));
        let events = node.publisher("~/transition_event", &diagnostics_qos(), DEPTH)?;
        let opener = Opener(node);
        let get: Service<EmptyRequest, GetStateReply> = opener.open("get_state", "GetState")?;
        let states: Service<EmptyRequest, GetAvailableStatesReply> =
            opener.open("get_available_states", "GetAvailableStates")?;
        let transitions: Service<EmptyRequest, GetAvailableTransitionsReply> =
            opener.open("get_available_transitions", "GetAvailableTransitions")?;
        let graph: Service<EmptyRequest, GetAvailableTransitionsReply> =
            opener.open("get_transition_graph", "GetAvailableTransitions")?;
        let (of_change, of_reading) = (Arc::clone(&standing), Arc::clone(&standing));
        let changing = match change {
            None => None,
            Some(change) => {
                let service: Service<ChangeStateRequest, ChangeStateReply> =
                    opener.open("change_state", "ChangeState")?;
                Some(Serving::start(async move || {
                    service.serve(async |request| changed(&of_change, &request.transition, &change)).await;
                })?)
            }
        };
        let reading = Serving::start(async move || {
            let available = || available(lock(&of_reading).state);
            future::join4(
                get.serve(async |_| GetStateReply { current_state: lock(&of_reading).shown.clone() }),
                states.serve(async |_| GetAvailableStatesReply { available_states: LifecycleState::all_messages() }),
                transitions.serve(async |_| available()),
                graph.serve(async |_| described(Transition::all_steps())),
            )
            .await;
        })?;
        Ok(Self { standing, events, threads: changing.into_iter().chain([reading]).collect(), _node: node.clone() })
    }

    /// The node has come one step further; `state` is where it stands, or where it comes from while it is on its way.
    pub(crate) fn moved(&self, state: LifecycleState, step: Step) {
        *lock(&self.standing) = Standing { state, shown: step.goal.clone() };
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let timestamp = u64::try_from(now.as_nanos()).unwrap_or_default();
        let Step { transition, start: start_state, goal: goal_state } = step;
        self.events.publish(TransitionEvent { timestamp, transition, start_state, goal_state });
    }
}

fn changed(
    standing: &Mutex<Standing>,
    request: &TransitionMessage,
    change: &impl Fn(Transition) -> TriggerOutcome,
) -> ChangeStateReply {
    let state = lock(standing).state;
    let outcome = match Transition::asked_for(request, state) {
        Some(transition) => change(transition).map(drop),
        None => {
            Err(format!("transition {} {:?} is none of a node that is {}", request.id, request.label, state.label()))
        }
    };
    if let Err(reason) = &outcome {
        // The reply has no room for it.
        tracing::warn!("the state stays as it is: {reason}");
    }
    ChangeStateReply { success: outcome.is_ok() }
}

fn available(state: LifecycleState) -> GetAvailableTransitionsReply {
    described(state.transitions().map(|transition| transition.begins(state)).collect())
}

fn described(steps: Vec<Step>) -> GetAvailableTransitionsReply {
    let describe = |Step { transition, start: start_state, goal: goal_state }| TransitionDescription {
        transition,
        start_state,
        goal_state,
    };
    GetAvailableTransitionsReply { available_transitions: steps.into_iter().map(describe).collect() }
}

struct Opener<'a>(&'a RosNode);

impl Opener<'_> {
    fn open<Request, Reply>(&self, name: &str, service: &str) -> Result<Service<Request, Reply>, RosError>
    where
        Request: serde::de::DeserializeOwned,
        Reply: Serialize,
    {
        self.0.service(&self.0.resolve(&format!("~/{name}"))?, PACKAGE, service)
    }
}

/// A thread that serves until this is dropped.
struct Serving {
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Serving {
    fn start(serving: impl AsyncFnOnce() + Send + 'static) -> Result<Serving, RosError> {
        let (stop, stopped) = oneshot::channel();
        let run = move || {
            let serving = std::pin::pin!(serving());
            futures::executor::block_on(future::select(serving, stopped));
        };
        let thread = thread::Builder::new()
            .name("lifecycle".into())
            .spawn(run)
            .map_err(|source| RosError::Thread { what: "a service", source })?;
        Ok(Serving { stop: Some(stop), thread: Some(thread) })
    }
}

impl Drop for LifecycleServices {
    fn drop(&mut self) {
        // All are told before one is waited for.
        self.threads.iter_mut().for_each(|thread| drop(thread.stop.take()));
        self.threads.clear();
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        drop(self.stop.take());
        if self.thread.take().is_some_and(|thread| thread.join().is_err()) {
            tracing::error!("a service of the lifecycle panicked");
        }
    }
}
