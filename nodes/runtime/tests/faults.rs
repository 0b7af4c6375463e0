//! Processes that die without a word (kill -9) while samples flow at 1 kHz: the others must not
//! feel it.
//!
//! What is asserted are gaps: a stall by a dead reader lasts seconds (measured 40 s with a reliable
//! writer that waits). A busy machine takes threads off the processor, so a thread that only sleeps
//! in steps of 1 ms runs beside as control: the limits hold on top of its longest delay, once for
//! each thread on the way. As delays differ between threads, a run beyond them is repeated; a defect
//! exceeds them every time.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

#[path = "common/mod.rs"]
mod common;

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use abbe_msgs::standard::{DiagnosticArray, Header};
use abbe_msgs::{RosType, ScaleReading, Stamp, ros};
use abbe_runtime::ros::{
    Domain, NodeIdentity, NodeOptions, ParameterSpec, ParameterTable, ParameterValue, RosNode, StaticPeers, TopicEnd,
    diagnostics_qos, qos_parameters,
};
use abbe_runtime::transport::dds::{DdsPublisher, DdsSubscriber};
use abbe_runtime::transport::shared_memory::{CleanupError, SharedMemory, cleanup};
use abbe_runtime::{Publish, RunId, Subscribe};
use common::network::{DOMAIN, in_own_network};
use common::peer::{Peer, role};
use common::samples::{PATIENCE, connect, expect, next, sample, send};
use ros2_client::dds::rustdds::DomainParticipantBuilder;

const STREAM: &str = "/stream";
const EVENTS: &str = "/events";
const PERIOD: Duration = Duration::from_millis(1);

/// Longest gap in the stream at a healthy subscriber: the limit the project promises.
const MAX_GAP: Duration = Duration::from_millis(50);
/// Longest a call of `send` may take. It moves a sample into a queue; the rest is the scheduler.
const MAX_SEND: Duration = Duration::from_millis(5);
/// Sender, queue, network thread, taker: each can be off the processor when the sample comes by.
const THREADS_ON_THE_WAY: u32 = 4;
const ATTEMPTS: usize = 3;

fn depth(samples: usize) -> NonZeroUsize {
    NonZeroUsize::new(samples).unwrap()
}

fn node(name: &str, domain: Domain) -> RosNode {
    node_with(name, domain, ParameterTable::default())
}

fn node_with(name: &str, domain: Domain, parameters: ParameterTable) -> RosNode {
    let identity = NodeIdentity::new("/", name).unwrap();
    RosNode::start(NodeOptions {
        identity,
        domain,
        remaps: Vec::new(),
        parameters,
        enclave: None,
        peers: StaticPeers::default(),
    })
    .unwrap()
}

/// The parameters of a node that asks for `reliability` on the stream.
fn asking_for(reliability: &'static str) -> ParameterTable {
    let specs = qos_parameters(STREAM, TopicEnd::Subscription, 4096);
    ParameterTable::new(specs.into_iter().map(|spec| match spec.name.ends_with("reliability") {
        true => ParameterSpec { default: ParameterValue::String(reliability.to_owned()), ..spec },
        false => spec,
    }))
    .unwrap()
}

/// The longest call of `send`, the longest gap between arrivals, the longest delay of the control.
#[derive(Debug, Clone, Copy)]
struct Worst {
    send: Duration,
    gap: Duration,
    control: Duration,
}

impl Worst {
    fn is_harmless(self) -> bool {
        self.send < MAX_SEND + self.control && self.gap < MAX_GAP + self.control * THREADS_ON_THE_WAY
    }
}

/// Sends at 1 kHz for `duration`, calling `beside` with every sample; `healthy` takes meanwhile.
fn stream(
    publisher: &mut dyn Publish<ScaleReading>,
    healthy: &mut dyn Subscribe<ScaleReading>,
    duration: Duration,
    mut beside: impl FnMut(u64),
) -> Worst {
    let running = AtomicBool::new(true);
    thread::scope(|scope| {
        let taking = scope.spawn(|| {
            let (mut gap, mut last) = (Duration::ZERO, Instant::now());
            while running.load(Ordering::Relaxed) {
                if healthy.take_within(Duration::from_millis(20)).unwrap().is_some() {
                    gap = gap.max(last.elapsed());
                    last = Instant::now();
                }
            }
            gap.max(last.elapsed())
        });
        let control = scope.spawn(|| {
            let mut longest = Duration::ZERO;
            while running.load(Ordering::Relaxed) {
                let start = Instant::now();
                thread::sleep(PERIOD);
                longest = longest.max(start.elapsed().saturating_sub(PERIOD));
            }
            longest
        });
        let start = Instant::now();
        let mut longest_send = Duration::ZERO;
        for number in 0.. {
            let due = start + PERIOD * u32::try_from(number).unwrap();
            if due > start + duration {
                break;
            }
            thread::sleep(due.saturating_duration_since(Instant::now()));
            let sending = Instant::now();
            publisher.send(&sample(number)).unwrap();
            longest_send = longest_send.max(sending.elapsed());
            beside(number);
        }
        running.store(false, Ordering::Relaxed);
        Worst { send: longest_send, gap: taking.join().unwrap(), control: control.join().unwrap() }
    })
}

