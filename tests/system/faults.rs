//! Others that die, stand still or talk nonsense: the corrected stream goes on, complete and in time.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod common;

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use abbe_msgs::standard::DiagnosticArray;
use abbe_msgs::{CorrectedCoordinates, Message, RosType, ScaleReading, ros};
use abbe_runtime::ros::{Domain, NodeIdentity, NodeOptions, ParameterTable, RosNode, diagnostics_qos, stream_qos};
use abbe_runtime::transport::dds::DdsSubscriber;
use abbe_runtime::{RunId, Subscribe};
use common::assert_says;
use common::files::{Bench, samples};
use common::graph::{DDS, LaunchText, MEMORY, files_of_run, long_recording, stream_of, topic, user};
use common::network::{DOMAIN, in_own_network};
use common::peer::{Peer, role};
use common::program::{Started, abbe_in, signal};
use ros2_client::QosProfile;
use ros2_client::dds::rustdds::DomainParticipantBuilder;
use rustix::process::Signal;

/// The tests of this file take turns: each wants the processor for itself.
static TURN: Mutex<()> = Mutex::new(());

const PATIENCE: Duration = Duration::from_secs(20);
/// Longest delay that a dead or slow subscriber may add: the limit the project promises.
const MAX_DELAY: Duration = Duration::from_millis(50);
/// Scale, geometric and residual node and this subscriber: each can be off the processor when a sample comes by.
const PROCESSES_ON_THE_WAY: u32 = 4;

fn my_turn() -> std::sync::MutexGuard<'static, ()> {
    TURN.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// A subscriber by others that takes nothing and waits to be killed: reliable on everything that can be reliable,
/// and best effort on the stream.
fn play_subscriber(domain: Domain) {
    let networks = [std::net::Ipv4Addr::LOCALHOST];
    let participant = DomainParticipantBuilder::new(domain.id()).with_only_networks(networks).build().unwrap();
    let context = ros2_client::Context::from_domain_participant(participant).unwrap();
    let name = ros2_client::NodeName::new("/", &format!("victim_{}", std::process::id())).unwrap();
    let mut node = context.new_node(name, ros2_client::NodeOptions::new()).unwrap();
    let depth = std::num::NonZeroUsize::new(64).unwrap();
    let (reliable, best_effort) = (diagnostics_qos(), stream_qos(depth));
    let topic = |node: &ros2_client::Node, name: &str, ros_type: &str, qos: &QosProfile| {
        let (package, kind) = (ros_type.split('/').next().unwrap(), ros_type.rsplit('/').next().unwrap());
        let kind = ros2_client::MessageTypeName::new(package, kind);
        node.create_topic(&ros2_client::Name::parse(name).unwrap(), kind, qos).unwrap()
    };
    let corrected = common::graph::topic("corrected");
    let corrected_type = ros::CorrectedCoordinates::ROS_TYPE;
    let stream = topic(&node, &corrected, corrected_type, &best_effort);
    let stubborn = topic(&node, &corrected, corrected_type, &reliable);
    let events = topic(&node, "/diagnostics", DiagnosticArray::ROS_TYPE, &reliable);
    let _stream = node.create_subscription::<ros::CorrectedCoordinates>(&stream, Some(best_effort)).unwrap();
    let _stubborn = node.create_subscription::<ros::CorrectedCoordinates>(&stubborn, Some(reliable.clone())).unwrap();
    let events = node.create_subscription::<DiagnosticArray>(&events, Some(reliable)).unwrap();
    // The first event says that it is connected; then it never takes anything again.
    let deadline = Instant::now() + PATIENCE;
    while events.take().unwrap().is_none() {
        assert!(Instant::now() < deadline, "no diagnostics arrived");
        thread::sleep(Duration::from_millis(5));
    }
    println!("{CONNECTED}");
    thread::sleep(PATIENCE);
}

const CONNECTED: &str = "the victim is connected";

/// Another process that runs [`play_subscriber`].
struct Victim {
    process: Peer,
    connected: Arc<AtomicBool>,
}

impl Victim {
    fn start(test: &str, domain: Domain) -> Victim {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args([test, "--exact", "--nocapture", "--test-threads=1"])
            .env("ABBE_TEST_ROLE", "victim")
            .env(DOMAIN, domain.id().to_string())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let connected = Arc::new(AtomicBool::new(false));
        let (output, told) = (BufReader::new(child.stdout.take().unwrap()), Arc::clone(&connected));
        // Ends with the process.
        thread::spawn(move || {
            for line in output.lines().map_while(Result::ok) {
                told.fetch_or(line.contains(CONNECTED), Ordering::Relaxed);
            }
        });
        Victim { process: Peer(child), connected }
    }
}

/// Arrivals at a healthy subscriber: the longest gap of each phase.
struct Arrivals {
    /// Between neighbours, by phase.
    gaps: [Duration; 2],
    /// Longest delay of a thread that only sleeps, by phase.
    control: [Duration; 2],
    received: u64,
}

