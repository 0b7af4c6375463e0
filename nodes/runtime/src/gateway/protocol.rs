//! What a node and its gateway say to each other, and the socket they say it over.
//!
//! Place in the flow: beside the samples, which go through shared memory. One JSON text a packet, over a pair of Unix
//! sockets that keep packets whole and that nobody else can open. Nothing here waits: a packet that finds the socket full
//! is refused, and whoever sends decides what becomes of it.

use std::os::fd::{AsFd, OwnedFd};
use std::time::Duration;

use abbe_msgs::standard::DiagnosticArray;
use ros2_client::parameters::raw;
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, RecvFlags, SendFlags, SocketFlags, SocketType, recv, send, socketpair, sockopt, sockopt::Timeout,
};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::companion::{Companion, Standing};
use super::foreign::Foreign;
use crate::log_lines::LogLine;
use crate::ros::{
    DiscoveryRange, Domain, Enclave, LifecycleState, NodeIdentity, NodeOptions, ParameterSpec, ParameterTable,
    ParameterValue, Range, RemapRule, RosError, StaticPeers, Step, Transition, TriggerOutcome, USE_SIM_TIME,
};
use crate::transport::TransportKind;

/// Longest packet; what is longer is refused.
const LONGEST: usize = 64 * 1024;

/// From the node to its gateway.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum ToGateway {
    /// The first word: who the gateway is to be.
    Join(Box<Join>),
    /// Open an endpoint, under a number of the node's choice.
    Open(u32, Endpoint),
    /// Close it; what is on its way still goes out.
    Close(u32),
    /// Publish on `/diagnostics`.
    Report(DiagnosticArray),
    /// The answer to [`FromGateway::Call`].
    Answer(u64, TriggerOutcome),
    /// A line of the node's log, for `/rosout`, and when it was written (ns since 1970).
    Log(LogLine, i64),
    /// A managed node has come one step further, and stands there, or comes from there: number of its endpoint.
    Moved(u32, LifecycleState, Step),
    /// Leave the graph, and end.
    Leave,
}

/// From the gateway to its node.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum FromGateway {
    /// It has joined the graph.
    Joined,
    /// It cannot, and ends.
    Refused {
        /// Why.
        reason: String,
        /// Whether the next one may find it otherwise: a clock is set, a network comes up.
        may_pass: bool,
    },
    /// The endpoint is open.
    Opened(u32),
    /// The endpoint cannot be opened, and why.
    NotOpened(u32, String),
    /// How things stand, ten times a second.
    Beat(Beat),
    /// Somebody calls a service: number of the call, number of the endpoint, and what for.
    Call(u64, u32, Asked),
    /// `/clock` says so (ns since 1970).
    Clock(i64),
}

/// What the caller of a service wants.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) enum Asked {
    /// What the service is there for.
    Trigger,
    /// To have the node in another state.
    Change(Transition),
    /// To have these parameters set, all or none; of [`PARAMETERS`].
    Set(Vec<(String, raw::ParameterValue)>),
}

/// Number that stands for the services of the parameters; no endpoint has it.
pub(super) const PARAMETERS: u32 = u32::MAX;

/// Who the gateway is in the graph, and where its node's samples are.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Join {
    pub(super) namespace: String,
    pub(super) name: String,
    pub(super) domain_id: u16,
    pub(super) on_this_host_only: bool,
    pub(super) enclave: Option<Enclave>,
    pub(super) peers: StaticPeers,
    pub(super) remaps: Vec<RemapRule>,
    pub(super) parameters: Vec<Parameter>,
    pub(super) run: String,
    pub(super) depth: usize,
    pub(super) memory_limit_bytes: u64,
    /// Whether it publishes the node's log.
    pub(super) rosout: bool,
}

/// A [`ParameterSpec`] with its value at the start.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Parameter {
    name: String,
    value: raw::ParameterValue,
    unit: String,
    range: ParameterRange,
    read_only: bool,
    description: String,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
enum ParameterRange {
    Any,
    Integer(i64, i64),
    Double(f64, f64),
    OneOf(Vec<String>),
    NotEmpty,
}

