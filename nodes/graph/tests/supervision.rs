//! What the launcher does with nodes that end, hang or will not stop; nodes here are small programs.

use abbe_graph::launch::NodeName;
use abbe_graph::supervisor::{Given, Stopped, Supervisor, SupervisorError};
use abbe_runtime::{RunId, Shutdown};
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::{Duration, Instant};

const LAUNCH: &str = r#"
namespace = "cmm"
machine = "machine.toml"
nodes = ["geometric"]
max_covariate_age_s = 10.0
wait_for_subscribers_s = 5.0

[[edges]]
from = "scale"
to = "geometric"
transport = "shared-memory"

[[edges]]
from = "geometric"
to = "user"
transport = "shared-memory"
"#;

/// A graph of one node that is this script; `$life` counts its starts from 0, `$all` are its words.
fn start(folder: &Path, script: &str) -> Supervisor {
    start_as(folder, LAUNCH, script)
}

/// The same of the nodes of this launch file.
fn start_as(folder: &Path, launched: &str, script: &str) -> Supervisor {
    let (program, launch) = (folder.join("node"), folder.join("launch.toml"));
    let life = r#"life=0; all="$*"; while [ $# -gt 0 ]; do [ "$1" = --life ] && life=$2; shift; done"#;
    fs::write(&program, format!("#!/bin/sh\n{life}\n{script}\n")).unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    fs::write(&launch, launched).unwrap();
    Supervisor::start(&program, &launch, RunId::unique()).unwrap()
}

#[test]
fn remarks_of_nodes_go_to_the_log_that_is_given() {
    let folder = tempfile::tempdir().unwrap();
    let (program, launch, log) =
        (folder.path().join("node"), folder.path().join("launch.toml"), folder.path().join("nodes.log"));
    let said = "echo '2026-01-01T00:00:00Z  WARN abbe: a remark' >&2; echo 'a panic' >&2";
    fs::write(&program, format!("#!/bin/sh\n{said}\n{WORKS}\n")).unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    fs::write(&launch, LAUNCH).unwrap();
    let given = Given { log: Some(log.clone()), ..Given::default() };
    let mut graph = Supervisor::start_with(&program, &launch, RunId::unique(), given).unwrap();
    let logged = || fs::read_to_string(&log).unwrap();
    look_after(&mut graph, |_| logged().lines().count() == 2).unwrap();
    assert_eq!(logged(), "geometric: 2026-01-01T00:00:00Z  WARN abbe: a remark\ngeometric: a panic\n");
    graph.stop(&Shutdown::manual()).unwrap();
    let nowhere = Given { log: Some(folder.path().join("no/where")), ..Given::default() };
    let refused = Supervisor::start_with(&program, &launch, RunId::unique(), nowhere).err().unwrap();
    assert!(refused.to_string().contains("no/where: the log of the nodes cannot be written"), "{refused}");
}

/// Looks after the graph until it fails or `done` says so.
fn look_after(graph: &mut Supervisor, done: impl Fn(&Supervisor) -> bool) -> Result<(), SupervisorError> {
    let deadline = Instant::now() + Duration::from_secs(20);
    while !done(graph) {
        assert!(Instant::now() < deadline, "it did not come to that");
        graph.check()?;
        std::thread::sleep(Duration::from_millis(5));
    }
    Ok(())
}

const WORKS: &str = "echo ready; echo alive; while :; do sleep 0.05; done";

#[test]
fn a_node_that_ends_without_an_error_starts_again_and_the_graph_is_healthy_again() {
    let folder = tempfile::tempdir().unwrap();
    let mut graph = start(folder.path(), &format!("[ $life = 0 ] && {{ echo ready; exit 0; }}\n{WORKS}"));
    let first = graph.process_ids();
    look_after(&mut graph, |graph| graph.is_healthy() && graph.process_ids() != first).unwrap();
    let Stopped { problems, .. } = graph.stop(&Shutdown::manual()).unwrap();
    assert_eq!(problems, Vec::<String>::new());
}

