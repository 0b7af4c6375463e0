//! The launch files of the package, and those of users, by `ros2 launch` itself.
//!
//! No wheel of PyPI has it. Where launch, launch_xml, launch_yaml, launch_ros, ros2cli and ros2launch can be imported (their sources on
//! `PYTHONPATH`, their share folders on `AMENT_PREFIX_PATH`) these tests run; elsewhere they say that they were skipped.

use std::process::Command;

use abbe_runtime::ros::Domain;
use serde_json::Value;

use super::packages::{LAUNCH_FILES, Workspace};
use crate::common::assert_says;
use crate::common::files::{Bench, machine, text};
use crate::common::network::in_own_network;
use crate::common::program::{Ran, Started, processes_with, program, signal};
use crate::common::python::{ros2, ros2cli, said};
use rustix::process::Signal;

/// A workspace with the package, and `ros2` as its user starts it; none where there is no `ros2 launch`.
struct Tools {
    bench: Bench,
    workspace: Workspace,
    domain: Domain,
}

impl Tools {
    fn new(domain: Domain) -> Option<Tools> {
        ros2cli(domain, &[])?;
        let bench = Bench::identified(5);
        let program = format!("-DABBE_PROGRAM={}", program().display());
        let workspace = Workspace::built(bench.path("workspace"), "packaging/ros", &[program])?;
        // A path as users have them.
        std::fs::rename(bench.path("model.json"), bench.path("my model.json")).unwrap();
        Some(Tools { bench, workspace, domain })
    }

    fn model(&self) -> String {
        self.bench.text("my model.json")
    }

    fn launch(&self, words: &[&str]) -> Command {
        let words: Vec<&str> = ["launch"].iter().chain(words).copied().collect();
        let mut command = self.workspace.set_up(&ros2cli(self.domain, &words).unwrap());
        command.env("ROS_LOG_DIR", self.bench.path("log")).env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
        command
    }

    /// What a user hears beside the launch, which then gets Ctrl-C; `mark` stands in the command line of each of its nodes.
    #[track_caller]
    fn beside(&self, launch: Command, words: &[&str], mark: &str) -> (Value, Ran) {
        let launch = Started::start(launch);
        let heard = said(ros2(self.domain, words).unwrap());
        assert_ne!(processes_with(mark), Vec::<u32>::new(), "no node has {mark} in its command line");
        signal(launch.id(), Signal::INT);
        let ran = launch.finish();
        assert_eq!(processes_with(mark), Vec::<u32>::new(), "a node is left behind");
        (heard, ran)
    }
}

/// What launch wrote of itself and its processes, once it has ended well.
#[track_caller]
fn ended_well(ran: Ran) -> String {
    let words = format!("{}{}", String::from_utf8_lossy(&ran.output), ran.errors);
    assert_eq!(ran.code, Some(0), "{words}");
    assert!(!words.contains("panicked") && !words.contains("process has died"), "{words}");
    words
}

#[test]
fn val_ros2_launch_starts_each_launch_file_with_its_arguments_and_ends_it_by_ctrl_c() {
    let test = "ros2::launched::val_ros2_launch_starts_each_launch_file_with_its_arguments_and_ends_it_by_ctrl_c";
    in_own_network(test, |domain| {
        let Some(tools) = Tools::new(domain) else { return };
        let (model, machine) = (format!("model:={}", tools.model()), format!("machine:={}", text(&machine())));
        for kind in LAUNCH_FILES {
            let file = format!("bridge_xyz_virtual.launch.{kind}");
            let shown = Started::start(tools.launch(&["abbe", &file, "--show-args"])).finish().ok();
            assert_says(
                &shown,
                &["'model'", "'machine'", "'namespace'", "'use_sim_time'", "bridge_xyz.toml", "'bridge_xyz'"],
            );
            let refused = Started::start(tools.launch(&["abbe", &file])).finish();
            let words = format!("{}{}", String::from_utf8_lossy(&refused.output), refused.errors);
            assert_says(&words, &["missing required argument 'model'"]);
            assert_ne!(refused.code, Some(0), "{words}");

            let launch = tools.launch(&["abbe", &file, &model, &machine, "namespace:=hall/other"]);
            let (heard, ran) = tools.beside(launch, &["streams", "hall/other", "100"], &tools.model());
            super::samples_of_each_stream(&heard, 100);
            let words = ended_well(ran);
            assert_says(&words, &["process has finished cleanly", "\"node\":\"residual\""]);
            assert!(!words.contains("sending signal 'SIGTERM'"), "{words}");

            // Nobody publishes /clock: the graph waits for it, and Ctrl-C ends it all the same.
            let launch = tools.launch(&["abbe", &file, &model, "namespace:=hall/other", "use_sim_time:=true"]);
            let (heard, ran) =
                tools.beside(launch, &["parameters", "/hall/other/scale", "rate_hz", "5.0"], &tools.model());
            assert_eq!(heard["values"]["use_sim_time"], true, "{kind}");
            ended_well(ran);
        }
    });
}

