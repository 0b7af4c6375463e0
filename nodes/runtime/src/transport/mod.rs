//! How samples travel between nodes: the two traits, and the choice of transport for an edge.
//!
//! Place in the flow: nodes are written against [`Publish`] and [`Subscribe`]; [`Edges`] opens them
//! by [`TransportKind`]. One file or folder a transport:
//! - [`in_process`]: a bounded ring, for tests and for replay within one process;
//! - [`shared_memory`]: iceoryx2, between the nodes of one host;
//! - [`dds`]: ROS 2, for everyone else;
//! - [`zenoh`]: programs of ROS 2 on rmw_zenoh, where this is built for it.
//!
//! What all of them promise (`tests/conformance.rs` holds each to it): samples of one publisher
//! arrive in order and bit by bit as sent; sending never waits for a subscriber; what a subscriber
//! misses is counted by [`Subscribe::lost`]; who joins late gets what is sent from then on.

pub mod dds;
mod deadline;
mod edges;
mod error;
mod fan_out;
pub mod in_process;
mod losses;
pub mod shared_memory;
pub mod zenoh;

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use abbe_msgs::Message;
use serde::{Deserialize, Serialize};

pub use edges::{Edges, EdgesConfig};
pub use error::TransportError;
pub use fan_out::FanOut;

/// Samples a subscriber can be behind before it loses the oldest: 4 s at 1 kHz.
pub const DEFAULT_DEPTH: usize = 4096;

/// What an edge of the graph runs on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum TransportKind {
    /// Between threads of one process.
    InProcess,
    /// Between processes of one host and one user.
    SharedMemory,
    /// ROS 2, between hosts.
    Dds,
    /// ROS 2 on rmw_zenoh, between hosts, in a program that is built for it.
    Zenoh,
}

impl TransportKind {
    /// All kinds, in the order of their reach.
    pub const ALL: [Self; 4] = [Self::InProcess, Self::SharedMemory, Self::Dds, Self::Zenoh];

    /// Whether this program is built for it.
    #[must_use]
    pub fn is_built(self) -> bool {
        self != Self::Zenoh || zenoh::IS_BUILT
    }

    /// Whether its library runs in the gateway of a node, and not in the node.
    #[must_use]
    pub fn is_behind_gateway(self) -> bool {
        matches!(self, Self::Dds | Self::Zenoh)
    }

    /// The name used in launch configurations.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::InProcess => "in-process",
            Self::SharedMemory => "shared-memory",
            Self::Dds => "dds",
            Self::Zenoh => "zenoh",
        }
    }
}

impl fmt::Display for TransportKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for TransportKind {
    type Err = TransportError;

    fn from_str(name: &str) -> Result<Self, TransportError> {
        Self::ALL
            .into_iter()
            .find(|kind| kind.name() == name)
            .ok_or_else(|| TransportError::UnknownKind { name: name.into() })
    }
}

/// The sending end of an edge.
pub trait Publish<M: Message>: Send {
    /// Hands the sample to the transport. Never waits for a subscriber or for the network.
    ///
    /// # Errors
    /// When the transport cannot take the sample; it is then counted by [`Publish::dropped`]. The
    /// next call tries again.
    fn send(&mut self, sample: &M) -> Result<(), TransportError>;

    /// Samples that were given to [`Publish::send`] and not handed on.
    fn dropped(&self) -> u64;

    /// Subscribers that this publisher knows of. Over DDS a subscriber may still need a moment to
    /// know of the publisher.
    fn subscribers(&self) -> usize;

    /// Publishers of the same topic that do not belong to this node, as far as the transport knows of any: a gateway
    /// does. Never waits.
    fn others(&self) -> usize {
        0
    }
}

/// The receiving end of an edge.
pub trait Subscribe<M: Message>: Send {
    /// The oldest sample that has not been taken, if there is one. Does not wait.
    ///
    /// # Errors
    /// [`TransportError::Malformed`] for a sample that arrived but must not be used; the stream
    /// goes on with the next call. Any other error means that the transport has failed.
    fn try_take(&mut self) -> Result<Option<M>, TransportError>;

    /// Waits until [`Subscribe::try_take`] has something to say, at most `timeout`. Returns whether
    /// it has.
    ///
    /// # Errors
    /// When the transport has failed.
    fn wait(&mut self, timeout: Duration) -> Result<bool, TransportError>;

    /// Samples that a publisher sent to this subscriber and that can no longer arrive: overrun
    /// here, or lost on the way.
    fn lost(&self) -> u64;

    /// How often samples of one publisher came between those of another: above 0, the topic has several at a time. One
    /// that takes the place of another does not count.
    fn interleaved(&self) -> u64;

    /// The next sample, waiting for it at most `timeout`.
    ///
    /// # Errors
    /// As [`Subscribe::try_take`].
    fn take_within(&mut self, timeout: Duration) -> Result<Option<M>, TransportError> {
        if let Some(sample) = self.try_take()? {
            return Ok(Some(sample));
        }
        if self.wait(timeout)? {
            return self.try_take();
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_is_found_by_its_name() {
        for kind in TransportKind::ALL {
            assert_eq!(kind.name().parse::<TransportKind>().unwrap(), kind);
        }
        let error = "shm".parse::<TransportKind>().unwrap_err().to_string();
        assert!(error.contains("shared-memory"), "{error}");
    }
}
