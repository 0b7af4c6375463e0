//! A node in the ROS 2 graph: participant, discovery, parameters, and the clean way out.
//!
//! Place in the flow: started once in `main`. Every endpoint opened on it holds the node, so the
//! node leaves the graph after its last endpoint: a participant that ends without saying so would
//! hold up its peers until its lease ends.

use std::net::Ipv4Addr;
use std::num::NonZeroUsize;
use std::pin::pin;
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::{self, JoinHandle};
use std::time::{SystemTime, UNIX_EPOCH};

use abbe_msgs::RosType;
use futures::channel::oneshot;
use futures::future;
use ros2_client::dds::rustdds::{DomainParticipantBuilder, GUID, QosPolicies, QosPolicyBuilder, RTPSEntity, TopicKind};
use ros2_client::{Context, Gid, MessageTypeName, Node, NodeName, ParameterValue, QosProfile, Subscription};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::diagnostics::Diagnostics;
use super::endpoint::{dds_name, endpoint_error};
use super::matched::Matched;
use super::names::{self, NameError, NodeIdentity};
use super::parameter_services::{Ask, ParameterServices};
use super::parameter_values::Values;
use super::parameters::{ParameterSpec, ParameterTable};
use super::queued::QueuedPublisher;
use super::service::Service;
use super::static_peers::{Meeting, StaticPeers};
use super::trigger::{TriggerOutcome, TriggerService};
use super::type_descriptions::{TypeDescriptions, Types};
use super::writer::{Writer, limits};
use super::{DiscoveryRange, Domain, Enclave, RemapRule, RosArgs, RosError};
use crate::gateway::Introduced;
use crate::lock::lock;

/// What ROS 2 puts before the name of a topic to make the name it has in DDS.
const TOPICS: &str = "rt";

/// What a node starts with.
#[derive(Debug, Clone)]
pub struct NodeOptions {
    /// Its name in the graph.
    pub identity: NodeIdentity,
    /// Domain and reach.
    pub domain: Domain,
    /// Renamed topics and services.
    pub remaps: Vec<RemapRule>,
    /// Parameters with their values at the start.
    pub parameters: ParameterTable,
    /// Keys of DDS Security; without them the node joins in the open.
    pub enclave: Option<Enclave>,
    /// Hosts that multicast does not reach.
    pub peers: StaticPeers,
}

impl NodeOptions {
    /// The options of a node called `name` in `namespace` unless `args` say else, in the domain of
    /// the environment.
    ///
    /// # Errors
    /// When a name, a parameter or an environment variable cannot be followed.
    pub fn new(
        namespace: &str,
        name: &str,
        args: RosArgs,
        parameters: impl IntoIterator<Item = ParameterSpec>,
    ) -> Result<Self, RosError> {
        let identity = args.identity(namespace, name)?;
        args.out_of_name(name, &identity).iter().for_each(|words| tracing::warn!("{words}"));
        let parameters = ParameterTable::new(parameters)?.with_assignments(&identity, &args.parameters)?;
        for stranger in parameters.strangers(&identity, &args.parameters) {
            tracing::warn!(
                "{}: this node has no parameter '{}', so it changes nothing here",
                stranger.origin,
                stranger.name
            );
        }
        let enclave = Enclave::from_environment(args.enclave.as_deref())?;
        let domain = Domain::from_environment()?;
        let peers = StaticPeers::from_environment(domain.range)?;
        Ok(Self { identity, domain, remaps: args.remaps, parameters, enclave, peers })
    }
}

/// A node in the graph. Clones, and all endpoints, share it; it leaves when the last is dropped.
#[derive(Clone)]
pub struct RosNode(Arc<Inner>);

pub(super) struct Inner {
    identity: NodeIdentity,
    remaps: Vec<RemapRule>,
    introduced: Introduced,
    node: Arc<Mutex<Node>>,
    values: Arc<Values>,
    matched: Arc<Matched>,
    /// Types of the messages that it publishes or takes.
    types: Types,
    _meeting: Meeting,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
    context: Context,
}

impl RosNode {
    /// Joins the graph.
    ///
    /// # Errors
    /// When the network or the domain refuse the participant, the system clock is before 1970, or the node cannot be
    /// made.
    pub fn start(options: NodeOptions) -> Result<Self, RosError> {
        Self::start_with(options, None)
    }

    /// The same; `ask` is asked before a value of a parameter is set.
    pub(crate) fn start_asking(options: NodeOptions, ask: Ask) -> Result<Self, RosError> {
        Self::start_with(options, Some(ask))
    }

