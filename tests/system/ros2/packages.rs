//! Abbe as packages of a ROS 2 workspace, built with CMake and ament from the wheels.

use std::path::{Path, PathBuf};
use std::process::Command;

use abbe_graph::launch::NodeName;
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus};
use serde_json::{Value, json};

use super::common::assert_says;
use super::common::files::{Bench, samples, text};
use super::common::graph::{NAMESPACE, topic};
use super::common::network::in_own_network;
use super::common::program::{Started, program};
use super::common::python::{ros2, ros2_prefix};
use super::{beside, graph};

/// What the launch files say, each in its own words.
const LAUNCH_FILES: [&str; 3] = ["py", "xml", "yaml"];

#[test]
fn the_launch_files_of_the_package_have_the_same_arguments() {
    for kind in LAUNCH_FILES {
        let file = std::fs::read_to_string(package().join(format!("launch/bridge_xyz_virtual.launch.{kind}"))).unwrap();
        let words = [
            "model",
            "Model file, as `abbe identify` writes it",
            "machine",
            "bridge_xyz.toml",
            "Machine file that the model belongs to",
            "namespace",
            "Namespace of all topics",
            "bridge_xyz_virtual.toml",
            "--machine",
            "--model",
        ];
        assert_says(&file, &words);
        assert_eq!(
            file.matches("default").count(),
            2,
            "{kind}: machine and namespace have defaults, the model has none"
        );
    }
}

/// The folder of the package of a ROS 2 workspace.
fn package() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../packaging/ros")
}

/// Builds the package as colcon does, with the program of the tests, and installs it; nothing where there is no ROS 2.
fn install_package(bench: &Bench) -> Option<()> {
    let tools = ros2_prefix()?;
    let [build, prefix] = ["build", "install"].map(|name| bench.text(name));
    let folder = text(&package());
    let python = format!("-DPython3_EXECUTABLE={}", tools.join("bin/python").display());
    let program = format!("-DABBE_PROGRAM={}", program().display());
    let to = format!("-DCMAKE_INSTALL_PREFIX={prefix}");
    cmake(&tools, &["-S", &folder, "-B", &build, "-G", "Unix Makefiles", &python, &program, &to]);
    cmake(&tools, &["--build", &build]);
    cmake(&tools, &["--install", &build]);
    Some(())
}

fn cmake(tools: &Path, words: &[&str]) {
    let mut command = Command::new(tools.join("bin/cmake"));
    command.args(words).env("CMAKE_PREFIX_PATH", tools).env("AMENT_PREFIX_PATH", tools);
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cmake {words:?}: {}{said}", String::from_utf8_lossy(&output.stdout));
}

#[test]
fn val_ament_the_package_is_found_runs_nodes_and_launches_the_machine_that_it_is_told() {
    let test = "packages::val_ament_the_package_is_found_runs_nodes_and_launches_the_machine_that_it_is_told";
    in_own_network(test, |domain| {
        let Some(user) = ros2(domain, &["streams", "other", "200"]) else { return };
        let bench = Bench::identified(5);
        install_package(&bench).unwrap();
        let [share, programs] = ["install/share/abbe", "install/lib/abbe"].map(|name| bench.path(name));
        assert!(bench.path("install/share/ament_index/resource_index/packages/abbe").is_file());
        for node in NodeName::ALL {
            let mut command = Command::new(programs.join(node.name()));
            command.args(["--launch", "none.toml"]);
            assert_says(&Started::start(command).finish().refused(), &["none.toml"]);
        }

        let config = share.join("launch-config");
        let mut command = Command::new(programs.join("abbe"));
        command.arg("launch").arg(config.join("bridge_xyz_virtual.toml"));
        command
            .arg("--machine")
            .arg(config.join("machines/bridge_xyz.toml"))
            .arg("--model")
            .arg(bench.path("model.json"));
        command.args(["--ros-args", "-r", "__ns:=/other"]).env("ROS_DOMAIN_ID", domain.id().to_string());
        command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
        let heard = beside(Started::start(command), user);
        let stamps = heard["stamps_s"]["corrected_point default"].as_array().unwrap();
        assert!(stamps.len() >= 200, "{} corrected points of the model that was named", stamps.len());
    });
}

/// Builds the package of the messages, as colcon does, in a folder that stays from one run of the tests to the next.
fn install_messages() -> Option<PathBuf> {
    let (tools, here) = (ros2_prefix()?, Path::new(env!("CARGO_MANIFEST_DIR")));
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("abbe_msgs");
    let [build, prefix] = ["build", "install"].map(|name| text(&folder.join(name)));
    let messages = text(&here.join("../../msgs"));
    let python = format!("-DPython3_EXECUTABLE={}", tools.join("bin/python").display());
    let wheels = format!("-DCMAKE_PROJECT_INCLUDE={}", here.join("../../tests/system/peers/wheels.cmake").display());
    let to = format!("-DCMAKE_INSTALL_PREFIX={prefix}");
    cmake(&tools, &["-S", &messages, "-B", &build, "-G", "Unix Makefiles", &python, &wheels, &to]);
    cmake(&tools, &["--build", &build, "--parallel"]);
    cmake(&tools, &["--install", &build]);
    Some(folder.join("install"))
}

/// A sample as the classes of rosidl have it.
fn as_taken(sample: &CorrectedCoordinates) -> Value {
    let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    json!({
        "header": {
            "stamp": { "sec": sample.stamp.sec(), "nanosec": sample.stamp.nanosec() },
            "frame_id": sample.frame_id.as_str(),
        },
        "sequence": sample.sequence,
        "reading_m": bits(&sample.reading_m),
        "offset_m": bits(&sample.offset_m),
        "geometric_correction_m": bits(&sample.geometric_correction_m),
        "effect_correction_m": bits(&sample.effect_correction_m),
        "residual_correction_m": bits(&sample.residual_correction_m),
        "corrected_valid": sample.corrected_valid,
        "corrected_m": bits(&sample.corrected_m),
        "covariance_m2": bits(&sample.covariance_m2),
        "status": sample.status as u8,
        "model_sha256": sample.model_sha256.to_hex(),
        "residual_model_sha256": sample.residual_model_sha256.to_hex(),
    })
}

#[test]
fn val_ament_the_messages_are_generated_and_a_program_takes_with_them_what_is_recorded() {
    let test = "packages::val_ament_the_messages_are_generated_and_a_program_takes_with_them_what_is_recorded";
    in_own_network(test, |domain| {
        let Some(mut user) = ros2(domain, &["corrected", NAMESPACE, "200"]) else { return };
        let (prefix, tools) = (install_messages().unwrap(), ros2_prefix().unwrap());
        let python = prefix.join("lib/python3.12/site-packages");
        user.env("PYTHONPATH", &python).env("LD_LIBRARY_PATH", prefix.join("lib"));
        user.env("AMENT_PREFIX_PATH", format!("{}:{}", prefix.display(), tools.display()));
        let bench = Bench::identified(5);
        let heard = beside(graph(&bench, domain), user);
        assert_eq!(heard["covers"], CorrectionStatus::Inactive as u8);
        let taken = heard["taken"].as_array().unwrap();
        assert!(taken.len() >= 200, "{}", taken.len());
        let recorded: Vec<CorrectedCoordinates> = samples(&bench.path("recorded"), &topic("corrected"));
        let first = recorded.iter().position(|sample| taken[0]["sequence"] == sample.sequence).unwrap();
        for (taken, sample) in taken.iter().zip(&recorded[first..]) {
            assert_eq!(*taken, as_taken(sample));
        }
    });
}
