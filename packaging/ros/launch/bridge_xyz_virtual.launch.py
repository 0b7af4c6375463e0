"""The virtual machine's scales and tracer, corrected live by a model of yours; bridge_xyz_virtual.toml says what it runs."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    """Declare the arguments, and start all nodes by one process that watches them."""
    config = PathJoinSubstitution([FindPackageShare('abbe'), 'launch-config'])
    machine = PathJoinSubstitution([config, 'machines', 'bridge_xyz.toml'])
    graph = PathJoinSubstitution([config, 'bridge_xyz_virtual.toml'])
    return LaunchDescription([
        DeclareLaunchArgument('model', description='Model file, as `abbe identify` writes it'),
        DeclareLaunchArgument('machine', default_value=machine, description='Machine file that the model belongs to'),
        DeclareLaunchArgument('namespace', default_value='bridge_xyz', description='Namespace of all topics'),
        DeclareLaunchArgument('use_sim_time', default_value='false', description='Whether nodes go by /clock'),
        Node(
            package='abbe',
            executable='abbe',
            arguments=[
                'launch', graph,
                '--machine', LaunchConfiguration('machine'),
                '--model', LaunchConfiguration('model'),
            ],
            namespace=LaunchConfiguration('namespace'),
            parameters=[{'use_sim_time': ParameterValue(LaunchConfiguration('use_sim_time'), value_type=bool)}],
            output='screen',
            # A recording is completed before the nodes end.
            sigterm_timeout='30',
        ),
    ])
