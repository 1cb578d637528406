"""What verbs take: arguments that several have are declared here, the others beside their verb."""

import argparse
import sys
from collections.abc import Callable
from typing import Any

Declare = Callable[[Any], object]
"""Adds an argument, or several, to a parser or a group of one."""
Main = Callable[[argparse.Namespace], Any]


def argument(*names: str, **settings: Any) -> Declare:
    """One argument, said as `add_argument` has it."""
    return lambda parser: parser.add_argument(*names, **settings)


def flag(*names: str, **settings: Any) -> Declare:
    """An option without a value."""
    return argument(*names, action="store_true", **settings)


def one_of(*declared: Declare) -> Declare:
    """Arguments of which at most one may be given."""

    def declare(parser: argparse.ArgumentParser) -> None:
        group = parser.add_mutually_exclusive_group()
        for each in declared:
            each(group)

    return declare


def takes(*declared: Declare) -> Callable[[Main], Main]:
    """Say the arguments of a verb, on the function that does it."""

    def mark(main: Main) -> Main:
        main.arguments = declared  # type: ignore[attr-defined]
        return main

    return mark


# ------------------------------------------------------------------ values
def positive_float(text: str) -> float:
    """A number greater than zero."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError("Expects a floating point number") from None
    if not value > 0.0:
        raise argparse.ArgumentTypeError("Value must be positive")
    return value


def positive_int(text: str) -> int:
    """A whole number greater than zero."""
    return whole_number(text, 1, "value must be a positive integer")


def non_negative_int(text: str) -> int:
    """A whole number, zero or greater."""
    return whole_number(text, 0, "value must be non-negative integer")


def whole_number(text: str, least: int, complaint: str) -> int:
    """A whole number of at least `least`."""
    try:
        value = int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(complaint) from None
    if value < least:
        raise argparse.ArgumentTypeError(complaint)
    return value


# ------------------------------------------------------------------ of several verbs
OWN_NODE = (
    argument(
        "--spin-time",
        type=float,
        default=1.0,
        help="seconds to wait for discovery, at most (default: %(default)s)",
    ),
    flag("-s", "--use-sim-time", help="use ROS simulation time"),
)
"""Of every command with a node of its own."""
NODE = (*OWN_NODE, flag("--no-daemon", help="has no effect: there is none"))
"""The same where ros2cli can do with its daemon instead."""
NODE_NAME = argument("node_name", help="name of the node")
TOPIC_NAME = argument("topic_name", help="name of the topic (e.g. '/chatter')")
TIMEOUT = argument(
    "--timeout",
    metavar="N",
    type=int,
    default=1,
    help="seconds to wait for the node (default: %(default)s)",
)
SHOW_TYPES = flag("-t", "--show-types", help="show the types as well")
ALL_NODES = flag("-a", "--all", help="show hidden nodes as well")
CSV = flag("--csv", help="all fields on one line, separated by commas")
SHORTENING = (
    flag("--full-length", "-f", help="do not shorten arrays and strings"),
    argument(
        "--truncate-length",
        "-l",
        type=non_negative_int,
        default=128,
        help="length to which arrays and strings are shortened (default: %(default)s)",
    ),
    flag("--no-arr", help="leave arrays out"),
    flag("--no-str", help="leave strings out"),
    flag("--flow-style", help="arrays on one line (no effect on --csv)"),
)
"""How much of a message is printed, and how."""


def count_only(what: str) -> Declare:
    """Whether a list is wanted or its length; `what` is in it."""
    return flag("-c", f"--count-{what}", help="show only how many there are")


def include_hidden(what: str, **settings: Any) -> Declare:
    """Whether those count that ROS takes for hidden."""
    return flag(f"--include-hidden-{what}", help=f"consider hidden {what} as well", **settings)


def window(default: int, **settings: Any) -> Declare:
    """Length of a sliding window."""
    what = "number of messages to average over (default: %(default)s)"
    return argument("--window", "-w", type=positive_int, default=default, help=what, **settings)


def values(help_text: str, **settings: Any) -> Declare:
    """The fields of what is sent, on the command line or not; `given_values` reads them."""
    return one_of(
        argument("values", nargs="?", default="{}", help=help_text, **settings),
        flag("--stdin", help="read the fields from standard input"),
    )


def given_values(args: argparse.Namespace) -> str | bytes:
    """The YAML of a message or request, from the command line or from standard input."""
    return sys.stdin.buffer.read() if args.stdin else args.values