#[test]
fn regress_a_node_that_is_started_again_is_given_what_it_was_told() {
    let folder = tempfile::tempdir().unwrap();
    let heard = folder.path().join("heard");
    let script = format!(
        "[ $life = 0 ] && {{ echo ready; echo state active; echo 'parameters {{\"model\":\"b.json\"}}'; echo state inactive; kill -9 $$; }}\n\
         [ $life = 1 ] && {{ echo ready; kill -9 $$; }}\n\
         [ $life = 2 ] && {{ echo ready; echo state active; kill -9 $$; }}\n{WORKS}"
    );
    let script = script.replacen("[ $life = 0 ]", &format!("echo \"$all\" >> {}\n[ $life = 0 ]", heard.display()), 1);
    let mut graph = start(folder.path(), &script);
    let lives = || fs::read_to_string(&heard).map_or(0, |words| words.lines().count());
    look_after(&mut graph, |_| lives() == 4).unwrap();
    let words = fs::read_to_string(&heard).unwrap();
    let lives: Vec<&str> = words.lines().collect();
    assert!(!lives[0].contains("--stays") && !lives[0].contains("--changed"), "{}", lives[0]);
    for life in [1, 2] {
        assert!(lives[life].contains("--stays inactive --changed {\"model\":\"b.json\"}"), "{}", lives[life]);
    }
    assert!(!lives[3].contains("--stays") && lives[3].contains("--changed {\"model\""), "{}", lives[3]);
    graph.stop(&Shutdown::manual()).unwrap();
}

#[test]
fn a_correcting_node_that_keeps_ending_ends_the_launch_with_its_words() {
    let folder = tempfile::tempdir().unwrap();
    let mut graph = start(folder.path(), "echo ready; echo 'no light' >&2; kill -9 $$");
    let error = look_after(&mut graph, |_| false).unwrap_err().to_string();
    for words in ["node geometric ended with signal: 9", "no light", "started again and ended again"] {
        assert!(error.contains(words), "{error:?} does not say {words:?}");
    }
}

#[test]
fn regress_a_node_that_fails_or_will_not_stop_is_told_of_at_the_end() {
    for (script, words) in [
        (format!("trap '' TERM\n{WORKS}"), "geometric was ended by the second signal"),
        (format!("trap 'exit 3' TERM\n{WORKS}"), "exit status: 3"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let mut graph = start(folder.path(), &script);
        look_after(&mut graph, Supervisor::is_healthy).unwrap();
        let hurry = Shutdown::manual();
        let again = hurry.clone();
        // As a second Ctrl-C does: what will not stop is not waited for.
        std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(500));
            again.request();
            again.request();
        });
        let since = Instant::now();
        let Stopped { problems, .. } = graph.stop(&hurry).unwrap();
        assert!(since.elapsed() < Duration::from_secs(4), "it was waited for");
        assert!(problems.len() == 1 && problems[0].contains(words), "{problems:?}");
    }
}

#[test]
fn a_graph_with_a_node_that_does_not_run_is_not_healthy() {
    let folder = tempfile::tempdir().unwrap();
    let mut graph = start(folder.path(), "echo ready; [ $life = 0 ] && exit 0; sleep 5");
    look_after(&mut graph, |graph| graph.process_ids().is_empty()).unwrap();
    assert!(!graph.is_healthy());
    assert!(!graph.has_ended(NodeName::Geometric).unwrap());
}

#[test]
fn regress_a_second_ctrl_c_leaves_the_recorder_the_time_to_finish_its_bag() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    let finishes = format!("trap 'sleep 0.7; echo whole > {}; exit 0' TERM", bag.display());
    let script = format!("case $all in *recorder*) {finishes};; *) trap '' TERM;; esac\n{WORKS}");
    let record = format!("nodes = [\"recorder\", \"geometric\"]\nrecord = \"{}\"", folder.path().join("b").display());
    let launch = LAUNCH.replace("nodes = [\"geometric\"]", &record)
        + "\n[[edges]]\nfrom = \"geometric\"\nto = \"recorder\"\ntransport = \"shared-memory\"\n";
    let mut graph = start_as(folder.path(), &launch, &script);
    look_after(&mut graph, Supervisor::is_healthy).unwrap();
    let hurry = Shutdown::manual();
    hurry.request();
    hurry.request();
    let Stopped { problems, .. } = graph.stop(&hurry).unwrap();
    assert!(
        problems.len() == 1 && problems[0].contains("node geometric was ended by the second signal"),
        "{problems:?}"
    );
    assert_eq!(fs::read_to_string(bag).unwrap(), "whole\n");
}
