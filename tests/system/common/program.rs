//! The `abbe` command as a process: run to its end within a time limit, or started, watched and ended.

use std::ffi::OsStr;
use std::fs;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use abbe_runtime::ros::Domain;
use rustix::process::{Pid, Signal, kill_process, kill_process_group};

/// Far beyond what any command here takes; only a test that fails waits for it.
const LIMIT: Duration = Duration::from_secs(240);

/// How a command ended, and what it said.
#[derive(Debug)]
pub(crate) struct Ran {
    /// None where a signal ended it.
    pub(crate) code: Option<i32>,
    pub(crate) output: Vec<u8>,
    pub(crate) errors: String,
}

impl Ran {
    /// The standard output as text, if the command succeeded.
    #[track_caller]
    pub(crate) fn ok(self) -> String {
        assert_eq!(self.code, Some(0), "failed: {}", self.errors);
        String::from_utf8(self.output).unwrap()
    }

    /// What it complained about, if the command failed with exit code 1.
    #[track_caller]
    pub(crate) fn refused(self) -> String {
        self.ended(1)
    }

    /// What it said on standard error, if the command ended with this exit code.
    #[track_caller]
    pub(crate) fn ended(self, code: i32) -> String {
        assert_eq!(self.code, Some(code), "exit code; it said: {}", self.errors);
        self.errors
    }
}

/// The program of this build. Tests of the program that trains find it beside that one.
pub(crate) fn program() -> PathBuf {
    let program = match (option_env!("CARGO_BIN_EXE_abbe"), option_env!("CARGO_BIN_EXE_abbe-train")) {
        (Some(own), _) => return PathBuf::from(own),
        (None, Some(other)) => Path::new(other).with_file_name("abbe"),
        (None, None) => panic!("these tests are of one of the two programs"),
    };
    let how = "is not built: `cargo test --workspace` does it, or `cargo build` with the settings of the tests";
    assert!(program.is_file(), "{} {how}", program.display());
    program
}

/// The command of this build, with these arguments, on loopback only whatever the environment says.
pub(crate) fn abbe<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Command {
    let mut command = Command::new(program());
    command.args(arguments);
    command.env_remove("RUST_LOG").env_remove("ROS_LOCALHOST_ONLY").env_remove("ROS_DOMAIN_ID");
    command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST").stdin(Stdio::null());
    command
}

/// The same in the test's own domain.
pub(crate) fn abbe_in<S: AsRef<OsStr>>(domain: Domain, arguments: impl IntoIterator<Item = S>) -> Command {
    let mut command = abbe(arguments);
    command.env("ROS_DOMAIN_ID", domain.id().to_string());
    command
}

/// Runs `abbe` to its end.
pub(crate) fn run<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Ran {
    Started::start(abbe(arguments)).finish()
}

/// Runs `abbe` to its end with this standard input.
pub(crate) fn run_with_input<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>, input: &[u8]) -> Ran {
    let mut command = abbe(arguments);
    command.stdin(Stdio::piped());
    let mut started = Started::start(command);
    let mut pipe = started.child.stdin.take().unwrap();
    thread::scope(|scope| {
        // A command that refuses its input leaves before it has read everything.
        scope.spawn(move || pipe.write_all(input));
        started.finish()
    })
}

/// A process whose output is collected while it runs; killed (-9) at the end if it still runs.
pub(crate) struct Started {
    pub(crate) child: Child,
    output: Option<thread::JoinHandle<Vec<u8>>>,
    errors: Option<thread::JoinHandle<Vec<u8>>>,
}

impl Started {
    pub(crate) fn start(mut command: Command) -> Started {
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let output = child.stdout.take().map(collect);
        let errors = child.stderr.take().map(collect);
        Started { child, output, errors }
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    pub(crate) fn is_running(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }

    /// Waits for the end.
    #[track_caller]
    pub(crate) fn finish(self) -> Ran {
        self.finish_within(LIMIT)
    }

    /// The same for what takes longer than other commands.
    #[track_caller]
    pub(crate) fn finish_within(mut self, limit: Duration) -> Ran {
        let deadline = Instant::now() + limit;
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            assert!(Instant::now() < deadline, "the command did not end within {limit:?}");
            thread::sleep(Duration::from_millis(5));
        };
        let text = |thread: Option<thread::JoinHandle<Vec<u8>>>| thread.unwrap().join().unwrap();
        let errors = String::from_utf8_lossy(&text(self.errors.take())).into_owned();
        Ran { code: status.code(), output: text(self.output.take()), errors }
    }
}

