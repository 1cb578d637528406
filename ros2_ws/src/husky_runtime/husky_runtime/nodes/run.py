"""How a node starts and ends."""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

import rclpy
import rclpy.utilities
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.logging import set_logger_level
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription

from husky_runtime import starter
from husky_runtime.nodes.executor import WaitSetExecutor
from husky_runtime.nodes.presence import hold_name
from husky_runtime.nodes.unknown_parameters import refuse_unknown
from husky_runtime.numba_cache import seal_numba_cache
from husky_runtime.rcl_error import said_by_rcl

_OWN_CLOCK = ("--ros-args", "-r", "/clock:=clock")
"""A robot in a namespace has its own time: rclpy's time source listens to the name of the root."""
_END_PERIOD = 2.0
"""Wall time after which a node that was told to end prints where it hangs [s]."""
HEARTBEAT = "HUSKY_HEARTBEAT"
"""Environment variable that names a file; without it there is no heart beat."""
_BEAT_PERIOD = 1.0
"""Wall time between two beats [s]."""


class HotNode(Protocol):
    """A node that names what its tick waits for, and that can be closed.

    One that also has timers to be looked at together with `hot` lists them in `hot_timers`.
    """

    @property
    def hot(self) -> Sequence[Subscription]:
        """Subscriptions that its tick waits for."""

    def quiet(self) -> None:
        """The hot subscriptions have had nothing for 2 ms of wall time."""

    def close(self) -> None:
        """Leave nothing moving and nothing open."""


def run(make_node: Callable[[], HotNode], args: Sequence[str] | None = None) -> int:
    """Run a node until a signal, or until its starter is gone; return the process's exit code.

    SIGHUP, SIGINT, SIGQUIT or SIGTERM ends the spinning, not the ROS context: `close` can still say
    a last word on a topic. Bad parameters end the process with one line that says what is wrong and
    what is allowed; so does a node of that name that runs already in this domain.
    """
    starter.end_with_starter()
    # The part of rosidl that a node needs imports the generator of messages' code too, if it is
    # there, with a parser and a grammar: 25 ms of each start.
    sys.modules.setdefault("rosidl_generator_py.generate_py_impl", None)  # type: ignore[arg-type]
    set_logger_level("rcl", LoggingSeverity.FATAL)  # what it says twice otherwise
    try:
        rclpy.init(
            args=[*(sys.argv if args is None else args), *_OWN_CLOCK],
            signal_handler_options=SignalHandlerOptions.NO,
        )
    except RuntimeError as error:  # rclpy's own errors are that
        print(f"error: {_in_one_line(error)}", file=sys.stderr)
        return 1
    set_logger_level("rcl", LoggingSeverity.INFO)
    try:
        return _spin(make_node, sys.argv[1:] if args is None else args)
    finally:
        rclpy.utilities.try_shutdown()


def _in_one_line(error: RuntimeError) -> str:
    """Return what rclpy says of a command line or an environment."""
    if isinstance(error, UnknownROSArgsError):
        return f"unknown behind --ros-args: {error}"
    return said_by_rcl(error)


def _spin(make_node: Callable[[], HotNode], args: Sequence[str]) -> int:
    stop = threading.Event()

    def end(*_: object) -> None:
        stop.set()
        # Whoever finds a node that does not end finds in its log where it stands.
        faulthandler.dump_traceback_later(_END_PERIOD)

    faulthandler.enable()
    for number in starter.ending_signals():
        signal.signal(number, end)
    seal_numba_cache()
    try:
        hold_name(make_node, args)
        node = make_node()
        assert isinstance(node, Node)
        refuse_unknown(node, args)
        beat(node)
    except (
        ValueError,
        InvalidParameterTypeException,
        InvalidParameterValueException,
        OSError,
    ) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except RCLError as error:
        print(f"error: {said_by_rcl(error)}", file=sys.stderr)
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


def beat(node: Node) -> None:
    """Touch the heart beat's file once a second from now on, as long as the node serves its timers.

    That is a sign of life for whoever watches the process from outside, as a container engine does.

    Raises:
        OSError: the file cannot be made.
    """
    name = os.environ.get(HEARTBEAT, "")
    if name:
        file = Path(name)
        file.touch()
        node.create_timer(_BEAT_PERIOD, file.touch)
