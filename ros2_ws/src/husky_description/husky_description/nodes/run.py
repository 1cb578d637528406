"""How a node starts and ends."""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Protocol

import rclpy
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription

from husky_description.nodes.executor import WaitSetExecutor
from husky_description.nodes.heartbeat import beat

_END_PERIOD = 2.0
"""Wall time after which a node that was told to end prints where it hangs [s]."""


class HotNode(Protocol):
    """A node that names what its tick waits for, and that can be closed.

    One that also has timers to be looked at together with `hot` lists them in `hot_timers`.
    """

    hot: Sequence[Subscription]

    def quiet(self) -> None:
        """The hot subscriptions have had nothing for 2 ms of wall time."""

    def close(self) -> None:
        """Leave nothing moving and nothing open."""


def run(make_node: Callable[[], HotNode], args: Sequence[str] | None = None) -> int:
    """Run a node until SIGINT or SIGTERM; return the process's exit code.

    The signal ends the spinning, not the ROS context: `close` can still say a last word on a topic.
    Bad parameters end the process with one line that says what is wrong and what is allowed.
    """
    rclpy.init(
        args=list(args) if args is not None else None,
        signal_handler_options=SignalHandlerOptions.NO,
    )
    try:
        return _spin(make_node)
    finally:
        rclpy.try_shutdown()


def _spin(make_node: Callable[[], HotNode]) -> int:
    stop = threading.Event()

    def end(*_: object) -> None:
        stop.set()
        # Whoever finds a node that does not end finds in its log where it stands.
        faulthandler.dump_traceback_later(_END_PERIOD)

    faulthandler.enable()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    try:
        node = make_node()
        assert isinstance(node, Node)
        beat(node)
    except (
        ValueError,
        InvalidParameterTypeException,
        InvalidParameterValueException,
        OSError,
    ) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    timers = list(getattr(node, "hot_timers", ()))
    executor = WaitSetExecutor(node, list(node.hot), node.quiet, timers, stop)
    # Everything made so far lives as long as the process: leave it out of every collection.
    gc.collect()
    gc.freeze()
    try:
        with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
            executor.spin()
    finally:
        node.close()
        executor.close()
        node.destroy_node()
    return 0
