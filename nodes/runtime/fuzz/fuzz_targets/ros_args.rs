//! Any text as arguments of ROS and as a parameter file: understood or refused, never a panic.

#![no_main]

use abbe_runtime::RunId;
use abbe_runtime::ros::{DiscoveryRange, Domain, NodeIdentity, RosArgs, StaticPeers, resolve};
use libfuzzer_sys::fuzz_target;
use std::io::{Seek, SeekFrom, Write};
use std::sync::{LazyLock, Mutex};
use tempfile::NamedTempFile;

/// One file for all runs: parameters are read from a path.
static FILE: LazyLock<Mutex<NamedTempFile>> =
    LazyLock::new(|| Mutex::new(NamedTempFile::new_in("/dev/shm").expect("a file in memory")));

fn split(words: impl IntoIterator<Item = String>) {
    let words = std::iter::once("--ros-args".to_owned()).chain(words);
    if let Ok((arguments, _)) = RosArgs::split(words) {
        let _ = arguments.identity("/cmm", "node");
    }
}

fn read_parameters(text: &str) {
    let mut file = FILE.lock().expect("no panic before");
    file.as_file().set_len(0).expect("memory");
    file.seek(SeekFrom::Start(0)).expect("memory");
    file.write_all(text.as_bytes()).expect("memory");
    split(["--params-file".to_owned(), file.path().display().to_string()]);
}

fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    // A path of the machine is not to be read by chance.
    if !text.contains("--params-file") {
        split(text.split('\0').map(str::to_owned));
    }
    split(["-p".to_owned(), format!("name:={text}")]);
    split(["-r".to_owned(), text.to_owned()]);
    read_parameters(text);
    if let Ok(node) = NodeIdentity::new("/cmm", "geometric")
        && let Ok(resolved) = resolve(text, &node, &[])
    {
        assert_eq!(resolve(&resolved, &node, &[]).ok(), Some(resolved));
    }
    let _ = text.parse::<RunId>();
    let _ = Domain::from_variables(|_| Some(text.to_owned()));
    let _ = StaticPeers::of(text, DiscoveryRange::Localhost);
});
