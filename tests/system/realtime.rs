//! Real time as a user asks for it in a launch file: who gets it, what is told, and what is refused.

use std::fs;
use std::process::Command;
use std::thread;

use abbe_msgs::standard::DiagnosticStatus;
use abbe_msgs::{CorrectedCoordinates, ScaleReading};
use abbe_runtime::RunId;
use abbe_runtime::realtime::{Realtime, online_cores};
use rustix::process::Signal;
use rustix::thread::{CapabilitySet, remove_capability_from_bounding_set};

use crate::common::assert_says;
use crate::common::dds::{Listener, PATIENCE};
use crate::common::files::{Bench, samples};
use crate::common::graph::{DDS, LaunchText, MEMORY, endless_stream_of, recorded_stream_of, topic, user};
use crate::common::network::in_own_network;
use crate::common::program::{Started, abbe, abbe_in, children, gateway_of, signal};

const FIFO: &str = "1";

/// Names of the threads of a process that run under SCHED_FIFO, with their priority.
fn under_fifo(process_id: u32) -> Vec<(String, String)> {
    let of_thread = |entry: std::io::Result<fs::DirEntry>| {
        let stat = fs::read_to_string(entry.unwrap().path().join("stat")).ok()?;
        let (head, rest) = stat.rsplit_once(')').unwrap();
        let fields: Vec<&str> = rest.split_whitespace().collect();
        // Fields 41 (policy) and 40 (priority) of proc_pid_stat(5); the first here is field 3.
        (fields[38] == FIFO).then(|| (head.split_once('(').unwrap().1.to_owned(), fields[37].to_owned()))
    };
    fs::read_dir(format!("/proc/{process_id}/task")).unwrap().filter_map(of_thread).collect()
}

fn locks_memory(process_id: u32) -> bool {
    let status = fs::read_to_string(format!("/proc/{process_id}/status")).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmLck:")).unwrap();
    line.split_whitespace().next().unwrap() != "0"
}

/// Whether this system allows it; says aloud where it does not.
fn is_allowed(realtime: &Realtime) -> bool {
    let refused = realtime.try_out().err();
    if let Some(error) = &refused {
        println!("only the refusal is tried, as this system refuses: {error}");
    }
    refused.is_none()
}

#[test]
fn nodes_on_the_path_run_in_real_time_and_nothing_beside_them_does() {
    let test = "realtime::nodes_on_the_path_run_in_real_time_and_nothing_beside_them_does";
    in_own_network(test, |domain| {
        let core = *online_cores().last().unwrap();
        let bench = Bench::identified(5);
        let file = endless_stream_of(&bench, |launch: LaunchText| {
            launch
                .key(&format!("realtime = {{ priority = 42, cores = [{core}] }}"))
                .nodes(&["recorder"])
                .edge("residual", "recorder", MEMORY)
                .edge("residual", "user", MEMORY)
                .edge("residual", "*", DDS)
                .record("recorded")
        });
        let run = RunId::unique();
        if !is_allowed(&Realtime { priority: 42, cores: vec![core], threads: 3 }) {
            let refused = Started::start(abbe_in(domain, ["launch", &file])).finish().refused();
            assert_says(&refused, &["realtime", "LimitRTPRIO=42"]);
            return;
        }
        let listener = Listener::on_diagnostics(domain);
        let graph = Started::start(abbe_in(domain, ["launch", &file, "--run", run.as_str()]));
        let mut corrected = user::<CorrectedCoordinates>(&run, "corrected");
        assert!(corrected.take_within(PATIENCE).unwrap().is_some(), "samples come");
        let words = format!("fifo 42, locked, cores [{core}]");
        listener.hears("residual: realtime", DiagnosticStatus::OK, &[&words]);

        let mut seen = 0;
        for (id, line) in children(graph.id()) {
            let name = line.split(" node ").nth(1).and_then(|rest| rest.split(' ').next()).unwrap().to_owned();
            let is_on_the_path = ["scale", "geometric", "residual"].contains(&name.as_str());
            let threads = under_fifo(id);
            assert_eq!(threads.len(), usize::from(is_on_the_path), "{name}: {threads:?}");
            assert!(threads.iter().all(|(_, priority)| priority == "42"), "{name}: {threads:?}");
            assert_eq!(locks_memory(id), is_on_the_path, "{name}");
            if let Some(gateway) = gateway_of(id) {
                assert_eq!((under_fifo(gateway).len(), locks_memory(gateway)), (0, false), "the gateway of {name}");
                seen += 1;
            }
            seen += 1;
        }
        assert_eq!((seen, under_fifo(graph.id()).len()), (5, 0), "four nodes and a gateway");

        signal(graph.id(), Signal::INT);
        assert_says(&graph.finish().ok(), &["\"realtime_priority\":42"]);
    });
}

/// Starts a command without the capabilities that real time asks for, and with these limits; as root, too.
fn forbidden(command: &Command) -> Started {
    let mut limited = Command::new("prlimit");
    limited.args(["--rtprio=0", "--memlock=65536"]).arg(command.get_program()).args(command.get_args());
    for (name, value) in command.get_envs() {
        match value {
            Some(value) => limited.env(name, value),
            None => limited.env_remove(name),
        };
    }
    // Of this thread alone, which then ends; who is not root has none to lose.
    let starting = thread::spawn(move || {
        for capability in [CapabilitySet::SYS_NICE, CapabilitySet::IPC_LOCK] {
            let _ = remove_capability_from_bounding_set(capability);
        }
        Started::start(limited)
    });
    starting.join().unwrap()
}

#[test]
fn a_launch_that_may_not_run_in_real_time_is_refused_with_what_to_grant_and_starts_nothing() {
    let bench = Bench::identified(5);
    let plain = recorded_stream_of(&bench, "recorded");
    let text = fs::read_to_string(&plain).unwrap();
    let file = bench.write("realtime.toml", format!("realtime = true\n{text}"));
    let ways = ["limits.d", "LimitRTPRIO=50", "LimitMEMLOCK=infinity", "setcap", "--cap-add=SYS_NICE"];
    let refused = forbidden(&abbe(["launch", &file])).finish().refused();
    assert_says(&refused, &["realtime", "RLIMIT_MEMLOCK is 64 KiB"]);
    assert_says(&refused, &ways);
    assert!(!bench.path("recorded").exists(), "the recorder was started");
    // A node that is started by hand says the same.
    let refused = forbidden(&abbe(["node", "geometric", "--launch", &file])).finish().refused();
    assert_says(&refused, &ways);
}

#[test]
fn what_is_corrected_in_real_time_is_what_is_corrected_without() {
    if !is_allowed(&Realtime { priority: 50, cores: vec![], threads: 3 }) {
        return;
    }
    let bench = Bench::identified(5);
    crate::common::graph::long_recording(&bench, 500);
    let recorded = |key: &str, bag: &str| {
        let plain = recorded_stream_of(&bench, bag);
        let file = bench.write("launch.toml", format!("{key}\n{}", fs::read_to_string(plain).unwrap()));
        crate::common::program::run(["launch", &file]).ok();
        samples::<CorrectedCoordinates>(&bench.path(bag), &topic("corrected"))
    };
    let (without, with) = (recorded("", "without"), recorded("realtime = true", "with"));
    assert_eq!(samples::<ScaleReading>(&bench.path("long"), &topic("scale/reading")).len(), without.len());
    assert_eq!(without, with);
}