    fn start_with(options: NodeOptions, ask: Option<Ask>) -> Result<Self, RosError> {
        // The library's threads would end then, and what it says of that leads nowhere.
        if SystemTime::now() < UNIX_EPOCH {
            return Err(RosError::Clock { domain_id: options.domain.id() });
        }
        if options.enclave.is_some() && !options.peers.is_empty() {
            return Err(RosError::SecuredPeers);
        }
        let (context, introduced, matched) = participant(options.domain, options.enclave.as_ref())?;
        let mut node = create(&context, &options)?;
        matched.await_calm();
        let values = Arc::new(Values::open(&mut node, &options.identity)?);
        let parameters = ParameterServices::open(&mut node, &options, (Arc::clone(&values), ask), &matched)?;
        let types = Types::default();
        matched.await_calm();
        let descriptions = TypeDescriptions::open(&mut node, &matched, &options.identity, types.clone())?;
        let node = Arc::new(Mutex::new(node));
        let (stop, stopped) = oneshot::channel();
        let (served, following) = (Arc::clone(&node), Arc::clone(&matched));
        let thread = thread::Builder::new()
            .name("ros-node".into())
            .spawn(move || {
                let serving = pin!(future::join(parameters.serve(&served), descriptions.serve()));
                let following = pin!(following.follow());
                let working = future::select(serving, following);
                futures::executor::block_on(future::select(working, stopped));
            })
            .map_err(|source| RosError::Thread { what: "the ROS node", source })?;
        let NodeOptions { identity, remaps, peers, .. } = options;
        let _meeting = peers.meet(introduced)?;
        let (stop, thread) = (Some(stop), Some(thread));
        let inner =
            Inner { identity, remaps, introduced, node, values, matched, types, _meeting, stop, thread, context };
        Ok(Self(Arc::new(inner)))
    }

    /// The name of the node in the graph.
    #[must_use]
    pub fn identity(&self) -> &NodeIdentity {
        &self.0.identity
    }

    /// The rules by which the node renames topics and services.
    #[must_use]
    pub fn remaps(&self) -> &[RemapRule] {
        &self.0.remaps
    }

    /// What the participant of this node is introduced to itself as.
    pub(crate) fn introduced(&self) -> Introduced {
        self.0.introduced
    }

    /// The absolute name of what the node calls `name`, after remapping.
    ///
    /// # Errors
    /// When it is not a ROS 2 name.
    pub fn resolve(&self, name: &str) -> Result<String, NameError> {
        names::resolve(name, &self.0.identity, &self.0.remaps)
    }

    /// The value that a parameter has now.
    #[must_use]
    pub fn parameter(&self, name: &str) -> Option<ParameterValue> {
        self.0.values.get(&self.0.node, name)
    }

    /// A publisher of any ROS 2 message, on its own thread behind a queue of `depth` messages.
    ///
    /// # Errors
    /// When the name is wrong or the publisher cannot be made.
    pub fn publisher<R: RosType>(
        &self,
        name: &str,
        qos: &QosProfile,
        depth: NonZeroUsize,
    ) -> Result<QueuedPublisher<R>, RosError> {
        QueuedPublisher::open(self, &self.resolve(name)?, qos, depth, |message: R| message)
    }

    /// `/diagnostics`, for the health of this node.
    ///
    /// # Errors
    /// When the publisher cannot be made.
    pub fn diagnostics(&self, hardware_id: &str) -> Result<Diagnostics, RosError> {
        Diagnostics::open(self, hardware_id)
    }

    /// A service of type `std_srvs/srv/Trigger`. `handler` runs on a thread of its own.
    ///
    /// # Errors
    /// When the name is wrong or the service cannot be made.
    pub fn trigger_service(
        &self,
        name: &str,
        handler: impl FnMut() -> TriggerOutcome + Send + 'static,
    ) -> Result<TriggerService, RosError> {
        TriggerService::open(self, name, handler)
    }

    pub(crate) fn writer<R: RosType>(&self, name: &str, qos: &QosProfile) -> Result<Writer<R>, RosError> {
        let failed = |source| endpoint_error("publisher of", name, source);
        dds_name(name)?;
        // The node's own way to a topic knows no window.
        let policies: QosPolicies = qos.into();
        let policies = policies.modify_by(&QosPolicyBuilder::new().resource_limits(limits()).build());
        let participant = self.0.context.domain_participant();
        let (topic, kind) = (format!("{TOPICS}{name}"), type_name::<R>().dds_msg_type());
        let topic = participant.create_topic(topic, kind, &policies, TopicKind::NoKey);
        let topic = topic.map_err(|error| failed(error.into()))?;
        self.await_calm();
        let publisher = self.lock().create_publisher(&topic, Some(qos.clone())).map_err(failed)?;
        self.0.types.add(R::ROS_TYPE);
        Ok(Writer::new(publisher, name, Arc::downgrade(&self.0)))
    }

    pub(crate) fn raw_subscription<R: RosType>(
        &self,
        name: &str,
        qos: &QosProfile,
    ) -> Result<Subscription<R>, RosError> {
        let failed = |source| endpoint_error("subscriber of", name, source);
        self.await_calm();
        let mut node = self.lock();
        let topic = node.create_topic(&dds_name(name)?, type_name::<R>(), qos);
        let subscription = node.create_subscription(&topic.map_err(failed)?, Some(qos.clone()));
        self.0.types.add(R::ROS_TYPE);
        subscription.map_err(failed)
    }

