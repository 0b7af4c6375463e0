//! A node in the ROS 2 graph, without a ROS 2 installation.
//!
//! Place in the flow: `main` of a node splits off `--ros-args` ([`RosArgs`]), declares its
//! parameters ([`ParameterTable`]) and starts a [`RosNode`]; endpoints over DDS, `/diagnostics`,
//! standard messages and services are opened on it.

mod args;
mod clock;
mod diagnostics;
mod endpoint;
mod environment;
mod first_call;
mod lifecycle;
mod lifecycle_services;
mod matched;
mod meant;
mod names;
mod node;
mod parameter_services;
mod parameter_values;
mod parameters;
mod qos;
mod qos_overrides;
mod queued;
mod rtps;
mod security;
mod service;
mod static_peers;
mod trigger;
mod type_descriptions;
mod writer;
mod yaml;

use ros2_client::{CreateError, NodeCreateError};
use thiserror::Error;

pub use args::{ArgsError, Renamed, RosArgs};
pub use clock::Clock;
pub(crate) use clock::{CLOCK_TOPIC, nanos_of};
pub use diagnostics::Diagnostics;
pub use environment::{DiscoveryRange, Domain, EnvironmentError};
pub(crate) use lifecycle::Step;
pub use lifecycle::{LifecycleState, NotPossible, Transition};
pub(crate) use lifecycle_services::LifecycleServices;
pub use meant::Meant;
pub use names::{NameError, NodeIdentity, RemapRule, resolve};
pub use node::{NodeOptions, RosNode};
pub use parameters::{ParameterError, ParameterSpec, ParameterTable, Range, USE_SIM_TIME};
pub use qos::{diagnostics_qos, latched_qos, offered_qos, rosout_qos, service_qos, stream_qos};
pub(crate) use qos_overrides::overridden;
pub use qos_overrides::{TopicEnd, offer_best_effort, qos_parameters};
pub use queued::QueuedPublisher;
pub use ros2_client::ParameterValue;
pub use security::{Enclave, SecurityError};
pub use static_peers::StaticPeers;
pub use trigger::{TriggerOutcome, TriggerService};
pub(crate) use writer::Writer;
pub use yaml::{ParameterAssignment, YamlError, YamlValue};

/// Why a node is not, or no longer, in the graph.
#[derive(Debug, Error)]
pub enum RosError {
    /// The command line.
    #[error(transparent)]
    Args(#[from] ArgsError),
    /// The environment.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// Keys that were asked for.
    #[error(transparent)]
    Security(#[from] SecurityError),
    /// Keys that the domain does not let in.
    #[error(
        "the keys for ROS domain {domain_id} are refused: {reason}; do certificates, governance and permissions belong \
         together, and allow the domain?"
    )]
    Keys {
        /// The domain.
        domain_id: u16,
        /// Why.
        reason: String,
    },
    /// Keys, and hosts that multicast does not reach.
    #[error(
        "ROS_STATIC_PEERS and DDS Security do not go together: the DDS library announces itself to nobody by address whom it has \
         not authenticated; unset one of them"
    )]
    SecuredPeers,
    /// A name.
    #[error(transparent)]
    Name(#[from] NameError),
    /// A parameter.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// The DDS participant.
    #[error("cannot join ROS domain {domain_id}: {reason}; is the network up and the domain free?")]
    Participant {
        /// The domain.
        domain_id: u16,
        /// Why.
        reason: String,
    },
    /// The system clock.
    #[error("cannot join ROS domain {domain_id}: the system clock is before 1970, with which DDS cannot run; set it")]
    Clock {
        /// The domain.
        domain_id: u16,
    },
    /// The node.
    #[error("cannot create node {node}: {source}")]
    Node {
        /// Its absolute name.
        node: String,
        /// Why.
        source: NodeCreateError,
    },
    /// The process that holds the node's place in the graph.
    #[error("the gateway to DDS: {reason}")]
    Gateway {
        /// Why.
        reason: String,
    },
    /// A topic, publisher, subscriber or service.
    #[error("cannot open {what} {name}: {source}")]
    Endpoint {
        /// What.
        what: &'static str,
        /// Its absolute name.
        name: String,
        /// Why.
        source: CreateError,
    },
    /// A thread.
    #[error("cannot start the thread of {what}: {source}")]
    Thread {
        /// What.
        what: &'static str,
        /// Why.
        source: std::io::Error,
    },
}
