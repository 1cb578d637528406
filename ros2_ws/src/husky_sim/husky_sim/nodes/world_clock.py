"""Time of the simulated world on `/clock`, and how long an IMU sample takes to become a command."""

from __future__ import annotations

import time
from collections import deque

import numpy as np
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from husky_description.arrays import Array
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps

_REPEAT_PERIOD = 0.1
"""Wall time after which the time of a world that stands still is told again [s]."""


class WorldClock:
    """Tells the world's time; `time_ns` was told last [ns]."""

    def __init__(self, node: Node):
        """Make the publisher; nothing has been told."""
        self._message = Clock()
        self._publisher = node.create_publisher(Clock, graph.CLOCK, qos.CLOCK_OFFERED)
        self.time_ns, self._told_at = 0, 0.0

    def tell(self, time_ns: int) -> None:
        """Tell a time [ns]."""
        self.time_ns, self._told_at = time_ns, time.monotonic()
        stamps.fill(self._message.clock, time_ns)
        self._publisher.publish(self._message)

    def repeat(self, now: float) -> None:
        """Tell who comes later the time of a world that waits; `now` is monotonic wall time [s]."""
        if now - self._told_at > _REPEAT_PERIOD:
            self.tell(self.time_ns)


class ImuLatency:
    """Wall time from an IMU sample to the first command that stands on it."""

    def __init__(self) -> None:
        """Nothing has been measured."""
        self._sent: dict[int, float] = {}
        self._durations: deque[float] = deque(maxlen=2048)

    def begin(self, sample_ns: int) -> None:
        """The sample with this stamp [ns] is sent."""
        self._sent[sample_ns] = time.perf_counter()

    def end(self, sample_ns: int) -> None:
        """A command that stands on the sample with this stamp [ns] has come."""
        sent = self._sent.pop(sample_ns, None)
        if sent is not None:
            self._durations.append(time.perf_counter() - sent)
            for older in [key for key in self._sent if key < sample_ns]:
                del self._sent[older]

    def durations(self) -> Array:
        """Return what was measured of late [s]."""
        return np.array(self._durations)

    def restart(self) -> None:
        """Time starts again: no command will come for what has been sent."""
        self._sent.clear()
