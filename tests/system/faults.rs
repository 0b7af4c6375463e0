//! Others that die, stand still or talk nonsense: the corrected stream goes on, complete and in time.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod common;

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use abbe_msgs::standard::{DiagnosticArray, DiagnosticStatus};
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, Message, RosType, ScaleReading, ros};
use abbe_runtime::ros::{
    Domain, NodeIdentity, NodeOptions, ParameterTable, QueuedPublisher, RosNode, diagnostics_qos, stream_qos,
};
use abbe_runtime::transport::dds::DdsSubscriber;
use abbe_runtime::{RunId, Subscribe};
use common::assert_says;
use common::attack::attack;
use common::files::{Bench, samples};
use common::graph::{DDS, LaunchText, MEMORY, files_of_run, long_recording, stream_of, topic, user};
use common::network::{DOMAIN, in_own_network};
use common::peer::{Peer, role};
use common::program::{Started, abbe_in, children, gateway_of, signal, wait_until};
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

/// What comes over DDS at a user's, counted on a thread of its own until this is dropped.
struct OverDds {
    received: Arc<AtomicUsize>,
    running: Arc<AtomicBool>,
    thread: Option<thread::JoinHandle<()>>,
}

impl OverDds {
    fn of(node: &RosNode, topic: &str) -> OverDds {
        let depth = std::num::NonZeroUsize::new(4096).unwrap();
        let mut subscriber = DdsSubscriber::<CorrectedCoordinates>::open(node, topic, depth).unwrap();
        let (received, running) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicBool::new(true)));
        let (count, goes_on) = (Arc::clone(&received), Arc::clone(&running));
        let thread = thread::spawn(move || {
            while goes_on.load(Ordering::Relaxed) {
                let taken = subscriber.take_within(Duration::from_millis(20)).unwrap();
                count.fetch_add(usize::from(taken.is_some()), Ordering::Relaxed);
            }
        });
        OverDds { received, running, thread: Some(thread) }
    }

    /// How long it takes until a hundred more samples have come.
    #[track_caller]
    fn flows_within(&self, limit: Duration, after: &str) -> Duration {
        let (since, before) = (Instant::now(), self.received.load(Ordering::Relaxed));
        wait_until(&format!("samples flow over DDS after {after}"), limit, || {
            self.received.load(Ordering::Relaxed) >= before + 100
        });
        since.elapsed()
    }
}

impl Drop for OverDds {
    fn drop(&mut self) {
        self.running.store(false, Ordering::Relaxed);
        self.thread.take().map(thread::JoinHandle::join);
    }
}

/// A process of a graph by its name: `launcher`, a node, or `gateway of` a node.
fn process_of(launcher: u32, name: &str) -> u32 {
    let node_of = |node: &str| {
        let found = children(launcher).into_iter().find(|(_, line)| line.contains(&format!("node {node} ")));
        found.expect("the node runs").0
    };
    match name.split_once(" of ") {
        Some((_, node)) => gateway_of(node_of(node)).expect("the gateway runs"),
        None if name == "launcher" => launcher,
        None => node_of(name),
    }
}

