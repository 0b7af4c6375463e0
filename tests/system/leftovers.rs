//! The way out: however a launcher or a node ends, failures are told by name, and no process and no file of the run
//! is left.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod common;

use std::fs;
use std::os::unix::process::CommandExt;
use std::thread;
use std::time::{Duration, Instant};

use abbe_msgs::CorrectedCoordinates;
use abbe_runtime::RunId;
use common::assert_says;
use common::files::{Bench, samples, text};
use common::graph::{LaunchText, MEMORY, files_of_run, long_recording, recorded_stream_of, topic};
use common::program::{Started, abbe, children, is_running, processes_with, run, signal, signal_group, wait_until};
use rustix::process::Signal;

const PATIENCE: Duration = Duration::from_secs(20);
/// How soon everything must have ended.
const GONE_WITHIN: Duration = Duration::from_secs(5);

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