    pub(super) fn service<Request: DeserializeOwned, Reply: Serialize>(
        &self,
        name: &str,
        package: &str,
        service: &str,
    ) -> Result<Service<Request, Reply>, RosError> {
        self.await_calm();
        Service::open(&mut self.lock(), &self.0.matched, name, package, service)
    }

    /// Before an endpoint is made.
    fn await_calm(&self) {
        self.0.matched.await_calm();
    }

    /// Subscribers elsewhere that this publisher has found.
    pub(crate) fn subscribers<R: RosType>(&self, writer: &Writer<R>) -> usize {
        self.0.matched.readers(writer.guid()).len()
    }

    /// What the participant is introduced to itself as.
    pub(super) fn introduced_as(inner: &Inner) -> Introduced {
        inner.introduced
    }

    /// Readers elsewhere that a writer is connected to.
    pub(super) fn readers_of(inner: &Inner, writer: GUID) -> Vec<[u8; 16]> {
        inner.matched.readers(writer).into_iter().map(|reader| reader.to_bytes()).collect()
    }

    /// Topics that other participants publish, by their absolute names; one that two publish stands twice.
    pub(crate) fn published_elsewhere(&self) -> Vec<String> {
        let participant = self.0.context.domain_participant();
        let own = participant.guid().prefix;
        let writers = participant.discovered_writers().into_iter();
        let elsewhere = writers.filter(|writer| writer.writer_proxy.remote_writer_guid.prefix != own);
        let topics = elsewhere.map(|writer| writer.publication_topic_data.topic_name);
        topics.filter_map(|name| name.strip_prefix(TOPICS).map(str::to_owned)).collect()
    }

    fn lock(&self) -> MutexGuard<'_, Node> {
        lock(&self.0.node)
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        drop(self.stop.take());
        if self.thread.take().is_some_and(|thread| thread.join().is_err()) {
            tracing::error!("the thread of the ROS node panicked");
        }
    }
}

impl std::fmt::Debug for RosNode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "RosNode({})", self.0.identity.qualified())
    }
}

fn participant(domain: Domain, enclave: Option<&Enclave>) -> Result<(Context, Introduced, Arc<Matched>), RosError> {
    let failed = |reason: String| RosError::Participant { domain_id: domain.id(), reason };
    let mut builder = DomainParticipantBuilder::new(domain.id());
    if domain.range == DiscoveryRange::Localhost {
        builder = builder.with_only_networks([Ipv4Addr::LOCALHOST]);
    }
    if let Some(enclave) = enclave {
        builder = secured(builder, enclave)?;
    }
    let participant = builder.build().map_err(|error| match error.to_string() {
        reason if enclave.is_some() => RosError::Keys { domain_id: domain.id(), reason },
        reason => failed(reason),
    })?;
    let matched = Arc::new(Matched::new(participant.clone(), enclave.is_some()));
    matched.await_calm();
    let guid = Gid::from(participant.guid()).to_bytes16();
    let mut guid_prefix = [0; 12];
    guid_prefix.copy_from_slice(&guid[..12]);
    let (domain_id, participant_id) = (participant.domain_id(), participant.participant_id());
    let introduced = Introduced { guid_prefix, domain_id, participant_id };
    let context = Context::from_domain_participant(participant).map_err(|error| failed(error.to_string()))?;
    Ok((context, introduced, matched))
}

#[cfg(feature = "dds-security")]
fn secured(builder: DomainParticipantBuilder, enclave: &Enclave) -> Result<DomainParticipantBuilder, RosError> {
    Ok(builder.builtin_security(enclave.files()))
}

#[cfg(not(feature = "dds-security"))]
fn secured(_: DomainParticipantBuilder, _: &Enclave) -> Result<DomainParticipantBuilder, RosError> {
    Err(super::SecurityError::NotBuilt { asked: "an enclave".to_owned() }.into())
}

fn create(context: &Context, options: &NodeOptions) -> Result<Node, RosError> {
    let identity = &options.identity;
    let name = NodeName::new(&identity.namespace, &identity.name).map_err(|error| NameError {
        name: format!("{} ({error})", identity.qualified()),
        reason: "the DDS library refuses it",
    })?;
    let table = options.parameters.clone();
    let mut node_options = ros2_client::NodeOptions::new()
        // The log goes to standard error; /rosout would be one more reliable writer.
        .enable_rosout(false)
        // Those of the library describe neither unit nor range; see `ParameterServices`.
        .start_parameter_services(false)
        .parameter_validator(Box::new(move |name, value| {
            let checked = table.check_change(name, value);
            checked.map_err(|error| error.to_string())
        }));
    for (name, value) in options.parameters.values() {
        node_options = node_options.declare_parameter(name, value.clone());
    }
    context.new_node(name, node_options).map_err(|source| RosError::Node { node: identity.qualified(), source })
}

/// `package/msg/Type` in the two parts that the DDS library wants.
fn type_name<R: RosType>() -> MessageTypeName {
    let package = R::ROS_TYPE.split('/').next().unwrap_or_default();
    let name = R::ROS_TYPE.rsplit('/').next().unwrap_or_default();
    MessageTypeName::new(package, name)
}
