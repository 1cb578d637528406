"""The commands and verbs there are, and where to find those of ROS that are not here."""

from collections.abc import Mapping
from typing import NamedTuple

from standin.arguments import Declare, include_hidden


class Command(NamedTuple):
    """A first-level command: its description and its verbs (none: the command itself does it)."""

    description: str
    verbs: dict[str, str]
    module: str = ""  # in place of the command's name
    shared: tuple[Declare, ...] = ()  # arguments between the command and its verb
    apart: Mapping[str, str] = {}  # modules of verbs that are not in the command's own


COMMANDS = {
    "action": Command(
        "Various action related sub-commands",
        {
            "info": "Print information about an action",
            "list": "Output a list of action names",
            "send_goal": "Send an action goal",
            "type": "Print a action's type",
        },
    ),
    "daemon": Command(
        "Various daemon related sub-commands",
        {
            "start": "Start the daemon if it isn't running",
            "status": "Output the status of the daemon",
            "stop": "Stop the daemon if it is running",
        },
    ),
    "doctor": Command("Check ROS setup and other potential issues", {}),
    "interface": Command(
        "Show information about ROS interfaces",
        {
            "list": "List all interface types available",
            "package": "Output a list of available interface types within one package",
            "packages": "Output a list of packages that provide interfaces",
            "proto": "Output an interface prototype",
            "show": "Output the interface definition",
        },
    ),
    "lifecycle": Command(
        "Various lifecycle related sub-commands",
        {
            "get": "Get lifecycle state for one or more nodes",
            "list": "Output a list of available transitions",
            "nodes": "Output a list of nodes with lifecycle",
            "set": "Trigger lifecycle state transition",
        },
    ),
    "node": Command(
        "Various node related sub-commands",
        {"info": "Output information about a node", "list": "Output a list of available nodes"},
    ),
    "param": Command(
        "Various param related sub-commands",
        {
            "delete": "Delete parameter",
            "describe": "Show descriptive information about declared parameters",
            "dump": "Show all of the parameters of a node in a YAML file format",
            "get": "Get parameter",
            "list": "Output a list of available parameters",
            "load": "Load parameter file for a node",
            "set": "Set parameter",
        },
    ),
    "pkg": Command(
        "Various package related sub-commands",
        {
            "executables": "Output a list of package specific executables",
            "list": "Output a list of available packages",
            "prefix": "Output the prefix path of a package",
            "xml": "Output the XML of the package manifest or a specific tag",
        },
    ),
    "run": Command("Run a package specific executable", {}),
    "service": Command(
        "Various service related sub-commands",
        {
            "call": "Call a service",
            "echo": "Echo a service",
            "find": "Output a list of available services of a given type",
            "info": "Print information about a service",
            "list": "Output a list of available services",
            "type": "Output a service's type",
        },
        shared=(include_hidden("services"),),
    ),
    "topic": Command(
        "Various topic related sub-commands",
        {
            "bw": "Display bandwidth used by topic",
            "delay": "Display delay of topic from timestamp in header",
            "echo": "Output messages from a topic",
            "find": "Output a list of available topics of a given type",
            "hz": "Print the average publishing rate to screen",
            "info": "Print information about a topic",
            "list": "Output a list of available topics",
            "pub": "Publish a message to a topic",
            "type": "Print a topic's type",
        },
        shared=(include_hidden("topics"),),
        apart={
            "bw": "topic_statistics",
            "delay": "topic_statistics",
            "echo": "topic_echo",
            "hz": "topic_statistics",
            "pub": "topic_pub",
        },
    ),
    "wtf": Command("Use `wtf` as alias to `doctor`", {}, module="doctor"),
}

# Those of a full installation that are not here, and the package of Jazzy that has them.
ELSEWHERE = {
    ("bag",): "ros-jazzy-ros2bag",
    ("component",): "ros-jazzy-ros2component",
    ("control",): "ros-jazzy-ros2controlcli",
    ("doctor", "hello"): "ros-jazzy-ros2doctor",
    ("launch",): "ros-jazzy-ros2launch",
    ("multicast",): "ros-jazzy-ros2multicast",
    ("pkg", "create"): "ros-jazzy-ros2pkg",
    ("security",): "ros-jazzy-sros2",
    ("trace",): "ros-jazzy-ros2trace",
    ("wtf", "hello"): "ros-jazzy-ros2doctor",
}


def missing(named: list[str]) -> str | None:
    """What to say of a command or verb that only a full installation has, else None.

    `named` are the words of the command line.
    """
    for words in (tuple(named[:1]), tuple(named[:2])):
        if words in ELSEWHERE:
            *of, name = words
            here = COMMANDS[of[0]].verbs if of else COMMANDS
            has = f", which has {', '.join(here)}" if here else ""
            return (
                f"ros2{''.join(f' {word}' for word in of)}: '{name}' is not in this stand-in for "
                f"the ros2 command{has}; a full installation of ROS 2 has it in {ELSEWHERE[words]} "
                "(https://docs.ros.org/en/jazzy/Installation.html)"
            )
    return None