/// The victim of the DDS test: a reliable and a best-effort reader of the stream, and a reliable
/// reader of a reliable topic. Takes nothing; waits to be killed.
fn play_dds_victim(domain: Domain) {
    let participant =
        DomainParticipantBuilder::new(domain.id()).with_only_networks([std::net::Ipv4Addr::LOCALHOST]).build().unwrap();
    let context = ros2_client::Context::from_domain_participant(participant).unwrap();
    let name = ros2_client::NodeName::new("/", "victim").unwrap();
    let mut node = context.new_node(name, ros2_client::NodeOptions::new()).unwrap();
    let qos = diagnostics_qos();
    let topic = |name: &str, ros_type: &str| {
        let (package, kind) = (ros_type.split('/').next(), ros_type.rsplit('/').next());
        let kind = ros2_client::MessageTypeName::new(package.unwrap(), kind.unwrap());
        let name = ros2_client::Name::parse(name).unwrap();
        node.create_topic(&name, kind, &qos).unwrap()
    };
    let stream = topic(STREAM, ros::ScaleReading::ROS_TYPE);
    let events = topic(EVENTS, DiagnosticArray::ROS_TYPE);
    let _stream = node.create_subscription::<ros::ScaleReading>(&stream, Some(qos.clone())).unwrap();
    let _events = node.create_subscription::<DiagnosticArray>(&events, Some(qos)).unwrap();
    let own = self::node("victim_best_effort", domain);
    let _best = DdsSubscriber::<ScaleReading>::open(&own, STREAM, depth(64)).unwrap();
    thread::sleep(PATIENCE);
}

fn event() -> DiagnosticArray {
    DiagnosticArray { header: Header::new(Stamp::default(), "event"), status: Vec::new() }
}

/// `reliability` is what the healthy subscriber asks for.
fn stream_while_a_dds_reader_dies(test: &str, domain: Domain, reliability: &'static str) -> Worst {
    let node = node("sender", domain);
    let healthy_node = node_with("healthy", domain, asking_for(reliability));
    let mut publisher = DdsPublisher::<ScaleReading>::open(&node, STREAM, depth(4096)).unwrap();
    let events = node.publisher::<DiagnosticArray>(EVENTS, &diagnostics_qos(), depth(64)).unwrap();
    let mut healthy = DdsSubscriber::<ScaleReading>::open(&healthy_node, STREAM, depth(4096)).unwrap();
    connect(&mut publisher, &mut healthy);
    let id = domain.id().to_string();
    let mut victim = Peer::start_with(test, "victim", DOMAIN, &id);
    let deadline = Instant::now() + PATIENCE;
    while (events.subscribers(), publisher.subscribers()) != (1, 3) {
        assert!(Instant::now() < deadline, "the victim did not connect");
        thread::sleep(Duration::from_millis(10));
    }

    let both = |_| events.publish(event());
    stream(&mut publisher, &mut healthy, Duration::from_millis(500), both);
    assert_eq!(events.counts().failed, 0, "the reliable reader did not acknowledge while it lived");
    victim.kill();
    assert_eq!(events.given_up(), 0, "a reader was given up while all acknowledged");
    // The window of 4096 samples is full 4.1 s after the reader's death.
    let worst = stream(&mut publisher, &mut healthy, Duration::from_secs(7), both);
    assert!(events.given_up() > 0, "the dead reader did not fill the window: the test tests nothing");
    assert_eq!((events.counts().failed, publisher.dropped(), healthy.lost()), (0, 0, 0));
    worst
}

#[test]
fn a_reliable_dds_reader_that_is_killed_stalls_nobody() {
    let test = "a_reliable_dds_reader_that_is_killed_stalls_nobody";
    in_own_network(test, |domain| {
        if role().is_some() {
            return play_dds_victim(domain);
        }
        for reliability in ["best_effort", "reliable"] {
            repeat_until_harmless(|| stream_while_a_dds_reader_dies(test, domain, reliability));
        }
    });
}

fn repeat_until_harmless(mut attempt: impl FnMut() -> Worst) {
    for left in (0..ATTEMPTS).rev() {
        let worst = attempt();
        println!("longest send and gap after the death: {worst:?}");
        if worst.is_harmless() {
            return;
        }
        assert!(left > 0, "stalled in every one of {ATTEMPTS} attempts");
    }
}

/// The run of a shared-memory test, handed to its other processes.
const RUN: &str = "ABBE_TEST_RUN";

fn memory(run: &RunId) -> SharedMemory {
    // Small, so that a reader that takes nothing is full within the test.
    SharedMemory::join(run, depth(128)).unwrap()
}

