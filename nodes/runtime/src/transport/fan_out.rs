//! One publisher on several transports: shared memory for this host and DDS for everyone else.
//!
//! Place in the flow: what [`super::Edges::publisher`] returns for an edge with more than one kind.

use abbe_msgs::Message;

use super::{Publish, TransportError};

/// Sends every sample to each of its publishers, in their order.
pub struct FanOut<M> {
    publishers: Vec<Box<dyn Publish<M>>>,
}

impl<M: Message> FanOut<M> {
    /// A publisher over all of these.
    #[must_use]
    pub fn new(publishers: Vec<Box<dyn Publish<M>>>) -> Self {
        Self { publishers }
    }
}

impl<M: Message> Publish<M> for FanOut<M> {
    /// Every transport gets the sample, also when one before it fails; the first failure is
    /// returned, the others show in [`Publish::dropped`].
    fn send(&mut self, sample: &M) -> Result<(), TransportError> {
        let mut outcome = Ok(());
        for publisher in &mut self.publishers {
            let sent = publisher.send(sample);
            outcome = outcome.and(sent);
        }
        outcome
    }

    fn dropped(&self) -> u64 {
        self.publishers.iter().map(|one| one.dropped()).sum()
    }

    fn subscribers(&self) -> usize {
        self.publishers.iter().map(|one| one.subscribers()).sum()
    }

    fn others(&self) -> usize {
        self.publishers.iter().map(|one| one.others()).sum()
    }
}
