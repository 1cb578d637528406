"""`scripts/console.sh`: the page of a robot that runs already, or of one that was recorded."""

from __future__ import annotations

import argparse
import importlib.util
import os
import sys
from collections.abc import Sequence

from husky_bringup.bringup import parse_namespace
from husky_bringup.system import NodeSpec, ParameterValue
from husky_runtime import graph


def make_parser() -> argparse.ArgumentParser:
    """Return the command line."""
    parser = argparse.ArgumentParser(
        prog="scripts/console.sh",
        description="Show a robot in the browser; Ctrl-C ends the page, not the robot.",
    )
    parser.add_argument("--port", type=int, help="to listen on instead of 8080, 0 for a free one")
    what = "address to listen on; with 0.0.0.0 other machines get to it, who show a token"
    parser.add_argument("--host", help=what)
    parser.add_argument("--token", help="the token; without, one is made and told")
    parser.add_argument("--namespace", type=parse_namespace, help="of the robot")
    robot = parser.add_mutually_exclusive_group()
    robot.add_argument(
        "--hardware", action="store_true", help="the robot is none that is simulated: wall time"
    )
    what = "replay what was recorded, e.g. out/bag, instead of showing a robot that runs"
    robot.add_argument("--bag", metavar="DIR", help=what)
    return parser


def command(arguments: Sequence[str] | None = None) -> list[str]:
    """Return the command line of the node, or of the replay.

    Raises:
        ValueError: it is not installed.
    """
    options = make_parser().parse_args(arguments)
    if importlib.util.find_spec("viser") is None:
        raise ValueError("the console is not installed here; scripts/setup.sh without --nodes does")
    given = {"host": options.host, "port": options.port, "token": options.token}
    if options.bag is not None:
        given["namespace"] = options.namespace
        words = [f"--{n}={value}" for n, value in given.items() if value is not None]
        program = ("-P", "-m", "husky_bringup.front", "-m", "husky_bringup.nodes.replay")
        return [sys.executable, *program, *words, "--", options.bag]
    parameters: dict[str, ParameterValue] = {n: v for n, v in given.items() if v is not None}
    if options.hardware:
        parameters["use_sim_time"] = False
    spec = NodeSpec("husky_bringup", graph.CONSOLE, parameters)
    return spec.command(namespace=options.namespace or "/")


def main() -> None:
    """Become the node."""
    try:
        words = command()
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
    os.execv(words[0], words)


if __name__ == "__main__":
    main()