impl Drop for Started {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn collect(mut stream: impl Read + Send + 'static) -> thread::JoinHandle<Vec<u8>> {
    thread::spawn(move || {
        let mut bytes = Vec::new();
        stream.read_to_end(&mut bytes).unwrap();
        bytes
    })
}

/// Sends a signal to one process.
pub(crate) fn signal(process_id: u32, signal: Signal) {
    kill_process(pid(process_id), signal).unwrap();
}

/// The same to one that may have ended; whether it had not.
pub(crate) fn try_signal(process_id: u32, signal: Signal) -> bool {
    kill_process(pid(process_id), signal).is_ok()
}

/// Waits until a program handles Ctrl-C: before that it ends without words, or not at all where it was started in the background.
#[track_caller]
pub(crate) fn wait_until_interruptible(process_id: u32) {
    let handled = || {
        let status = fs::read_to_string(format!("/proc/{process_id}/status")).unwrap_or_default();
        let mask = status.lines().find_map(|line| line.strip_prefix("SigCgt:"));
        let bits = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or_default();
        bits >> (Signal::INT.as_raw() - 1) & 1 == 1
    };
    wait_until("the program handles Ctrl-C", Duration::from_secs(120), handled);
}

/// Sends a signal to a process and its children, as a terminal does.
pub(crate) fn signal_group(process_id: u32, signal: Signal) {
    kill_process_group(pid(process_id), signal).unwrap();
}

fn pid(process_id: u32) -> Pid {
    Pid::from_raw(i32::try_from(process_id).unwrap()).unwrap()
}

fn processes() -> impl Iterator<Item = u32> {
    fs::read_dir("/proc").unwrap().filter_map(|entry| entry.unwrap().file_name().to_str()?.parse().ok())
}

fn command_line(process_id: u32) -> String {
    let words = fs::read(format!("/proc/{process_id}/cmdline")).unwrap_or_default();
    String::from_utf8_lossy(&words).replace('\0', " ")
}

/// Children of a process, as (process id, command line).
pub(crate) fn children(parent: u32) -> Vec<(u32, String)> {
    let of_parent = processes().filter(|id| stat(*id).is_some_and(|(_, its_parent)| its_parent == parent));
    of_parent.map(|id| (id, command_line(id))).collect()
}

/// The gateway to DDS of a node; none while it has none.
pub(crate) fn gateway_of(node: u32) -> Option<u32> {
    let found = children(node).into_iter().find(|(id, line)| line.contains(" gateway ") && is_running(*id));
    found.map(|(id, _)| id)
}

/// Ports of IPv4 at which a process takes UDP packets.
pub(crate) fn udp_ports(process_id: u32) -> Vec<u16> {
    let sockets = fs::read_dir(format!("/proc/{process_id}/fd")).map(|entries| {
        let targets = entries.filter_map(|entry| fs::read_link(entry.ok()?.path()).ok());
        targets.map(|target| target.display().to_string()).collect::<Vec<_>>()
    });
    let sockets = sockets.unwrap_or_default();
    let table = fs::read_to_string(format!("/proc/{process_id}/net/udp")).unwrap_or_default();
    let lines = table.lines().skip(1).map(|line| line.split_whitespace().collect::<Vec<_>>());
    let ours = lines.filter(|fields| sockets.contains(&format!("socket:[{}]", fields[9])));
    ours.filter_map(|fields| u16::from_str_radix(fields[1].split(':').nth(1)?, 16).ok()).collect()
}

/// Living processes with this word on their command line.
pub(crate) fn processes_with(word: &str) -> Vec<u32> {
    processes().filter(|id| is_running(*id) && command_line(*id).contains(word)).collect()
}

/// Whether a process lives; one that has ended but was not waited for does not.
pub(crate) fn is_running(process_id: u32) -> bool {
    stat(process_id).is_some_and(|(state, _)| state != "Z" && state != "X")
}

/// State and parent of a process.
fn stat(process_id: u32) -> Option<(String, u32)> {
    let text = fs::read_to_string(format!("/proc/{process_id}/stat")).ok()?;
    let mut fields = text.rsplit_once(')')?.1.split_whitespace();
    let state = fields.next()?.to_owned();
    Some((state, fields.next()?.parse().ok()?))
}

/// Waits until a condition holds; fails the test when it does not within `limit`.
#[track_caller]
pub(crate) fn wait_until(what: &str, limit: Duration, mut holds: impl FnMut() -> bool) {
    let deadline = Instant::now() + limit;
    while !holds() {
        assert!(Instant::now() < deadline, "not within {limit:?}: {what}");
        thread::sleep(Duration::from_millis(10));
    }
}
