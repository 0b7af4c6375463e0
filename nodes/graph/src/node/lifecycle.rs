//! The life of a node in the ROS graph: configured, activated, paused, cleaned up, by itself or by a manager.
//!
//! Place in the flow: around the loop of every node. A life is one run of it: what the loop opens is opened when the node
//! is configured, and closed when it is cleaned up. Between, an atomic says whether the node is active; the loop looks at it
//! with every sample and never waits for it. Requests come on a thread of their own, one at a time.

use super::told::say_state;
use super::{NodeContext, NodeError, NodeSummary};
use abbe_msgs::standard::DiagnosticStatus;
use abbe_runtime::Shutdown;
use abbe_runtime::gateway::{GatewayLifecycle, GatewayNode};
use abbe_runtime::ros::{Diagnostics, LifecycleState, Transition, TriggerOutcome};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread;
use std::time::Duration;

/// How often a node that waits for a command looks whether there is one.
const LOOK_EVERY: Duration = Duration::from_millis(10);
/// How often the state is told.
const REPORT_EVERY: Duration = Duration::from_secs(1);
/// Component on `/diagnostics`.
const COMPONENT: &str = "lifecycle";

/// Where a node stands, and what it was told. Clones share it.
#[derive(Clone)]
pub(crate) struct Lifecycle(Arc<Inner>);

struct Inner {
    /// The whole process.
    process: Shutdown,
    is_active: AtomicBool,
    /// Whether a launcher hears where a manager took the node.
    has_launcher: bool,
    place: Mutex<Place>,
    /// Nothing where the node is not in the ROS graph.
    services: OnceLock<GatewayLifecycle>,
}

struct Place {
    state: LifecycleState,
    /// A transition under way.
    under_way: Option<Transition>,
    /// Whether the node configures and activates itself.
    by_itself: bool,
    /// Whether it is not activated by that: a manager had deactivated it before its process ended.
    rests: bool,
    /// What became of being configured; nothing while that is under way, or not asked for.
    configured: Option<Result<(), String>>,
    /// The life that runs.
    life: Option<Shutdown>,
    /// Why the last try to configure failed.
    failed: Option<String>,
}

impl Lifecycle {
    /// A node that is not configured; it will be at once where it goes `by_itself`, and be activated, unless it `stays` where a manager
    /// took it before its process ended.
    pub(super) fn new(
        process: &Shutdown,
        by_itself: bool,
        stays: Option<LifecycleState>,
        has_launcher: bool,
    ) -> Lifecycle {
        if let Some(stays) = stays.filter(|_| by_itself) {
            tracing::warn!("the node stays {}, as it was told before its process ended", stays.label());
        }
        let rests = stays == Some(LifecycleState::Inactive);
        let by_itself = by_itself && stays != Some(LifecycleState::Unconfigured);
        let place = Place {
            state: LifecycleState::Unconfigured,
            under_way: by_itself.then_some(Transition::Configure),
            by_itself,
            rests,
            configured: None,
            life: None,
            failed: None,
        };
        let (process, place) = (process.clone(), Mutex::new(place));
        let (is_active, services) = (AtomicBool::new(false), OnceLock::new());
        Lifecycle(Arc::new(Inner { process, is_active, has_launcher, place, services }))
    }

    /// Offers the services of a managed node, that which changes its state where it is `commanded`, and tells the state on
    /// `/diagnostics`.
    pub(super) fn serve(&self, node: &GatewayNode, hardware_id: &str, commanded: bool) -> Result<(), NodeError> {
        // Weak: the node leaves the graph when its loop lets go of it, whoever still serves.
        let inner = Arc::downgrade(&self.0);
        let handler = move |transition| match inner.upgrade() {
            Some(inner) => Lifecycle(inner).follow(transition),
            None => Err("the node is stopping".to_owned()),
        };
        let services = node.lifecycle(LifecycleState::Unconfigured, commanded, handler)?;
        if self.place().by_itself {
            services.begins(Transition::Configure, LifecycleState::Unconfigured);
        }
        let _ = self.0.services.set(services);
        let (inner, health) = (Arc::downgrade(&self.0), node.diagnostics(hardware_id));
        let telling = move || {
            while let Some(inner) = inner.upgrade() {
                Lifecycle(inner).report(&health);
                thread::sleep(REPORT_EVERY);
            }
        };
        thread::Builder::new().name("lifecycle".into()).spawn(telling).map_err(NodeError::Thread)?;
        Ok(())
    }

