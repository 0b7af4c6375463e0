//! Processes that die or stand still: subscribers, nodes, the launcher. The corrected stream goes on, failures are
//! told by name, and nothing is left running or lying about.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod common;

use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use abbe_msgs::bag::BagWriter;
use abbe_msgs::standard::DiagnosticArray;
use abbe_msgs::{CorrectedCoordinates, RosType, ScaleReading, Stamp, ros};
use abbe_runtime::ros::{Domain, diagnostics_qos, stream_qos};
use abbe_runtime::{RunId, Subscribe};
use common::assert_says;
use common::files::{Bench, machine, samples, text};
use common::graph::{DDS, LaunchText, MEMORY, NAMESPACE, files_of_run, topic, user};
use common::network::{DOMAIN, in_own_network};
use common::peer::{Peer, role};
use common::program::{Started, abbe, abbe_in, children, is_running, run, signal, signal_group, wait_until};
use ros2_client::QosProfile;
use ros2_client::dds::rustdds::DomainParticipantBuilder;
use rustix::process::Signal;

/// The tests of this file take turns: each wants the processor for itself.
static TURN: Mutex<()> = Mutex::new(());

const PATIENCE: Duration = Duration::from_secs(20);
/// How soon everything must have ended.
const GONE_WITHIN: Duration = Duration::from_secs(5);
const RATE_HZ: f64 = 1000.0;
/// Longest delay that a dead or slow subscriber may add: the limit the project promises.
const MAX_DELAY: Duration = Duration::from_millis(50);
/// Scale, geometric and residual node and this subscriber: each can be off the processor when a sample comes by.
const PROCESSES_ON_THE_WAY: u32 = 4;

fn my_turn() -> std::sync::MutexGuard<'static, ()> {
    TURN.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// A bag with the campaign's readings over and over, 1 ms apart.
fn long_recording(bench: &Bench, count: u64) {
    let (campaign, bag) = (bench.text("campaign.csv"), bench.text("campaign"));
    run(["convert", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &bag, "--namespace", NAMESPACE])
        .ok();
    let readings = samples::<ScaleReading>(&bench.path("campaign"), &topic("scale/reading"));
    let mut writer = BagWriter::create(bench.path("long")).unwrap();
    for (sequence, reading) in (0..count).zip(readings.iter().cycle()) {
        let stamp = Stamp::from_nanos(i64::try_from(sequence).unwrap() * 1_000_000).unwrap();
        writer.write(&topic("scale/reading"), &ScaleReading { stamp, sequence, ..*reading }, sequence).unwrap();
    }
    writer.finish().unwrap();
}

/// The correcting path over shared memory, fed with `long_recording`; `more` adds edges.
fn stream_of(bench: &Bench, more: impl FnOnce(LaunchText) -> LaunchText) -> String {
    let long = bench.text("long");
    let launch = LaunchText::default()
        .nodes(&["scale", "geometric", "residual"])
        .edge("scale", "geometric", MEMORY)
        .edge("geometric", "residual", MEMORY)
        .source("scale", &long, Some(&topic("scale/reading")), RATE_HZ);
    more(launch).write(bench)
}

