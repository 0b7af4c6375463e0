//! Programs of others: Python with the wheels of `.ci/python-peers.txt`, named by `ABBE_PYTHON`, and a real ROS 2 (rclpy on
//! Fast DDS, the wheels `ros-jazzy-*`), named by `ABBE_ROS_PYTHON`.
//!
//! Without one such a test says that it was skipped. With `ABBE_REQUIRE_PEERS=1` it fails instead where the first is not
//! there; the second wants Python 3.12, which not every system has.

use std::env;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use abbe_runtime::ros::Domain;
use serde_json::Value;

/// Cyclone DDS on loopback and nowhere else.
const CYCLONE: &str = "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name=\"lo\" multicast=\"true\"/>\
                       </Interfaces></General></Domain></CycloneDDS>";

/// A script of `tests/system/peers`; none where there is no Python to run it.
pub(crate) fn python(script: &str) -> Option<Command> {
    let Ok(interpreter) = env::var("ABBE_PYTHON") else {
        let required = env::var("ABBE_REQUIRE_PEERS").is_ok_and(|value| value == "1");
        assert!(!required, "ABBE_REQUIRE_PEERS=1, but ABBE_PYTHON names no interpreter");
        println!("SKIPPED {script}: set ABBE_PYTHON to a Python with the wheels of .ci/python-peers.txt");
        return None;
    };
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/system/peers").join(script);
    let mut command = Command::new(interpreter);
    command.arg(path).env("CYCLONEDDS_URI", CYCLONE).stdin(Stdio::null());
    keep_compiled(&mut command);
    Some(command)
}

/// Modules that Python has compiled are kept, and not beside their sources: compiling those of ROS 2 or SciPy takes longer than most
/// tests do.
pub(crate) fn keep_compiled(command: &mut Command) {
    command.env_remove("PYTHONDONTWRITEBYTECODE");
    command.env("PYTHONPYCACHEPREFIX", Path::new(env!("CARGO_TARGET_TMPDIR")).join("pycache"));
}

/// A user's program on ROS 2, `tests/system/peers/ros2_user.py`; none where there is no ROS 2 to run it.
pub(crate) fn ros2(domain: Domain, words: &[&str]) -> Option<Command> {
    ros2_script("ros2_user.py", domain, words)
}

/// The same of those whose time is what is looked at, `tests/system/peers/ros2_timed.py`.
pub(crate) fn ros2_timed(domain: Domain, words: &[&str]) -> Option<Command> {
    ros2_script("ros2_timed.py", domain, words)
}

fn ros2_script(script: &str, domain: Domain, words: &[&str]) -> Option<Command> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/system/peers").join(script);
    let mut command = ros2_python(script, domain, words)?;
    command.arg(path).args(words);
    Some(command)
}

/// `ros2` with these words; none where there is no ROS 2, or no `ros2 launch`, which comes in no wheel.
pub(crate) fn ros2cli(domain: Domain, words: &[&str]) -> Option<Command> {
    const NEEDS: &str = "import launch, launch_ros.actions, launch_xml, launch_yaml, ros2cli.cli, ros2launch";
    let mut command = ros2_python("ros2", domain, words)?;
    let tried = Command::new(command.get_program()).args(["-c", NEEDS]).output().unwrap();
    if !tried.status.success() {
        println!(
            "SKIPPED ros2 {words:?}: put what `{NEEDS}` wants on PYTHONPATH, and its share folders on AMENT_PREFIX_PATH"
        );
        return None;
    }
    command.args(["-c", "import sys; from ros2cli.cli import main; sys.exit(main())"]).args(words);
    Some(command)
}

fn ros2_python(what: &str, domain: Domain, words: &[&str]) -> Option<Command> {
    let Ok(interpreter) = env::var("ABBE_ROS_PYTHON") else {
        println!("SKIPPED {what} {words:?}: set ABBE_ROS_PYTHON to a Python 3.12 with the wheels of .ci/ros-peers.txt");
        return None;
    };
    let mut command = Command::new(interpreter);
    command.stdin(Stdio::null());
    keep_compiled(&mut command);
    command.env("ROS_DOMAIN_ID", domain.id().to_string()).env("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET");
    Some(command)
}

/// Where the wheels of ROS 2 are installed, with what builds packages; none where there is no ROS 2.
pub(crate) fn ros2_prefix() -> Option<PathBuf> {
    let interpreter = env::var_os("ABBE_ROS_PYTHON")?;
    Some(Path::new(&interpreter).parent()?.parent()?.to_owned())
}

/// What such a program says.
#[track_caller]
pub(crate) fn said(mut command: Command) -> Value {
    let output = command.output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let text = String::from_utf8_lossy(&output.stdout);
    let line = text.lines().last().unwrap_or_default();
    serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {text}{errors}"))
}
