//! A DDS publisher on a thread of its own.
//!
//! Place in the flow: everything this crate publishes over DDS goes through here: samples,
//! standard messages, diagnostics. Conversion, serialisation and the socket cost the caller nothing.

use std::num::NonZeroUsize;
use std::sync::Arc;

use abbe_msgs::RosType;
use ros2_client::QosProfile;

use super::{RosError, RosNode, Writer};
use crate::{Outbox, OutboxCounts};

/// Publishes messages made from items of type `T` (by default the message itself).
pub struct QueuedPublisher<R: RosType, T = R> {
    topic: String,
    // First of the three: its thread lets go of the publisher before the node can leave.
    outbox: Outbox<T>,
    publisher: Arc<Writer<R>>,
    node: RosNode,
}

impl<R: RosType, T: Send + 'static> QueuedPublisher<R, T> {
    /// Opens `topic`, an absolute name. `message` runs on the publishing thread.
    pub(crate) fn open(
        node: &RosNode,
        topic: &str,
        qos: &QosProfile,
        depth: NonZeroUsize,
        message: impl Fn(T) -> R + Send + 'static,
    ) -> Result<Self, RosError> {
        let publisher = Arc::new(node.writer::<R>(topic, qos)?);
        let writer = Arc::clone(&publisher);
        let outbox = Outbox::spawn(topic, depth, move |item| writer.publish(message(item)));
        let outbox = outbox.map_err(|source| RosError::Thread { what: "a publisher", source })?;
        Ok(Self { topic: topic.to_owned(), outbox, publisher, node: node.clone() })
    }

    /// Hands over an item. Never waits: when the queue is full, the oldest item goes, counted.
    pub fn publish(&self, item: T) {
        self.outbox.push(item);
    }

    /// What became of the items so far.
    #[must_use]
    pub fn counts(&self) -> OutboxCounts {
        self.outbox.counts()
    }

    /// The absolute name of the topic.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// How often a reliable reader lagged by a whole window and lost its oldest samples.
    #[must_use]
    pub fn given_up(&self) -> u64 {
        self.publisher.given_up()
    }

    /// Subscribers found so far.
    #[must_use]
    pub fn subscribers(&self) -> usize {
        self.node.subscribers(&self.publisher)
    }
}
