//! Transports (shared memory, DDS, in-process) and the ROS 2 runtime that every node shares.
//!
//! Place in the flow: between the nodes and the outside. A node takes samples of
//! [`abbe_msgs::Message`] from a [`transport::Subscribe`] and gives samples to a
//! [`transport::Publish`]; which transport an edge of the graph runs on is a value
//! ([`TransportKind`]), so the node's code is the same for all.
//!
//! - [`transport`]: the two traits, their three implementations, and [`Edges`], which opens either
//!   by kind.
//! - [`gateway`]: DDS in a process beside the node, started again when it ends.
//! - [`ros`]: a node in the ROS 2 graph: arguments, names, parameters, diagnostics, services.
//! - [`Outbox`]: publishing on a thread of its own, behind a bounded queue.
//! - [`Shutdown`]: signals, the death of the launcher, and of who reads the output.
//! - [`realtime`]: SCHED_FIFO and locked memory for the threads that carry samples.
//! - [`Claim`]: a run and a topic have one holder at a time on a host.
//! - [`agree`]: the word of the first process of a run is that of all.
//! - [`tell_log_line`]: the log of a process, for `/rosout`.
//! - [`RunId`]: the name of one run, which all its shared-memory files carry.
//!
//! Samples are SI with the frame in their header; this crate changes no number in them.
//!
//! Nodes are for Linux. Elsewhere there is what commands need that only compute: [`Shutdown`], the log, and ROS arguments.

#[cfg(target_os = "linux")]
mod agreed;
#[cfg(target_os = "linux")]
mod claim;
#[cfg(target_os = "linux")]
pub mod gateway;
#[cfg(target_os = "linux")]
mod lock;
mod log_lines;
#[cfg(target_os = "linux")]
mod outbox;
#[cfg(target_os = "linux")]
pub mod realtime;
#[cfg(target_os = "linux")]
pub mod ros;
#[cfg(not(target_os = "linux"))]
#[path = "ros/elsewhere.rs"]
pub mod ros;
#[cfg(target_os = "linux")]
mod run_id;
mod shutdown;
#[cfg(target_os = "linux")]
pub mod transport;

#[cfg(target_os = "linux")]
pub use agreed::agree;
#[cfg(target_os = "linux")]
pub use claim::{Claim, ClaimError};
pub use log_lines::{LogLine, tell_log_line};
#[cfg(target_os = "linux")]
pub use outbox::{Outbox, OutboxCounts};
#[cfg(target_os = "linux")]
pub use run_id::{RunId, RunIdError};
pub use shutdown::{
    LAUNCHER_PID, Shutdown, ShutdownError, end_on_signals, end_with_reader, follow_launcher, heeds_interrupt,
};
#[cfg(target_os = "linux")]
pub use transport::{Edges, EdgesConfig, Publish, Subscribe, TransportError, TransportKind};
