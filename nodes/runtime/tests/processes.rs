//! A node ends when it is told to, and when its launcher dies, and cleans up behind itself.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

#[path = "common/mod.rs"]
mod common;

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread;
use std::time::{Duration, Instant};

use abbe_runtime::{LAUNCHER_PID, Shutdown, follow_launcher};
use common::peer::{Peer, role};
use common::samples::PATIENCE;

/// Folder in which the processes of a test tell what they did.
const FOLDER: &str = "ABBE_TEST_FOLDER";

fn told(folder: &Path, what: &str) -> PathBuf {
    folder.join(what)
}

fn wait_for(path: &Path) -> String {
    let deadline = Instant::now() + PATIENCE;
    while Instant::now() < deadline {
        match fs::read_to_string(path) {
            Ok(text) if text.ends_with('\n') => return text,
            _ => thread::sleep(Duration::from_millis(5)),
        }
    }
    panic!("{} was not written", path.display());
}

/// A node that runs until it should stop, then says so.
fn play_node(folder: &Path) {
    let shutdown = Shutdown::on_signals().unwrap();
    shutdown.follow_parent(std::os::unix::process::parent_id()).unwrap();
    fs::write(told(folder, "started"), format!("{}\n", std::process::id())).unwrap();
    while !shutdown.sleep(Duration::from_secs(1)) {}
    fs::write(told(folder, "stopped"), "in order\n").unwrap();
}

/// A node with a second thread, which says of each thread which signals it blocks.
fn play_threads(folder: &Path) {
    let _shutdown = Shutdown::on_signals().unwrap();
    let (_keep, wait) = std::sync::mpsc::channel::<()>();
    thread::Builder::new().name("later".into()).spawn(move || wait.recv()).unwrap();
    // A thread gets its name and its mask after it was made.
    let deadline = Instant::now() + PATIENCE;
    let mut blocked = blocked_by_threads();
    while !["signals\n", "later\n"].iter().all(|name| blocked.contains(name)) && Instant::now() < deadline {
        thread::sleep(Duration::from_millis(1));
        blocked = blocked_by_threads();
    }
    fs::write(told(folder, "blocked"), blocked).unwrap();
}

/// Mask of blocked signals and name of each thread of this process, a line each.
fn blocked_by_threads() -> String {
    let of = |thread: std::io::Result<fs::DirEntry>| {
        let status = fs::read_to_string(thread.unwrap().path().join("status")).unwrap();
        let field = |name: &str| status.lines().find_map(|line| line.strip_prefix(name)).unwrap().trim().to_owned();
        format!("{} {}\n", field("SigBlk:"), field("Name:"))
    };
    fs::read_dir("/proc/self/task").unwrap().map(of).collect()
}

/// A node whose loop does not look at the flag.
fn play_stuck_node(folder: &Path) {
    let shutdown = Shutdown::on_signals().unwrap();
    shutdown.follow_parent(std::os::unix::process::parent_id()).unwrap();
    fs::write(told(folder, "started"), format!("{}\n", std::process::id())).unwrap();
    thread::sleep(3 * PATIENCE);
}

/// A program for work beside a node's own, which looks at no flag.
fn play_program(folder: &Path) {
    follow_launcher().unwrap();
    fs::write(told(folder, "started"), format!("{}\n", std::process::id())).unwrap();
    thread::sleep(3 * PATIENCE);
}

fn play_launcher_of_program(test: &str) {
    // From now on it hands down blocked signals.
    let _shutdown = Shutdown::on_signals().unwrap();
    let _program = Peer::start_with(test, "program", LAUNCHER_PID, &std::process::id().to_string());
    thread::sleep(PATIENCE);
}

fn play_launcher(test: &str, node: &str) {
    let _node = Peer::start(test, node);
    thread::sleep(PATIENCE);
}

fn is_running(process_id: &str) -> bool {
    // A process that has ended but was not waited for still has its entry, as a zombie.
    let status = fs::read_to_string(format!("/proc/{}/stat", process_id.trim()));
    status.is_ok_and(|status| !status.contains(") Z "))
}

fn wait_for_end(process_id: &str) {
    let deadline = Instant::now() + PATIENCE;
    while is_running(process_id) {
        assert!(Instant::now() < deadline, "process {process_id} still runs");
        thread::sleep(Duration::from_millis(10));
    }
}