/// One end of a topic or service.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) enum Endpoint {
    /// Samples of the node, published.
    Publication {
        /// Where they come in, in shared memory.
        link: String,
        /// Type of the samples.
        ros_type: String,
        /// Absolute name of their topic; none where only what is made of them goes out.
        topic: Option<String>,
        /// Over what they go out.
        over: TransportKind,
        /// What is made of them, with absolute names of the topics.
        companions: Vec<Companion>,
    },
    /// Samples of others, handed to the node.
    Subscription {
        /// Where they go, in shared memory.
        link: String,
        /// Type of the samples.
        ros_type: String,
        /// Absolute name of their topic.
        topic: String,
        /// Over what they come.
        over: TransportKind,
        /// What they are made of, where standard messages come on it.
        foreign: Option<Foreign>,
    },
    /// A `std_srvs/srv/Trigger` of this name, as the node calls it.
    Service(String),
    /// A message on this topic, an absolute name, that whoever joins later gets as well.
    Standing(String, Standing),
    /// The services of a managed node that stands there, and whether there is one that changes that.
    Lifecycle(LifecycleState, bool),
}

/// How things stand.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Beat {
    pub(super) publications: Vec<(u32, PublicationBeat)>,
    pub(super) subscriptions: Vec<(u32, SubscriptionBeat)>,
    /// Whether a heartbeat has come back through DDS at all.
    pub(super) is_proved: bool,
}

/// What became of the samples of a publication. Numbers are those that the node's end of the link gives.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct PublicationBeat {
    pub(super) subscribers: usize,
    /// Publishers of the same topic in other participants.
    pub(super) others: usize,
    /// How often a reliable reader lagged by a whole window and lost its oldest samples.
    pub(super) given_up: u64,
    pub(super) now: Progress,
    /// As it was when the last heartbeat that came back through DDS was sent.
    pub(super) proved: Progress,
}

/// How far a publication has come.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Progress {
    /// The first number that was taken; none before.
    pub(super) first: Option<u64>,
    /// The number that comes next.
    pub(super) next: u64,
    /// Lost on the link, or refused by DDS.
    pub(super) dropped: u64,
}

/// What a subscription had to refuse.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct SubscriptionBeat {
    /// Publishers of the topic in other participants.
    pub(super) publishers: usize,
    pub(super) malformed: u64,
    pub(super) last_reason: String,
}

impl Join {
    pub(super) fn new(options: &NodeOptions, run: &str, depth: usize, memory_limit_bytes: u64, rosout: bool) -> Join {
        let range = |range: &Range| match range {
            Range::Any => ParameterRange::Any,
            Range::Integer(from, to) => ParameterRange::Integer(*from, *to),
            Range::Double(from, to) => ParameterRange::Double(*from, *to),
            Range::NotEmpty => ParameterRange::NotEmpty,
            Range::OneOf(texts) => ParameterRange::OneOf(texts.iter().map(|text| (*text).to_owned()).collect()),
        };
        let parameter = |(name, value): (&'static str, &ros2_client::ParameterValue)| {
            let spec = options.parameters.spec(name)?;
            Some(Parameter {
                name: name.to_owned(),
                value: value.clone().into(),
                unit: spec.unit.to_owned(),
                range: range(&spec.range),
                read_only: spec.read_only,
                description: spec.description.to_owned(),
            })
        };
        Join {
            namespace: options.identity.namespace.clone(),
            name: options.identity.name.clone(),
            domain_id: options.domain.id(),
            on_this_host_only: options.domain.range == DiscoveryRange::Localhost,
            enclave: options.enclave.clone(),
            peers: options.peers.clone(),
            remaps: options.remaps.clone(),
            parameters: options.parameters.values().filter_map(parameter).collect(),
            run: run.to_owned(),
            depth,
            memory_limit_bytes,
            rosout,
        }
    }

