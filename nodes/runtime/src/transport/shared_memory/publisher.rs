//! The sending end over shared memory.
//!
//! Place in the flow: on the correcting thread itself; one sample is a copy into shared memory and
//! one wake-up a subscriber.

use abbe_msgs::Message;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::service::ipc_threadsafe::Service;
use iceoryx2::service::port_factory::PortFactory;

use super::{MAX_BORROWED, MAX_LOANED, MAX_SUBSCRIBERS, SampleOrigin, SampleService, SharedMemory, endpoint_error};
use crate::transport::{Publish, TransportError, TransportKind};

const WHAT: &str = "publisher";

/// Sends over shared memory.
#[derive(Debug)]
pub struct SharedMemoryPublisher<M: Message> {
    topic: String,
    samples: Publisher<Service, M, SampleOrigin>,
    wake: Notifier<Service>,
    service: SampleService<M>,
    next_number: u64,
    dropped: u64,
    // Last: the node leaves the run after its endpoints.
    _node: SharedMemory,
}

impl<M: Message> SharedMemoryPublisher<M> {
    pub(super) fn open(memory: &SharedMemory, topic: &str) -> Result<Self, TransportError> {
        let (service, events) = memory.services::<M>(topic, WHAT)?;
        // iceoryx2 would reserve a full buffer for each possible subscriber. As every buffer holds
        // the newest samples and overflows, what is in use at a time is one buffer and what
        // subscribers hold borrowed, in this and in the process before it under the same place.
        let in_use = memory.depth.get() + 2 * MAX_SUBSCRIBERS * MAX_BORROWED + MAX_LOANED;
        let samples = service
            .publisher_builder()
            .max_loaned_samples(MAX_LOANED)
            .override_sample_preallocation(move |worst_case| worst_case.min(in_use))
            .create()
            .map_err(|error| endpoint_error(topic, WHAT, format!("{error:?}")))?;
        let wake =
            events.notifier_builder().create().map_err(|error| endpoint_error(topic, WHAT, format!("{error:?}")))?;
        Ok(Self { topic: topic.to_owned(), samples, wake, service, next_number: 0, dropped: 0, _node: memory.clone() })
    }

    /// Sends a sample of someone else's.
    pub(crate) fn send_as(&mut self, sample: &M, origin: SampleOrigin) -> Result<(), TransportError> {
        self.deliver(sample, origin).map_err(|reason| {
            self.dropped += 1;
            TransportError::Send { topic: self.topic.clone(), kind: TransportKind::SharedMemory, reason }
        })
    }

    fn deliver(&self, sample: &M, origin: SampleOrigin) -> Result<(), String> {
        let loan = self.samples.loan_uninit();
        let mut loan = loan.map_err(|error| format!("{error:?}"))?;
        *loan.user_header_mut() = origin;
        let delivered = loan.write_payload(*sample).send();
        delivered.map_err(|error| format!("{error:?}"))?;
        let woken = self.wake.notify();
        woken.map_err(|error| format!("{error:?}"))?;
        Ok(())
    }
}

impl<M: Message> Publish<M> for SharedMemoryPublisher<M> {
    fn send(&mut self, sample: &M) -> Result<(), TransportError> {
        let origin = SampleOrigin { number: self.next_number, ..SampleOrigin::default() };
        // Also after a failure: subscribers then see the gap.
        self.next_number += 1;
        self.send_as(sample, origin)
    }

    fn dropped(&self) -> u64 {
        self.dropped
    }

    fn subscribers(&self) -> usize {
        self.service.dynamic_config().number_of_subscribers()
    }
}
