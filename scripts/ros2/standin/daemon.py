"""`ros2 daemon`: there is none; every command looks at the graph itself."""

import argparse

from standin.arguments import flag, takes


@takes(flag("--debug", "-d", help="has no effect: there is none"))
def start_main(_: argparse.Namespace) -> None:
    """Say why nothing was started."""
    print("This stand-in for the ros2 command needs no daemon: it looks at the graph each time")


@takes()
def status_main(_: argparse.Namespace) -> None:
    """Say what the original says where none runs."""
    print("The daemon is not running")


stop_main = status_main
