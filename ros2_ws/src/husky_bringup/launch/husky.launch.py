"""Launch file: the same graph as `scripts/bringup.sh`, where `launch` is installed.

Any parameter of any node is an argument: `plant.terrain:=tiles`.
"""

import os
import sys

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from husky_bringup.bringup import parse_namespace
from husky_bringup.neighbours import refuse_neighbours
from husky_bringup.settings import Settings, collect, parse_setting
from husky_bringup.system import TIMES, simulated_robot
from husky_description.robot import ROBOTS
from husky_runtime import graph, starter
from husky_runtime.domain_locks import Claims

ARGUMENTS = {
    "time": {
        "default_value": "realtime",
        "choices": list(TIMES),
        "description": "who sets the pace",
    },
    "robot": {
        "default_value": ROBOTS[0],
        "description": f"which robot it is: {', '.join(ROBOTS)}, or the path of its file",
    },
    "body": {
        "default_value": "robot",
        "choices": list(graph.BODIES),
        "description": "Husky without fans, with them, or the propulsion unit alone",
    },
    "remote": {
        "default_value": "false",
        "choices": ["true", "false"],
        "description": "with the remote control of the propulsion unit",
    },
    "console": {
        "default_value": "false",
        "choices": ["true", "false"],
        "description": "with a page for the browser",
    },
    "namespace": {
        "default_value": "/",
        "description": "of all names, e.g. robot1: for several robots in one ROS domain",
    },
    "params_file": {"default_value": "", "description": "a ROS parameter file for every node"},
    "record": {"default_value": "", "description": "record a bag into this directory"},
}
"""What may be given besides NODE.PARAMETER, e.g. `plant.terrain:=tiles`."""


def _settings(context: LaunchContext) -> Settings:
    """Return what the arguments NODE.PARAMETER:=VALUE say.

    Raises:
        ValueError: an argument given to this file is not one that it has.
    """
    given = context.launch_configurations
    at_top = any(argument.endswith(os.path.basename(__file__)) for argument in sys.argv)
    for argument in context.argv if at_top else ():  # else they are also those of another file
        name = argument.partition(":=")[0]
        if name not in ARGUMENTS and "." not in name:
            known = ", ".join(ARGUMENTS)
            raise ValueError(
                f"there is no argument {name}; there are {known}, and NODE.PARAMETER, "
                f"e.g. plant.terrain"
            )
    names = [name for name in given if "." in name]
    return collect([parse_setting(f"{name}={given[name]}") for name in names])


def make_nodes(context: LaunchContext) -> list[Node]:
    """Return a launch action for each node of the table; the end of one ends all.

    Raises:
        OccupiedError: a graph of this robot is in the ROS domain already.
    """
    time = LaunchConfiguration("time").perform(context)
    record = LaunchConfiguration("record").perform(context) or None
    body = LaunchConfiguration("body").perform(context)
    remote = LaunchConfiguration("remote").perform(context) == "true"
    console = LaunchConfiguration("console").perform(context) == "true"
    params_file = LaunchConfiguration("params_file").perform(context)
    settings = _settings(context)
    plant = settings.setdefault(graph.PLANT, {})
    plant.setdefault("body", body)
    plant.setdefault("robot", LaunchConfiguration("robot").perform(context))
    specs = simulated_robot(time, settings, record, remote, wakes=True, console=console)
    namespace = parse_namespace(LaunchConfiguration("namespace").perform(context))
    claims = Claims(os.environ, namespace)
    claims.claim(spec.name for spec in specs)
    refuse_neighbours([spec.name for spec in specs], claims.domain, os.environ, namespace)
    context.extend_globals({"husky_claims": claims})  # held as long as the launch lasts
    return [
        Node(
            package=spec.package,
            executable=spec.executable,
            name=spec.name,
            namespace=namespace,
            ros_arguments=spec.ros_arguments(params_file or None, namespace),
            output="screen",
            additional_env={starter.VARIABLE: starter.identity()},
            on_exit=Shutdown(reason=f"{spec.name} has ended"),
        )
        for spec in specs
    ]


def generate_launch_description() -> LaunchDescription:
    """Describe the simulated robot."""
    declared = [DeclareLaunchArgument(name, **options) for name, options in ARGUMENTS.items()]
    return LaunchDescription([*declared, OpaqueFunction(function=make_nodes)])
