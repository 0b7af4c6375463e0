//! The states of a managed node, and which transition leads from which to which.
//!
//! Place in the flow: a node keeps its [`LifecycleState`] and follows a [`Transition`] only from where it starts; its
//! gateway offers the services of a managed node, and tells every change ([`super::lifecycle_services`]). Pure.
//!
//! Source: the design article "Managed nodes" of ROS 2; numbers and names of `lifecycle_msgs` 2.0, and the names that
//! `rcl_lifecycle` gives the transitions. Error processing is left out: a transition that fails leads back to where it
//! began, and an error while a node is active ends its process, which `abbe launch` starts again.

use abbe_msgs::standard::{State, Transition as TransitionMessage};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Where a managed node stands between two transitions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum LifecycleState {
    /// Nothing is opened, nothing is loaded.
    Unconfigured,
    /// Everything is opened and loaded; nothing is done.
    Inactive,
    /// At work.
    Active,
    /// At its end.
    Finalized,
}

/// A command to a managed node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Transition {
    /// Open and load everything.
    Configure,
    /// Close and forget everything.
    Cleanup,
    /// Go to work.
    Activate,
    /// Pause.
    Deactivate,
    /// Come to the end.
    Shutdown,
}

/// A transition that cannot be followed now.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{} is not possible while the node is {}; possible are {possible}", transition.label(), state.label())]
pub struct NotPossible {
    transition: Transition,
    state: LifecycleState,
    possible: String,
}

/// A step of a transition, as `lifecycle_msgs` tells of it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Step {
    pub(crate) transition: TransitionMessage,
    pub(crate) start: State,
    pub(crate) goal: State,
}

const ALL_STATES: [LifecycleState; 4] =
    [LifecycleState::Unconfigured, LifecycleState::Inactive, LifecycleState::Active, LifecycleState::Finalized];
const ALL_TRANSITIONS: [Transition; 5] =
    [Transition::Configure, Transition::Cleanup, Transition::Activate, Transition::Deactivate, Transition::Shutdown];
const SUCCESS: &str = "transition_success";
const FAILURE: &str = "transition_failure";

impl LifecycleState {
    /// Its name.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            LifecycleState::Unconfigured => "unconfigured",
            LifecycleState::Inactive => "inactive",
            LifecycleState::Active => "active",
            LifecycleState::Finalized => "finalized",
        }
    }

    pub(crate) fn message(self) -> State {
        let id = match self {
            LifecycleState::Unconfigured => 1,
            LifecycleState::Inactive => 2,
            LifecycleState::Active => 3,
            LifecycleState::Finalized => 4,
        };
        State { id, label: self.label().to_owned() }
    }

    /// What leads from here.
    pub(crate) fn transitions(self) -> impl Iterator<Item = Transition> {
        ALL_TRANSITIONS.into_iter().filter(move |transition| transition.goal(self).is_some())
    }

    /// Every state that a node can be in, those of transitions under way included.
    pub(crate) fn all_messages() -> Vec<State> {
        let under_way = ALL_TRANSITIONS.into_iter().map(Transition::under_way);
        ALL_STATES.into_iter().map(LifecycleState::message).chain(under_way).collect()
    }
}