#[test]
fn regress_any_process_may_be_stopped_and_continued_and_samples_flow_again_over_dds() {
    /// Long enough to interrupt every wait, short enough to lose nothing from a buffer of four seconds.
    const STOPPED: Duration = Duration::from_millis(300);
    const FLOWS_WITHIN: Duration = Duration::from_secs(15);
    let test = "regress_any_process_may_be_stopped_and_continued_and_samples_flow_again_over_dds";
    let _turn = my_turn();
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        long_recording(&bench, 120_000);
        let file = stream_of(&bench, |launch| {
            let launch = launch.edge("residual", "user", MEMORY);
            ["scale", "residual"].into_iter().fold(launch, |launch, node| launch.edge(node, "*", DDS))
        });
        let run = RunId::unique();
        let graph = Started::start(abbe_in(domain, ["launch", &file, "--run", run.as_str()]));
        let mut subscriber = user::<CorrectedCoordinates>(&run, "corrected");
        let node = user_node(domain);
        let over_dds = OverDds::of(&node, &topic("corrected"));
        let stop = AtomicBool::new(false);
        let phase = AtomicUsize::new(0);
        let (taken, _) = thread::scope(|scope| {
            let stops = StopAtEnd(&stop);
            let taking = scope.spawn(|| take_in_phases(subscriber.as_mut(), &phase, &stop));
            over_dds.flows_within(FLOWS_WITHIN, "the start");
            for name in ["launcher", "scale", "geometric", "residual", "gateway of scale", "gateway of residual"] {
                let id = process_of(graph.id(), name);
                signal(id, Signal::STOP);
                thread::sleep(STOPPED);
                signal(id, Signal::CONT);
                // What was on its way when it was stopped does not count.
                thread::sleep(Duration::from_millis(500));
                println!("{name}: {:?}", over_dds.flows_within(FLOWS_WITHIN, name));
            }
            drop(stops);
            taking.join().unwrap()
        });
        let lost = subscriber.lost();
        drop((subscriber, over_dds));
        signal(graph.id(), Signal::INT);
        let ran = graph.finish();
        assert_says(&ran.errors, &["threads of the DDS library have ended", "it is started again"]);
        let summaries = ran.ok();
        println!("{taken} samples taken over shared memory\n{summaries}");
        assert_eq!(lost, 0);
        assert_says(&summaries, &["\"gateway_restarts\":1.0"]);
        let missed = summaries.lines().filter(|line| !line.contains("\"gateway_missed\":0.0"));
        assert!(missed.filter(|line| line.contains("gateway_missed")).count() == 2, "what was missed is not counted");
        assert_eq!(files_of_run(run.as_str()), Vec::<String>::new());
    });
}

#[test]
fn regress_packets_that_exhaust_memory_end_a_gateway_and_never_touch_the_chain_over_shared_memory() {
    const PHASE: Duration = Duration::from_secs(5);
    const FLOWS_WITHIN: Duration = Duration::from_secs(15);
    let test = "regress_packets_that_exhaust_memory_end_a_gateway_and_never_touch_the_chain_over_shared_memory";
    let _turn = my_turn();
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        long_recording(&bench, 120_000);
        let file = stream_of(&bench, |launch| launch.edge("residual", "user", MEMORY).edge("residual", "*", DDS));
        let run = RunId::unique();
        let graph = Started::start(abbe_in(domain, ["launch", &file, "--run", run.as_str()]));
        let mut subscriber = user::<CorrectedCoordinates>(&run, "corrected");
        let node = user_node(domain);
        let over_dds = OverDds::of(&node, &topic("corrected"));
        let (stop, phase) = (AtomicBool::new(false), AtomicUsize::new(0));
        let (taken, gaps, control) = thread::scope(|scope| {
            let stops = StopAtEnd(&stop);
            let taking = scope.spawn(|| take_in_phases(subscriber.as_mut(), &phase, &stop));
            let control = scope.spawn(|| control(&phase, &stop));
            over_dds.flows_within(FLOWS_WITHIN, "the start");
            // The start does not count.
            phase.store(1, Ordering::Relaxed);
            thread::sleep(PHASE);
            phase.store(2, Ordering::Relaxed);
            attack(process_of(graph.id(), "residual"), PHASE);
            phase.store(3, Ordering::Relaxed);
            println!("after the attack: {:?}", over_dds.flows_within(FLOWS_WITHIN, "the attack"));
            drop(stops);
            let (taken, gaps) = taking.join().unwrap();
            (taken, gaps, control.join().unwrap())
        });
        let lost = subscriber.lost();
        drop((subscriber, over_dds));
        signal(graph.id(), Signal::INT);
        let ran = graph.finish();
        println!("{taken} samples; longest gaps {gaps:?}, of the control {control:?}; {}", ran.errors);
        assert_eq!(lost, 0);
        let limit = gaps[1] + MAX_DELAY + control[2] * PROCESSES_ON_THE_WAY;
        assert!(gaps[2] < limit, "a gap of {:?} under attack, {:?} without", gaps[2], gaps[1]);
        assert_says(&ran.errors, &["the gateway to DDS has ended", "it is started again"]);
        assert!(ran.errors.len() < 64 << 10, "the attack wrote {} bytes of log", ran.errors.len());
        let summaries = ran.ok();
        assert!(!summaries.contains("\"gateway_restarts\":0.0"), "no gateway ended: the test tests nothing");
        assert_eq!(files_of_run(run.as_str()), Vec::<String>::new());
    });
}