#[test]
fn a_shared_memory_reader_that_is_killed_stalls_nobody() {
    let test = "a_shared_memory_reader_that_is_killed_stalls_nobody";
    if role().is_some() {
        let run = std::env::var(RUN).unwrap().parse().unwrap();
        let _holds = memory(&run).subscriber::<ScaleReading>(STREAM).unwrap();
        return thread::sleep(PATIENCE);
    }
    let run = RunId::unique();
    repeat_until_harmless(|| {
        let memory = memory(&run);
        let mut publisher = memory.publisher(STREAM).unwrap();
        let mut healthy = memory.subscriber(STREAM).unwrap();
        let mut victim = Peer::start_with(test, "victim", RUN, run.as_str());
        let deadline = Instant::now() + PATIENCE;
        while publisher.subscribers() != 2 {
            assert!(Instant::now() < deadline, "the victim did not connect");
            thread::sleep(Duration::from_millis(10));
        }
        victim.kill();
        let worst = stream(&mut publisher, &mut healthy, Duration::from_secs(1), |_| ());
        assert_eq!(publisher.dropped(), 0);
        memory.remove_dead_nodes();
        assert_eq!(publisher.subscribers(), 1, "the dead reader still holds its place");
        worst
    });
    cleanup(&run).unwrap();
}

#[test]
fn what_a_killed_publisher_leaves_is_taken_and_then_removed() {
    let test = "what_a_killed_publisher_leaves_is_taken_and_then_removed";
    if role().is_some() {
        let run = std::env::var(RUN).unwrap().parse().unwrap();
        let mut publisher = memory(&run).publisher::<ScaleReading>(STREAM).unwrap();
        while publisher.subscribers() == 0 {
            thread::sleep(Duration::from_millis(1));
        }
        send(&mut publisher, 0..50);
        return thread::sleep(PATIENCE);
    }
    let run = RunId::unique();
    let memory = memory(&run);
    let mut subscriber = memory.subscriber(STREAM).unwrap();
    let mut first = Peer::start_with(test, "publisher", RUN, run.as_str());
    expect(&mut subscriber, 0..50);
    first.kill();

    let second = Peer::start_with(test, "publisher", RUN, run.as_str());
    expect(&mut subscriber, 0..50);
    assert_eq!(subscriber.lost(), 0);
    assert!(matches!(cleanup(&run), Err(CleanupError::Alive { .. })), "cleaned up a living run");

    drop((second, subscriber, memory));
    let left = files_of(&run);
    assert!(!left.is_empty(), "a killed publisher left nothing: the test tests nothing");
    cleanup(&run).unwrap();
    assert_eq!(files_of(&run), Vec::<String>::new());
    cleanup(&run).unwrap();
}

fn files_of(run: &RunId) -> Vec<String> {
    let of = |folder: &str| std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let paths = of("/dev/shm").chain(of("/tmp")).map(|path| path.display().to_string());
    paths.filter(|path| path.contains(run.as_str())).collect()
}

#[test]
fn a_foreign_type_on_the_topic_is_refused_and_the_stream_goes_on() {
    let test = "a_foreign_type_on_the_topic_is_refused_and_the_stream_goes_on";
    in_own_network(test, |domain| {
        let (ours, theirs) = (node("ours", domain), node("theirs", domain));
        let mut publisher = DdsPublisher::open(&ours, STREAM, depth(64)).unwrap();
        let mut subscriber = DdsSubscriber::<ScaleReading>::open(&node("reader", domain), STREAM, depth(64)).unwrap();
        connect(&mut publisher, &mut subscriber);
        while next(&mut subscriber, Duration::from_millis(100)).is_some() {}

        let qos = abbe_runtime::ros::stream_qos(depth(64));
        let foreign = theirs.publisher::<DiagnosticArray>(STREAM, &qos, depth(64)).unwrap();
        let stop = Arc::new(AtomicBool::new(false));
        let refused = thread::scope(|scope| {
            scope.spawn(|| {
                while !stop.load(Ordering::Relaxed) {
                    foreign.publish(event());
                    thread::sleep(Duration::from_millis(5));
                }
            });
            let deadline = Instant::now() + PATIENCE;
            let error = loop {
                match subscriber.take_within(Duration::from_millis(50)) {
                    Err(error) => break Some(error),
                    Ok(_) if Instant::now() > deadline => break None,
                    Ok(_) => {}
                }
            };
            stop.store(true, Ordering::Relaxed);
            error
        });
        let refused = refused.expect("the foreign type was accepted");
        assert!(refused.is_malformed_sample(), "{refused}");
        drop(foreign);

        send(&mut publisher, 0..20);
        let mut numbers = Vec::new();
        while numbers.last() != Some(&19) {
            match subscriber.take_within(PATIENCE) {
                Ok(sample) => numbers.push(sample.expect("the stream ended").sequence),
                Err(error) => assert!(error.is_malformed_sample(), "{error}"),
            }
        }
        assert_eq!(numbers, (0..20).collect::<Vec<_>>());
    });
}