    /// Whether the node is at work. Never waits.
    pub(crate) fn is_active(&self) -> bool {
        self.0.is_active.load(Ordering::Relaxed)
    }

    /// Waits until the node is at work; true when told to stop before.
    pub(super) fn await_active(&self, life: &Shutdown) -> bool {
        while !self.is_active() {
            if life.sleep(LOOK_EVERY) {
                return true;
            }
        }
        false
    }

    /// Whether the node configures and activates itself, and has not done so yet.
    pub(super) fn starts_by_itself(&self) -> bool {
        let place = self.place();
        place.by_itself && place.state == LifecycleState::Unconfigured
    }

    /// Waits until the node is to be configured; the flag of the life that begins, or nothing when told to stop.
    fn begin(&self) -> Option<Shutdown> {
        loop {
            let mut place = self.place();
            if place.under_way == Some(Transition::Configure) && place.configured.is_none() {
                let life = self.0.process.part();
                place.life = Some(life.clone());
                return Some(life);
            }
            drop(place);
            if self.0.process.sleep(LOOK_EVERY) {
                return None;
            }
        }
    }

    /// Everything is opened.
    pub(super) fn opened(&self) {
        let mut place = self.place();
        place.failed = None;
        if !place.by_itself {
            place.configured = Some(Ok(()));
            return;
        }
        place.by_itself = false;
        place.under_way = None;
        self.arrive(&mut place, Transition::Configure, LifecycleState::Inactive, true);
        if place.rests {
            return;
        }
        self.depart(Transition::Activate, LifecycleState::Inactive);
        self.0.is_active.store(true, Ordering::Relaxed);
        self.arrive(&mut place, Transition::Activate, LifecycleState::Active, true);
        tracing::info!("the node is active");
    }

    /// The loop has ended; whether a manager hears of it, and the next life is waited for.
    fn ended(&self, outcome: Result<(), String>) -> bool {
        let mut place = self.place();
        let was_ended = place.life.take().is_some_and(|life| life.requested());
        match outcome {
            // What was opened is closed: who asked for that waits.
            Ok(()) => was_ended && place.under_way.is_some(),
            Err(reason) => {
                let is_managed = !place.by_itself && place.under_way == Some(Transition::Configure);
                if is_managed {
                    (place.configured, place.failed) = (Some(Err(reason.clone())), Some(reason));
                }
                is_managed
            }
        }
    }

    /// Follows a transition, and says what came of it.
    fn follow(&self, transition: Transition) -> TriggerOutcome {
        let from = {
            let mut place = self.place();
            if let Some(other) = place.under_way {
                return Err(format!("the node is busy with {}; ask again when it is done", other.label()));
            }
            transition.from_state(place.state).map_err(|error| error.to_string())?;
            place.under_way = Some(transition);
            place.configured = None;
            place.state
        };
        self.depart(transition, from);
        let outcome = match transition {
            Transition::Configure => self.await_configured(),
            Transition::Activate => {
                self.0.is_active.store(true, Ordering::Relaxed);
                Ok(())
            }
            Transition::Deactivate => {
                self.0.is_active.store(false, Ordering::Relaxed);
                Ok(())
            }
            Transition::Cleanup | Transition::Shutdown => self.close(),
        };
        let mut place = self.place();
        place.under_way = None;
        let goal = transition.from_state(from).ok().filter(|_| outcome.is_ok()).unwrap_or(from);
        self.arrive(&mut place, transition, goal, outcome.is_ok());
        match outcome {
            Ok(()) => {
                if self.0.has_launcher {
                    say_state(goal);
                }
                tracing::info!("{} done: the node is {}", transition.label(), goal.label());
                Ok(format!("the node is {}", goal.label()))
            }
            Err(reason) => Err(format!("{} failed, the node stays {}: {reason}", transition.label(), goal.label())),
        }
    }