impl Transition {
    /// Its name.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Transition::Configure => "configure",
            Transition::Cleanup => "cleanup",
            Transition::Activate => "activate",
            Transition::Deactivate => "deactivate",
            Transition::Shutdown => "shutdown",
        }
    }

    /// Where it leads from a state; `None` where it does not start there.
    fn goal(self, from: LifecycleState) -> Option<LifecycleState> {
        use LifecycleState::{Active, Finalized, Inactive, Unconfigured};
        match (self, from) {
            (Transition::Configure, Unconfigured) | (Transition::Deactivate, Active) => Some(Inactive),
            (Transition::Cleanup, Inactive) => Some(Unconfigured),
            (Transition::Activate, Inactive) => Some(Active),
            (Transition::Shutdown, Unconfigured | Inactive | Active) => Some(Finalized),
            _ => None,
        }
    }

    /// Where it leads from a state.
    ///
    /// # Errors
    /// When it does not start there.
    pub fn from_state(self, state: LifecycleState) -> Result<LifecycleState, NotPossible> {
        self.goal(state).ok_or_else(|| {
            let names: Vec<&str> = state.transitions().map(Transition::label).collect();
            let possible = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
            NotPossible { transition: self, state, possible }
        })
    }

    /// What a request means in a state: by its name where it has one, as in `rclcpp`, otherwise by its number.
    pub(crate) fn asked_for(request: &TransitionMessage, state: LifecycleState) -> Option<Transition> {
        let is_meant = |one: &Transition| match request.label.as_str() {
            "" => one.number(state) == request.id,
            label => one.label() == label,
        };
        ALL_TRANSITIONS.into_iter().find(is_meant)
    }

    /// Its number from a state; a shutdown has one for each.
    fn number(self, from: LifecycleState) -> u8 {
        match (self, from) {
            (Transition::Configure, _) => 1,
            (Transition::Cleanup, _) => 2,
            (Transition::Activate, _) => 3,
            (Transition::Deactivate, _) => 4,
            (Transition::Shutdown, LifecycleState::Unconfigured) => 5,
            (Transition::Shutdown, LifecycleState::Inactive) => 6,
            (Transition::Shutdown, LifecycleState::Active | LifecycleState::Finalized) => 7,
        }
    }

    /// Number of the success that ends it; that of a failure is one more.
    fn ending(self) -> u8 {
        match self {
            Transition::Configure => 10,
            Transition::Cleanup => 20,
            Transition::Activate => 30,
            Transition::Deactivate => 40,
            Transition::Shutdown => 50,
        }
    }

    /// The state of a node while it follows this.
    fn under_way(self) -> State {
        let (id, label) = match self {
            Transition::Configure => (10, "configuring"),
            Transition::Cleanup => (11, "cleaningup"),
            Transition::Shutdown => (12, "shuttingdown"),
            Transition::Activate => (13, "activating"),
            Transition::Deactivate => (14, "deactivating"),
        };
        State { id, label: label.to_owned() }
    }

    /// The step with which it begins.
    pub(crate) fn begins(self, from: LifecycleState) -> Step {
        let transition = TransitionMessage { id: self.number(from), label: self.label().to_owned() };
        Step { transition, start: from.message(), goal: self.under_way() }
    }

    /// The step with which it ends: in `goal`, or back where it began.
    pub(crate) fn ends(self, goal: LifecycleState, is_success: bool) -> Step {
        let (id, label) = if is_success { (self.ending(), SUCCESS) } else { (self.ending() + 1, FAILURE) };
        let transition = TransitionMessage { id, label: label.to_owned() };
        Step { transition, start: self.under_way(), goal: goal.message() }
    }

    /// Every step that there is.
    pub(crate) fn all_steps() -> Vec<Step> {
        let mut steps = Vec::new();
        for from in ALL_STATES {
            for transition in from.transitions() {
                let Some(goal) = transition.goal(from) else { continue };
                steps.extend([transition.begins(from), transition.ends(goal, true), transition.ends(from, false)]);
            }
        }
        let mut seen = Vec::new();
        steps.retain(|step| {
            let is_new = !seen.contains(step);
            seen.push(step.clone());
            is_new
        });
        steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use LifecycleState::{Active, Finalized, Inactive, Unconfigured};

    fn asked(id: u8, label: &str, state: LifecycleState) -> Option<Transition> {
        Transition::asked_for(&TransitionMessage { id, label: label.to_owned() }, state)
    }

    #[test]
    fn a_node_goes_the_way_of_managed_nodes_and_no_other() {
        let mut state = Unconfigured;
        for (transition, goal) in [
            (Transition::Configure, Inactive),
            (Transition::Activate, Active),
            (Transition::Deactivate, Inactive),
            (Transition::Cleanup, Unconfigured),
            (Transition::Shutdown, Finalized),
        ] {
            state = transition.from_state(state).unwrap();
            assert_eq!(state, goal);
        }
        assert_eq!(Finalized.transitions().count(), 0);
        let refused = Transition::Activate.from_state(Unconfigured).unwrap_err().to_string();
        assert_eq!(
            refused,
            "activate is not possible while the node is unconfigured; possible are configure, shutdown"
        );
        assert!(Transition::Configure.from_state(Finalized).unwrap_err().to_string().ends_with("none"));
    }

    #[test]
    fn a_request_is_understood_by_name_and_by_the_number_of_the_state() {
        assert_eq!(asked(0, "configure", Unconfigured), Some(Transition::Configure));
        assert_eq!(asked(3, "", Inactive), Some(Transition::Activate));
        for (id, state) in [(5, Unconfigured), (6, Inactive), (7, Active)] {
            assert_eq!(asked(id, "", state), Some(Transition::Shutdown));
        }
        assert_eq!(asked(5, "", Active), None, "the number of another state");
        assert_eq!(asked(200, "", Active), None);
        assert_eq!(asked(1, "fly", Unconfigured), None);
    }

    #[test]
    fn each_step_is_there_once_with_the_numbers_of_the_messages() {
        let steps = Transition::all_steps();
        let numbers: Vec<(u8, u8, u8)> =
            steps.iter().map(|step| (step.start.id, step.transition.id, step.goal.id)).collect();
        for expected in
            [(1, 1, 10), (10, 10, 2), (10, 11, 1), (2, 3, 13), (13, 30, 3), (3, 4, 14), (12, 50, 4), (3, 7, 12)]
        {
            assert_eq!(numbers.iter().filter(|found| **found == expected).count(), 1, "{expected:?} in {numbers:?}");
        }
        let states: Vec<u8> = LifecycleState::all_messages().iter().map(|state| state.id).collect();
        assert!(numbers.iter().all(|(start, _, goal)| states.contains(start) && states.contains(goal)));
    }
}