/// The same with a recorder in place of a user.
fn recorded_stream_of(bench: &Bench, bag: &str) -> String {
    stream_of(bench, |launch| launch.nodes(&["recorder"]).edge("residual", "recorder", MEMORY).record(bag))
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
        let file = stream_of(&bench, |launch| launch.edge("residual", "user", MEMORY).edge("residual", "*", DDS));
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

/// How a launcher is told to end.
#[derive(Debug, Clone, Copy)]
enum End {
    Interrupt,
    /// As Ctrl-C in a terminal does: the nodes get it, too.
    InterruptAll,
    Terminate,
    Kill,
}

impl End {
    const ALL: [End; 4] = [End::Interrupt, End::InterruptAll, End::Terminate, End::Kill];

    fn send(self, launcher: u32) {
        match self {
            End::Interrupt => signal(launcher, Signal::INT),
            End::InterruptAll => signal_group(launcher, Signal::INT),
            End::Terminate => signal(launcher, Signal::TERM),
            End::Kill => signal(launcher, Signal::KILL),
        }
    }
}

/// Ends a launcher that has `nodes` children and asserts that nothing of it is left.
fn end_and_look(mut launcher: Started, nodes: usize, run: &str, end: End) -> common::program::Ran {
    let id = launcher.id();
    wait_until("all nodes run", PATIENCE, || {
        assert!(launcher.is_running(), "{end:?}: it ended by itself");
        children(id).len() == nodes
    });
    // Into the middle of the stream.
    thread::sleep(Duration::from_millis(700));
    let processes = children(id);
    assert_eq!(processes.len(), nodes, "{end:?}: {processes:?}");
    assert!(!files_of_run(run).is_empty(), "there was no shared memory: the test tests nothing");
    end.send(id);
    let since = Instant::now();
    wait_until(&format!("{end:?}: all processes end"), GONE_WITHIN, || {
        !launcher.is_running() && processes.iter().all(|(id, _)| !is_running(*id))
    });
    println!("{end:?}: gone after {:?}", since.elapsed());
    assert_eq!(files_of_run(run), Vec::<String>::new(), "{end:?}: files are left");
    launcher.finish()
}

#[test]
fn a_launch_that_is_interrupted_terminated_or_killed_leaves_no_process_and_no_file() {
    let _turn = my_turn();
    let bench = Bench::identified(5);
    long_recording(&bench, 60_000);
    for (number, end) in End::ALL.into_iter().enumerate() {
        let bag = format!("recorded_{number}");
        let file = recorded_stream_of(&bench, &bag);
        let run = RunId::unique();
        let mut command = abbe(["launch", &file, "--run", run.as_str()]);
        command.process_group(0);
        let ran = end_and_look(Started::start(command), 4, run.as_str(), end);
        match end {
            End::Kill => assert_eq!(ran.code, None),
            _ => assert_says(&ran.ok(), &["\"node\":\"residual\""]),
        }
        let recorded = samples::<CorrectedCoordinates>(&bench.path(&bag), &topic("corrected"));
        assert!(recorded.len() > 100, "{end:?}: only {} samples were recorded", recorded.len());
    }
}

#[test]
fn a_demo_that_is_interrupted_terminated_or_killed_leaves_no_process_and_no_file() {
    let _turn = my_turn();
    for end in End::ALL {
        let folder = tempfile::tempdir().unwrap();
        let mut command = abbe(["demo", "--out", &text(&folder.path().join("demo")), "--rate-hz", "200"]);
        command.process_group(0);
        let demo = Started::start(command);
        let run = format!("{:x}-", demo.id());
        let ran = end_and_look(demo, 6, &run, end);
        match end {
            End::Kill => assert_eq!(ran.code, None),
            _ => assert_says(&ran.refused(), &["stopped on request"]),
        }
        assert!(!folder.path().join("demo/report.html").exists());
    }
}

#[test]
fn a_node_that_is_killed_ends_the_launch_with_its_name() {
    let _turn = my_turn();
    let bench = Bench::identified(5);
    long_recording(&bench, 60_000);
    for victim in ["geometric", "scale", "recorder"] {
        let file = recorded_stream_of(&bench, &format!("without_{victim}"));
        let run = RunId::unique();
        let launcher = Started::start(abbe(["launch", &file, "--run", run.as_str()]));
        wait_until("all nodes run", PATIENCE, || children(launcher.id()).len() == 4);
        thread::sleep(Duration::from_millis(500));
        let processes = children(launcher.id());
        let (id, _) = processes.iter().find(|(_, words)| words.contains(&format!("node {victim} "))).unwrap();
        signal(*id, Signal::KILL);
        let said = launcher.finish().refused();
        assert_says(&said, &[&format!("node {victim} ended with"), "signal: 9"]);
        assert!(processes.iter().all(|(id, _)| !is_running(*id)), "a node outlived the launcher");
        assert_eq!(files_of_run(run.as_str()), Vec::<String>::new());
    }
}

#[test]
fn a_node_that_cannot_start_ends_the_launch_with_its_own_words() {
    let _turn = my_turn();
    let bench = Bench::identified(5);
    let launch = LaunchText::default()
        .nodes(&["scale", "geometric"])
        .edge("scale", "geometric", MEMORY)
        .edge("geometric", "user", MEMORY)
        .source("scale", "no_such_file.csv", None, RATE_HZ);
    let run_name = RunId::unique();
    let said = run(["launch", &launch.write(&bench), "--run", run_name.as_str()]).refused();
    assert_says(&said, &["node scale ended with", "no_such_file.csv", "cannot open"]);
    assert_eq!(files_of_run(run_name.as_str()), Vec::<String>::new());
}
