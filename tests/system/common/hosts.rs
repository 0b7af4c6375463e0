//! Hosts of a test's own behind a router that passes no multicast: network namespaces, each joined by one cable to the one
//! of the test, which routes between them.

use std::ffi::OsStr;
use std::fs;
use std::net::Ipv4Addr;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// Longest that the system takes for a new namespace.
const PATIENCE: Duration = Duration::from_secs(20);

/// A host; it goes when this is dropped.
pub(crate) struct Host {
    holder: Child,
    address: Ipv4Addr,
}

/// `count` hosts; the test has to be in a network of its own.
pub(crate) fn hosts(count: u8) -> Vec<Host> {
    fs::write("/proc/sys/net/ipv4/ip_forward", "1").unwrap();
    (1..=count).map(Host::new).collect()
}

impl Host {
    fn new(number: u8) -> Host {
        let mut holder = Command::new("unshare");
        holder.args(["-n", "sleep", "infinity"]).stdin(Stdio::null()).stdout(Stdio::null());
        let host = Host { holder: holder.spawn().unwrap(), address: Ipv4Addr::new(10, 77, number, 2) };
        let (process, deadline) = (host.holder.id(), Instant::now() + PATIENCE);
        let network = |process: &str| fs::read_link(format!("/proc/{process}/ns/net")).ok();
        while network(&process.to_string()) == network("self") {
            assert!(Instant::now() < deadline, "no network of its own");
            thread::sleep(Duration::from_millis(2));
        }
        sh(&format!(
            "ip link add to{number} type veth peer name cable netns {process} && ip link set to{number} up && \
             ip address add 10.77.{number}.1/24 dev to{number}"
        ));
        let mut inside = host.runs("sh");
        inside.args([
            "-c",
            &format!(
                "ip link set lo up && ip link set cable up && ip address add {}/24 dev cable && \
                 ip route add default via 10.77.{number}.1",
                host.address
            ),
        ]);
        assert!(inside.status().unwrap().success());
        host
    }

    /// Its network says that it knows no multicast, as it should where none goes anywhere.
    pub(crate) fn knows_no_multicast(&self) {
        let mut inside = self.runs("ip");
        assert!(inside.args(["link", "set", "cable", "multicast", "off"]).status().unwrap().success());
    }

    /// Where the others find it.
    pub(crate) fn address(&self) -> String {
        self.address.to_string()
    }

    /// A program that runs there.
    pub(crate) fn runs(&self, program: impl AsRef<OsStr>) -> Command {
        let mut command = Command::new("nsenter");
        command.args(["-t", &self.holder.id().to_string(), "-n", "--"]).arg(program).stdin(Stdio::null());
        command
    }

    /// The same command, there, with DDS as far as multicast goes and to these peers.
    pub(crate) fn runs_with_peers(&self, command: &Command, peers: &str) -> Command {
        let mut there = self.runs(command.get_program());
        there.args(command.get_args());
        for (name, value) in command.get_envs() {
            match value {
                Some(value) => there.env(name, value),
                None => there.env_remove(name),
            };
        }
        there.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET").env("ROS_STATIC_PEERS", peers);
        there
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        // It may be gone; there is nobody to tell.
        drop(self.holder.kill());
        drop(self.holder.wait());
    }
}

#[track_caller]
fn sh(script: &str) {
    assert!(Command::new("sh").args(["-c", script]).status().unwrap().success(), "{script}");
}
