"""`scripts/bringup.sh`: every node of the robot, one process each."""

from __future__ import annotations

import argparse
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from husky_bringup.front import end_by_signals
from husky_bringup.hardware import Hardware, read_hardware, robot_on_hardware
from husky_bringup.neighbours import discovery
from husky_bringup.processes import Processes
from husky_bringup.settings import (
    HelpFormatter,
    Settings,
    add_set_option,
    collect,
    nodes_of_file,
)
from husky_bringup.system import TIMES, NodeSpec, simulated_robot
from husky_description.robot import ROBOTS
from husky_runtime import graph
from husky_runtime.domain_locks import domain_of

_NAMESPACE = re.compile(r"/|/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*", re.ASCII)
_LOOK_PERIOD = 0.1
"""Wall time between two looks at the nodes [s]."""
_TIME = "realtime"
_SIMULATED = ("time", "bus", "robot", "remote")
"""Options that a robot of real devices does not take: its file or its devices decide."""


def leave_out(specs: Sequence[NodeSpec], names: Sequence[str]) -> tuple[NodeSpec, ...]:
    """Return the nodes without some of them.

    Raises:
        ValueError: one of them is not there, or none is left.
    """
    known = [spec.name for spec in specs]
    for name in names:
        if name not in known:
            raise ValueError(f"there is no node {name!r}, the graph has {', '.join(known)}")
    left = tuple(spec for spec in specs if spec.name not in names)
    if not left:
        raise ValueError("no node is left")
    return left


def add_robot_options(parser: argparse.ArgumentParser) -> None:
    """Declare what says which robot it is, and its parameters."""
    parser.add_argument(
        "--robot",
        metavar="ROBOT",
        help=f"which robot it is: {', '.join(ROBOTS)}, or the path of its file; {ROBOTS[0]} by "
        "default",
    )
    add_bus_option(parser)
    what = f"who sets the pace (default: {_TIME})"
    parser.add_argument("--time", choices=TIMES, default=_TIME, help=what)
    add_set_option(
        parser, "e.g. plant.terrain=tiles, plant.body=robot_with_unit; may be given many times"
    )
    parser.add_argument(
        "--remote", action="store_true", help="with the remote control of the propulsion unit"
    )
    parser.add_argument("--record", metavar="DIR", help="record a bag into this directory")


def add_bus_option(parser: argparse.ArgumentParser) -> None:
    """Declare which bus the drives have."""
    parser.add_argument(
        "--bus",
        choices=graph.BUSES,
        help=f"EtherCAT bus of the drives: {graph.BUSES[0]} inside a process, {graph.BUSES[1]} "
        f"with frames on a network interface (default: {graph.BUSES[0]})",
    )


def robot_of(options: argparse.Namespace, *, console: bool = False) -> tuple[NodeSpec, ...]:
    """Return the nodes that the options of `add_robot_options` ask for.

    Args:
        options: with these.
        console: whether there is a page for the browser.

    Raises:
        ValueError: they do not fit together.
    """
    settings = settings_of(options)
    time = options.time or _TIME
    return simulated_robot(
        time, settings, options.record, remote=options.remote, wakes=True, console=console
    )


def robot_with_devices(hardware: Hardware, options: argparse.Namespace) -> tuple[NodeSpec, ...]:
    """Return the nodes of a robot of real devices.

    Raises:
        ValueError: options of a simulated robot are given as well, or settings do not fit.
    """
    for name in _SIMULATED:
        if getattr(options, name) not in (None, False):
            raise ValueError(
                f"--{name} is for a simulated robot, it does not go with --hardware"
                + (": its file has the key robot" if name == "robot" else "")
            )
    settings = collect(options.set)
    if graph.PLANT in settings:
        name = next(iter(settings[graph.PLANT]))
        raise ValueError(
            f"--set {graph.PLANT}.{name} is for a simulated robot: with --hardware nothing is"
        )
    return robot_on_hardware(hardware, settings, options.record, console=options.console)


def settings_of(options: argparse.Namespace) -> Settings:
    """Return the parameters by node that `--set`, `--bus` and `--robot` give."""
    settings = collect(options.set)
    if options.bus is not None:
        settings.setdefault(graph.PLANT, {})["bus"] = options.bus
    if options.robot is not None:
        settings.setdefault(graph.PLANT, {})["robot"] = options.robot
    return settings


def make_parser() -> argparse.ArgumentParser:
    """Return the command line."""
    parser = argparse.ArgumentParser(
        prog="scripts/bringup.sh",
        description="Start every node of the robot, simulated or with real devices; Ctrl-C ends "
        "them all, and so does the end of one.",
        formatter_class=HelpFormatter,
    )
    add_robot_options(parser)
    parser.set_defaults(time=None)  # so that one that is given is seen
    parser.add_argument(
        "--hardware",
        metavar="FILE",
        help="start the robot's side alone, with the real devices that a file names "
        "(docs/hardware.md), if all of them answer; nothing is simulated",
    )
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="with --hardware: ask each device what it is and end; exit code 0 if all answer",
    )
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


def watch(processes: Processes, done: Callable[[], bool] = lambda: False) -> dict[str, int]:
    """Wait until nodes end, whichever, or until something is done; return their exit codes."""
    while not (codes := processes.ended()) and not done():
        time.sleep(_LOOK_PERIOD)
    return codes


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until a signal comes, which raises, or a node ends; return 1.

    A robot that has lost a node is no robot: the others are ended too.
    """
    parser = make_parser()
    options = parser.parse_args(arguments)
    hardware = None
    try:
        if options.hardware is not None:
            hardware = read_hardware(Path(options.hardware))
            specs = robot_with_devices(hardware, options)
        elif options.dry_run:
            raise ValueError("--dry-run asks the devices of --hardware FILE")
        else:
            specs = robot_of(options, console=options.console)
        specs = leave_out(specs, options.without)
        names = {spec.name for spec in specs}
        if options.params_file is not None:
            for name in sorted(nodes_of_file(Path(options.params_file)) - names):
                print(f"note: {options.params_file}: {name} is not started", file=sys.stderr)
    except ValueError as error:
        parser.error(str(error))
    if hardware is not None:
        missing = _missing(hardware)
        if options.dry_run:
            return 1 if missing else 0
        if missing:
            print(f"error: nothing is started without {', '.join(missing)}", file=sys.stderr)
            return 1
    try:
        with Processes(params_file=options.params_file, namespace=options.namespace) as processes:
            processes.start_all(specs)
            print(f"starting {', '.join(sorted(names))}; Ctrl-C ends them", flush=True)
            with discovery(domain_of(os.environ), options.namespace) as seen:
                codes = watch(processes, lambda: names <= seen())
            if not codes:
                print(f"ready: {len(names)} nodes", flush=True)
                codes = watch(processes)
            for name, code in codes.items():
                print(f"{name} has ended with {_told(code)}", file=sys.stderr, flush=True)
            print("ending the others", file=sys.stderr, flush=True)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
    return 1


def _missing(hardware: Hardware) -> list[str]:
    """Ask the devices, and tell what they say; return which do not answer as they should."""
    # Here, as a simulated robot needs none of it: the drivers take a while to load.
    from husky_bringup.hardware_check import check_devices, devices_of, print_machine

    missing = check_devices(devices_of(hardware))
    print_machine()
    return missing


def _told(code: int) -> str:
    """Say an exit code of `subprocess`."""
    return f"code {code}" if code >= 0 else f"code {code} ({signal.Signals(-code).name})"


if __name__ == "__main__":
    end_by_signals()
    sys.exit(main())