    /// Gives parameters other values.
    pub(super) fn set(&mut self, values: Vec<(String, raw::ParameterValue)>) {
        for (name, value) in values {
            self.parameters.iter_mut().filter(|one| one.name == name).for_each(|one| one.value = value.clone());
        }
    }

    /// What the gateway starts its node in the graph with.
    pub(super) fn node_options(self) -> Result<NodeOptions, RosError> {
        let range = if self.on_this_host_only { DiscoveryRange::Localhost } else { DiscoveryRange::Subnet };
        let is_sim_time = |one: &Parameter| one.name == USE_SIM_TIME;
        let (sim_time, declared): (Vec<_>, Vec<_>) = self.parameters.into_iter().partition(is_sim_time);
        let uses_it =
            sim_time.iter().any(|one| ParameterValue::from(one.value.clone()) == ParameterValue::Boolean(true));
        let parameters = ParameterTable::new(declared.into_iter().map(Parameter::spec))?.with_sim_time(uses_it);
        Ok(NodeOptions {
            identity: NodeIdentity::new(&self.namespace, &self.name)?,
            domain: Domain::new(self.domain_id, range)?,
            remaps: self.remaps,
            parameters,
            enclave: self.enclave,
            peers: self.peers,
        })
    }
}

impl Parameter {
    fn spec(self) -> ParameterSpec {
        // Declared once in the life of a gateway: what the tables of nodes say as constants is here as lasting.
        let text = |text: String| &*text.leak();
        let range = match self.range {
            ParameterRange::Any => Range::Any,
            ParameterRange::Integer(from, to) => Range::Integer(from, to),
            ParameterRange::Double(from, to) => Range::Double(from, to),
            ParameterRange::NotEmpty => Range::NotEmpty,
            ParameterRange::OneOf(texts) => Range::OneOf(texts.into_iter().map(text).collect::<Vec<_>>().leak()),
        };
        ParameterSpec {
            name: text(self.name),
            default: self.value.into(),
            unit: text(self.unit),
            range,
            read_only: self.read_only,
            description: text(self.description),
        }
    }
}

/// One end of the socket.
#[derive(Debug)]
pub(super) struct Channel {
    socket: OwnedFd,
}

/// What came over a [`Channel`].
#[derive(Debug)]
pub(super) enum Received<T> {
    /// A packet.
    Packet(T),
    /// None within the time.
    Nothing,
    /// None will come any more: the other end is gone, or says what this program does not understand.
    End,
}

impl Channel {
    /// Two ends.
    pub(super) fn pair() -> std::io::Result<(Channel, OwnedFd)> {
        let (ours, theirs) = socketpair(AddressFamily::UNIX, SocketType::SEQPACKET, SocketFlags::CLOEXEC, None)?;
        Ok((Channel { socket: ours }, theirs))
    }

    /// The end that the node gave its gateway as standard input.
    pub(super) fn from_standard_input() -> std::io::Result<Channel> {
        Ok(Channel { socket: std::io::stdin().as_fd().try_clone_to_owned()? })
    }

    /// Sends a packet, or says why not; never waits.
    pub(super) fn send(&self, packet: &impl Serialize) -> std::io::Result<()> {
        let text = serde_json::to_vec(packet)?;
        if text.len() > LONGEST {
            return Err(std::io::Error::other(format!("{} bytes are too many for a packet", text.len())));
        }
        send(&self.socket, &text, SendFlags::DONTWAIT | SendFlags::NOSIGNAL)?;
        Ok(())
    }

