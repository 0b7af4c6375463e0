//! The sending end over DDS.
//!
//! Place in the flow: [`Publish::send`] on the correcting thread, everything else on the
//! publisher's own.

use std::num::NonZeroUsize;

use abbe_msgs::Message;

use crate::ros::{QueuedPublisher, RosNode, offered_qos};
use crate::transport::{Publish, TransportError};

/// Sends over DDS.
pub struct DdsPublisher<M: Message> {
    queue: QueuedPublisher<M::Ros, M>,
}

impl<M: Message> DdsPublisher<M> {
    /// A publisher on `topic`, an absolute name ([`RosNode::resolve`]). `depth` bounds the queue to the
    /// publishing thread.
    ///
    /// # Errors
    /// When the name is wrong or the DDS library refuses.
    pub fn open(node: &RosNode, topic: &str, depth: NonZeroUsize) -> Result<Self, TransportError> {
        let qos = offered_qos(depth);
        let queue = QueuedPublisher::open(node, topic, &qos, depth, |sample: M| sample.to_ros())?;
        Ok(Self { queue })
    }
}

impl<M: Message> Publish<M> for DdsPublisher<M> {
    /// Cannot fail here: what the publishing thread cannot send is counted and logged there.
    fn send(&mut self, sample: &M) -> Result<(), TransportError> {
        self.queue.publish(*sample);
        Ok(())
    }

    fn dropped(&self) -> u64 {
        let counts = self.queue.counts();
        counts.dropped + counts.failed
    }

    fn subscribers(&self) -> usize {
        self.queue.subscribers()
    }
}
