"""One clock for all that a node says: simulated time where there is a simulation, else wall time.

rclpy stamps what it publishes by the node's clock, which follows `/clock` while the parameter
`use_sim_time` is true. Three things are added to that. The parameter is true unless the node is
told that it runs on the robot. `/rosout` is stamped by the same clock: rcl takes wall time for it,
always. And nothing waits for `/clock`: 100 messages a second would wake every node for nothing, so
the newest is looked up when somebody asks what time it is.
"""

from __future__ import annotations

import contextlib
import math
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import Log
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle
from rclpy.impl import rcutils_logger
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription
from rclpy.time_source import USE_SIM_TIME_NAME
from rclpy.timer import Timer

from husky_runtime.patient_clock import LONGEST_LOOK

ROSOUT = QoSProfile(
    depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL, lifespan=Duration(seconds=10)
)
"""As rcl offers `/rosout`."""
_ON_THE_ROBOT = (("time", "hardware"), ("clock", "host"))
"""Parameters, and what they are where there is no simulation."""
_WALL = Clock(clock_type=ClockType.STEADY_TIME)

_LOGGERS = (__file__, rcutils_logger.__file__)
"""What stands between who logs and the log."""


def _find_caller() -> rcutils_logger.CallerId:
    """Return who logs: function, file, line, and the place in the line's code."""
    caller = sys._getframe(1)
    while caller.f_code.co_filename in _LOGGERS and caller.f_back is not None:
        caller = caller.f_back
    code = caller.f_code
    return _CallerId._make((code.co_name, code.co_filename, caller.f_lineno, caller.f_lasti))


# rclpy's own looks for the text of the line, for which the first line of a log looks up every
# module's file: 40 ms of each start.
_CallerId = rcutils_logger.CallerId
rcutils_logger.CallerId = _find_caller  # type: ignore[misc, assignment]


# It stands before the node in the bases of a class, and is one itself to whoever checks types.
_Base = Node if TYPE_CHECKING else object


class OneClock(_Base):  # type: ignore[misc, valid-type]
    """What stands before `Node` or `LifecycleNode` in the bases of each node of the robot."""

    def __init__(self, name: str) -> None:
        """Make the node, with the clock that its parameters call for."""
        super().__init__(name, enable_rosout=False)
        self._enter_clock: Callable[[Any], None] | None = None
        given = self._parameter_overrides
        if USE_SIM_TIME_NAME not in given:
            on_the_robot = any(
                key in given and given[key].value == value for key, value in _ON_THE_ROBOT
            )
            self.set_parameters([Parameter(USE_SIM_TIME_NAME, value=not on_the_robot)])
        self._logger: rcutils_logger.RcutilsLogger = StampedLogger(self)

    @property
    def unawaited(self) -> tuple[Subscription, ...]:
        """Subscriptions that need not wake the node; a node may add some of its own."""
        return self._clock_subscriptions

    @property
    def _clock_subscriptions(self) -> tuple[Subscription, ...]:
        clock = self._time_source._clock_sub
        return () if clock is None else (clock,)

    def get_clock(self) -> Clock:
        """Return the node's clock; it shows the newest time that has come."""
        guard: Any = getattr(self.executor, "guard", None)
        for told in self._clock_subscriptions if guard is not None else ():
            if self._enter_clock is None:
                self._enter_clock = guard.guarded(
                    self._time_source.clock_callback, told.topic_name, told.msg_type, raw=False
                )
            with told.handle:
                taken = told.handle.take_message(told.msg_type, False)
            if taken is not None:
                self._enter_clock(taken[0])
        clock: Clock = super().get_clock()
        return clock

    def create_timer(
        self, timer_period_sec: float, callback: Callable[[], Any], *args: Any, **options: Any
    ) -> Timer:
        """Make a timer, of wall time: reports and watchdogs go on while the world stands still."""
        if len(args) < 2:
            options.setdefault("clock", _WALL)
        timer: Timer = super().create_timer(timer_period_sec, callback, *args, **options)
        return timer


def longest_look(node: Node) -> float:
    """Return how much time between two looks a node's watchdogs of wall time count at most [s].

    It is infinite on the robot, where silence is a fault however it came about.
    """
    return LONGEST_LOOK if node.get_parameter(USE_SIM_TIME_NAME).value else math.inf


class StampedLogger(rcutils_logger.RcutilsLogger):
    """Logs as rclpy does, and tells `/rosout` with stamps of the node's clock."""

    def __init__(self, node: Node):
        """Take the place of a node's logger, which must not publish itself."""
        super().__init__(node.get_logger().name)
        self._node = node
        self._publisher = node.create_publisher(Log, "/rosout", ROSOUT)

    def log(self, message: str, severity: Any, **options: Any) -> bool:
        """Log a message, unless its level or a filter is against it; return whether it was."""
        if not super().log(message, severity, **options):
            return False
        caller = _find_caller()
        line = Log(
            stamp=self._node.get_clock().now().to_msg(),
            level=int(severity),
            name=self.name,
            msg=str(message),
            file=caller.file_path,
            function=caller.function_name,
            line=caller.line_number,
        )
        with contextlib.suppress(InvalidHandle):  # the node is being destroyed
            self._publisher.publish(line)
        return True
