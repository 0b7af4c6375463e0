//! What can go wrong on an edge of the graph.
//!
//! Place in the flow: returned by every transport, with the topic and what to do.

use abbe_msgs::MessageError;
use thiserror::Error;

use super::TransportKind;
use crate::ros::RosError;

/// A failure of an edge.
#[derive(Debug, Error)]
pub enum TransportError {
    /// A transport of that name does not exist.
    #[error("unknown transport '{name}'; use in-process, shared-memory, dds or zenoh")]
    UnknownKind {
        /// The name as given.
        name: String,
    },
    /// This program is built without the library of a transport.
    #[error("this program is built without {kind}; build it with `cargo build --release --features {kind}`")]
    NotBuilt {
        /// The transport.
        kind: TransportKind,
    },
    /// An edge asks for a transport that the node was not started with.
    #[error("topic {topic} asks for {kind}, which this node was started without")]
    NotConfigured {
        /// The topic.
        topic: String,
        /// The transport.
        kind: TransportKind,
    },
    /// A publisher without a transport.
    #[error("topic {topic} has no transport; name at least one of in-process, shared-memory, dds, zenoh")]
    NoTransport {
        /// The topic.
        topic: String,
    },
    /// The transport itself cannot be opened.
    #[error("cannot open {kind}: {reason}")]
    Open {
        /// The transport.
        kind: TransportKind,
        /// Why, and what to do.
        reason: String,
    },
    /// A publisher or subscriber cannot be opened.
    #[error("topic {topic}: cannot open {what} over {kind}: {reason}")]
    Endpoint {
        /// The topic.
        topic: String,
        /// `publisher` or `subscriber`.
        what: &'static str,
        /// The transport.
        kind: TransportKind,
        /// Why, and what to do.
        reason: String,
    },
    /// Another type travels on the topic.
    #[error("topic {topic} already carries another type than {expected}; give one another name")]
    OtherType {
        /// The topic.
        topic: String,
        /// ROS 2 name of the type asked for.
        expected: &'static str,
    },
    /// A sample could not be handed to the transport.
    #[error("topic {topic}: cannot send over {kind}: {reason}")]
    Send {
        /// The topic.
        topic: String,
        /// The transport.
        kind: TransportKind,
        /// Why.
        reason: String,
    },
    /// The transport failed while receiving.
    #[error("topic {topic}: cannot receive over {kind}: {reason}")]
    Receive {
        /// The topic.
        topic: String,
        /// The transport.
        kind: TransportKind,
        /// Why.
        reason: String,
    },
    /// A sample arrived that must not be used. The stream goes on.
    #[error("topic {topic}: refused a sample: {reason}")]
    Malformed {
        /// The topic.
        topic: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The ROS 2 side.
    #[error(transparent)]
    Ros(#[from] RosError),
}

impl TransportError {
    /// Whether the stream goes on: the sample is refused, the transport is sound.
    #[must_use]
    pub fn is_malformed_sample(&self) -> bool {
        matches!(self, Self::Malformed { .. })
    }

    pub(crate) fn refused(topic: &str, error: &MessageError) -> Self {
        Self::Malformed { topic: topic.into(), reason: error.to_string() }
    }
}
