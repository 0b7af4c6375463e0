//! What other ROS 2 programs see of a node: parameters, diagnostics, services, names.
//!
//! The other program here is a plain node of the DDS library; interoperation with other vendors'
//! DDS is tested where the whole graph runs.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

#[path = "common/mod.rs"]
mod common;

use std::net::Ipv4Addr;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use abbe_msgs::standard::{DiagnosticArray, DiagnosticStatus, PointStamped};
use abbe_runtime::ros::{
    DiscoveryRange, Domain, Enclave, NodeOptions, ParameterSpec, ParameterValue, Range, RosArgs, RosError, RosNode,
    StaticPeers, diagnostics_qos, service_qos, stream_qos,
};
use common::network::in_own_network;
use common::samples::PATIENCE;
use ros2_client::dds::rustdds::{DomainParticipantBuilder, QosPolicies, TopicKind};
use ros2_client::parameters::raw;
use ros2_client::rcl_interfaces::{
    DescribeParametersRequest, DescribeParametersResponse, GetParametersRequest, GetParametersResponse,
    ListParametersRequest, ListParametersResponse, SetParametersAtomicallyResponse, SetParametersRequest,
    SetParametersResponse,
};
use ros2_client::{Message, Name, Node, QosProfile, ServiceMapping, ServiceTypeName, Subscription};
use serde::{Deserialize, Serialize};

fn specs() -> [ParameterSpec; 2] {
    [
        ParameterSpec {
            name: "max_age_s",
            default: ParameterValue::Double(0.1),
            unit: "s",
            range: Range::Double(0.0, 10.0),
            read_only: false,
            description: "Age above which a covariate is stale.",
        },
        ParameterSpec {
            name: "depth",
            default: ParameterValue::Integer(64),
            unit: "samples",
            range: Range::Integer(1, 4096),
            read_only: true,
            description: "Samples a subscriber can be behind.",
        },
    ]
}

fn node(domain: Domain, arguments: &str) -> RosNode {
    let words = arguments.split_whitespace().map(str::to_owned);
    let (args, own) = RosArgs::split(words).unwrap();
    assert_eq!(own, Vec::<String>::new());
    let mut options = NodeOptions::new("/", "geometric", args, specs()).unwrap();
    options.domain = domain;
    RosNode::start(options).unwrap()
}

/// A node of another program.
struct Other(Node);

impl Other {
    fn new(domain: Domain) -> Self {
        let participant =
            DomainParticipantBuilder::new(domain.id()).with_only_networks([Ipv4Addr::LOCALHOST]).build().unwrap();
        let context = ros2_client::Context::from_domain_participant(participant).unwrap();
        let name = ros2_client::NodeName::new("/", "other").unwrap();
        Self(context.new_node(name, ros2_client::NodeOptions::new()).unwrap())
    }

    fn subscribe<R: 'static>(&mut self, topic: &str, kind: (&str, &str), qos: QosProfile) -> Subscription<R> {
        let kind = ros2_client::MessageTypeName::new(kind.0, kind.1);
        let topic = self.0.create_topic(&Name::parse(topic).unwrap(), kind, &qos).unwrap();
        self.0.create_subscription(&topic, Some(qos)).unwrap()
    }

    /// Asks until the service is found and answers; it may have acted on an earlier request too.
    fn call<Q: Message + Clone + 'static, A: Message + Clone + 'static>(
        &mut self,
        service: &str,
        kind: (&str, &str),
        request: Q,
    ) -> A {
        let name = Name::parse(service).unwrap();
        let kind = ServiceTypeName::new(kind.0, kind.1);
        let client =
            self.0.create_client::<Q, A>(ServiceMapping::Enhanced, &name, &kind, service_qos(), service_qos()).unwrap();
        let deadline = Instant::now() + PATIENCE;
        while Instant::now() < deadline {
            let asked = client.send_request(request.clone()).unwrap();
            let again = Instant::now() + Duration::from_millis(500);
            while Instant::now() < again {
                match client.receive_response().unwrap() {
                    Some((id, answer)) if id == asked => return answer,
                    _ => thread::sleep(Duration::from_millis(2)),
                }
            }
        }
        panic!("{service} does not answer");
    }

    fn parameter_service<Q: Message + Clone + 'static, A: Message + Clone + 'static>(
        &mut self,
        service: &str,
        kind: &str,
        request: Q,
    ) -> A {
        self.call(&format!("/cmm/corrector/{service}"), ("rcl_interfaces", kind), request)
    }
}

fn wanted(values: &[(&str, ParameterValue)]) -> SetParametersRequest {
    let raw = |(name, value): &(&str, ParameterValue)| raw::Parameter {
        name: (*name).to_owned(),
        value: value.clone().into(),
    };
    SetParametersRequest { parameter: values.iter().map(raw).collect() }
}