/// The role that this process plays in `test`, if it is not the test itself.
fn play(test: &str) -> bool {
    let Some(role) = role() else {
        return false;
    };
    let folder = PathBuf::from(env::var(FOLDER).unwrap());
    match role.as_str() {
        "node" => play_node(&folder),
        "stuck" => play_stuck_node(&folder),
        "threads" => play_threads(&folder),
        "launcher" => play_launcher(test, "node"),
        "program" => play_program(&folder),
        "launcher of program" => play_launcher_of_program(test),
        "launcher of stuck" => play_launcher(test, "stuck"),
        other => panic!("unknown role {other}"),
    }
    true
}

fn start(test: &str, role: &str) -> (Peer, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let peer = Peer::start_with(test, role, FOLDER, folder.path().to_str().unwrap());
    (peer, folder)
}

#[test]
fn regress_only_one_thread_of_a_process_is_interrupted_by_ctrl_c() {
    let test = "regress_only_one_thread_of_a_process_is_interrupted_by_ctrl_c";
    if play(test) {
        return;
    }
    let (_peer, folder) = start(test, "threads");
    let blocked = wait_for(&told(folder.path(), "blocked"));
    let of = |name: &str| {
        let mask =
            blocked.lines().find_map(|line| line.strip_suffix(name)).unwrap_or_else(|| panic!("{name}: {blocked}"));
        u64::from_str_radix(mask.trim(), 16).unwrap()
    };
    // SIGHUP 1, SIGINT 2, SIGTERM 15, where bit 0 is signal 1.
    let ends = 1 | 1 << 1 | 1 << 14;
    assert_eq!(of("signals") & ends, 0, "{blocked}");
    assert_eq!(of("later") & ends, ends, "{blocked}");
    let others = blocked.lines().filter(|line| !line.ends_with("signals"));
    let heard = others.filter(|line| u64::from_str_radix(&line[..16], 16).unwrap() & ends != ends);
    // The test harness starts threads of its own before.
    assert_eq!(heard.filter(|line| line.ends_with(&test[..15])).count(), 0, "{blocked}");
}

#[test]
fn sigterm_and_sigint_stop_a_node_in_order() {
    let test = "sigterm_and_sigint_stop_a_node_in_order";
    if play(test) {
        return;
    }
    for signal in ["-TERM", "-INT", "-HUP"] {
        let (mut node, folder) = start(test, "node");
        let process_id = wait_for(&told(folder.path(), "started"));
        let sent = Command::new("kill").args([signal, process_id.trim()]).status().unwrap();
        assert!(sent.success());
        assert!(node.0.wait().unwrap().success(), "{signal}");
        assert_eq!(wait_for(&told(folder.path(), "stopped")), "in order\n");
    }
}

#[test]
fn a_node_stops_in_order_when_its_launcher_is_killed() {
    let test = "a_node_stops_in_order_when_its_launcher_is_killed";
    if play(test) {
        return;
    }
    let (mut launcher, folder) = start(test, "launcher");
    let node = wait_for(&told(folder.path(), "started"));
    launcher.kill();
    assert_eq!(wait_for(&told(folder.path(), "stopped")), "in order\n");
    wait_for_end(&node);
}

#[test]
fn a_stuck_node_does_not_outlive_its_launcher() {
    let test = "a_stuck_node_does_not_outlive_its_launcher";
    if play(test) {
        return;
    }
    let (mut launcher, folder) = start(test, "launcher of stuck");
    let node = wait_for(&told(folder.path(), "started"));
    launcher.kill();
    wait_for_end(&node);
}

#[test]
fn a_program_beside_a_node_does_not_outlive_it() {
    let test = "a_program_beside_a_node_does_not_outlive_it";
    if play(test) {
        return;
    }
    let (mut launcher, folder) = start(test, "launcher of program");
    let program = wait_for(&told(folder.path(), "started"));
    launcher.kill();
    wait_for_end(&program);
}

#[test]
fn regress_a_program_beside_a_node_ends_on_sigterm() {
    let test = "regress_a_program_beside_a_node_ends_on_sigterm";
    if play(test) {
        return;
    }
    let (_launcher, folder) = start(test, "launcher of program");
    let program = wait_for(&told(folder.path(), "started"));
    assert!(Command::new("kill").args(["-TERM", program.trim()]).status().unwrap().success());
    wait_for_end(&program);
}
