"""Publishes a sensor's samples, and in simulation says those again that nobody may have heard."""

from __future__ import annotations

import threading
import time

from rclpy.lifecycle import LifecycleNode

from husky_runtime.nodes import qos
from husky_runtime.nodes.one_clock import longest_look
from husky_runtime.patient_clock import PatientClock

_REPEAT_PERIOD = 0.1
"""Wall time between two repeats [s]."""
_FIRST = 4
"""So many samples are the first ones: more than the two that an IMU at 800 Hz has in a tick."""
_AT_START, _AFTER_A_STOP = 300, 20
"""Most repeats of the first samples together, and of the newest one after a stop."""
_STOP = 0.5
"""Time in which this process did not run after which it was stopped [s]."""


class SamplePublisher:
    """Publishes samples from the thread of a device's link.

    A lockstep world that waits for a sample makes no other. It may wait in vain in two cases, in
    which the newest sample is therefore published again, as long as no other has come since the
    last look:

    - The first samples may be sent before discovery has made a way to the subscriber.
    - DDS drops what waits at a process that is stopped for a second; after this one was.
    """

    def __init__(self, node: LifecycleNode, kind: type, topic: str, *, simulated: bool):
        """Make the publisher.

        Args:
            node: the driver; the publisher is active when the driver is.
            kind: type of the messages.
            topic: of the samples.
            simulated: whether samples are published again.
        """
        self._publisher = node.create_lifecycle_publisher(kind, topic, qos.CONTROL_OFFERED)
        self._lock = threading.Lock()
        self._newest, self._count = b"", 0  # under the lock, as is publishing
        self._seen = 0  # samples at the last look
        self._patient_clock = PatientClock(longest_look(node))
        self._left_at_start, self._left = _AT_START, 0
        if simulated:
            node.create_timer(_REPEAT_PERIOD, self._repeat)

    def publish(self, sample: bytes) -> None:
        """Publish a serialised message."""
        with self._lock:
            self._newest = sample
            self._count += 1
            self._publisher.publish(sample)

    def _repeat(self) -> None:
        missed = self._patient_clock.missed
        self._patient_clock.read(time.monotonic())
        if self._patient_clock.missed - missed > _STOP:
            self._left = _AFTER_A_STOP
        with self._lock:
            waits, self._seen = self._count == self._seen, self._count
            if not self._newest or not self._publisher.is_activated:
                return
            if self._left > 0:
                self._left -= 1
            elif self._count <= _FIRST and self._left_at_start > 0:
                self._left_at_start -= 1
            else:
                return
            if waits:
                self._publisher.publish(self._newest)
