"""A node's report on `/diagnostics`, by default once a second."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from husky_runtime import graph
from husky_runtime.nodes import qos
from husky_runtime.nodes.parameters import declare

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR

Report = tuple[bytes, str, Mapping[str, object]]
"""Level, message, values."""

PERIOD = "diagnostic_updater.period"
"""Parameter of the wall time between two reports [s]; ROS's own updater calls it so."""


class Diagnostics:
    """Publishes what a node says of itself, and what its `MessageGuard` has refused."""

    def __init__(self, node: Node, hardware_id: str, report: Callable[[], Report]):
        """Start to report, by wall time.

        Args:
            node: whose report it is.
            hardware_id: the device that the node stands for.
            report: called for each report; returns level, message and values.
        """
        self._node = node
        self._hardware_id = hardware_id
        self._report = report
        self._refused = self._failures = 0
        self._publisher = node.create_publisher(DiagnosticArray, graph.DIAGNOSTICS, qos.STATUS)
        text = "wall time between two reports on /diagnostics [s]"
        self._timer = node.create_timer(declare(node, PERIOD, 1.0, text, 0.05, 60.0), self.publish)

    def publish(self) -> None:
        """Send one report now."""
        level, message, values = self._guarded(*self._report())
        array = DiagnosticArray()
        array.header.stamp = self._node.get_clock().now().to_msg()
        array.status = [
            DiagnosticStatus(
                level=level,
                name=self._node.get_name(),
                message=message,
                hardware_id=self._hardware_id,
                values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
            )
        ]
        self._publisher.publish(array)

    def _guarded(self, level: bytes, message: str, values: Mapping[str, object]) -> Report:
        """Add what has not been let in; it is the message while there is nothing worse."""
        guard = getattr(self._node.executor, "guard", None)
        if guard is None:
            return level, message, values
        refused, failures = guard.refused.total(), guard.failures
        if failures != self._failures and level < ERROR:
            level, message = ERROR, f"failed: {guard.last}"
        elif refused != self._refused and level == OK:
            level, message = WARN, f"{message}; refused: {guard.last}"
        self._refused, self._failures = refused, failures
        more = {"refused_messages": refused, "failed_callbacks": failures}
        return level, message, {**values, **more}