    /// The next packet, waiting at most `timeout` for it.
    pub(super) fn receive<T: DeserializeOwned>(&self, timeout: Duration) -> Received<T> {
        // Zero would mean for ever.
        let timeout = timeout.max(Duration::from_millis(1));
        if let Err(error) = sockopt::set_socket_timeout(&self.socket, Timeout::Recv, Some(timeout)) {
            tracing::error!(%error, "the socket between node and gateway fails");
            return Received::End;
        }
        let mut text = vec![0; LONGEST];
        match recv(&self.socket, &mut text[..], RecvFlags::empty()) {
            Ok((0, _)) => Received::End,
            Ok((length, _)) => match serde_json::from_slice(text.get(..length).unwrap_or_default()) {
                Ok(packet) => Received::Packet(packet),
                Err(error) => {
                    tracing::error!(%error, "node and gateway do not understand each other");
                    Received::End
                }
            },
            // A signal, such as that a stopped process goes on, only ends the wait.
            Err(Errno::AGAIN | Errno::INTR) => Received::Nothing,
            Err(_) => Received::End,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros::RosArgs;

    fn ends() -> (Channel, Channel) {
        let (ours, theirs) = Channel::pair().unwrap();
        (ours, Channel { socket: theirs })
    }

    #[test]
    fn packets_arrive_whole_and_in_order_and_the_end_is_noticed() {
        let (node, gateway) = ends();
        for number in 0..20 {
            node.send(&ToGateway::Close(number)).unwrap();
        }
        drop(node);
        for number in 0..20 {
            let Received::Packet(ToGateway::Close(found)) = gateway.receive(Duration::from_secs(1)) else { panic!() };
            assert_eq!(found, number);
        }
        assert!(matches!(gateway.receive::<ToGateway>(Duration::from_secs(1)), Received::End));
    }

    #[test]
    fn a_full_socket_refuses_at_once() {
        let (node, _stopped) = ends();
        let packet = ToGateway::Open(1, Endpoint::Service("x".repeat(1000)));
        let refused = (0..100_000).find_map(|_| node.send(&packet).err());
        assert_eq!(refused.unwrap().kind(), std::io::ErrorKind::WouldBlock);
    }

    #[test]
    fn what_is_too_long_is_refused_and_what_is_nonsense_ends_the_talk() {
        let (node, gateway) = ends();
        let long = Endpoint::Service("x".repeat(LONGEST));
        assert!(node.send(&ToGateway::Open(1, long)).is_err());
        node.send(&"nonsense").unwrap();
        assert!(matches!(gateway.receive::<ToGateway>(Duration::from_secs(1)), Received::End));
    }

    #[test]
    fn a_node_is_the_same_behind_its_gateway() {
        let words = ["--ros-args", "-r", "a:=b", "-r", "geometric:/c:=d", "-r", "__ns:=/left", "-p", "age_s:=2.5"];
        let (args, _) = RosArgs::split(words.map(str::to_owned)).unwrap();
        let specs = [
            ParameterSpec {
                name: "age_s",
                default: ParameterValue::Double(0.1),
                unit: "s",
                range: Range::Double(0.0, 10.0),
                read_only: true,
                description: "An age.",
            },
            ParameterSpec {
                name: "mode",
                default: ParameterValue::String("b".into()),
                unit: "",
                range: Range::OneOf(&["a", "b"]),
                read_only: false,
                description: "",
            },
        ];
        let options = NodeOptions::new("/", "geometric", args, specs).unwrap();
        let (node, gateway) = ends();
        node.send(&ToGateway::Join(Box::new(Join::new(&options, "run", 64, 1 << 30, true)))).unwrap();
        let Received::Packet(ToGateway::Join(join)) = gateway.receive(Duration::from_secs(1)) else { panic!() };
        assert_eq!((join.run.as_str(), join.depth, join.memory_limit_bytes), ("run", 64, 1 << 30));
        let arrived = join.node_options().unwrap();
        assert_eq!(arrived.identity, options.identity);
        assert_eq!((arrived.domain, &arrived.remaps), (options.domain, &options.remaps));
        let values = |options: &NodeOptions| {
            options.parameters.values().map(|(name, value)| (name, value.clone())).collect::<Vec<_>>()
        };
        assert_eq!(values(&arrived), values(&options));
        for name in ["age_s", "mode"] {
            let (here, there) = (arrived.parameters.spec(name).unwrap(), options.parameters.spec(name).unwrap());
            let without_default =
                |spec: &ParameterSpec| ParameterSpec { default: ParameterValue::NotSet, ..spec.clone() };
            assert_eq!(without_default(here), without_default(there));
        }
    }
}
