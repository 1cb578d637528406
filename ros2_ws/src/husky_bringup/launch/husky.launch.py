"""Launch file: the same graph as `scripts/bringup.sh`, where `launch` is installed."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from husky_bringup.system import TIMES, simulated_robot


def make_nodes(context: LaunchContext) -> list[Node]:
    """Return a launch action for each node of the table."""
    time = LaunchConfiguration("time").perform(context)
    record = LaunchConfiguration("record").perform(context) or None
    params_file = LaunchConfiguration("params_file").perform(context)
    return [
        Node(
            package=spec.package,
            executable=spec.executable,
            name=spec.name,
            parameters=[*([params_file] if params_file else []), dict(spec.parameters)],
            output="screen",
        )
        for spec in simulated_robot(time, record=record)
    ]


def generate_launch_description() -> LaunchDescription:
    """Describe the simulated robot."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "time",
                default_value="realtime",
                choices=list(TIMES),
                description="who sets the pace",
            ),
            DeclareLaunchArgument(
                "params_file", default_value="", description="a ROS parameter file for every node"
            ),
            DeclareLaunchArgument(
                "record", default_value="", description="record a bag into this directory"
            ),
            OpaqueFunction(function=make_nodes),
        ]
    )
