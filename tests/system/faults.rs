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
use abbe_runtime::ros::{Domain, diagnostics_qos, stream_qos};
use abbe_runtime::{RunId, Subscribe};
use common::assert_says;
use common::attack::attack;
use common::clock::ShiftedClock;
use common::dds::{Fed, OverDds, PATIENCE, user_node};
use common::files::{Bench, samples};
use common::graph::{DDS, MEMORY, files_of_run, long_recording, stream_of, topic, user};
use common::network::{DOMAIN, in_own_network};
use common::peer::{Peer, role};
use common::program::{Started, abbe_in, signal, try_signal, wait_until};
use common::python::ros2_timed;
use common::watched::{FLOWS_WITHIN, MAX_DELAY, PHASES, PROCESSES_ON_THE_WAY, Seen, StopAtEnd, control, watch};
use ros2_client::QosProfile;
use ros2_client::dds::rustdds::DomainParticipantBuilder;
use rustix::process::Signal;

/// The tests of this file take turns: each wants the processor for itself.
static TURN: Mutex<()> = Mutex::new(());

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
    control: [Duration; PHASES],
    received: u64,
}

/// Takes `count` samples and asserts that each came once and in order. `fault` runs in the middle.
fn take_all(subscriber: &mut dyn Subscribe<CorrectedCoordinates>, count: u64, fault: impl FnOnce() + Send) -> Arrivals {
    let (phase, stop) = (AtomicUsize::new(0), AtomicBool::new(false));
    thread::scope(|scope| {
        let stops = StopAtEnd(&stop);
        let control = scope.spawn(|| control(&phase, &stop));
        let mut fault = Some(fault);
        let (mut gaps, mut last) = ([Duration::ZERO; 2], None::<Instant>);
        for sequence in 0..count {
            let sample = subscriber.take_within(PATIENCE).unwrap().expect("the stream ended");
            let waited = last.map(|last| last.elapsed());
            assert_eq!(sample.sequence, sequence, "samples were lost; the last one came {waited:?} before");
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
        drop(stops);
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

#[test]
fn val_rclpy_a_stopped_reliable_subscriber_of_fast_dds_delays_nobody_over_dds_or_shared_memory() {
    /// Longer than a window of samples at 1 kHz reaches, twice.
    const STOPPED: Duration = Duration::from_secs(10);
    let test = "val_rclpy_a_stopped_reliable_subscriber_of_fast_dds_delays_nobody_over_dds_or_shared_memory";
    let _turn = my_turn();
    in_own_network(test, |domain| {
        let Some(mut victim) = ros2_timed(domain, &["held", "test"]) else { return };
        let (mut over_dds, mut goes_on) = ([Duration::ZERO; 2], 0);
        let seen = watch(domain, 120, &["scale", "residual"], |graph| {
            let mut victim = Peer(victim.stdout(Stdio::piped()).spawn().unwrap());
            let mut told = BufReader::new(victim.0.stdout.take().unwrap()).lines().map_while(Result::ok);
            assert_says(&told.next().expect("it is connected"), &["held"]);
            graph.begin(1);
            graph.over_dds.longest_gap();
            thread::sleep(STOPPED);
            over_dds[0] = graph.over_dds.longest_gap();
            graph.begin(2);
            signal(victim.0.id(), Signal::STOP);
            thread::sleep(STOPPED);
            over_dds[1] = graph.over_dds.longest_gap();
            graph.begin(3);
            signal(victim.0.id(), Signal::CONT);
            thread::sleep(STOPPED / 5);
            goes_on = usize::from(victim.0.try_wait().unwrap().is_none());
            victim.kill();
        });
        let Seen { gaps, control, missed, errors, summaries, .. } = &seen;
        println!("longest gaps {gaps:?}, over DDS {over_dds:?}, of the control {control:?}");
        assert_eq!((*missed, goes_on), (0, 1));
        // Else the window was never full, and nothing was tried.
        assert_says(errors, &["a reliable reader does not acknowledge"]);
        let limit = |before: Duration, processes: u32| before + MAX_DELAY + control[2] * processes;
        assert!(gaps[2] < limit(gaps[1], PROCESSES_ON_THE_WAY), "a gap of {:?}, {:?} before", gaps[2], gaps[1]);
        // The gateway is one more process on the way.
        let [before, stopped] = over_dds;
        assert!(stopped < limit(before, PROCESSES_ON_THE_WAY + 1), "over DDS a gap of {stopped:?}, {before:?} before");
        assert!(summaries.matches("\"gateway_restarts\":0.0").count() >= 2, "{summaries}");
    });
}

#[test]
fn regress_samples_flow_over_dds_once_a_clock_before_1970_is_set_right() {
    let test = "regress_samples_flow_over_dds_once_a_clock_before_1970_is_set_right";
    let _turn = my_turn();
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        let Some(clock) = ShiftedClock::new(&bench) else { return };
        long_recording(&bench, 120_000);
        let file = stream_of(&bench, |launch| launch.edge("residual", "user", MEMORY).edge("residual", "*", DDS));
        let run = RunId::unique();
        let mut command = abbe_in(domain, ["launch", &file, "--run", run.as_str()]);
        clock.set(-2_000_000_000);
        clock.hold(&mut command);
        let graph = Started::start(command);
        let mut subscriber = user::<CorrectedCoordinates>(&run, "corrected");
        for sequence in 0..2000 {
            let sample = subscriber.take_within(PATIENCE).unwrap().expect("the chain does not start");
            assert_eq!(sample.sequence, sequence);
        }
        let node = user_node(domain);
        let over_dds = OverDds::of(&node, &topic("corrected"));
        clock.set(0);
        println!("{:?}", over_dds.flows_within(FLOWS_WITHIN, "the clock was set"));
        drop((subscriber, over_dds));
        signal(graph.id(), Signal::INT);
        let ran = graph.finish();
        assert_says(&ran.errors, &["no gateway to DDS", "the system clock is before 1970", "tried again", "runs now"]);
        assert_eq!(ran.errors.matches("no gateway to DDS").count(), 1, "{}", ran.errors);
        // What was sent before counts as not published.
        let summaries = ran.ok();
        let residual = summaries.lines().find(|line| line.contains("\"residual\"")).unwrap();
        let residual: serde_json::Value = serde_json::from_str(residual).unwrap();
        assert!(residual["figures"]["gateway_missed"].as_f64().unwrap() >= 2000.0, "{residual}");
    });
}

/// A fault lasts seconds in every run of the tests, and minutes where `ABBE_FAULTS=long` asks for it (`just faults`).
fn lasting(seconds: u64, long: u64) -> u64 {
    if std::env::var("ABBE_FAULTS").is_ok_and(|how| how == "long") { long } else { seconds }
}

/// A line of the table of figures in nodes/runtime/README.md.
fn tell(fault: &str, seen: &Seen, phase: usize) {
    let Seen { taken, missed, gaps, control, lasted, .. } = seen;
    let (seconds, ms) = (lasted.as_secs(), |gap: Duration| gap.as_millis());
    let (gap, control) = (ms(gaps[phase]), ms(control[phase]));
    println!("| {fault} | {seconds} s | {taken} | {missed} | {gap} ms | {control} ms |");
}

#[test]
fn regress_any_process_may_be_stopped_and_continued_and_samples_flow_again_over_dds() {
    /// Long enough to interrupt every wait, short enough to lose nothing from a buffer of four seconds.
    const STOPPED: Duration = Duration::from_millis(300);
    /// Longer than a buffer reaches.
    const SOURCE_STOPPED: Duration = Duration::from_secs(6);
    const PROCESSES: [&str; 6] =
        ["launcher", "scale", "geometric", "residual", "gateway of scale", "gateway of residual"];
    const GATEWAYS: [&str; 2] = ["gateway of scale", "gateway of residual"];
    const MOST_TRIES: usize = 30;
    let test = "regress_any_process_may_be_stopped_and_continued_and_samples_flow_again_over_dds";
    let stops = lasting(PROCESSES.len() as u64, 100);
    let _turn = my_turn();
    in_own_network(test, |domain| {
        let seen = watch(domain, 120 + 8 * stops, &["scale", "residual"], |graph| {
            let stop = |name| {
                wait_until(&format!("the {name} runs"), FLOWS_WITHIN, || graph.process(name).is_some());
                let id = graph.process(name).expect("it runs");
                signal(id, Signal::STOP);
                thread::sleep(STOPPED);
                signal(id, Signal::CONT);
                // What was on its way when it was stopped does not count.
                thread::sleep(Duration::from_millis(500));
                println!("{name}: {:?}", graph.over_dds.flows_within(FLOWS_WITHIN, name));
                graph.process(name) != Some(id)
            };
            for name in PROCESSES.into_iter().cycle().take(stops as usize) {
                stop(name);
            }
            // A gateway lives on where none of its threads waited when it was stopped; one that ends is tried as well.
            for name in GATEWAYS {
                assert!((0..MOST_TRIES).any(|_| stop(name)), "no {name} ended: the test does not try what follows");
            }
            // As where the whole host stands still: what is overdue must not drown those who take it.
            let scale = graph.process("scale").expect("it runs");
            signal(scale, Signal::STOP);
            thread::sleep(SOURCE_STOPPED);
            signal(scale, Signal::CONT);
            thread::sleep(SOURCE_STOPPED / 2);
            println!("scale, longer: {:?}", graph.over_dds.flows_within(FLOWS_WITHIN, "scale, longer"));
        });
        tell(&format!("{stops} times a process is stopped for {STOPPED:?}"), &seen, 0);
        assert_eq!(seen.missed, 0, "the chain over shared memory lost a sample");
        assert_says(&seen.errors, &["threads of the DDS library have ended", "it is started again"]);
        assert!(!seen.summaries.contains("\"gateway_restarts\":0.0"), "{}", seen.summaries);
        let missed = seen.summaries.lines().filter(|line| !line.contains("\"gateway_missed\":0.0"));
        assert!(missed.filter(|line| line.contains("gateway_missed")).count() == 2, "what was missed is not counted");
    });
}

#[test]
fn regress_packets_that_exhaust_memory_end_a_gateway_and_never_touch_the_chain_over_shared_memory() {
    let test = "regress_packets_that_exhaust_memory_end_a_gateway_and_never_touch_the_chain_over_shared_memory";
    let attacked = Duration::from_secs(lasting(5, 300));
    let _turn = my_turn();
    in_own_network(test, |domain| {
        let seen = watch(domain, 120 + 2 * attacked.as_secs(), &["residual"], |graph| {
            // The start does not count.
            graph.begin(1);
            thread::sleep(Duration::from_secs(5));
            graph.begin(2);
            attack(graph.process("residual").expect("it runs"), attacked);
            graph.begin(3);
            println!("after the attack: {:?}", graph.over_dds.flows_within(FLOWS_WITHIN, "the attack"));
        });
        let Seen { gaps, control, errors, summaries, .. } = &seen;
        println!("longest gaps {gaps:?}, of the control {control:?}; {errors}");
        tell(&format!("200 hostile packets a second for {attacked:?}"), &seen, 2);
        assert_eq!(seen.missed, 0, "the chain over shared memory lost a sample");
        let limit = gaps[1] + MAX_DELAY + control[2] * PROCESSES_ON_THE_WAY;
        assert!(gaps[2] < limit, "a gap of {:?} under attack, {:?} without", gaps[2], gaps[1]);
        assert_says(errors, &["the gateway to DDS has ended", "it is started again"]);
        let written = errors.len() as u64;
        assert!(written < (64 << 10) * (1 + attacked.as_secs() / 10), "the attack wrote {written} bytes of log");
        assert!(!summaries.contains("\"gateway_restarts\":0.0"), "no gateway ended: the test tests nothing");
    });
}

#[test]
fn a_storm_of_ends_of_nodes_and_gateways_never_ends_the_stream() {
    /// A node that ends five times within a minute is given up, so these take turns, this far apart.
    const BETWEEN_NODES: Duration = Duration::from_secs(8);
    /// A gateway that is killed says no farewell: the user's participant keeps each for 50 s, and may be busy with them.
    const FORGOTTEN_WITHIN: Duration = Duration::from_secs(60);
    let test = "a_storm_of_ends_of_nodes_and_gateways_never_ends_the_stream";
    let storm = Duration::from_secs(lasting(10, 60));
    let _turn = my_turn();
    in_own_network(test, |domain| {
        let (mut nodes, mut gateways) = (0_u32, 0_u32);
        let seen = watch(domain, 120 + 2 * storm.as_secs(), &["geometric", "residual"], |graph| {
            let since = Instant::now();
            graph.begin(1);
            while since.elapsed() < storm {
                if since.elapsed() >= BETWEEN_NODES * nodes
                    && let Some(id) = graph.process(["geometric", "residual"][nodes as usize % 2])
                {
                    signal(id, Signal::KILL);
                    nodes += 1;
                }
                for name in ["gateway of geometric", "gateway of residual"] {
                    if let Some(id) = graph.process(name) {
                        // It may have ended with its node just now.
                        gateways += u32::from(try_signal(id, Signal::KILL));
                    }
                }
                thread::sleep(Duration::from_millis(500));
            }
            graph.begin(2);
            println!(
                "after the storm: {:?}",
                graph.over_dds.flows_within(FLOWS_WITHIN + FORGOTTEN_WITHIN, "the storm")
            );
        });
        tell(&format!("{nodes} times a correcting node is killed, {gateways} times a gateway"), &seen, 1);
        assert!(nodes >= 2 && gateways >= 4, "{nodes} nodes, {gateways} gateways: the test tests nothing");
        assert!(seen.missed > 0 && seen.taken > seen.missed, "{} of {} missed", seen.missed, seen.taken);
    });
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
