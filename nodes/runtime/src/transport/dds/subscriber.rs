//! The receiving end over DDS.
//!
//! Place in the flow: on the thread of the node that works with the samples. The DDS library's own
//! thread puts what arrives into a cache of `depth` samples a publisher.

use std::num::NonZeroUsize;
use std::time::Duration;

use abbe_msgs::{Message, RosType};
use ros2_client::dds::rustdds::mio1::{Events, Interest, Poll, Token};
use ros2_client::{ReadError, Subscription};

use crate::ros::{RosNode, TopicEnd, overridden, stream_qos};
use crate::transport::deadline::Deadline;
use crate::transport::losses::{Arrival, Losses, Refusals};
use crate::transport::shared_memory::SampleOrigin;
use crate::transport::{Subscribe, TransportError, TransportKind};

/// A sample and who sent it, or why one that arrived must not be used.
type Taken<M> = Result<(M, SampleOrigin), TransportError>;

/// Makes a sample of a message that arrived, or says why it is none.
type Convert<M, R> = Box<dyn Fn(R) -> Result<M, String> + Send>;

/// Receives over DDS samples of type `M` from messages of type `R`. Losses are counted from the first sample of a publisher on.
pub struct DdsSubscriber<M: Message, R: RosType = <M as Message>::Ros> {
    topic: String,
    samples: Subscription<R>,
    convert: Convert<M, R>,
    poll: Poll,
    events: Events,
    losses: Losses,
    refusals: Refusals,
    /// Found while waiting, not yet taken.
    waiting: Option<Taken<M>>,
    // Last: the node leaves the graph after its endpoints.
    _node: RosNode,
}

impl<M: Message> DdsSubscriber<M> {
    /// A subscriber on `topic`, an absolute name ([`RosNode::resolve`]).
    ///
    /// # Errors
    /// When the name is wrong or the DDS library refuses.
    pub fn open(node: &RosNode, topic: &str, depth: NonZeroUsize) -> Result<Self, TransportError> {
        let convert = |message| M::from_ros(message).map_err(|error| error.to_string());
        Self::converting(node, topic, depth, Box::new(convert))
    }
}

impl<M: Message, R: RosType> DdsSubscriber<M, R> {
    /// The same for messages that are no samples of this project; `convert` makes samples of them.
    pub(crate) fn converting(
        node: &RosNode,
        topic: &str,
        depth: NonZeroUsize,
        convert: Convert<M, R>,
    ) -> Result<Self, TransportError> {
        let qos = overridden(node, topic, TopicEnd::Subscription, stream_qos(depth));
        let mut samples = node.raw_subscription::<R>(topic, &qos)?;
        let poll = polling(&mut samples).map_err(|error| TransportError::Endpoint {
            topic: topic.to_owned(),
            what: "subscriber",
            kind: TransportKind::Dds,
            reason: format!("cannot poll it: {error}"),
        })?;
        Ok(Self {
            topic: topic.to_owned(),
            samples,
            convert,
            poll,
            events: Events::with_capacity(1),
            losses: Losses::default(),
            refusals: Refusals::default(),
            waiting: None,
            _node: node.clone(),
        })
    }

    /// The next sample, or why one that arrived must not be used.
    fn receive(&mut self) -> Result<Option<Taken<M>>, TransportError> {
        loop {
            let (message, info) = match self.samples.take() {
                Ok(Some(taken)) => taken,
                Ok(None) => return Ok(None),
                Err(ReadError::Deserialization { reason }) => {
                    let topic = self.topic.clone();
                    return Ok(Some(Err(TransportError::Malformed { topic, reason })));
                }
                Err(error) => return Err(self.failed(&error)),
            };
            let number = info.sequence_number().unsigned_abs();
            let source = info.publisher_gid().to_bytes16();
            match self.losses.judge(source, number) {
                Arrival::New => {
                    let checked = self.checked(message);
                    if checked.is_err() {
                        self.refusals.note(source);
                    }
                    let number = self.refusals.number(source, number);
                    return Ok(Some(checked.map(|sample| (sample, SampleOrigin { source, number }))));
                }
                Arrival::Repeated => {}
            }
        }
    }

    /// The next sample and who sent it, waiting for it at most `timeout`; errors as [`Subscribe::try_take`].
    pub(crate) fn take_with_origin(&mut self, timeout: Duration) -> Result<Option<(M, SampleOrigin)>, TransportError> {
        if !self.wait(timeout)? {
            return Ok(None);
        }
        self.next().transpose()
    }

    fn next(&mut self) -> Option<Taken<M>> {
        self.waiting.take().or_else(|| self.receive().unwrap_or_else(|error| Some(Err(error))))
    }

    fn checked(&self, message: R) -> Result<M, TransportError> {
        (self.convert)(message).map_err(|reason| TransportError::Malformed { topic: self.topic.clone(), reason })
    }

    fn failed(&self, error: &dyn std::fmt::Display) -> TransportError {
        TransportError::Receive { topic: self.topic.clone(), kind: TransportKind::Dds, reason: error.to_string() }
    }
}

fn polling<R: RosType>(samples: &mut Subscription<R>) -> std::io::Result<Poll> {
    let poll = Poll::new()?;
    poll.registry().register(samples, Token(0), Interest::READABLE)?;
    Ok(poll)
}

impl<M: Message, R: RosType> Subscribe<M> for DdsSubscriber<M, R> {
    fn try_take(&mut self) -> Result<Option<M>, TransportError> {
        let next = self.next().transpose()?;
        Ok(next.map(|(sample, _)| sample))
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
            match self.poll.poll(&mut self.events, Some(left)) {
                // A signal ends the wait early; the next round sleeps on, or finds the time over.
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(error) => return Err(self.failed(&error)),
                Ok(()) => {}
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
