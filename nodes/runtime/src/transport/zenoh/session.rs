//! A node's place in a graph over Zenoh.
//!
//! Place in the flow: one a process, opened before the endpoints, which hold it; it leaves when the last is dropped. Nothing
//! waits for a router: a session without one is open, and meets the others when it comes.

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use abbe_msgs::{Message, RosType};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait};

use super::graph::Graph;
use super::keys::{End, NodeKey, TopicKey, all_tokens};
use super::publisher::ZenohWriter;
use super::{ZenohConfig, ZenohPublisher, ZenohSubscriber};
use crate::ros::{Domain, NodeIdentity};
use crate::transport::{TransportError, TransportKind};

/// A session with one node. Clones, and all endpoints, share it.
#[derive(Clone)]
pub struct ZenohSession(Arc<Inner>);

struct Inner {
    domain_id: u16,
    key: NodeKey,
    id: String,
    next: AtomicU64,
    graph: Arc<Graph>,
    // In the order in which they go.
    _tokens: Subscriber<()>,
    _token: LivelinessToken,
    session: Session,
}

impl ZenohSession {
    /// Opens a session in which there is this node.
    ///
    /// # Errors
    /// When the configuration cannot be followed: an address that cannot be listened on, a certificate that is missing, a
    /// client without a router.
    pub fn open(identity: &NodeIdentity, domain: Domain, config: ZenohConfig) -> Result<Self, TransportError> {
        let failed =
            |error: zenoh::Error| TransportError::Open { kind: TransportKind::Zenoh, reason: error.to_string() };
        let session = zenoh::open(config.into_inner()).wait().map_err(failed)?;
        let id = session.zid().to_string();
        let key = NodeKey::new(domain.id(), &id, identity);
        let graph = Arc::<Graph>::default();
        let seen = Arc::clone(&graph);
        let _tokens = session
            .liveliness()
            .declare_subscriber(all_tokens(domain.id()))
            .history(true)
            .callback(move |token| match token.kind() {
                SampleKind::Put => seen.add(token.key_expr()),
                SampleKind::Delete => seen.remove(token.key_expr()),
            })
            .wait()
            .map_err(failed)?;
        let _token = session.liveliness().declare_token(key.token()).wait().map_err(failed)?;
        let domain_id = domain.id();
        // The node itself is 0.
        let next = AtomicU64::new(1);
        Ok(Self(Arc::new(Inner { domain_id, key, id, next, graph, _tokens, _token, session })))
    }

    /// A publisher on `topic`, an absolute name. `depth` bounds the queue to the publishing thread.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub fn publisher<M: Message>(&self, topic: &str, depth: NonZeroUsize) -> Result<ZenohPublisher<M>, TransportError> {
        ZenohPublisher::open(self, topic, depth)
    }

    /// A subscriber on `topic`, an absolute name, that can be `depth` samples behind.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub fn subscriber<M: Message>(
        &self,
        topic: &str,
        depth: NonZeroUsize,
    ) -> Result<ZenohSubscriber<M>, TransportError> {
        ZenohSubscriber::open(self, topic, depth)
    }

    /// Publishes on the calling thread.
    pub(crate) fn writer<R: RosType>(
        &self,
        topic: &str,
        depth: NonZeroUsize,
    ) -> Result<ZenohWriter<R>, TransportError> {
        ZenohWriter::open(self, topic, depth)
    }

    /// Publishers of a topic with messages of this type in other sessions.
    pub(crate) fn publishers_elsewhere(&self, topic: &str, ros_type: &str) -> usize {
        TopicKey::new(topic, ros_type).map_or(0, |topic| self.0.graph.publishers(&topic, &self.0.id))
    }

    pub(super) fn topic<R: RosType>(&self, what: &'static str, topic: &str) -> Result<TopicKey, TransportError> {
        let key = TopicKey::new(topic, R::ROS_TYPE);
        key.ok_or_else(|| endpoint_error(what, topic, &format!("{} has no description, hence no hash", R::ROS_TYPE)))
    }

    pub(super) fn key_of_samples(&self, topic: &TopicKey) -> String {
        topic.of_samples(self.0.domain_id)
    }

    /// The name of a new endpoint.
    pub(super) fn endpoint_token(&self, end: End, topic: &TopicKey, depth: NonZeroUsize) -> String {
        self.0.key.endpoint_token(self.0.next.fetch_add(1, Ordering::Relaxed), end, topic, depth)
    }

    pub(super) fn declare(&self, token: String) -> zenoh::Result<LivelinessToken> {
        self.0.session.liveliness().declare_token(token).wait()
    }

    pub(super) fn library(&self) -> &Session {
        &self.0.session
    }

    pub(super) fn subscribers(&self, topic: &TopicKey) -> usize {
        self.0.graph.subscribers(topic)
    }

    pub(super) fn publishers(&self, topic: &TopicKey) -> usize {
        self.0.graph.publishers(topic, &self.0.id)
    }
}

impl std::fmt::Debug for ZenohSession {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "ZenohSession({})", self.0.id)
    }
}

pub(super) fn endpoint_error(what: &'static str, topic: &str, reason: &dyn std::fmt::Display) -> TransportError {
    let (topic, reason) = (topic.to_owned(), reason.to_string());
    TransportError::Endpoint { topic, what, kind: TransportKind::Zenoh, reason }
}
