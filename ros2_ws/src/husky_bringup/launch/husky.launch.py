"""Launch file: the same graph as `scripts/bringup.sh`, where `launch` is installed."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from husky_bringup.system import TIMES, NodeSpec, simulated_robot
from husky_description import graph


def _values(spec: NodeSpec) -> dict[str, object]:
    """Return parameters as launch wants them: lists, not tuples."""
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in spec.parameters.items()
    }


def make_nodes(context: LaunchContext) -> list[Node]:
    """Return a launch action for each node of the table."""
    time = LaunchConfiguration("time").perform(context)
    record = LaunchConfiguration("record").perform(context) or None
    body = LaunchConfiguration("body").perform(context)
    remote = LaunchConfiguration("remote").perform(context) == "true"
    params_file = LaunchConfiguration("params_file").perform(context)
    return [
        Node(
            package=spec.package,
            executable=spec.executable,
            name=spec.name,
            parameters=[*([params_file] if params_file else []), _values(spec)],
            output="screen",
        )
        for spec in simulated_robot(time, {graph.PLANT: {"body": body}}, record, remote)
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
                "body",
                default_value="robot",
                choices=list(graph.BODIES),
                description="Husky without fans, with them, or the propulsion unit alone",
            ),
            DeclareLaunchArgument(
                "remote",
                default_value="false",
                choices=["true", "false"],
                description="with the remote control of the propulsion unit",
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