#[test]
fn val_ros2_launch_includes_a_launch_file_in_a_namespace_with_parameters_and_remappings_of_its_own() {
    const TEXT: &str = "
from launch import LaunchDescription
from launch.actions import GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import AnyLaunchDescriptionSource
from launch.substitutions import PathJoinSubstitution
from launch_ros.actions import PushROSNamespace, SetParameter, SetRemap
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    file = PathJoinSubstitution([FindPackageShare('abbe'), 'launch', 'bridge_xyz_virtual.launch.xml'])
    return LaunchDescription([GroupAction([
        PushROSNamespace('hall'),
        SetParameter('use_sim_time', False),
        # Of the geometric node alone, and of a node that is none of Abbe's.
        SetParameter('max_covariate_age_s', 7.5),
        SetParameter('robot_name', 'anna'),
        SetRemap('corrected_point', '/hall/point'),
        IncludeLaunchDescription(AnyLaunchDescriptionSource(file), launch_arguments={'model': MODEL}.items()),
    ])])
";
    let test = "ros2::launched::val_ros2_launch_includes_a_launch_file_in_a_namespace_with_parameters_and_remappings_of_its_own";
    in_own_network(test, |domain| {
        let Some(tools) = Tools::new(domain) else { return };
        let file = tools.bench.write("hall.launch.py", TEXT.replace("MODEL", &format!("{:?}", tools.model())));
        let launch = Started::start(tools.launch(&[&file]));
        let heard = said(ros2(domain, &["offers", "/hall/point"]).unwrap());
        assert_eq!(heard["/hall/point"], serde_json::json!([["RELIABLE", "VOLATILE"]]));
        let words = ["parameters", "/hall/bridge_xyz/geometric", "max_covariate_age_s", "5.0"];
        let heard = said(ros2(domain, &words).unwrap());
        assert_eq!(
            (&heard["values"]["max_covariate_age_s"], &heard["values"]["use_sim_time"]),
            (&7.5.into(), &false.into())
        );
        signal(launch.id(), Signal::INT);
        let words = ended_well(launch.finish());
        let told = "no node of this launch has a parameter 'robot_name'";
        assert_eq!(words.matches(told).count(), 1, "{words}");
        assert!(!words.contains("has a parameter 'max_covariate_age_s'"), "{words}");
    });
}

#[test]
fn val_ros2_launch_takes_nodes_of_its_own_through_their_states_by_its_events() {
    const TEXT: &str = "
import lifecycle_msgs.msg
from launch import LaunchDescription
from launch.actions import EmitEvent, RegisterEventHandler
from launch.events import matches_action
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState

Transition = lifecycle_msgs.msg.Transition


def generate_launch_description():
    actions = []
    for name in ['residual', 'geometric', 'scale']:
        node = LifecycleNode(
            package='abbe', executable=name, name=name, namespace='bridge_xyz', output='screen',
            arguments=['--launch', LAUNCH, '--run', RUN], parameters=[{'use_sim_time': False}],
            ros_arguments=['--log-level', 'info'])

        def change(transition):
            return EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition))

        actions += [node, change(Transition.TRANSITION_CONFIGURE), RegisterEventHandler(OnStateTransition(
            target_lifecycle_node=node, start_state='configuring', goal_state='inactive',
            entities=[change(Transition.TRANSITION_ACTIVATE)]))]
    return LaunchDescription(actions)
";
    let test = "ros2::launched::val_ros2_launch_takes_nodes_of_its_own_through_their_states_by_its_events";
    in_own_network(test, |domain| {
        let Some(tools) = Tools::new(domain) else { return };
        let launch = format!(
            "namespace = \"bridge_xyz\"\nmachine = {:?}\nmodel = {:?}\nnodes = [\"residual\", \"geometric\", \"scale\"]\n\
             max_covariate_age_s = 10.0\nwait_for_subscribers_s = 20.0\nautostart = false\nstamps = \"now\"\n\
             [scale]\ndriver = {{ kind = \"virtual_machine\", seed = 1 }}\npace = {{ rate_hz = 100.0 }}\nrepeat_from = 0\n\
             [[edges]]\nfrom = \"scale\"\nto = \"geometric\"\ntransport = \"shared-memory\"\n\
             [[edges]]\nfrom = \"geometric\"\nto = \"residual\"\ntransport = \"shared-memory\"\n\
             [[edges]]\nfrom = \"scale\"\nto = \"*\"\ntransport = \"dds\"\n\
             [[edges]]\nfrom = \"residual\"\nto = \"*\"\ntransport = \"dds\"\n",
            text(&machine()),
            tools.model()
        );
        let launch = tools.bench.write("states.toml", launch);
        let run = abbe_runtime::RunId::unique();
        let words = TEXT.replace("LAUNCH,", &format!("{launch:?},")).replace("RUN]", &format!("{:?}]", run.as_str()));
        let file = tools.bench.write("states.launch.py", words);
        let (heard, ran) = tools.beside(tools.launch(&[&file]), &["streams", "bridge_xyz", "100"], run.as_str());
        super::samples_of_each_stream(&heard, 100);
        let words = format!("{}{}", String::from_utf8_lossy(&ran.output), ran.errors);
        assert_eq!(words.matches("process has finished cleanly").count(), 3, "{words}");
        assert!(!words.contains("process has died"), "{words}");
    });
}