#[test]
fn parameters_are_listed_read_described_and_set_within_their_range() {
    let test = "parameters_are_listed_read_described_and_set_within_their_range";
    in_own_network(test, |domain| {
        let node = node(domain, "--ros-args -r __ns:=/cmm -r __node:=corrector -p max_age_s:=2");
        let mut other = Other::new(domain);

        let request = ListParametersRequest { prefixes: Vec::new(), depth: 0 };
        let listed: ListParametersResponse = other.parameter_service("list_parameters", "ListParameters", request);
        assert_eq!(listed.result.names, ["depth", "max_age_s", "use_sim_time"]);

        let names = vec!["max_age_s".to_owned(), "depth".to_owned(), "nothing".to_owned()];
        let request = GetParametersRequest { names: names.clone() };
        let read: GetParametersResponse = other.parameter_service("get_parameters", "GetParameters", request);
        let read: Vec<ParameterValue> = read.values.into_iter().map(Into::into).collect();
        let expected = [ParameterValue::Double(2.0), ParameterValue::Integer(64), ParameterValue::NotSet];
        assert_eq!(read, expected);

        let described: DescribeParametersResponse =
            other.parameter_service("describe_parameters", "DescribeParameters", DescribeParametersRequest { names });
        let age = &described.values[0];
        assert_eq!(age.description, "Age above which a covariate is stale. [s]");
        assert_eq!(age.floating_point_range[0].to_value, 10.0);
        assert!(described.values[1].read_only);
        assert_eq!(described.values[1].integer_range[0].from_value, 1);

        let request = wanted(&[
            ("max_age_s", ParameterValue::Double(3.0)),
            ("max_age_s", ParameterValue::Double(11.0)),
            ("max_age_s", ParameterValue::NotSet),
            ("depth", ParameterValue::Integer(65)),
            ("nothing", ParameterValue::Integer(1)),
        ]);
        let set: SetParametersResponse = other.parameter_service("set_parameters", "SetParameters", request);
        let outcomes: Vec<bool> = set.results.iter().map(|one| one.successful).collect();
        assert_eq!(outcomes, [true, false, false, false, false]);
        assert!(set.results[1].reason.contains("within 0 to 10 s"), "{}", set.results[1].reason);
        assert_eq!(node.parameter("max_age_s"), Some(ParameterValue::Double(3.0)));

        let request = wanted(&[("max_age_s", ParameterValue::Double(4.0)), ("depth", ParameterValue::Integer(65))]);
        let refused: SetParametersAtomicallyResponse =
            other.parameter_service("set_parameters_atomically", "SetParametersAtomically", request);
        assert!(!refused.result.successful);
        assert_eq!(node.parameter("max_age_s"), Some(ParameterValue::Double(3.0)));
    });
}

