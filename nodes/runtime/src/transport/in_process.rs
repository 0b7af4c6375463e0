//! The transport within one process: a bounded ring for each subscriber.
//!
//! Place in the flow: tests, and replay of a recording through the nodes in one process, where the
//! order of events must not depend on the scheduler.

use std::any::Any;
use std::collections::{BTreeMap, VecDeque};
use std::num::NonZeroUsize;
use std::sync::{Arc, Condvar, Mutex, PoisonError, Weak};
use std::time::Duration;

use abbe_msgs::Message;

use super::{Publish, Subscribe, TransportError};
use crate::lock::lock;

/// The topics of one process. Clones share them.
#[derive(Debug, Clone, Default)]
pub struct InProcess {
    topics: Arc<Mutex<BTreeMap<String, Box<dyn Any + Send>>>>,
}

/// Sends to every subscriber that this process has on the topic at that moment.
#[derive(Debug)]
pub struct InProcessPublisher<M> {
    topic: Arc<Topic<M>>,
}

/// Receives from every publisher that this process has on the topic.
#[derive(Debug)]
pub struct InProcessSubscriber<M> {
    name: String,
    ring: Arc<Ring<M>>,
}

#[derive(Debug)]
struct Topic<M> {
    rings: Mutex<Vec<Weak<Ring<M>>>>,
}

#[derive(Debug)]
struct Ring<M> {
    state: Mutex<RingState<M>>,
    filled: Condvar,
    depth: usize,
}

#[derive(Debug)]
struct RingState<M> {
    samples: VecDeque<M>,
    overrun: u64,
}

impl InProcess {
    /// A publisher on `topic`.
    ///
    /// # Errors
    /// When the topic carries another type.
    pub fn publisher<M: Message>(&self, topic: &str) -> Result<InProcessPublisher<M>, TransportError> {
        let topic = self.topic(topic)?;
        Ok(InProcessPublisher { topic })
    }

    /// A subscriber on `topic` that can be `depth` samples behind.
    ///
    /// # Errors
    /// When the topic carries another type.
    pub fn subscriber<M: Message>(
        &self,
        topic: &str,
        depth: NonZeroUsize,
    ) -> Result<InProcessSubscriber<M>, TransportError> {
        let ring = Arc::new(Ring {
            state: Mutex::new(RingState { samples: VecDeque::new(), overrun: 0 }),
            filled: Condvar::new(),
            depth: depth.get(),
        });
        let shared = self.topic::<M>(topic)?;
        lock(&shared.rings).push(Arc::downgrade(&ring));
        Ok(InProcessSubscriber { name: topic.to_owned(), ring })
    }

    fn topic<M: Message>(&self, name: &str) -> Result<Arc<Topic<M>>, TransportError> {
        let mut topics = lock(&self.topics);
        let entry =
            topics.entry(name.to_owned()).or_insert_with(|| Box::new(Arc::new(Topic::<M> { rings: Mutex::default() })));
        let found = entry.downcast_ref::<Arc<Topic<M>>>().map(Arc::clone);
        found.ok_or_else(|| TransportError::OtherType { topic: name.to_owned(), expected: M::ROS_TYPE })
    }
}

/// No lock here is held across code that can panic half-way through a change.
impl<M: Message> Publish<M> for InProcessPublisher<M> {
    fn send(&mut self, sample: &M) -> Result<(), TransportError> {
        lock(&self.topic.rings).retain(|ring| match ring.upgrade() {
            Some(ring) => {
                ring.push(*sample);
                true
            }
            None => false,
        });
        Ok(())
    }

    fn dropped(&self) -> u64 {
        0
    }

    fn subscribers(&self) -> usize {
        let rings = lock(&self.topic.rings);
        rings.iter().filter(|ring| ring.strong_count() > 0).count()
    }
}

impl<M> Ring<M> {
    fn push(&self, sample: M) {
        let mut state = lock(&self.state);
        if state.samples.len() >= self.depth {
            state.samples.pop_front();
            state.overrun += 1;
        }
        state.samples.push_back(sample);
        drop(state);
        self.filled.notify_all();
    }
}

impl<M: Message> Subscribe<M> for InProcessSubscriber<M> {
    fn try_take(&mut self) -> Result<Option<M>, TransportError> {
        let Some(sample) = lock(&self.ring.state).samples.pop_front() else {
            return Ok(None);
        };
        let checked = sample.validate().map(|()| Some(sample));
        checked.map_err(|error| TransportError::refused(&self.name, &error))
    }

    fn wait(&mut self, timeout: Duration) -> Result<bool, TransportError> {
        let state = lock(&self.ring.state);
        let waited = self.ring.filled.wait_timeout_while(state, timeout, |state| state.samples.is_empty());
        let state = waited.unwrap_or_else(PoisonError::into_inner).0;
        Ok(!state.samples.is_empty())
    }

    fn lost(&self) -> u64 {
        lock(&self.ring.state).overrun
    }

    /// Not told here: a program knows its own publishers.
    fn interleaved(&self) -> u64 {
        0
    }
}
