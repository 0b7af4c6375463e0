//! The sending end over Zenoh.
//!
//! Place in the flow: [`Publish::send`] on the correcting thread, everything else on the publisher's own; in a gateway on the
//! thread of the stream. What a slow or dead reader cannot take is dropped on the way to it (congestion control "drop", as
//! with rmw_zenoh), so that nobody waits for it; the reader misses the numbers and counts them.

use std::marker::PhantomData;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

use abbe_msgs::{Message, RosType, Sha256, cdr};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;

use super::ZenohSession;
use super::attachment::Attachment;
use super::keys::{End, TopicKey};
use super::session::endpoint_error;
use crate::Outbox;
use crate::ros::RosError;
use crate::transport::{Publish, TransportError};

const WHAT: &str = "publisher";

/// Publishes messages on the calling thread.
pub(crate) struct ZenohWriter<R: RosType> {
    publisher: Publisher<'static>,
    gid: [u8; 16],
    next: AtomicI64,
    topic: TopicKey,
    _token: LivelinessToken,
    // Last: the session leaves after its endpoints.
    session: ZenohSession,
    of: PhantomData<fn(R)>,
}

impl<R: RosType> ZenohWriter<R> {
    pub(super) fn open(session: &ZenohSession, topic: &str, depth: NonZeroUsize) -> Result<Self, TransportError> {
        let failed = |error: zenoh::Error| endpoint_error(WHAT, topic, &error);
        let key = session.topic::<R>(WHAT, topic)?;
        let publisher = session.library().declare_publisher(session.key_of_samples(&key));
        let publisher = publisher.congestion_control(CongestionControl::Drop).wait().map_err(failed)?;
        let token = session.endpoint_token(End::Publisher, &key, depth);
        let mut gid = [0; 16];
        gid.copy_from_slice(&Sha256::of(token.as_bytes()).to_bytes()[..16]);
        let _token = session.declare(token).map_err(failed)?;
        let (next, session) = (AtomicI64::new(1), session.clone());
        Ok(Self { publisher, gid, next, topic: key, _token, session, of: PhantomData })
    }

    /// Publishes a message; one that cannot be sent is a gap in the numbers.
    pub(crate) fn publish(&self, message: &R) -> Result<(), String> {
        let number = self.next.fetch_add(1, Ordering::Relaxed);
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let sent_ns = i64::try_from(since.as_nanos()).unwrap_or(i64::MAX);
        let attachment = Attachment { number, sent_ns, gid: self.gid };
        let bytes = cdr::encode(message).map_err(|error| error.to_string())?;
        let sent = self.publisher.put(bytes).attachment(attachment.to_bytes()).wait();
        sent.map_err(|error| error.to_string())
    }

    /// Subscribers that there are.
    pub(crate) fn subscribers(&self) -> usize {
        self.session.subscribers(&self.topic)
    }

    fn others(&self) -> usize {
        self.session.publishers(&self.topic)
    }
}

/// Sends over Zenoh.
pub struct ZenohPublisher<M: Message> {
    // First: its thread lets go of the writer before the session can leave.
    outbox: Outbox<M>,
    writer: Arc<ZenohWriter<M::Ros>>,
}

impl<M: Message> ZenohPublisher<M> {
    pub(super) fn open(session: &ZenohSession, topic: &str, depth: NonZeroUsize) -> Result<Self, TransportError> {
        let writer = Arc::new(ZenohWriter::open(session, topic, depth)?);
        let its = Arc::clone(&writer);
        let outbox = Outbox::spawn(topic, depth, move |sample: M| its.publish(&sample.to_ros()));
        let outbox = outbox.map_err(|source| RosError::Thread { what: "a publisher", source })?;
        Ok(Self { outbox, writer })
    }
}

impl<M: Message> Publish<M> for ZenohPublisher<M> {
    /// Cannot fail here: what the publishing thread cannot send is counted and logged there.
    fn send(&mut self, sample: &M) -> Result<(), TransportError> {
        self.outbox.push(*sample);
        Ok(())
    }

    fn dropped(&self) -> u64 {
        let counts = self.outbox.counts();
        counts.dropped + counts.failed
    }

    fn subscribers(&self) -> usize {
        self.writer.subscribers()
    }

    fn others(&self) -> usize {
        self.writer.others()
    }
}
