//! The `abbe` program, built once for the tests that run it.
//!
//! Place in the flow: tests of the whole system call [`abbe`] and start what it returns. `ABBE_PROGRAM` names a
//! program that is built already, such as the optimised one.

use crate::workspace;
use cargo_metadata::Message;
use std::env;
use std::io::BufReader;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::OnceLock;

/// Path of the `abbe` program.
pub fn abbe() -> PathBuf {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| env::var_os("ABBE_PROGRAM").map_or_else(build, PathBuf::from)).clone()
}

/// Builds it with the settings of the tests themselves, so that their dependencies are not built again.
fn build() -> PathBuf {
    let mut cargo = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
        .args(["build", "--locked", "--package", "abbe", "--message-format", "json-render-diagnostics"])
        .current_dir(workspace::root())
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .expect("cargo can be called");
    let mut program = None;
    for message in Message::parse_stream(BufReader::new(cargo.stdout.take().expect("its output is piped"))) {
        if let Message::CompilerArtifact(artifact) = message.expect("cargo speaks JSON")
            && artifact.target.name == "abbe"
            && let Some(executable) = artifact.executable
        {
            program = Some(executable.into_std_path_buf());
        }
    }
    let status = cargo.wait().expect("cargo ends");
    assert!(status.success(), "cargo build --package abbe ended with {status}");
    program.expect("cargo names the program it built")
}
