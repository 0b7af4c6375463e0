//! DDS, and Zenoh, in a process of their own: a node's gateway to ROS 2.
//!
//! Place in the flow: between a correcting node and DDS. The DDS library takes packets from anyone on the network; it can
//! be made to reserve memory without bound, and it silently stops for good when its `poll` is interrupted. So it runs
//! where it may die: in a process beside the node, fed over shared memory, started by the node and started again when it
//! ends. The node in the ROS 2 graph (name, topics, parameters, services, `/diagnostics`) is the gateway's participant.
//!
//! | part | process | does |
//! |---|---|---|
//! | [`GatewayNode`] | node | opens endpoints, and opens them again in each new gateway |
//! | `keeper` | node, a thread | starts the gateway, listens to it, starts it again |
//! | `shared` | node | keeps what the node has open for the next gateway |
//! | `account` | node | counts what did not go out, over all gateways |
//! | [`serve()`] | gateway | joins the graph, moves samples, ends when DDS or the node does |
//! | `calls` | gateway | hands calls of services to the node |
//! | `companion` | gateway | makes standard messages of samples and of the machine |
//! | `foreign` | gateway | makes samples of standard messages of other programs |
//! | `clock` | gateway | hears `/clock`, where its node goes by it |
//! | `health` | gateway | heartbeat through DDS itself; watches the library's threads |
//!
//! What is known to have failed behind it: an interrupted `poll` (SIGSTOP and SIGCONT, a debugger, a freezer), and packets
//! that make the library reserve a gigabyte, which the limit of the process turns into its end.

mod account;
mod calls;
mod clock;
mod companion;
mod endpoints;
mod foreign;
mod health;
mod introduction;
mod keeper;
mod node;
mod protocol;
mod serve;
mod shared;
mod streams;

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::transport::TransportKind;

pub use companion::{Companion, Content, Frames, Standing, Volume};
pub use endpoints::{GatewayPublisher, GatewaySubscriber};
pub use foreign::{Foreign, ForeignMessage};
pub(crate) use introduction::{Introduced, discovery_port};
pub use keeper::GatewayCommand;
pub use node::{GatewayLifecycle, GatewayNode, GatewayOptions, GatewayService, GatewayStanding, OnChange};
pub use serve::{GatewayError, serve};
pub use shared::GatewayFigures;

const KIND: TransportKind = TransportKind::Dds;
const DIAGNOSTICS: &str = "/diagnostics";
const ROSOUT: &str = "/rosout";
/// Standard messages waiting to be published.
pub const COMPANION_DEPTH: NonZeroUsize = NonZeroUsize::MIN.saturating_add(1023);
/// Whether the gateway of this process takes its leave of the graph.
static LEAVING: AtomicBool = AtomicBool::new(false);

/// Whether this process is a gateway that takes its leave of the graph: the DDS library calls every clean exit an error.
#[must_use]
pub fn is_leaving() -> bool {
    LEAVING.load(Ordering::Relaxed)
}
