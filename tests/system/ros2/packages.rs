//! Abbe as packages of a ROS 2 workspace, built by colcon with the wheels of CMake, ament and rosidl.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use abbe_graph::launch::NodeName;
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, RangeResidual};
use serde_json::{Value, json};

use super::{beside, graph};
use crate::common::assert_says;
use crate::common::files::{Bench, samples};
use crate::common::graph::{DDS, LaunchText, MEMORY, NAMESPACE, topic};
use crate::common::network::in_own_network;
use crate::common::program::{Started, abbe_in, program};
use crate::common::python::{ros2, ros2_prefix};

/// What the launch files say, each in its own words.
pub(super) const LAUNCH_FILES: [&str; 3] = ["py", "xml", "yaml"];

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
            "use_sim_time",
            "Whether nodes go by /clock",
            "bridge_xyz_virtual.toml",
            "--machine",
            "--model",
        ];
        assert_says(&file, &words);
        assert_eq!(
            file.matches("default").count(),
            3,
            "{kind}: machine, namespace and use_sim_time have defaults, the model has none"
        );
    }
}

/// The folder of the package of a ROS 2 workspace.
fn package() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../packaging/ros")
}

/// A workspace that colcon builds; none where there is no ROS 2.
pub(super) struct Workspace {
    folder: PathBuf,
}

