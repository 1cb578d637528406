"""`scripts/bringup.sh`: every node of the robot, one process each."""

from __future__ import annotations

import argparse
import re
import signal
import sys
import time
from collections.abc import Sequence

import yaml

from husky_bringup.front import end_by_signals
from husky_bringup.processes import Processes
from husky_bringup.system import TIMES, NodeSpec, ParameterValue, simulated_robot
from husky_description.robot import ROBOTS
from husky_runtime import graph
from husky_runtime.domain_locks import OccupiedError

Settings = dict[str, dict[str, ParameterValue]]

_NAMESPACE = re.compile(r"/|/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*", re.ASCII)
_LOOK_PERIOD = 0.1
"""Wall time between two looks at the nodes [s]."""


def parse_setting(text: str) -> tuple[str, str, ParameterValue]:
    """Read `NODE.PARAMETER=VALUE`, the value as YAML.

    Raises:
        argparse.ArgumentTypeError: anything else.
    """
    target, equals, value = text.partition("=")
    node, dot, parameter = target.partition(".")
    if not (equals and dot and node and parameter):
        raise argparse.ArgumentTypeError(f"{text!r} is not NODE.PARAMETER=VALUE")
    parsed = yaml.safe_load(value)
    if not isinstance(parsed, bool | int | float | str):
        raise argparse.ArgumentTypeError(f"{value!r} is not a number, a word, true or false")
    return node, parameter, parsed


def add_set_option(parser: argparse.ArgumentParser, help_text: str) -> None:
    """Declare `--set NODE.PARAMETER=VALUE`, a list of what `parse_setting` returns."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        type=parse_setting,
        metavar="NODE.PARAMETER=VALUE",
        help=help_text,
    )


def collect(settings: Sequence[tuple[str, str, ParameterValue]]) -> Settings:
    """Sort single settings by node."""
    result: Settings = {}
    for node, parameter, value in settings:
        result.setdefault(node, {})[parameter] = value
    return result


def leave_out(specs: Sequence[NodeSpec], names: Sequence[str]) -> tuple[NodeSpec, ...]:
    """Return the nodes without some of them.

    Raises:
        ValueError: one of them is not there.
    """
    known = [spec.name for spec in specs]
    for name in names:
        if name not in known:
            raise ValueError(f"there is no node {name!r}, the graph has {', '.join(known)}")
    return tuple(spec for spec in specs if spec.name not in names)


def add_robot_options(parser: argparse.ArgumentParser) -> None:
    """Declare what says which robot it is, and its parameters."""
    parser.add_argument(
        "--robot",
        metavar="ROBOT",
        help=f"which robot it is: {', '.join(ROBOTS)}, or the path of its file; {ROBOTS[0]} by "
        "default",
    )
    parser.add_argument("--time", choices=TIMES, default="realtime", help="who sets the pace")
    add_set_option(
        parser, "e.g. plant.terrain=tiles, plant.body=robot_with_unit; may be given many times"
    )
    parser.add_argument(
        "--remote", action="store_true", help="with the remote control of the propulsion unit"
    )
    parser.add_argument("--record", metavar="DIR", help="record a bag into this directory")


def robot_of(options: argparse.Namespace, *, console: bool = False) -> tuple[NodeSpec, ...]:
    """Return the nodes that the options of `add_robot_options` ask for.

    Args:
        options: with these.
        console: whether there is a page for the browser.

    Raises:
        ValueError: they do not fit together.
    """
    settings = settings_of(options)
    return simulated_robot(
        options.time, settings, options.record, remote=options.remote, wakes=True, console=console
    )


def settings_of(options: argparse.Namespace) -> Settings:
    """Return the parameters by node that `--set` and `--robot` give."""
    settings = collect(options.set)
    if options.robot is not None:
        settings.setdefault(graph.PLANT, {})["robot"] = options.robot
    return settings


def make_parser() -> argparse.ArgumentParser:
    """Return the command line."""
    parser = argparse.ArgumentParser(
        prog="scripts/bringup.sh",
        description="Start every node of the simulated robot; Ctrl-C ends them all, "
        "and so does the end of one.",
    )
    add_robot_options(parser)
    parser.add_argument("--console", action="store_true", help="with a page for the browser")
    parser.add_argument("--params-file", help="a ROS parameter file for every node")
    parser.add_argument(
        "--namespace",
        type=parse_namespace,
        default="/",
        help="of all names, e.g. robot1: for several robots in one ROS domain",
    )
    parser.add_argument(
        "--without",
        action="append",
        default=[],
        metavar="NODE",
        help="leave a node out, to start it by hand, e.g. under a debugger",
    )
    return parser


def parse_namespace(text: str) -> str:
    """Read the name of a robot, e.g. `robot1` or `/fleet/robot1`; return the full one.

    Raises:
        argparse.ArgumentTypeError: it is none that ROS takes.
    """
    if not _NAMESPACE.fullmatch(text):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no namespace: letters, digits and _, as robot1 or /fleet/robot1"
        )
    return f"/{text.strip('/')}"


def watch(processes: Processes) -> dict[str, int]:
    """Wait until nodes end, whichever; return their exit codes."""
    while not (codes := processes.ended()):
        time.sleep(_LOOK_PERIOD)
    return codes


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until a signal comes, which raises, or a node ends; return 1.

    A robot that has lost a node is no robot: the others are ended too.
    """
    parser = make_parser()
    options = parser.parse_args(arguments)
    try:
        specs = leave_out(robot_of(options, console=options.console), options.without)
    except ValueError as error:
        parser.error(str(error))
    try:
        with Processes(
            params_file=options.params_file, namespace=options.namespace
        ) as processes:
            processes.start_all(specs)
            names = ", ".join(sorted(spec.name for spec in specs))
            print(f"started {names}; Ctrl-C ends them", flush=True)
            for name, code in watch(processes).items():
                print(f"{name} has ended with {_told(code)}", file=sys.stderr, flush=True)
            print("ending the others", file=sys.stderr, flush=True)
    except (OccupiedError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
    return 1


def _told(code: int) -> str:
    """Say an exit code of `subprocess`."""
    return f"code {code}" if code >= 0 else f"code {code} ({signal.Signals(-code).name})"


if __name__ == "__main__":
    end_by_signals()
    sys.exit(main())
