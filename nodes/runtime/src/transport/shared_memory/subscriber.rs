//! The receiving end over shared memory.
//!
//! Place in the flow: on the thread of the node that works with the samples.

use std::time::Duration;

use abbe_msgs::Message;
use iceoryx2::port::listener::{Listener, ListenerWaitError};
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::service::ipc_threadsafe::Service;

use super::ledger::Ledger;
use super::{SampleOrigin, SharedMemory, endpoint_error};
use crate::transport::deadline::Deadline;
use crate::transport::losses::{Arrival, Losses};
use crate::transport::{Subscribe, TransportError, TransportKind};

const WHAT: &str = "subscriber";

/// Receives over shared memory. Losses are counted from the first sample of a publisher on.
#[derive(Debug)]
pub struct SharedMemorySubscriber<M: Message> {
    topic: String,
    samples: Subscriber<Service, M, SampleOrigin>,
    wake: Listener<Service>,
    losses: Losses,
    ledger: Option<Ledger>,
    /// Found while waiting, not yet taken.
    waiting: Option<M>,
    // Last: the node leaves the run after its endpoints.
    _node: SharedMemory,
}

impl<M: Message> SharedMemorySubscriber<M> {
    /// On the service `link`; errors and the ledger speak of `topic`.
    pub(super) fn open(memory: &SharedMemory, link: &str, topic: &str) -> Result<Self, TransportError> {
        let (samples, events) = memory.services::<M>(link, WHAT)?;
        // The listener first: a sample that comes between the two wakes it.
        let wake =
            events.listener_builder().create().map_err(|error| endpoint_error(topic, WHAT, format!("{error:?}")))?;
        let samples = samples
            .subscriber_builder()
            .buffer_size(memory.depth.get())
            .create()
            .map_err(|error| endpoint_error(topic, WHAT, format!("{error:?}")))?;
        let remembered = memory.remembered_as.as_ref().map(|node| Ledger::open(&memory.run, node, topic));
        let ledger = remembered
            .transpose()
            .map_err(|error| endpoint_error(topic, WHAT, format!("cannot note what is taken: {error}")))?;
        let mut losses = Losses::default();
        if let Some((publisher, next)) = ledger.as_ref().and_then(Ledger::read) {
            losses.resume(publisher, next);
        }
        Ok(Self { topic: topic.to_owned(), samples, wake, losses, ledger, waiting: None, _node: memory.clone() })
    }

    /// The next sample as it lies in memory, unchecked.
    fn receive(&mut self) -> Result<Option<M>, TransportError> {
        if let Some(ledger) = &mut self.ledger {
            ledger.write(self.losses.latest());
        }
        loop {
            let received = self.samples.receive();
            let Some(sample) = received.map_err(|error| self.failed(&error))? else {
                return Ok(None);
            };
            let SampleOrigin { source, number } = *sample.user_header();
            let publisher = match source == SampleOrigin::default().source {
                true => sample.header().publisher_id().value().to_le_bytes(),
                false => source,
            };
            match self.losses.judge(publisher, number) {
                Arrival::New => return Ok(Some(*sample.payload())),
                Arrival::Repeated => {}
            }
        }
    }

    /// The number after that of the sample taken last; none before the first.
    pub(crate) fn next_number(&self) -> Option<u64> {
        self.losses.latest().map(|(_, next)| next)
    }

    fn failed(&self, error: &dyn std::fmt::Debug) -> TransportError {
        TransportError::Receive {
            topic: self.topic.clone(),
            kind: TransportKind::SharedMemory,
            reason: format!("{error:?}"),
        }
    }
}

impl<M: Message> Subscribe<M> for SharedMemorySubscriber<M> {
    fn try_take(&mut self) -> Result<Option<M>, TransportError> {
        let sample = match self.waiting.take() {
            Some(sample) => Some(sample),
            None => self.receive()?,
        };
        let Some(sample) = sample else {
            return Ok(None);
        };
        let checked = sample.validate().map(|()| Some(sample));
        checked.map_err(|error| TransportError::refused(&self.topic, &error))
    }

    fn wait(&mut self, timeout: Duration) -> Result<bool, TransportError> {
        let deadline = Deadline::after(timeout);
        loop {
            if self.waiting.is_none() {
                self.waiting = self.receive()?;
            }
            let left = deadline.round();
            if self.waiting.is_some() || left.is_zero() {
                return Ok(self.waiting.is_some());
            }
            match self.wake.timed_wait(|_| {}, left) {
                // A signal ends the wait early; the next round sleeps on, or finds the time over.
                Ok(_) | Err(ListenerWaitError::InterruptSignal) => {}
                Err(error) => return Err(self.failed(&error)),
            }
        }
    }

    fn lost(&self) -> u64 {
        self.losses.count()
    }

    fn interleaved(&self) -> u64 {
        self.losses.interleaved()
    }
}
