"""The console's page of a bag: no node, there is no graph; messages pass the same rules."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from functools import cache
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReaderError

from husky_bringup.console.page import Page
from husky_bringup.console.player import Player
from husky_bringup.console.record import Record
from husky_bringup.console.server import PORT, PageServer
from husky_bringup.definitions import message_class
from husky_bringup.nodes.shown import decode_shown
from husky_bringup.web_gate import WebGate
from husky_runtime import graph

_PERIOD = 1.0 / 30.0
"""Wall time between two drawings [s]."""

_class_of = cache(message_class)


def replay(bag: Path, namespace: str | None, host: str, port: int, token: str) -> None:
    """Serve the page until a signal.

    Args:
        bag: that is shown.
        namespace: of the robot in it; None for the one whose clock is recorded.
        host: of the gate, as its port and its token.
        port: see there.
        token: see there.

    Raises:
        OSError: there is no such bag, or the gate cannot listen there.
        AnyReaderError: the bag cannot be read.
        ValueError: there is nothing in the bag to see, or the token may not be.
    """
    with contextlib.ExitStack() as stack:
        record = Record(bag, namespace)
        stack.callback(record.close)
        server = PageServer()
        stack.callback(server.stop)
        player = Player(server, Page(server, "(recorded)"), record, decode)
        gate = WebGate(host, port, server.get_port(), token=token)
        stack.callback(gate.close)
        print(f"the record is at {gate.address('http')}", flush=True)
        while True:
            begin = time.monotonic()
            if server.get_clients():
                player.turn(begin)
            time.sleep(max(0.0, begin + _PERIOD - time.monotonic()))


def decode(topic: str, data: bytes) -> Any:
    """Return a message of a topic of the graph, by its name there; raises ValueError for none."""
    return decode_shown(topic, data, _class_of(graph.topic(topic).type))


def main() -> int:
    """Run as `scripts/console.sh --bag` asks."""
    parser = argparse.ArgumentParser(prog="scripts/console.sh --bag")
    parser.add_argument("bag", type=Path)
    parser.add_argument("--namespace")
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=PORT)
    parser.add_argument("--token", default="")
    try:
        replay(**vars(parser.parse_args()))
    except (OSError, AnyReaderError, ValueError, OverflowError) as error:
        print(f"error: {error}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
