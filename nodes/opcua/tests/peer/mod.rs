//! A server of OPC UA that is not ours (PyPI `asyncua`), which says what a test tells it to.

#![allow(dead_code)] // Each test takes what it needs.

use std::env;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{SystemTime, UNIX_EPOCH};

/// The process.
pub(crate) struct Peer {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
    /// Its address.
    pub(crate) address: String,
}

impl Peer {
    /// Starts one; `None` where no interpreter is named.
    pub(crate) fn start(port: u16, asked: &str) -> Option<Peer> {
        let Ok(python) = env::var("ABBE_PYTHON") else {
            assert!(
                env::var("ABBE_REQUIRE_PEERS").is_err(),
                "ABBE_REQUIRE_PEERS=1, but ABBE_PYTHON names no interpreter"
            );
            println!("SKIPPED: set ABBE_PYTHON to a Python with asyncua");
            return None;
        };
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../opcua/tests/peer/server.py");
        let mut command = Command::new(python);
        command.arg(script).arg(port.to_string()).arg(asked).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let input = child.stdin.take().unwrap();
        let output = BufReader::new(child.stdout.take().unwrap());
        let mut peer = Peer { child, input, output, address: format!("opc.tcp://127.0.0.1:{port}/test") };
        assert_eq!(peer.answer(), "ready");
        Some(peer)
    }

    /// The same address with nobody there before.
    pub(crate) fn free_port() -> u16 {
        TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
    }

    fn answer(&mut self) -> String {
        let mut line = String::new();
        self.output.read_line(&mut line).unwrap();
        line.trim().to_owned()
    }

    /// Tells it a line, and waits until it has done that.
    pub(crate) fn tell(&mut self, line: &str) {
        writeln!(self.input, "{line}").unwrap();
        assert_eq!(self.answer(), "done", "{line}");
    }

    /// All axes at one instant (ms).
    pub(crate) fn axes(&mut self, at_ms: i64, mm: [f64; 3]) {
        let [x, y, z] = mm;
        self.tell(&format!("[[\"X\",{x:?},{at_ms},0],[\"Y\",{y:?},{at_ms},0],[\"Z\",{z:?},{at_ms},0]]"));
    }

    /// Sends a signal, such as `STOP`.
    pub(crate) fn signal(&self, name: &str) {
        let sent = Command::new("kill").args(["-s", name, &self.child.id().to_string()]).status().unwrap();
        assert!(sent.success());
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Now (ms since 1970).
pub(crate) fn now_ms() -> i64 {
    i64::try_from(SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_millis()).unwrap()
}