/// Takes `count` samples and asserts that each came once and in order. `fault` runs in the middle.
fn take_all(subscriber: &mut dyn Subscribe<CorrectedCoordinates>, count: u64, fault: impl FnOnce() + Send) -> Arrivals {
    let (phase, running) = (AtomicUsize::new(0), AtomicBool::new(true));
    thread::scope(|scope| {
        let control = scope.spawn(|| {
            let mut longest = [Duration::ZERO; 2];
            while running.load(Ordering::Relaxed) {
                let (start, now) = (Instant::now(), phase.load(Ordering::Relaxed));
                thread::sleep(Duration::from_millis(1));
                longest[now] = longest[now].max(start.elapsed());
            }
            longest
        });
        let mut fault = Some(fault);
        let (mut gaps, mut last) = ([Duration::ZERO; 2], None::<Instant>);
        for sequence in 0..count {
            let sample = subscriber.take_within(PATIENCE).unwrap().expect("the stream ended");
            assert_eq!(sample.sequence, sequence, "samples were lost");
            let now = phase.load(Ordering::Relaxed);
            if let Some(last) = last {
                gaps[now] = gaps[now].max(last.elapsed());
            }
            last = Some(Instant::now());
            if sequence == count / 2 {
                // On a thread of its own: what it takes must not count as a gap.
                phase.store(1, Ordering::Relaxed);
                scope.spawn(fault.take().unwrap());
            }
        }
        running.store(false, Ordering::Relaxed);
        Arrivals { gaps, control: control.join().unwrap(), received: count }
    })
}

#[test]
fn a_killed_and_a_stopped_reliable_subscriber_neither_delay_nor_lose_a_corrected_sample() {
    let test = "a_killed_and_a_stopped_reliable_subscriber_neither_delay_nor_lose_a_corrected_sample";
    let _turn = my_turn();
    in_own_network(test, |domain| {
        if role().is_some() {
            return play_subscriber(domain);
        }
        let bench = Bench::identified(5);
        let count = 12_000;
        long_recording(&bench, count);
        let file = stream_of(&bench, |launch| {
            let launch = launch.edge("residual", "user", MEMORY);
            ["scale", "geometric", "residual"].into_iter().fold(launch, |launch, node| launch.edge(node, "*", DDS))
        });
        let run = RunId::unique();
        let graph = Started::start(abbe_in(domain, ["launch", &file, "--run", run.as_str()]));
        let [mut killed, stopped] = [(); 2].map(|()| Victim::start(test, domain));
        let mut subscriber = user::<CorrectedCoordinates>(&run, "corrected");
        let arrivals = take_all(subscriber.as_mut(), count, || {
            let connected = [&killed, &stopped].map(|victim| victim.connected.load(Ordering::Relaxed));
            assert_eq!(connected, [true; 2], "the victims were not connected when the faults came");
            killed.process.kill();
            signal(stopped.process.0.id(), Signal::STOP);
        });
        let lost = subscriber.lost();
        drop(subscriber);
        graph.finish().ok();
        let Arrivals { gaps, control, received } = arrivals;
        println!("{received} samples; longest gaps before and after the faults {gaps:?}, of the control {control:?}");
        assert_eq!(lost, 0);
        let limit = gaps[0] + MAX_DELAY + control[1] * PROCESSES_ON_THE_WAY;
        assert!(gaps[1] < limit, "a gap of {:?} after the faults, {:?} before", gaps[1], gaps[0]);
        assert_eq!(files_of_run(run.as_str()), Vec::<String>::new());
    });
}

/// A node of a user who sends and takes over DDS.
fn user_node(domain: Domain) -> RosNode {
    let identity = NodeIdentity::new("/", "test_user").unwrap();
    RosNode::start(NodeOptions { identity, domain, remaps: Vec::new(), parameters: ParameterTable::default() }).unwrap()
}

#[test]
fn a_flood_of_malformed_readings_is_refused_aloud_and_the_stream_goes_on() {
    const MALFORMED: u64 = 3000;
    const GOOD: u64 = 200;
    let test = "a_flood_of_malformed_readings_is_refused_aloud_and_the_stream_goes_on";
    let _turn = my_turn();
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        long_recording(&bench, GOOD);
        let good = samples::<ScaleReading>(&bench.path("long"), &topic("scale/reading"));
        let launch = LaunchText::default().nodes(&["geometric", "residual"]).edge("scale", "geometric", DDS);
        let launch = launch.edge("geometric", "residual", MEMORY).edge("residual", "*", DDS);
        let graph = Started::start(abbe_in(domain, ["launch", &launch.write(&bench)]));

        let (node, depth) = (user_node(domain), std::num::NonZeroUsize::new(4096).unwrap());
        let publisher =
            node.publisher::<ros::ScaleReading>(&topic("scale/reading"), &stream_qos(depth), depth).unwrap();
        let mut subscriber = DdsSubscriber::<CorrectedCoordinates>::open(&node, &topic("corrected"), depth).unwrap();
        let deadline = Instant::now() + PATIENCE;
        let probe = ScaleReading { sequence: u64::MAX, ..good[0] };
        while subscriber.take_within(Duration::from_millis(20)).unwrap().is_none() {
            assert!(Instant::now() < deadline, "the graph did not answer");
            publisher.publish(probe.to_ros());
        }
        let mut malformed = good[0].to_ros();
        malformed.covariate_values.pop();
        for _ in 0..MALFORMED {
            publisher.publish(malformed.clone());
            thread::sleep(Duration::from_micros(200));
        }
        for reading in &good {
            publisher.publish(reading.to_ros());
            thread::sleep(Duration::from_millis(1));
        }
        let mut sequences = Vec::new();
        while sequences.last() != Some(&(GOOD - 1)) {
            let sample = subscriber.take_within(PATIENCE).unwrap().expect("the stream ended");
            sequences.extend(Some(sample.sequence).filter(|sequence| *sequence != u64::MAX));
        }
        assert_eq!(sequences, (0..GOOD).collect::<Vec<_>>());

        signal(graph.id(), Signal::INT);
        let ran = graph.finish();
        assert!(ran.errors.len() > 1 << 17, "it said less than a pipe holds: the test tests nothing");
        assert_says(&ran.errors, &["geometric: ", "refused", "covariate"]);
        let summary = ran.ok();
        assert_says(&summary, &[&format!("\"malformed\":{MALFORMED}")]);
    });
}
