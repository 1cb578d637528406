"""`scripts/bringup.sh`: every node of the robot with `ros2 run`, one process each."""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from collections.abc import Sequence
from types import FrameType

import yaml

from husky_bringup.processes import Processes
from husky_bringup.system import TIMES, NodeSpec, ParameterValue, simulated_robot

Settings = dict[str, dict[str, ParameterValue]]


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
    parser.add_argument("--time", choices=TIMES, default="realtime", help="who sets the pace")
    add_set_option(
        parser, "e.g. plant.terrain=tiles, plant.body=robot_with_unit; may be given many times"
    )
    parser.add_argument(
        "--remote", action="store_true", help="with the remote control of the propulsion unit"
    )
    parser.add_argument("--record", metavar="DIR", help="record a bag into this directory")


def robot_of(options: argparse.Namespace) -> tuple[NodeSpec, ...]:
    """Return the nodes that the options of `add_robot_options` ask for.

    Raises:
        ValueError: they do not fit together.
    """
    return simulated_robot(
        options.time, collect(options.set), options.record, remote=options.remote
    )


def make_parser() -> argparse.ArgumentParser:
    """Return the command line."""
    parser = argparse.ArgumentParser(
        prog="scripts/bringup.sh",
        description="Start every node of the simulated robot; Ctrl-C or SIGTERM ends them all.",
    )
    add_robot_options(parser)
    parser.add_argument("--params-file", help="a ROS parameter file for every node")
    parser.add_argument(
        "--without",
        action="append",
        default=[],
        metavar="NODE",
        help="leave a node out, to start it by hand, e.g. under a debugger",
    )
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until a signal comes; return 0, or 1 when nodes failed."""
    parser = make_parser()
    options = parser.parse_args(arguments)
    try:
        specs = leave_out(robot_of(options), options.without)
    except ValueError as error:
        parser.error(str(error))
    stop = threading.Event()

    def on_signal(number: int, frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, on_signal)
    failed = False
    with Processes(params_file=options.params_file) as processes:
        processes.start_all(specs)
        running = {spec.name for spec in specs}
        print(f"started {', '.join(sorted(running))}; Ctrl-C ends them", flush=True)
        while running and not stop.wait(0.2):
            for name, code in processes.ended().items():
                running.discard(name)
                failed |= code != 0
                print(f"{name} has ended with code {code}", file=sys.stderr, flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