/// The longest delay of a thread that only sleeps, by phase.
fn control(phase: &AtomicUsize, stop: &AtomicBool) -> [Duration; 4] {
    let mut longest = [Duration::ZERO; 4];
    while !stop.load(Ordering::Relaxed) {
        let (start, now) = (Instant::now(), phase.load(Ordering::Relaxed));
        thread::sleep(Duration::from_millis(1));
        longest[now] = longest[now].max(start.elapsed());
    }
    longest
}

/// Tells the threads of a test to stop, also where the test fails: it waits for them.
struct StopAtEnd<'a>(&'a AtomicBool);

impl Drop for StopAtEnd<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Takes every sample, each once and in order: how many, and the longest gap of each phase.
fn take_in_phases(
    subscriber: &mut dyn Subscribe<CorrectedCoordinates>,
    phase: &AtomicUsize,
    stop: &AtomicBool,
) -> (u64, [Duration; 4]) {
    let (mut next, mut last, mut gaps) = (0, None::<Instant>, [Duration::ZERO; 4]);
    while !stop.load(Ordering::Relaxed) {
        let Some(sample) = subscriber.take_within(Duration::from_millis(20)).unwrap() else { continue };
        assert_eq!(sample.sequence, next, "the chain over shared memory lost a sample");
        next += 1;
        let now = phase.load(Ordering::Relaxed);
        gaps[now] = gaps[now].max(last.map_or(Duration::ZERO, |last: Instant| last.elapsed()));
        last = Some(Instant::now());
    }
    (next, gaps)
}

/// A node of a user who sends and takes over DDS.
fn user_node(domain: Domain) -> RosNode {
    let identity = NodeIdentity::new("/", "test_user").unwrap();
    RosNode::start(NodeOptions { identity, domain, remaps: Vec::new(), parameters: ParameterTable::default() }).unwrap()
}

/// The correcting nodes, fed by a user over DDS.
struct Fed {
    graph: Started,
    node: RosNode,
    readings: QueuedPublisher<ros::ScaleReading>,
    corrected: DdsSubscriber<CorrectedCoordinates>,
}

impl Fed {
    /// Starts them and waits until they answer; `probe` finds that out.
    fn start(bench: &Bench, domain: Domain, probe: &ScaleReading) -> Fed {
        let launch = LaunchText::default().nodes(&["geometric", "residual"]).edge("scale", "geometric", DDS);
        let launch = launch.edge("geometric", "residual", MEMORY).edge("residual", "*", DDS);
        let graph = Started::start(abbe_in(domain, ["launch", &launch.write(bench)]));
        let (node, depth) = (user_node(domain), DEPTH);
        let readings = publisher_of_readings(&node);
        let corrected = DdsSubscriber::<CorrectedCoordinates>::open(&node, &topic("corrected"), depth).unwrap();
        let mut fed = Fed { graph, node, readings, corrected };
        let deadline = Instant::now() + PATIENCE;
        let probe = ScaleReading { sequence: u64::MAX, ..*probe };
        while fed.corrected.take_within(Duration::from_millis(20)).unwrap().is_none() {
            assert!(Instant::now() < deadline, "the graph did not answer");
            fed.readings.publish(probe.to_ros());
        }
        fed
    }

    /// Sends a reading a millisecond.
    fn send(&self, readings: impl IntoIterator<Item = ScaleReading>) {
        for reading in readings {
            self.readings.publish(reading.to_ros());
            thread::sleep(Duration::from_millis(1));
        }
    }