    fn await_configured(&self) -> Result<(), String> {
        loop {
            if let Some(outcome) = self.place().configured.clone() {
                return outcome;
            }
            self.go_on()?;
        }
    }

    /// Ends the life that runs, and waits for that.
    fn close(&self) -> Result<(), String> {
        self.0.is_active.store(false, Ordering::Relaxed);
        if let Some(life) = &self.place().life {
            life.request();
        }
        while self.place().life.is_some() {
            self.go_on()?;
        }
        Ok(())
    }

    /// Waits a little; an error when the process is to stop. The loop's own looks are not to be mistaken for this.
    fn go_on(&self) -> Result<(), String> {
        thread::sleep(LOOK_EVERY);
        if self.0.process.is_raised() { Err("the node is stopping".to_owned()) } else { Ok(()) }
    }

    fn depart(&self, transition: Transition, from: LifecycleState) {
        if let Some(services) = self.0.services.get() {
            services.begins(transition, from);
        }
    }

    fn arrive(&self, place: &mut Place, transition: Transition, state: LifecycleState, is_success: bool) {
        place.state = state;
        if let Some(services) = self.0.services.get() {
            services.ends(transition, state, is_success);
        }
    }

    fn report(&self, health: &Diagnostics) {
        let place = self.place();
        let (state, under_way, failed) = (place.state, place.under_way, place.failed.clone());
        let starts = place.by_itself;
        drop(place);
        let (level, message) = match (state, failed) {
            _ if starts => (DiagnosticStatus::OK, "is being configured".to_owned()),
            (LifecycleState::Active, _) => (DiagnosticStatus::OK, "active".to_owned()),
            (_, Some(reason)) => (DiagnosticStatus::ERROR, format!("could not be configured: {reason}")),
            (LifecycleState::Inactive, _) => {
                (DiagnosticStatus::WARN, "inactive: activate the node to go on".to_owned())
            }
            (LifecycleState::Unconfigured, _) => {
                (DiagnosticStatus::WARN, "unconfigured: configure the node".to_owned())
            }
            (LifecycleState::Finalized, _) => (DiagnosticStatus::WARN, "finalized: start the node again".to_owned()),
        };
        let under_way = under_way.map_or("none", Transition::label).to_owned();
        health.report(COMPONENT, level, &message, [("state", state.label().to_owned()), ("transition", under_way)]);
    }

    fn place(&self) -> MutexGuard<'_, Place> {
        self.0.place.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Runs the lives of a node, one after the other, until its source ends or it is told to stop.
pub(super) fn live(
    mut context: NodeContext,
    work: impl Fn(&NodeContext) -> Result<NodeSummary, NodeError>,
) -> Result<NodeSummary, NodeError> {
    let lifecycle = context.lifecycle.clone();
    let mut total: Option<NodeSummary> = None;
    if !lifecycle.starts_by_itself() {
        context.is_ready();
    }
    while let Some(life) = lifecycle.begin() {
        context.shutdown = life;
        context.configured += 1;
        let name = context.name;
        context.changes.apply(&mut context.launch, name);
        match work(&context) {
            Ok(summary) => {
                total = Some(total.take().unwrap_or_default().followed_by(summary));
                if !lifecycle.ended(Ok(())) {
                    break;
                }
            }
            Err(error) => {
                let reason = error.to_string();
                if !lifecycle.ended(Err(reason)) {
                    return Err(error);
                }
                context.configured -= 1;
                tracing::warn!("the node could not be configured: {error}");
            }
        }
    }
    let summary = total.unwrap_or_else(|| context.summary());
    Ok(context.with_gateway_figures(summary))
}
