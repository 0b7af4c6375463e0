//! Evidence for real time: threads that step in are under SCHED_FIFO with locked memory and no others; what is not allowed is
//! refused with what to grant. Each part runs in a process of its own, because memory is locked for all of a process.

#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::panic)] // A test fails by panicking.

use std::fs;
use std::process::Command;
use std::sync::mpsc::channel;
use std::thread;

use abbe_runtime::realtime::{Realtime, RealtimeError, begun, online_cores, step_in};
use rustix::process::{Pid, Resource, Rlimit, setrlimit};
use rustix::thread::{CapabilitySet, capabilities, gettid, sched_getaffinity, set_capabilities};

const INSIDE: &str = "ABBE_TEST_OWN_PROCESS";
const FIFO: u32 = 1;

/// Runs `body` in a process of its own; `test` is the full name of the test.
fn in_own_process(test: &str, body: impl FnOnce()) {
    if std::env::var_os(INSIDE).is_some() {
        return body();
    }
    let mut again = Command::new(std::env::current_exe().unwrap());
    let output = again.args([test, "--exact", "--nocapture", "--test-threads=1"]).env(INSIDE, "1").output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    println!("{text}");
    assert!(output.status.success() && text.contains("1 passed"), "{test} failed in its own process");
}

/// Policy and priority of a thread of this process, as the kernel tells them.
fn scheduling(thread: Pid) -> (u32, u32) {
    let stat = fs::read_to_string(format!("/proc/self/task/{}/stat", thread.as_raw_nonzero())).unwrap();
    let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
    // Fields 41 and 40 of proc_pid_stat(5); the first here is field 3.
    (fields[38].parse().unwrap(), fields[37].parse().unwrap())
}

fn locked_kib() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmLck:")).unwrap();
    line.trim().trim_end_matches("kB").trim().parse().unwrap()
}

/// Whether the system of this test allows it; says aloud where it does not, with the refusal.
fn is_allowed(realtime: &Realtime) -> bool {
    match realtime.try_out() {
        Ok(()) => true,
        Err(error @ (RealtimeError::Priority { .. } | RealtimeError::Memory { .. })) => {
            let words = error.to_string();
            println!("not tried in real time, which this system refuses: {words}");
            assert!(words.contains("limits.d"), "{words}");
            false
        }
        Err(other) => panic!("{other}"),
    }
}

#[test]
fn a_thread_that_steps_in_is_under_fifo_until_its_guard_goes_and_no_other_is() {
    in_own_process("a_thread_that_steps_in_is_under_fifo_until_its_guard_goes_and_no_other_is", || {
        let last = *online_cores().last().unwrap();
        let realtime = Realtime { priority: 42, cores: vec![last], threads: 1 };
        if !is_allowed(&realtime) {
            return;
        }
        assert_eq!(locked_kib(), 0, "trying locks nothing");
        realtime.clone().begin().unwrap();
        assert_eq!(begun(), Some(&realtime));
        assert!(locked_kib() > 1000, "{} KiB", locked_kib());

        let ((tell, told), (go_on, wait)) = (channel(), channel());
        let carries = thread::spawn(move || {
            let before = sched_getaffinity(None).unwrap();
            let inside = step_in().unwrap();
            assert!(inside.is_some());
            tell.send(gettid()).unwrap();
            wait.recv().unwrap();
            drop(inside);
            assert_eq!(scheduling(gettid()), (0, 0), "the guard has gone");
            assert_eq!(sched_getaffinity(None).unwrap(), before);
            // What it starts from now on is as every other.
            thread::spawn(|| assert_eq!(scheduling(gettid()), (0, 0))).join().unwrap();
        });
        let its_id = told.recv().unwrap();
        assert_eq!(scheduling(its_id), (FIFO, 42));
        let cores = sched_getaffinity(Some(its_id)).unwrap();
        assert!(cores.is_set(last) && cores.count() == 1, "{cores:?}");
        for entry in fs::read_dir("/proc/self/task").unwrap() {
            let other = Pid::from_raw(entry.unwrap().file_name().to_str().unwrap().parse().unwrap()).unwrap();
            assert!(other == its_id || scheduling(other).0 != FIFO, "{other:?}");
        }
        go_on.send(()).unwrap();
        carries.join().unwrap();
    });
}

#[test]
fn a_thread_that_never_sleeps_is_made_to_rest() {
    in_own_process("a_thread_that_never_sleeps_is_made_to_rest", || {
        let realtime = Realtime { priority: 1, cores: vec![], threads: 64 };
        if !is_allowed(&realtime) {
            return;
        }
        realtime.begin().unwrap();
        let mut inside = step_in().unwrap().unwrap();
        while abbe_runtime::realtime::rests() < 2 {
            inside.breathe();
        }
    });
}

/// Takes these capabilities from this thread, and lowers the limits.
fn forbid(capability: CapabilitySet, memlock: Option<u64>) {
    let mut sets = capabilities(None).unwrap();
    sets.effective -= capability;
    set_capabilities(None, sets).unwrap();
    setrlimit(Resource::Rtprio, Rlimit { current: Some(0), maximum: Some(0) }).unwrap();
    if memlock.is_some() {
        setrlimit(Resource::Memlock, Rlimit { current: memlock, maximum: memlock }).unwrap();
    }
}

#[test]
fn memory_that_may_not_be_locked_is_refused_with_what_to_grant() {
    in_own_process("memory_that_may_not_be_locked_is_refused_with_what_to_grant", || {
        forbid(CapabilitySet::SYS_NICE | CapabilitySet::IPC_LOCK, Some(64 << 10));
        let realtime = Realtime { priority: 50, cores: vec![], threads: 3 };
        for refused in [realtime.try_out(), realtime.clone().begin()] {
            let words = refused.unwrap_err().to_string();
            for part in
                ["RLIMIT_MEMLOCK is 64 KiB", "CAP_IPC_LOCK", "memlock unlimited", "LimitMEMLOCK=infinity", "setcap"]
            {
                assert!(words.contains(part), "{words} lacks {part}");
            }
        }
        assert!(begun().is_none() && locked_kib() == 0);
    });
}

#[test]
fn a_priority_above_the_limit_is_refused_with_what_to_grant() {
    in_own_process("a_priority_above_the_limit_is_refused_with_what_to_grant", || {
        forbid(CapabilitySet::SYS_NICE, None);
        let realtime = Realtime { priority: 50, cores: vec![], threads: 3 };
        let error = realtime.try_out().unwrap_err();
        if matches!(error, RealtimeError::Memory { .. }) {
            println!("not tried: this user may not lock memory either, which is refused first: {error}");
            return;
        }
        let words = error.to_string();
        for part in ["priority 50", "RLIMIT_RTPRIO is 0", "CAP_SYS_NICE", "rtprio 50", "LimitRTPRIO=50"] {
            assert!(words.contains(part), "{words} lacks {part}");
        }
        assert!(realtime.begin().is_err() && locked_kib() == 0, "what is refused in part is not begun at all");
    });
}
