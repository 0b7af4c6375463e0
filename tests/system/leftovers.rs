//! The way out: however a launcher or a node ends, failures are told by name, what can go on goes on, and no process and
//! no file of the run is left.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::os::unix::process::CommandExt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use crate::common::assert_says;
use crate::common::files::{Bench, samples, text};
use crate::common::graph::{
    LaunchText, MEMORY, files_of_run, long_recording, recorded_stream_of, stream_of, topic, user,
};
use crate::common::program::{
    Started, abbe, children, is_running, processes_with, run, signal, signal_group, wait_until,
};
use abbe_graph::node::NodeSummary;
use abbe_msgs::CorrectedCoordinates;
use abbe_runtime::RunId;
use rustix::process::Signal;

const PATIENCE: Duration = Duration::from_secs(20);
/// How soon everything must have ended.
const GONE_WITHIN: Duration = Duration::from_secs(10);

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

/// Ends a launcher that has `nodes` children, and is in the middle of its stream when `flows` says so; asserts that nothing
/// of it is left.
fn end_and_look(
    mut launcher: Started,
    nodes: usize,
    run: &str,
    end: End,
    flows: impl Fn() -> bool,
) -> crate::common::program::Ran {
    let id = launcher.id();
    wait_until("all nodes run, and samples flow", PATIENCE, || {
        assert!(launcher.is_running(), "{end:?}: it ended by itself");
        children(id).len() == nodes && flows()
    });
    // Into the middle of the stream.
    thread::sleep(Duration::from_millis(500));
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
    let bench = Bench::identified(5);
    long_recording(&bench, 60_000);
    for (number, end) in End::ALL.into_iter().enumerate() {
        let bag = format!("recorded_{number}");
        let file = recorded_stream_of(&bench, &bag);
        let run = RunId::unique();
        let mut command = abbe(["launch", &file, "--run", run.as_str()]);
        command.process_group(0);
        let ran = end_and_look(Started::start(command), 4, run.as_str(), end, || is_recording(&bench, &bag));
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
    for end in End::ALL {
        let folder = tempfile::tempdir().unwrap();
        let mut command = abbe(["demo", "--out", &text(&folder.path().join("demo")), "--rate-hz", "200"]);
        command.process_group(0);
        let demo = Started::start(command);
        let run = format!("{:x}-", demo.id());
        let ran = end_and_look(demo, 6, &run, end, || files_of_run(&run).len() > 10);
        match end {
            End::Kill => assert_eq!(ran.code, None),
            _ => assert_says(&ran.refused(), &["stopped on request"]),
        }
        assert!(!folder.path().join("demo/report.html").exists());
    }
}

#[test]
fn a_demo_that_is_interrupted_or_killed_while_it_diagnoses_leaves_no_process_and_no_file() {
    for end in [End::InterruptAll, End::Kill] {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("demo");
        let mut command = abbe(["demo", "--out", &text(&out)]);
        command.process_group(0);
        let demo = Started::start(command);
        let run = format!("{:x}-", demo.id());
        // It begins when the campaign has been played, and then the tracer has nothing more to give.
        let nodes = 6 - 1;
        let diagnoses = || processes_with(&format!("{}/diagnoses/0001/campaign.csv", out.display()));
        end_and_look(demo, nodes, &run, end, || !diagnoses().is_empty());
        wait_until("the diagnosis ends with the node that it is for", GONE_WITHIN, || diagnoses().is_empty());
        assert!(!out.join("report.html").exists() && !out.join("diagnoses/0001/model.json").exists());
    }
}

/// Whether a bag holds what some tenths of a second at 1 kHz give.
fn is_recording(bench: &Bench, bag: &str) -> bool {
    fs::metadata(bench.path(&format!("{bag}/{bag}_0.mcap"))).is_ok_and(|file| file.len() > 32 << 10)
}

/// A launch of four nodes that record a stream to this bag, and are at work.
fn at_work(bench: &Bench, bag: &str, run: &RunId) -> Started {
    let mut command = abbe(["launch", &recorded_stream_of(bench, bag), "--run", run.as_str()]);
    command.process_group(0);
    let launcher = Started::start(command);
    wait_until("all nodes are at work", PATIENCE, || children(launcher.id()).len() == 4 && is_recording(bench, bag));
    launcher
}

/// The process of a node; none while it is not running.
fn process_of(launcher: &Started, node: &str) -> Option<u32> {
    let words = format!("node {node} ");
    let found = children(launcher.id()).into_iter().find(|(id, line)| line.contains(&words) && is_running(*id));
    found.map(|(id, _)| id)
}

/// What each node said at its end.
fn summaries(output: &str) -> BTreeMap<String, NodeSummary> {
    let summaries = output.lines().map(|line| serde_json::from_str::<NodeSummary>(line).unwrap());
    summaries.map(|summary| (summary.node.clone(), summary)).collect()
}

#[test]
fn regress_a_source_that_is_killed_or_terminated_ends_the_launch_with_its_name() {
    let bench = Bench::identified(5);
    long_recording(&bench, 60_000);
    for (by, told) in [(Signal::KILL, "signal: 9"), (Signal::TERM, "exit status: 0")] {
        let run = RunId::unique();
        let launcher = at_work(&bench, &format!("without_source_{}", by.as_raw()), &run);
        let processes = children(launcher.id());
        signal(process_of(&launcher, "scale").unwrap(), by);
        let said = launcher.finish().refused();
        assert_says(&said, &["node scale ended with", told, "not started again"]);
        assert!(processes.iter().all(|(id, _)| !is_running(*id)), "a node outlived the launcher");
        assert_eq!(files_of_run(run.as_str()), Vec::<String>::new());
    }
}

#[test]
fn regress_a_correcting_node_that_ends_unasked_starts_again_and_what_was_missed_is_counted() {
    const COUNT: u64 = 6000;
    let bench = Bench::identified(5);
    long_recording(&bench, COUNT);
    let file = stream_of(&bench, |launch| launch.edge("residual", "user", MEMORY));
    let run = RunId::unique();
    let mut launcher = Started::start(abbe(["launch", &file, "--run", run.as_str()]));
    let mut subscriber = user::<CorrectedCoordinates>(&run, "corrected");
    let faults =
        [(1000, "geometric", Signal::KILL), (2500, "residual", Signal::TERM), (4000, "residual", Signal::KILL)];
    let mut faults = faults.into_iter().peekable();
    let (mut received, mut ended) = (Vec::new(), BTreeSet::new());
    while received.last() != Some(&(COUNT - 1)) {
        let sample = subscriber.take_within(PATIENCE).unwrap().expect("correction did not go on");
        received.push(sample.sequence);
        // One that was asked to end may still be giving what it took.
        let living = |node| process_of(&launcher, node).filter(|id| !ended.contains(id));
        if let Some((_, node, by)) =
            faults.next_if(|(after, node, _)| sample.sequence >= *after && living(node).is_some())
        {
            let id = process_of(&launcher, node).unwrap();
            signal(id, by);
            ended.insert(id);
        }
    }
    assert!(faults.peek().is_none(), "not every fault came");
    assert!(received.is_sorted() && received.windows(2).all(|two| two[0] != two[1]), "a sample came twice");
    assert!(launcher.is_running());
    drop(subscriber);
    let ran = launcher.finish();
    assert_says(&ran.errors, &["geometric", "residual", "it is started again"]);
    let nodes = summaries(&ran.ok());
    assert_eq!([&nodes["geometric"], &nodes["residual"]].map(|node| node.figures["restarts"]), [1.0, 2.0]);
    let missed = COUNT - received.len() as u64;
    // Of the two that residual's first end missed, its third life knows nothing: each life tells of the gap before it.
    let first_gap = gap_after(&received, 1000);
    let last_gap = gap_after(&received, 4000);
    println!("{missed} of {COUNT} missed, {first_gap} by geometric, {last_gap} by the last residual");
    let told = [(nodes["geometric"].lost, first_gap), (nodes["residual"].lost, last_gap)];
    for (lost, gap) in told {
        // The sample that a node is killed with counts as lost, whether or not its answer went out.
        assert!(gap > 0 && (gap..=gap + 1).contains(&lost), "{lost} told, {gap} missed");
    }
    assert_eq!(files_of_run(run.as_str()), Vec::<String>::new());
}

#[test]
fn regress_what_a_crashed_run_of_an_automatic_name_left_goes_with_the_next_launch_and_living_runs_stay() {
    let bench = Bench::identified(5);
    long_recording(&bench, 60_000);
    let start = |bag: &str| {
        let launcher = Started::start(abbe(["launch", &recorded_stream_of(&bench, bag)]));
        wait_until("all nodes run", PATIENCE, || children(launcher.id()).len() == 4);
        let run = format!("{:x}-", launcher.id());
        wait_until("it has files", PATIENCE, || files_of_run(&run).len() > 10);
        (launcher, run)
    };
    let (crashed, crashed_run) = start("crashed");
    // All at once, as when the machine does.
    let processes: Vec<u32> = children(crashed.id()).into_iter().map(|(id, _)| id).chain([crashed.id()]).collect();
    processes.iter().for_each(|id| signal(*id, Signal::STOP));
    processes.iter().for_each(|id| signal(*id, Signal::KILL));
    assert_eq!(crashed.finish().code, None);
    wait_until("all have ended", PATIENCE, || processes.iter().all(|id| !is_running(*id)));
    let left = files_of_run(&crashed_run);
    assert!(left.len() > 10, "the crash left nothing: the test tests nothing");
    let (living, living_run) = start("living");
    assert_eq!(files_of_run(&crashed_run), Vec::<String>::new());
    let (second, second_run) = start("second");
    assert!(files_of_run(&living_run).len() > 10, "a living run lost its files");
    for (launcher, run) in [(second, second_run), (living, living_run)] {
        signal(launcher.id(), Signal::INT);
        launcher.finish().ok();
        assert_eq!(files_of_run(&run), Vec::<String>::new());
    }
}

#[test]
fn regress_what_a_crashed_run_of_a_given_name_left_goes_when_the_next_of_that_name_starts() {
    let bench = Bench::identified(5);
    long_recording(&bench, 60_000);
    // Names of this test alone, as a person would give them.
    let names = ["line-7", "line-8"].map(|name| format!("{name}-{:x}", std::process::id()));
    let runs = names.map(|name| name.parse::<RunId>().unwrap());
    assert!(runs.iter().all(|run| run.chosen_by().is_none()), "{runs:?}");
    let [crashed, living] = &runs;
    let first = at_work(&bench, "crashed", crashed);
    let other = at_work(&bench, "living", living);
    let of_other = files_of_run(living.as_str()).len();
    let processes: Vec<u32> = children(first.id()).into_iter().map(|(id, _)| id).chain([first.id()]).collect();
    processes.iter().for_each(|id| signal(*id, Signal::STOP));
    processes.iter().for_each(|id| signal(*id, Signal::KILL));
    assert_eq!(first.finish().code, None);
    wait_until("all have ended", PATIENCE, || processes.iter().all(|id| !is_running(*id)));
    let left = files_of_run(crashed.as_str());
    assert!(left.len() > 10, "the crash left nothing: the test tests nothing");
    let identity = |path: &String| {
        let file = fs::metadata(path).ok()?;
        Some((path.clone(), file.ino(), file.created().ok(), file.is_dir()))
    };
    let left: BTreeSet<_> = left.iter().filter_map(identity).collect();
    let next = at_work(&bench, "next", crashed);
    let now: BTreeSet<_> = files_of_run(crashed.as_str()).iter().filter_map(identity).collect();
    let stayed: Vec<_> = now.intersection(&left).collect();
    assert!(stayed.is_empty(), "{} of {} files of the crash are still there: {stayed:?}", stayed.len(), left.len());
    assert_eq!(files_of_run(living.as_str()).len(), of_other, "a living run lost its files");
    for (launcher, run) in [(next, crashed), (other, living)] {
        signal(launcher.id(), Signal::INT);
        launcher.finish().ok();
        assert_eq!(files_of_run(run.as_str()), Vec::<String>::new());
    }
}

#[test]
fn a_service_manager_hears_that_the_chain_is_ready_and_alive_and_nothing_while_a_node_hangs() {
    let bench = Bench::identified(5);
    long_recording(&bench, 60_000);
    let file = recorded_stream_of(&bench, "watched");
    let socket = std::os::unix::net::UnixDatagram::bind(bench.path("notify")).unwrap();
    socket.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
    let mut command = abbe(["launch", &file]);
    command.env("NOTIFY_SOCKET", bench.path("notify")).env("WATCHDOG_USEC", "400000");
    let launcher = Started::start(command);
    let heard_within = |time: Duration| {
        let (since, mut heard, mut bytes) = (Instant::now(), String::new(), [0; 512]);
        while since.elapsed() < time {
            if let Ok(length) = socket.recv(&mut bytes) {
                heard += &String::from_utf8_lossy(&bytes[..length]);
                heard.push('\n');
            }
        }
        heard
    };
    let mut heard = String::new();
    wait_until("the chain is ready", PATIENCE, || {
        heard += &heard_within(Duration::from_millis(200));
        heard.contains("READY=1")
    });
    assert_says(&heard_within(Duration::from_secs(2)), &["WATCHDOG=1"]);
    let geometric = process_of(&launcher, "geometric").unwrap();
    signal(geometric, Signal::STOP);
    wait_until("the chain is taken for ill", PATIENCE, || {
        heard_within(Duration::from_millis(200)).contains("STATUS=a node of the correcting chain")
    });
    let silence = heard_within(Duration::from_secs(1));
    assert!(!silence.contains("WATCHDOG=1"), "{silence}");
    signal(geometric, Signal::CONT);
    wait_until("the chain is well again", PATIENCE, || heard_within(Duration::from_millis(200)).contains("WATCHDOG=1"));
    signal(launcher.id(), Signal::INT);
    let since = Instant::now();
    let ran = launcher.finish();
    println!("stopped after {:?}", since.elapsed());
    assert_says(&heard_within(Duration::from_millis(200)), &["STOPPING=1"]);
    assert_says(&ran.errors, &["it hangs, or is stopped"]);
    ran.ok();
}

#[test]
fn the_shipped_unit_is_one_and_says_what_the_launcher_does() {
    let unit = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config/systemd/abbe@.service");
    let text = fs::read_to_string(&unit).unwrap();
    let says = ["Type=notify", "Restart=", "MemoryMax=", "WatchdogSec=", "KillMode=mixed", "OOMPolicy=continue"];
    assert_says(&text, &says);
    // The command line of the unit is one that the program takes.
    let line = text.lines().find_map(|line| line.strip_prefix("ExecStart=/usr/local/bin/abbe ")).unwrap();
    let words = line.replace("/etc/abbe/%i.toml", "no_such_file.toml").replace("%i", "line-1");
    assert_says(&run(words.split_whitespace()).refused(), &["no_such_file.toml", "check the path"]);
    // Its limit on stopping is beyond what the launcher takes for the six nodes of a graph that will not stop.
    assert!(text.contains("TimeoutStopSec=45"));
    let copy = tempfile::tempdir().unwrap();
    let here = copy.path().join("abbe@line-1.service");
    let program = env!("CARGO_BIN_EXE_abbe");
    fs::write(&here, text.replace("/usr/local/bin/abbe", program).replace("User=abbe", "User=root")).unwrap();
    match std::process::Command::new("systemd-analyze").args(["verify", "--man=no"]).arg(&here).output() {
        Ok(verified) => {
            let said = String::from_utf8_lossy(&verified.stderr).into_owned();
            let of_unit: Vec<&str> = said.lines().filter(|line| line.contains("abbe@")).collect();
            assert!(of_unit.is_empty(), "{said}");
        }
        Err(_) => eprintln!("systemd-analyze is not installed: the unit was not verified"),
    }
}

/// Samples missing in the first gap from this sequence on.
fn gap_after(received: &[u64], sequence: u64) -> u64 {
    let mut pairs = received.windows(2).filter(|two| two[0] >= sequence && two[1] != two[0] + 1);
    pairs.next().map_or(0, |two| two[1] - two[0] - 1)
}

#[test]
fn regress_correction_goes_on_without_a_recorder_that_keeps_ending_and_the_launch_says_so() {
    const COUNT: u64 = 12_000;
    let bench = Bench::identified(5);
    long_recording(&bench, COUNT);
    let file = stream_of(&bench, |launch| {
        let launch = launch.nodes(&["recorder"]).edge("residual", "recorder", MEMORY).record("recorded");
        launch.edge("residual", "user", MEMORY)
    });
    let run = RunId::unique();
    let launcher = Started::start(abbe(["launch", &file, "--run", run.as_str()]));
    let mut subscriber = user::<CorrectedCoordinates>(&run, "corrected");
    let flows = AtomicBool::new(false);
    thread::scope(|scope| {
        let taking = scope.spawn(|| {
            for sequence in 0..COUNT {
                flows.store(sequence > 0, Ordering::Relaxed);
                let sample = subscriber.take_within(PATIENCE).unwrap().expect("the stream ended");
                assert_eq!(sample.sequence, sequence, "a recorder that ends cost a sample");
            }
        });
        let mut ended = BTreeSet::new();
        while !taking.is_finished() {
            match process_of(&launcher, "recorder") {
                Some(id) if flows.load(Ordering::Relaxed) && ended.insert(id) => signal(id, Signal::KILL),
                _ => thread::sleep(Duration::from_millis(20)),
            }
        }
        taking.join().unwrap();
        println!("{} recorders were ended", ended.len());
        assert!((2..=5).contains(&ended.len()));
    });
    drop(subscriber);
    let said = launcher.finish().refused();
    assert_says(&said, &["node recorder was given up", "the others go on without it", "did not run well"]);
    assert_eq!(files_of_run(run.as_str()), Vec::<String>::new());
}

#[test]
fn regress_an_interrupt_from_the_terminal_loses_no_answer_that_was_under_way() {
    let bench = Bench::identified(5);
    long_recording(&bench, 60_000);
    let run = RunId::unique();
    let launcher = at_work(&bench, "interrupted", &run);
    signal_group(launcher.id(), Signal::INT);
    let nodes = summaries(&launcher.finish().ok());
    let sent = nodes["scale"].sent;
    assert!(sent > 0 && !nodes["scale"].recording_ended);
    let taken = ["geometric", "residual", "recorder"].map(|node| (nodes[node].received, nodes[node].lost));
    assert_eq!(taken, [(sent, 0); 3], "of {sent} sent");
}

#[test]
fn regress_a_launch_that_crashed_starts_again_and_records_beside_what_there_is() {
    let bench = Bench::identified(5);
    long_recording(&bench, 60_000);
    let run = RunId::unique();
    let crashed = at_work(&bench, "line", &run);
    let nodes: Vec<u32> = children(crashed.id()).into_iter().map(|(id, _)| id).collect();
    signal(crashed.id(), Signal::KILL);
    assert_eq!(crashed.finish().code, None);
    wait_until("its nodes end", PATIENCE, || nodes.iter().all(|id| !is_running(*id)));
    let recorded = || fs::read(bench.path("line/line_0.mcap")).unwrap();
    let before = recorded();
    // As the unit of systemd does: the same words once more.
    let again = Started::start(abbe(["launch", &recorded_stream_of(&bench, "line"), "--run", run.as_str()]));
    wait_until("it records", PATIENCE, || is_recording(&bench, "line-2"));
    signal(again.id(), Signal::INT);
    let said = again.finish();
    assert_says(&said.errors, &["line exists already and stays; recording to", "line-2"]);
    said.ok();
    assert!(recorded() == before, "what was recorded before is touched");
}

#[test]
fn a_node_that_cannot_start_ends_the_launch_with_its_own_words() {
    let bench = Bench::identified(5);
    let launch = LaunchText::default()
        .nodes(&["scale", "geometric"])
        .edge("scale", "geometric", MEMORY)
        .edge("geometric", "user", MEMORY)
        .source("scale", "no_such_file.csv", None, 1000.0);
    let run_name = RunId::unique();
    let said = run(["launch", &launch.write(&bench), "--run", run_name.as_str()]).refused();
    assert_says(&said, &["node scale ended with", "no_such_file.csv", "cannot open"]);
    assert_eq!(files_of_run(run_name.as_str()), Vec::<String>::new());
}

#[test]
fn regress_a_second_sigterm_within_milliseconds_kills_no_node() {
    let bench = Bench::identified(5);
    long_recording(&bench, 60_000);
    let run = RunId::unique();
    let launcher = at_work(&bench, "terminated", &run);
    // As `timeout` of GNU does: its child, and then the group of both.
    for _ in 0..2 {
        signal(launcher.id(), Signal::TERM);
        thread::sleep(Duration::from_millis(5));
    }
    let nodes = summaries(&launcher.finish().ok());
    assert_eq!(nodes["recorder"].received, nodes["scale"].sent, "a node was ended before it had taken all");
    assert_eq!(files_of_run(run.as_str()), Vec::<String>::new());
}

#[test]
fn a_launch_that_is_interrupted_while_it_starts_leaves_no_process_and_no_file() {
    let bench = Bench::identified(5);
    long_recording(&bench, 60_000);
    for after_ms in [2, 5, 10, 15, 20, 30, 40, 60, 80, 120, 200, 300] {
        let file = recorded_stream_of(&bench, &format!("after_{after_ms}"));
        let run = RunId::unique();
        let mut command = abbe(["launch", &file, "--run", run.as_str()]);
        command.process_group(0);
        let launcher = Started::start(command);
        thread::sleep(Duration::from_millis(after_ms));
        // As Ctrl-C does; before the launcher handles signals, it just ends.
        signal_group(launcher.id(), Signal::INT);
        let ran = launcher.finish();
        assert!(matches!(ran.code, Some(0) | None), "after {after_ms} ms: {ran:?}");
        assert_eq!(processes_with(run.as_str()), Vec::<u32>::new(), "after {after_ms} ms");
        assert_eq!(files_of_run(run.as_str()), Vec::<String>::new(), "after {after_ms} ms");
    }
    let partial = fs::read_dir(bench.path("")).unwrap().map(|entry| entry.unwrap().path());
    assert!(partial.into_iter().all(|path| !text(&path).contains(".abbe-")), "temporary files are left");
}