    /// The next answers, without those to the probes.
    fn take(&mut self, count: usize) -> Vec<CorrectedCoordinates> {
        let mut taken = Vec::new();
        while taken.len() < count {
            let sample = self.corrected.take_within(PATIENCE).unwrap().expect("the stream ended");
            taken.extend(Some(sample).filter(|sample| sample.sequence != u64::MAX));
        }
        taken
    }
}

const DEPTH: std::num::NonZeroUsize = std::num::NonZeroUsize::MIN.saturating_add(4095);

fn publisher_of_readings(node: &RosNode) -> QueuedPublisher<ros::ScaleReading> {
    node.publisher::<ros::ScaleReading>(&topic("scale/reading"), &stream_qos(DEPTH), DEPTH).unwrap()
}

#[test]
fn regress_a_flood_of_malformed_readings_is_refused_in_few_words_and_the_stream_goes_on() {
    const MALFORMED: u64 = 3000;
    const GOOD: u64 = 200;
    let test = "regress_a_flood_of_malformed_readings_is_refused_in_few_words_and_the_stream_goes_on";
    let _turn = my_turn();
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        long_recording(&bench, GOOD);
        let good = samples::<ScaleReading>(&bench.path("long"), &topic("scale/reading"));
        let mut fed = Fed::start(&bench, domain, &good[0]);
        let mut malformed = good[0].to_ros();
        malformed.covariate_values.pop();
        for _ in 0..MALFORMED {
            fed.readings.publish(malformed.clone());
            thread::sleep(Duration::from_micros(200));
        }
        fed.send(good);
        let sequences: Vec<u64> = fed.take(GOOD as usize).iter().map(|sample| sample.sequence).collect();
        assert_eq!(sequences, (0..GOOD).collect::<Vec<_>>());

        signal(fed.graph.id(), Signal::INT);
        let ran = fed.graph.finish();
        assert_says(&ran.errors, &["geometric: ", "refused", "covariate"]);
        println!("{} bytes of log for {MALFORMED} malformed readings", ran.errors.len());
        assert!(ran.errors.len() < 16 << 10, "{}", ran.errors);
        let summary = ran.ok();
        assert_says(&summary, &[&format!("\"malformed\":{MALFORMED}")]);
    });
}

/// A listener to `/diagnostics` by others; keep both.
fn diagnostics(domain: Domain) -> (ros2_client::Node, ros2_client::Subscription<DiagnosticArray>) {
    let networks = [std::net::Ipv4Addr::LOCALHOST];
    let participant = DomainParticipantBuilder::new(domain.id()).with_only_networks(networks).build().unwrap();
    let context = ros2_client::Context::from_domain_participant(participant).unwrap();
    let name = ros2_client::NodeName::new("/", "listener").unwrap();
    let mut node = context.new_node(name, ros2_client::NodeOptions::new()).unwrap();
    let kind = ros2_client::MessageTypeName::new("diagnostic_msgs", "DiagnosticArray");
    let topic =
        node.create_topic(&ros2_client::Name::parse("/diagnostics").unwrap(), kind, &diagnostics_qos()).unwrap();
    let events = node.create_subscription::<DiagnosticArray>(&topic, Some(diagnostics_qos())).unwrap();
    (node, events)
}

