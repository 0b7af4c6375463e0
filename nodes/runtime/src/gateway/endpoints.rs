//! The node's ends of topics over DDS and Zenoh: samples go to, and come from, the gateway through shared memory.
//!
//! Place in the flow: on the correcting thread, in place of a publisher or subscriber of the library. Sending costs a copy into
//! shared memory, whether or not there is a gateway.

use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use abbe_msgs::Message;

use super::companion::Companion;
use super::foreign::Foreign;
use super::node::{GatewayNode, Held};
use super::protocol::Endpoint;
use super::shared::{NodeEnd, Publication, SubscriptionState};
use crate::lock::lock;
use crate::transport::shared_memory::{SharedMemoryPublisher, SharedMemorySubscriber};
use crate::transport::{Publish, Subscribe, TransportError, TransportKind};

/// Sends through the gateway.
pub struct GatewayPublisher<M: Message> {
    link: SharedMemoryPublisher<M>,
    publication: Arc<Publication>,
    // Last: the gateway closes its end when this one is gone.
    _held: Held,
}

impl<M: Message> GatewayPublisher<M> {
    /// A publisher on `topic`, an absolute name, over `kind`; without one only what is made of the samples goes out, the
    /// `companions`.
    ///
    /// # Errors
    /// When a name is wrong, or the gateway cannot open it.
    pub fn open(
        node: &GatewayNode,
        topic: Option<&str>,
        kind: TransportKind,
        companions: &[Companion],
    ) -> Result<Self, TransportError> {
        let name =
            node.link_name(topic.or(companions.first().map(|companion| companion.topic.as_str())).unwrap_or_default());
        let link = node.memory().publisher(&name)?;
        let publication = Arc::new(Publication::default());
        let endpoint = Endpoint::Publication {
            link: name,
            ros_type: M::ROS_TYPE.to_owned(),
            topic: topic.map(str::to_owned),
            over: kind,
            companions: companions.to_vec(),
        };
        let held = node.open(endpoint, NodeEnd::Publication(Arc::clone(&publication)))?;
        Ok(Self { link, publication, _held: held })
    }
}

impl<M: Message> Publish<M> for GatewayPublisher<M> {
    /// Cannot fail: what cannot be handed on is counted.
    fn send(&mut self, sample: &M) -> Result<(), TransportError> {
        self.publication.sent.fetch_add(1, Ordering::Relaxed);
        // A sample that the link cannot take is a gap in its numbers, which the gateway reports; where there is no
        // gateway, it is missed like all the others.
        if let Err(error) = self.link.send(sample) {
            tracing::debug!(%error, "not handed to the gateway");
        }
        Ok(())
    }

    fn dropped(&self) -> u64 {
        self.publication.dropped()
    }

    fn subscribers(&self) -> usize {
        self.publication.subscribers()
    }

    fn others(&self) -> usize {
        self.publication.others.load(Ordering::Relaxed)
    }
}

/// Receives through the gateway.
pub struct GatewaySubscriber<M: Message> {
    topic: String,
    link: SharedMemorySubscriber<M>,
    refused: Arc<Mutex<SubscriptionState>>,
    /// Refused samples that have been told of.
    told: u64,
    _held: Held,
}

impl<M: Message> GatewaySubscriber<M> {
    /// A subscriber on `topic`, an absolute name, over `kind`.
    ///
    /// # Errors
    /// When the name is wrong, or the gateway cannot open it.
    pub fn open(node: &GatewayNode, topic: &str, kind: TransportKind) -> Result<Self, TransportError> {
        Self::opened(node, topic, kind, None)
    }

    /// The same over DDS on a topic of other programs, on which standard messages come.
    ///
    /// # Errors
    /// As [`GatewaySubscriber::open`].
    pub fn open_foreign(node: &GatewayNode, topic: &str, foreign: Foreign) -> Result<Self, TransportError> {
        Self::opened(node, topic, TransportKind::Dds, Some(foreign))
    }

    /// Publishers of the topic elsewhere; 0 while there is no gateway that could tell.
    #[must_use]
    pub fn publishers(&self) -> usize {
        lock(&self.refused).publishers
    }

    fn opened(
        node: &GatewayNode,
        topic: &str,
        over: TransportKind,
        foreign: Option<Foreign>,
    ) -> Result<Self, TransportError> {
        let name = node.link_name(topic);
        let link = node.memory().link_subscriber(&name, topic)?;
        let refused = Arc::new(Mutex::default());
        let (ros_type, absolute) = (M::ROS_TYPE.to_owned(), topic.to_owned());
        let endpoint = Endpoint::Subscription { link: name, ros_type, topic: absolute, over, foreign };
        let held = node.open(endpoint, NodeEnd::Subscription(Arc::clone(&refused)))?;
        Ok(Self { topic: topic.to_owned(), link, refused, told: 0, _held: held })
    }

    /// Tells of one more sample that the gateway had to refuse.
    fn refusal(&mut self) -> Option<TransportError> {
        let refused = lock(&self.refused);
        if self.told >= refused.malformed {
            return None;
        }
        self.told += 1;
        Some(TransportError::Malformed { topic: self.topic.clone(), reason: refused.last_reason.clone() })
    }
}

impl<M: Message> Subscribe<M> for GatewaySubscriber<M> {
    fn try_take(&mut self) -> Result<Option<M>, TransportError> {
        if let Some(sample) = self.link.try_take()? {
            return Ok(Some(sample));
        }
        self.refusal().map_or(Ok(None), Err)
    }

    fn wait(&mut self, timeout: Duration) -> Result<bool, TransportError> {
        let refusals = lock(&self.refused).malformed;
        Ok(refusals > self.told || self.link.wait(timeout)?)
    }

    fn lost(&self) -> u64 {
        self.link.lost()
    }

    /// The gateway hands on which publisher a sample is of.
    fn interleaved(&self) -> u64 {
        self.link.interleaved()
    }
}
