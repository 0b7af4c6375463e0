//! Another process: the test program itself, in another role.
//!
//! A test starts itself again with `ABBE_TEST_ROLE` set; the same test function then plays that
//! role instead of the test.

use std::env;
use std::process::{Child, Command, Stdio};

/// Variable that names the role of a process.
pub(crate) const ROLE: &str = "ABBE_TEST_ROLE";

/// The role this process plays; none for the test itself.
pub(crate) fn role() -> Option<String> {
    env::var(ROLE).ok()
}

/// A process in another role, killed (-9) at the end if it still runs.
pub(crate) struct Peer(pub(crate) Child);

impl Peer {
    /// Starts the test program again for `test` as `role`, with its output where the test's is.
    pub(crate) fn start(test: &str, role: &str) -> Self {
        Self::start_with(test, role, ROLE, role)
    }

    /// As [`Peer::start`], with one more environment variable.
    pub(crate) fn start_with(test: &str, role: &str, variable: &str, value: &str) -> Self {
        let child = Command::new(env::current_exe().unwrap())
            .args([test, "--exact", "--nocapture", "--test-threads=1"])
            .env(ROLE, role)
            .env(variable, value)
            .stdin(Stdio::null())
            .spawn()
            .unwrap();
        Self(child)
    }

    /// kill -9.
    pub(crate) fn kill(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
