//! Opens publishers and subscribers by the kind of transport that the launch configuration names.
//!
//! Place in the flow: made once in `main` of a node; the node's code sees only the two traits.

use std::num::NonZeroUsize;

use abbe_msgs::Message;

use super::dds::{DdsPublisher, DdsSubscriber};
use super::in_process::InProcess;
use super::shared_memory::SharedMemory;
use super::zenoh::ZenohSession;
use super::{DEFAULT_DEPTH, FanOut, Publish, Subscribe, TransportError, TransportKind};
use crate::RunId;
use crate::gateway::{Companion, GatewayNode, GatewayPublisher, GatewaySubscriber};
use crate::ros::{self, NodeIdentity, RemapRule, RosNode};

/// Which transports a node takes part in.
#[derive(Debug, Clone)]
pub struct EdgesConfig {
    /// The node, whose namespace and remapping hold for every transport.
    pub identity: NodeIdentity,
    /// Renamed topics.
    pub remaps: Vec<RemapRule>,
    /// The run whose shared memory the node joins; none for no shared memory.
    pub run: Option<RunId>,
    /// The node in the ROS 2 graph, as a participant of this process: for programs beside the graph, and for tests.
    pub ros: Option<RosNode>,
    /// The node in the ROS 2 graph, behind a gateway; comes before `ros` and `zenoh`. Without it and them there is no DDS and no Zenoh.
    pub gateway: Option<GatewayNode>,
    /// The node in a graph over Zenoh, as a session of this process: for programs beside the graph, and for tests.
    pub zenoh: Option<ZenohSession>,
    /// The topics of this process; none for no in-process edges.
    pub in_process: Option<InProcess>,
    /// Samples a subscriber can be behind; the same in all nodes of a run.
    pub depth: NonZeroUsize,
    /// Whether subscribers over shared memory count what they missed since an earlier process of this node.
    pub remembers: bool,
}

impl EdgesConfig {
    /// No transports yet, no remapping, [`DEFAULT_DEPTH`].
    #[must_use]
    pub fn new(identity: NodeIdentity) -> Self {
        Self {
            identity,
            remaps: Vec::new(),
            run: None,
            ros: None,
            gateway: None,
            zenoh: None,
            in_process: None,
            depth: NonZeroUsize::MIN.saturating_add(DEFAULT_DEPTH - 1),
            remembers: false,
        }
    }

    /// DDS through `node`, under its name and with its remapping.
    #[must_use]
    pub fn with_ros(node: RosNode) -> Self {
        Self { remaps: node.remaps().to_vec(), ros: Some(node.clone()), ..Self::new(node.identity().clone()) }
    }
}

/// The transports of one node.
#[derive(Debug, Clone)]
pub struct Edges {
    config: EdgesConfig,
    memory: Option<SharedMemory>,
}

impl Edges {
    /// Joins the transports of `config`.
    ///
    /// # Errors
    /// When the shared memory of the run cannot be joined.
    pub fn open(config: EdgesConfig) -> Result<Self, TransportError> {
        let run = config.run.as_ref();
        let mut memory = run.map(|run| SharedMemory::join(run, config.depth)).transpose()?;
        if config.remembers {
            memory = memory.map(|memory| memory.remembering(&config.identity.qualified()));
        }
        Ok(Self { config, memory })
    }

    /// A publisher on what the node calls `topic`, over all of `kinds`.
    ///
    /// # Errors
    /// When `kinds` is empty, a transport is not configured, or one refuses.
    pub fn publisher<M: Message>(
        &self,
        topic: &str,
        kinds: &[TransportKind],
    ) -> Result<Box<dyn Publish<M>>, TransportError> {
        self.publisher_with(topic, kinds, &[])
    }