impl Workspace {
    /// Builds the package of a folder of the project, with what has to be said to CMake.
    pub(super) fn built(folder: PathBuf, package: &str, for_cmake: &[String]) -> Option<Workspace> {
        let (tools, project) = (ros2_prefix()?, Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."));
        let mut path = std::ffi::OsString::from(tools.join("bin"));
        path.push(":");
        path.push(std::env::var_os("PATH").unwrap_or_default());
        let mut colcon = Command::new(tools.join("bin/colcon"));
        std::fs::create_dir_all(&folder).unwrap();
        colcon
            .current_dir(&folder)
            .arg("--log-base")
            .arg("log")
            .args(["build", "--base-paths"])
            .arg(project.join(package));
        colcon.arg("--cmake-args").arg(format!("-DPython3_EXECUTABLE={}", tools.join("bin/python").display()));
        colcon.args(for_cmake).env("PATH", path).env("CMAKE_PREFIX_PATH", &tools).env("AMENT_PREFIX_PATH", &tools);
        let output = colcon.output().unwrap();
        let said = [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned()).concat();
        assert!(output.status.success(), "colcon cannot build {package}: {said}");
        Some(Workspace { folder })
    }

    fn installed(&self, package: &str, path: &str) -> PathBuf {
        self.folder.join("install").join(package).join(path)
    }

    /// The same program of a user who has said `. install/setup.sh`.
    pub(super) fn set_up(&self, command: &Command) -> Command {
        let mut shell = Command::new("sh");
        shell.args(["-c", ". \"$0\" && exec \"$@\""]).arg(self.folder.join("install/setup.sh"));
        shell.arg(command.get_program()).args(command.get_args()).stdin(Stdio::null());
        for (name, value) in command.get_envs() {
            match value {
                Some(value) => shell.env(name, value),
                None => shell.env_remove(name),
            };
        }
        shell
    }
}

#[test]
fn val_colcon_the_package_is_found_runs_nodes_and_launches_the_machine_that_it_is_told() {
    let test = "ros2::packages::val_colcon_the_package_is_found_runs_nodes_and_launches_the_machine_that_it_is_told";
    in_own_network(test, |domain| {
        let Some(user) = ros2(domain, &["streams", "other", "200"]) else { return };
        let bench = Bench::identified(5);
        let program = format!("-DABBE_PROGRAM={}", program().display());
        let workspace = Workspace::built(bench.path("workspace"), "packaging/ros", &[program]).unwrap();
        let [share, programs] = ["share/abbe", "lib/abbe"].map(|path| workspace.installed("abbe", path));
        assert!(workspace.installed("abbe", "share/ament_index/resource_index/packages/abbe").is_file());
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

/// The same of what the monitor says.
fn residual_as_taken(residual: &RangeResidual) -> Value {
    json!({
        "header": {
            "stamp": { "sec": residual.stamp.sec(), "nanosec": residual.stamp.nanosec() },
            "frame_id": residual.frame_id.as_str(),
        },
        "sequence": residual.sequence,
        "station": residual.station.as_str(),
        "residual_valid": residual.residual_valid,
        "measured_length_m": residual.measured_length_m.to_bits(),
        "predicted_length_m": residual.predicted_length_m.to_bits(),
        "residual_m": residual.residual_m.to_bits(),
        "u_residual_m": residual.u_residual_m.to_bits(),
        "status": residual.status as u8,
        "model_sha256": residual.model_sha256.to_hex(),
    })
}

/// A campaign that is played through all nodes for half a minute and more; what the monitor says is over DDS, and recorded.
fn monitored(bench: &Bench) -> String {
    let campaign = bench.text("campaign.csv");
    let launch = LaunchText::default().nodes(&["scale", "tracer", "geometric", "residual", "monitor", "recorder"]);
    let launch = launch.source("scale", &campaign, None, 20.0).source("tracer", &campaign, None, 20.0).monitor();
    let edges = [("scale", "geometric"), ("geometric", "residual"), ("residual", "monitor"), ("tracer", "monitor")];
    let launch = edges.iter().fold(launch, |launch, (from, to)| launch.edge(from, to, MEMORY));
    launch.edge("monitor", "recorder", MEMORY).edge("monitor", "*", DDS).record("monitored").write(bench)
}

#[test]
fn val_colcon_the_messages_are_generated_and_a_program_takes_with_them_what_is_recorded() {
    let test = "ros2::packages::val_colcon_the_messages_are_generated_and_a_program_takes_with_them_what_is_recorded";
    in_own_network(test, |domain| {
        let Some(user) = ros2(domain, &["corrected", NAMESPACE, "200"]) else { return };
        // It stays from one run of the tests to the next: generating and compiling takes a while.
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("workspace_of_messages");
        let wheels = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/system/peers/wheels.cmake");
        let wheels = format!("-DCMAKE_PROJECT_INCLUDE={}", wheels.display());
        let workspace = Workspace::built(folder, "msgs", &[wheels]).unwrap();
        let user = workspace.set_up(&user);
        let bench = Bench::identified(5);
        let heard = beside(graph(&bench, domain), user);
        assert_eq!(heard["covers"], CorrectionStatus::Inactive as u8);
        let taken = heard["taken"].as_array().unwrap();
        assert!(taken.len() >= 200, "{}", taken.len());
        let recorded: Vec<CorrectedCoordinates> = samples(&bench.path("recorded"), &topic("corrected"));
        // By its number: a reader that is slow on a loaded machine misses some.
        for taken in taken {
            let sample = recorded.iter().find(|sample| taken["sequence"] == sample.sequence).unwrap();
            assert_eq!(*taken, as_taken(sample));
        }

        // What the monitor says comes to a subscriber with default quality of service as well.
        let user = workspace.set_up(&ros2(domain, &["residuals", NAMESPACE, "20"]).unwrap());
        let heard = beside(Started::start(abbe_in(domain, ["launch", &monitored(&bench)])), user);
        let taken = heard["taken"].as_array().unwrap();
        assert!(taken.len() >= 20, "{}", taken.len());
        let recorded: Vec<RangeResidual> = samples(&bench.path("monitored"), &topic("monitor/range_residual"));
        for taken in taken {
            let residual = recorded.iter().find(|residual| taken["sequence"] == residual.sequence).unwrap();
            assert!(residual.residual_valid, "{taken}");
            assert_eq!(*taken, residual_as_taken(residual));
        }
    });
}
