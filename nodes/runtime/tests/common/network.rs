//! A network of the test's own, so that DDS traffic of tests meets nobody.
//!
//! The test program starts itself again for the one test, in a new network namespace with nothing
//! but loopback. Where namespaces are not allowed, the test runs on loopback in a domain chosen at
//! random, and says so.

use std::env;
use std::process::{Command, Stdio};
use std::time::{SystemTime, UNIX_EPOCH};

use abbe_runtime::ros::{DiscoveryRange, Domain};

const INSIDE: &str = "ABBE_TEST_OWN_NETWORK";
/// The domain of the test that started this process, if one did.
pub(crate) const DOMAIN: &str = "ABBE_TEST_DOMAIN";
const SETUP: &str = "ip link set lo up && ip link set lo multicast on && \
                     ip route add 239.0.0.0/8 dev lo";

/// Runs `body` with a domain that is this test's own. `test` is the full name of the test.
pub(crate) fn in_own_network(test: &str, body: impl FnOnce(Domain)) {
    if let Ok(id) = env::var(DOMAIN) {
        return body(domain(id.parse().unwrap()));
    }
    if is_in_own_network() {
        return body(domain(0));
    }
    let arguments = [test, "--exact", "--nocapture", "--test-threads=1"];
    let Some(mut again) = this_program_in_own_network(&arguments) else {
        let id = random_domain();
        eprintln!("no network namespace to be had; {test} runs on loopback in domain {id}");
        return body(domain(id));
    };
    let output = again.output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    println!("{text}");
    assert!(output.status.success(), "{test} failed in its own network");
    assert!(text.contains("1 passed"), "there is no test called {test}");
}

/// This program with other arguments, in a network of its own; none where that is not allowed.
pub(crate) fn this_program_in_own_network(arguments: &[&str]) -> Option<Command> {
    let unshare = unshare()?;
    let mut command = Command::new(unshare[0]);
    command
        .args(&unshare[1..])
        .args(["sh", "-c", &format!("{SETUP} && exec \"$0\" \"$@\"")])
        .arg(env::current_exe().unwrap())
        .args(arguments)
        .env(INSIDE, "1");
    Some(command)
}

/// Whether this process was started by [`this_program_in_own_network`].
pub(crate) fn is_in_own_network() -> bool {
    env::var_os(INSIDE).is_some()
}

fn domain(id: u16) -> Domain {
    Domain::new(id, DiscoveryRange::Localhost).unwrap()
}

/// The command that makes a network namespace here, as root or as a user.
fn unshare() -> Option<&'static [&'static str]> {
    let ways: [&[&str]; 2] = [&["unshare", "-n"], &["unshare", "-rn"]];
    ways.into_iter().find(|way| {
        let tried = Command::new(way[0])
            .args(&way[1..])
            .args(["sh", "-c", SETUP])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
        tried.is_ok_and(|status| status.success())
    })
}

/// Domains above 0 whose ports stay out of the ephemeral range.
fn random_domain() -> u16 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    let mixed = since.subsec_nanos() ^ std::process::id();
    1 + u16::try_from(mixed % 100).unwrap()
}