    /// As [`Edges::publisher`]. Where the node has a gateway, that publishes the standard message which is made of each
    /// sample, too, with the names of `companions` as the node calls them.
    ///
    /// # Errors
    /// As [`Edges::publisher`].
    pub fn publisher_with<M: Message>(
        &self,
        topic: &str,
        kinds: &[TransportKind],
        companions: &[Companion],
    ) -> Result<Box<dyn Publish<M>>, TransportError> {
        let topic = &self.resolve(topic)?;
        let absolute =
            |one: &Companion| Ok(Companion { topic: self.resolve(&one.topic)?, content: one.content.clone() });
        let companions = companions.iter().map(absolute).collect::<Result<Vec<_>, TransportError>>()?;
        let mut publishers: Vec<Box<dyn Publish<M>>> = Vec::new();
        for kind in kinds {
            publishers.push(match (&self.config.gateway, kind) {
                (Some(gateway), TransportKind::Dds) => {
                    Box::new(GatewayPublisher::open(gateway, Some(topic), *kind, &companions)?)
                }
                // What is made of the samples goes over DDS alone.
                (Some(gateway), TransportKind::Zenoh) => {
                    Box::new(GatewayPublisher::open(gateway, Some(topic), *kind, &[])?)
                }
                _ => self.one_publisher(topic, *kind)?,
            });
        }
        // The companions alone, for whoever has a gateway for other reasons.
        if let (Some(gateway), false, false) =
            (&self.config.gateway, kinds.contains(&TransportKind::Dds), companions.is_empty())
        {
            publishers.push(Box::new(GatewayPublisher::open(gateway, None, TransportKind::Dds, &companions)?));
        }
        match (publishers.len(), publishers.pop()) {
            (1, Some(only)) => Ok(only),
            (_, Some(last)) => {
                publishers.push(last);
                Ok(Box::new(FanOut::new(publishers)))
            }
            (_, None) => Err(TransportError::NoTransport { topic: topic.clone() }),
        }
    }

    /// A subscriber on what the node calls `topic`, over `kind`.
    ///
    /// # Errors
    /// When the transport is not configured, or refuses.
    pub fn subscriber<M: Message>(
        &self,
        topic: &str,
        kind: TransportKind,
    ) -> Result<Box<dyn Subscribe<M>>, TransportError> {
        let topic = &self.resolve(topic)?;
        let depth = self.config.depth;
        Ok(match kind {
            TransportKind::InProcess => Box::new(self.in_process(topic)?.subscriber(topic, depth)?),
            TransportKind::SharedMemory => Box::new(self.memory(topic)?.subscriber::<M>(topic)?),
            TransportKind::Dds | TransportKind::Zenoh if self.config.gateway.is_some() => {
                let gateway = configured(self.config.gateway.as_ref(), topic, kind)?;
                Box::new(GatewaySubscriber::open(gateway, topic, kind)?)
            }
            TransportKind::Dds => Box::new(DdsSubscriber::open(self.ros(topic)?, topic, depth)?),
            TransportKind::Zenoh => Box::new(self.zenoh(topic)?.subscriber::<M>(topic, depth)?),
        })
    }

    /// Frees the places that killed nodes of the run still hold. For the launcher.
    pub fn remove_dead_nodes(&self) {
        if let Some(memory) = &self.memory {
            memory.remove_dead_nodes();
        }
    }

    fn one_publisher<M: Message>(
        &self,
        topic: &str,
        kind: TransportKind,
    ) -> Result<Box<dyn Publish<M>>, TransportError> {
        Ok(match kind {
            TransportKind::InProcess => Box::new(self.in_process(topic)?.publisher(topic)?),
            TransportKind::SharedMemory => Box::new(self.memory(topic)?.publisher::<M>(topic)?),
            TransportKind::Dds => Box::new(DdsPublisher::open(self.ros(topic)?, topic, self.config.depth)?),
            TransportKind::Zenoh => Box::new(self.zenoh(topic)?.publisher::<M>(topic, self.config.depth)?),
        })
    }

    /// One absolute name for all transports.
    ///
    /// # Errors
    /// When the name is wrong.
    pub fn resolve(&self, topic: &str) -> Result<String, TransportError> {
        let resolved = ros::resolve(topic, &self.config.identity, &self.config.remaps);
        Ok(resolved.map_err(ros::RosError::from)?)
    }

    fn in_process(&self, topic: &str) -> Result<&InProcess, TransportError> {
        configured(self.config.in_process.as_ref(), topic, TransportKind::InProcess)
    }

    fn memory(&self, topic: &str) -> Result<&SharedMemory, TransportError> {
        configured(self.memory.as_ref(), topic, TransportKind::SharedMemory)
    }

    fn zenoh(&self, topic: &str) -> Result<&ZenohSession, TransportError> {
        configured(self.config.zenoh.as_ref(), topic, TransportKind::Zenoh)
    }

    fn ros(&self, topic: &str) -> Result<&RosNode, TransportError> {
        configured(self.config.ros.as_ref(), topic, TransportKind::Dds)
    }
}

fn configured<'a, T>(transport: Option<&'a T>, topic: &str, kind: TransportKind) -> Result<&'a T, TransportError> {
    transport.ok_or_else(|| TransportError::NotConfigured { topic: topic.to_owned(), kind })
}
