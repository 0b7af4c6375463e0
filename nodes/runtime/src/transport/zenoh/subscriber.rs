//! The receiving end over Zenoh.
//!
//! Place in the flow: on the thread of whoever works with the samples. The library's thread puts what arrives into the
//! [`Inbox`]; here it is judged, decoded and checked, because whoever is in the network may send anything.

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::Duration;

use abbe_msgs::{Message, cdr};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Sample, SampleKind};

use super::ZenohSession;
use super::inbox::{Arrived, Inbox, arrived};
use super::keys::End;
use super::session::endpoint_error;
use crate::transport::deadline::Deadline;
use crate::transport::losses::{Arrival, Losses};
use crate::transport::shared_memory::SampleOrigin;
use crate::transport::{Subscribe, TransportError};

const WHAT: &str = "subscriber";

/// A sample and who sent it, or why one that arrived must not be used.
type Taken<M> = Result<(M, SampleOrigin), TransportError>;

/// Receives over Zenoh. Losses are counted from the first sample of a publisher on.
pub struct ZenohSubscriber<M: Message> {
    topic: String,
    inbox: Arc<Inbox>,
    losses: Losses,
    /// Found while waiting, not yet taken.
    waiting: Option<Taken<M>>,
    _subscriber: Subscriber<()>,
    _token: LivelinessToken,
    // Last: the session leaves after its endpoints.
    _session: ZenohSession,
}

impl<M: Message> ZenohSubscriber<M> {
    pub(super) fn open(session: &ZenohSession, topic: &str, depth: NonZeroUsize) -> Result<Self, TransportError> {
        let failed = |error: zenoh::Error| endpoint_error(WHAT, topic, &error);
        let key = session.topic::<M::Ros>(WHAT, topic)?;
        let inbox = Arc::new(Inbox::new(depth));
        let hears = Arc::clone(&inbox);
        let subscriber = session.library().declare_subscriber(session.key_of_samples(&key));
        let _subscriber = subscriber.callback(move |sample| hears.push(read(&sample))).wait().map_err(failed)?;
        let _token = session.declare(session.endpoint_token(End::Subscriber, &key, depth)).map_err(failed)?;
        let (losses, waiting, topic) = (Losses::default(), None, topic.to_owned());
        Ok(Self { topic, inbox, losses, waiting, _subscriber, _token, _session: session.clone() })
    }

    /// The next sample and who sent it, waiting for it at most `timeout`; errors as [`Subscribe::try_take`].
    pub(crate) fn take_with_origin(&mut self, timeout: Duration) -> Result<Option<(M, SampleOrigin)>, TransportError> {
        if !self.wait(timeout)? {
            return Ok(None);
        }
        self.next().transpose()
    }

    fn next(&mut self) -> Option<Taken<M>> {
        self.waiting.take().or_else(|| self.receive())
    }

    /// The next sample, or why one that arrived must not be used.
    fn receive(&mut self) -> Option<Taken<M>> {
        loop {
            let (origin, bytes) = match self.inbox.pop()? {
                Ok(arrived) => arrived,
                Err(reason) => return Some(Err(self.refused(reason))),
            };
            match self.losses.judge(origin.source, origin.number) {
                Arrival::New => {
                    let message = cdr::decode::<M::Ros>(&bytes).map_err(|error| error.to_string());
                    let checked = |message| M::from_ros(message).map_err(|error| error.to_string());
                    let sample = message.and_then(checked);
                    return Some(sample.map(|sample| (sample, origin)).map_err(|reason| self.refused(reason)));
                }
                Arrival::Repeated => {}
            }
        }
    }

    fn refused(&self, reason: String) -> TransportError {
        TransportError::Malformed { topic: self.topic.clone(), reason }
    }
}

fn read(sample: &Sample) -> Arrived {
    if sample.kind() != SampleKind::Put {
        return Err("it deletes instead of saying anything".to_owned());
    }
    let attachment = sample.attachment().map(|attachment| attachment.to_bytes());
    arrived(attachment.as_deref(), sample.payload().len(), || sample.payload().to_bytes().into_owned())
}

impl<M: Message> Subscribe<M> for ZenohSubscriber<M> {
    fn try_take(&mut self) -> Result<Option<M>, TransportError> {
        let next = self.next().transpose()?;
        Ok(next.map(|(sample, _)| sample))
    }

    fn wait(&mut self, timeout: Duration) -> Result<bool, TransportError> {
        let deadline = Deadline::after(timeout);
        loop {
            if self.waiting.is_none() {
                self.waiting = self.receive();
            }
            let left = deadline.round();
            if self.waiting.is_some() || left.is_zero() {
                return Ok(self.waiting.is_some());
            }
            self.inbox.wait(left);
        }
    }

    fn lost(&self) -> u64 {
        self.losses.count() + self.inbox.given_up()
    }

    fn interleaved(&self) -> u64 {
        self.losses.interleaved()
    }
}