#[test]
fn regress_readings_of_another_frame_and_of_a_second_source_are_refused_aloud() {
    const EACH: usize = 100;
    let test = "regress_readings_of_another_frame_and_of_a_second_source_are_refused_aloud";
    let _turn = my_turn();
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        long_recording(&bench, 4 * EACH as u64);
        let good = samples::<ScaleReading>(&bench.path("long"), &topic("scale/reading"));
        let (_listener, events) = diagnostics(domain);
        let mut fed = Fed::start(&bench, domain, &good[0]);

        let frame_id = abbe_msgs::Text::new("other_machine").unwrap();
        fed.send(good[..EACH].iter().map(|reading| ScaleReading { frame_id, ..*reading }));
        let foreign = fed.take(EACH);
        assert!(foreign.iter().all(|sample| sample.status == CorrectionStatus::OtherFrame && !sample.corrected_valid));

        // The machine, and beside it a recording that somebody plays.
        let other = publisher_of_readings(&fed.node);
        let deadline = Instant::now() + PATIENCE;
        while other.subscribers() == 0 {
            assert!(Instant::now() < deadline, "the second source is not heard");
            thread::sleep(Duration::from_millis(10));
        }
        thread::sleep(Duration::from_millis(500));
        for place in 0..EACH {
            fed.send([good[EACH + place]]);
            other.publish(ScaleReading { sequence: 5000 + place as u64, ..good[2 * EACH + place] }.to_ros());
            thread::sleep(Duration::from_millis(1));
        }
        let mixed = fed.take(2 * EACH);
        let told = mixed.iter().position(|sample| sample.status == CorrectionStatus::SeveralSources).expect("not told");
        assert!(told < 10, "told after {told} samples");
        assert!(mixed[told..].iter().all(|sample| sample.corrected_point_in_machine_m().is_none()));

        // Alone again, with later stamps.
        drop(other);
        fed.send(good[3 * EACH..].iter().copied());
        let alone = fed.take(EACH);
        assert!(alone[40..].iter().all(|sample| sample.status == CorrectionStatus::InVolume), "{:?}", alone[40].status);

        let mut warned = String::new();
        let deadline = Instant::now() + PATIENCE;
        while !(["another frame", "are mixed", "several publishers"].iter().all(|words| warned.contains(words))) {
            assert!(Instant::now() < deadline, "no WARN: {warned}");
            while let Some((array, _)) = events.take().unwrap() {
                let input = array.status.into_iter().filter(|s| s.name.ends_with("geometric: input"));
                input.filter(|s| s.level == DiagnosticStatus::WARN).for_each(|s| warned += &s.message);
            }
            thread::sleep(Duration::from_millis(20));
        }
        signal(fed.graph.id(), Signal::INT);
        let ran = fed.graph.finish();
        assert_says(&ran.errors, &["in another frame are refused", "of several sources are mixed"]);
        assert_says(&ran.ok(), &[&format!("\"scale_readings_other_frame\":{EACH}.0")]);
    });
}

#[test]
fn regress_a_second_launch_of_a_run_or_in_a_namespace_is_refused_and_the_first_goes_on() {
    let test = "regress_a_second_launch_of_a_run_or_in_a_namespace_is_refused_and_the_first_goes_on";
    let _turn = my_turn();
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        long_recording(&bench, 60_000);
        let file = stream_of(&bench, |launch| launch.edge("residual", "user", MEMORY).edge("residual", "*", DDS));
        let run = RunId::unique();
        let first = Started::start(abbe_in(domain, ["launch", &file, "--run", run.as_str()]));
        let mut subscriber = user::<CorrectedCoordinates>(&run, "corrected");
        let mut next = 0;
        let mut goes_on = |samples: u64| {
            for _ in 0..samples {
                let sample = subscriber.take_within(PATIENCE).unwrap().expect("the stream ended");
                assert_eq!((sample.sequence, sample.status), (next, CorrectionStatus::InVolume));
                next += 1;
            }
        };
        goes_on(100);
        let refused = |arguments: &[&str]| Started::start(abbe_in(domain, arguments)).finish().refused();
        let said = refused(&["launch", &file, "--run", run.as_str()]);
        assert_says(&said, &["is in use", run.as_str(), "--run"]);
        let said = refused(&["node", "geometric", "--launch", &file, "--run", run.as_str()]);
        assert_says(&said, &["has a publisher of /test/geometric/corrected", run.as_str()]);
        let said = refused(&["launch", &file]);
        assert_says(&said, &["has a publisher of /test/corrected", "ROS domain", "namespace"]);
        goes_on(1000);
        drop(subscriber);
        signal(first.id(), Signal::INT);
        first.finish().ok();
        assert_eq!(files_of_run(run.as_str()), Vec::<String>::new());
    });
}