#[test]
fn diagnostics_and_standard_messages_arrive_under_their_remapped_names() {
    let test = "diagnostics_and_standard_messages_arrive_under_their_remapped_names";
    in_own_network(test, |domain| {
        let node = node(domain, "--ros-args -r position:=/left/position -r /diagnostics:=/health");
        let mut other = Other::new(domain);
        let health: Subscription<DiagnosticArray> =
            other.subscribe("/health", ("diagnostic_msgs", "DiagnosticArray"), diagnostics_qos());
        let depth = NonZeroUsize::new(16).unwrap();
        let position: Subscription<PointStamped> =
            other.subscribe("/left/position", ("geometry_msgs", "PointStamped"), stream_qos(depth));

        let diagnostics = node.diagnostics("cmm-7").unwrap();
        let positions = node.publisher::<PointStamped>("position", &stream_qos(depth), depth).unwrap();
        let mut point = PointStamped::default();
        point.point.x = 0.25;

        let (mut status, mut arrived) = (None, None);
        let deadline = Instant::now() + PATIENCE;
        while (status.is_none() || arrived.is_none()) && Instant::now() < deadline {
            let figures = [("lost", "3".to_owned())];
            diagnostics.report("stream", DiagnosticStatus::WARN, "losing", figures);
            positions.publish(point.clone());
            thread::sleep(Duration::from_millis(20));
            status = status.or(health.take().unwrap());
            arrived = arrived.or(position.take().unwrap());
        }
        let status = status.expect("no diagnostics arrived").0.status.remove(0);
        assert_eq!(status.level, DiagnosticStatus::WARN);
        assert_eq!((status.name.as_str(), status.message.as_str()), ("geometric: stream", "losing"));
        assert_eq!(status.hardware_id, "cmm-7");
        assert_eq!((status.values[0].key.as_str(), status.values[0].value.as_str()), ("lost", "3"));
        assert_eq!(arrived.expect("no position arrived").0, point);
    });
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Empty {
    structure_needs_at_least_one_member: u8,
}
impl Message for Empty {}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Outcome {
    success: bool,
    message: String,
}
impl Message for Outcome {}

#[test]
fn a_trigger_service_runs_its_handler_and_ends_with_its_handle() {
    let test = "a_trigger_service_runs_its_handler_and_ends_with_its_handle";
    in_own_network(test, |domain| {
        let node = node(domain, "");
        let whole = Arc::new(AtomicBool::new(true));
        let is_whole = Arc::clone(&whole);
        let service = node.trigger_service("~/reload", move || match is_whole.load(Ordering::SeqCst) {
            true => Ok("loaded".to_owned()),
            false => Err("the file is cut off".to_owned()),
        });
        let service = service.unwrap();
        let mut other = Other::new(domain);
        let request = Empty { structure_needs_at_least_one_member: 0 };
        let mut call = || other.call("/geometric/reload", ("std_srvs", "Trigger"), request.clone());
        let first: Outcome = call();
        whole.store(false, Ordering::SeqCst);
        let second: Outcome = call();
        assert!(first.success && first.message == "loaded", "{first:?}");
        assert!(!second.success && second.message == "the file is cut off", "{second:?}");
        drop(service);
        drop(node);
    });
}

/// A program calls as soon as it has found the service, which may be before the service has found its reader of replies.
#[test]
fn regress_a_caller_whose_reader_of_replies_comes_late_gets_its_reply() {
    let test = "regress_a_caller_whose_reader_of_replies_comes_late_gets_its_reply";
    in_own_network(test, |domain| {
        let node = node(domain, "");
        let [is_called, has_reader] = [(); 2].map(|()| Arc::new(AtomicBool::new(false)));
        let (called, made) = (Arc::clone(&is_called), Arc::clone(&has_reader));
        let service = node.trigger_service("~/reload", move || {
            called.store(true, Ordering::SeqCst);
            while !made.load(Ordering::SeqCst) {
                thread::sleep(Duration::from_millis(1));
            }
            Ok("loaded".to_owned())
        });
        let service = service.unwrap();
        let participant =
            DomainParticipantBuilder::new(domain.id()).with_only_networks([Ipv4Addr::LOCALHOST]).build().unwrap();
        let policies = QosPolicies::from(&service_qos());
        let topic = |name: &str, part: &str| {
            let kind = format!("std_srvs::srv::dds_::Trigger_{part}_");
            participant.create_topic(name.to_owned(), kind, &policies, TopicKind::NoKey).unwrap()
        };
        let publisher = participant.create_publisher(&policies).unwrap();
        let subscriber = participant.create_subscriber(&policies).unwrap();
        let requests = topic("rq/geometric/reloadRequest", "Request");
        let writer = publisher.create_datawriter_no_key_cdr::<Empty>(&requests, None).unwrap();
        let deadline = Instant::now() + PATIENCE;
        while !is_called.load(Ordering::SeqCst) {
            assert!(Instant::now() < deadline, "no request arrives");
            writer.write(Empty { structure_needs_at_least_one_member: 0 }, None).unwrap();
            thread::sleep(Duration::from_millis(100));
        }
        let replies = topic("rr/geometric/reloadReply", "Response");
        let mut reader = subscriber.create_datareader_no_key_cdr::<Outcome>(&replies, None).unwrap();
        has_reader.store(true, Ordering::SeqCst);
        let reply = loop {
            match reader.take_next_sample().unwrap() {
                Some(reply) => break reply.into_value(),
                None => thread::sleep(Duration::from_millis(2)),
            }
            assert!(Instant::now() < deadline, "no reply");
        };
        assert_eq!(reply, Outcome { success: true, message: "loaded".to_owned() });
        // Who calls without a pause and takes no reply keeps no service from ending.
        drop(reader);
        let until = Instant::now() + Duration::from_secs(1);
        while Instant::now() < until {
            writer.write(Empty { structure_needs_at_least_one_member: 0 }, None).unwrap();
            thread::sleep(Duration::from_millis(5));
        }
        let ending = Instant::now();
        drop(service);
        assert!(ending.elapsed() < Duration::from_secs(5), "{:?}", ending.elapsed());
    });
}

#[test]
fn hosts_that_multicast_does_not_reach_and_keys_are_refused_together() {
    let (args, _) = RosArgs::split(std::iter::empty()).unwrap();
    let mut options = NodeOptions::new("/", "geometric", args, specs()).unwrap();
    let enclave: Enclave = serde_json::from_str(r#"{"folder": "/keys"}"#).unwrap();
    (options.enclave, options.peers) = (Some(enclave), StaticPeers::of("10.0.0.1", DiscoveryRange::Subnet).unwrap());
    let refused = RosNode::start(options).map(drop).unwrap_err();
    assert!(matches!(refused, RosError::SecuredPeers), "{refused}");
    assert!(refused.to_string().contains("unset one of them"), "{refused}");
}
