//! Programs of others: Python with PyPI `cyclonedds` and `rosbags`, named by `ABBE_PYTHON`.
//!
//! Without it such a test says that it was skipped; with `ABBE_REQUIRE_PEERS=1` it fails instead.

use std::env;
use std::path::Path;
use std::process::{Command, Stdio};

/// Cyclone DDS on loopback and nowhere else.
const CYCLONE: &str = "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name=\"lo\" multicast=\"true\"/>\
                       </Interfaces></General></Domain></CycloneDDS>";

/// A script of `tests/system/peers`; none where there is no Python to run it.
pub(crate) fn python(script: &str) -> Option<Command> {
    let Ok(interpreter) = env::var("ABBE_PYTHON") else {
        let required = env::var("ABBE_REQUIRE_PEERS").is_ok_and(|value| value == "1");
        assert!(!required, "ABBE_REQUIRE_PEERS=1, but ABBE_PYTHON names no interpreter");
        println!("SKIPPED {script}: set ABBE_PYTHON to a Python with cyclonedds and rosbags");
        return None;
    };
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/system/peers").join(script);
    let mut command = Command::new(interpreter);
    command.arg(path).env("CYCLONEDDS_URI", CYCLONE).env("PYTHONDONTWRITEBYTECODE", "1").stdin(Stdio::null());
    Some(command)
}
