"""What a running graph tells an experiment: the newest reports, and whether any are late.

Reports are fetched, they wake nobody: who is woken by each of the thousands that come while the
world steps takes a fifth of a processor from the nodes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.callback_groups import CallbackGroup
from rclpy.subscription import Subscription

from husky_experiments.link import GraphLink
from husky_msgs.msg import (
    ControllerState,
    DriveStatusArray,
    FanState,
    NavigatorState,
    PropulsionState,
)
from husky_runtime import graph
from husky_runtime.nodes import stamps

_REPORT_PERIOD = 5.0
"""Wall time that a report may be late, after which its node counts as silent [s]. One that is lost
is sent again within 3 s, the middleware's heartbeat."""
_GLANCE, _LOOK = 0.001, 0.02
"""Wall time between two looks for a late report: at first, most are here at once, and later [s]."""
_REPORTS = {
    graph.GROUND_TRUTH: 10_000_000,
    graph.FAN_STATE: 10_000_000,
    graph.CONTROLLER_STATE: 20_000_000,
    graph.MAP_POSE: 20_000_000,
    graph.NAVIGATOR_STATE: 100_000_000,
    graph.DRIVES_STATUS: 100_000_000,
}
"""Periods of what nodes report of themselves [ns]."""
_BY_LEGS = (graph.CONTROLLER_STATE, graph.MAP_POSE, graph.NAVIGATOR_STATE)
_REPORTERS = {
    graph.PLANT: (graph.GROUND_TRUTH, graph.FAN_STATE),
    **dict.fromkeys(graph.JOINT_BRIDGES, (graph.DRIVES_STATUS, *_BY_LEGS)),
    graph.LOW_LEVEL_CONTROLLER: _BY_LEGS,
    graph.LOCALIZER: (graph.MAP_POSE, graph.NAVIGATOR_STATE),
    graph.NAVIGATOR: (graph.NAVIGATOR_STATE,),
}
"""Topics that stop without a node: the controller ticks by the joint states, the localizer
publishes with each of the controller's poses, and the navigator with each fifth of those."""


def waiting(subscription: Subscription) -> Iterator[Any]:
    """Take the messages that wait in the queue of a subscription which no executor serves."""
    with (queue := subscription.handle):
        while (taken := queue.take_message(subscription.msg_type, False)) is not None:
            yield taken[0]


class _Unserved(CallbackGroup):
    """What no executor waits for or serves."""

    def can_execute(self, entity: Any) -> bool:
        """Never."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Never."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Nothing has begun."""


class HeardGraph(GraphLink):
    """A graph whose nodes' reports are kept.

    Attributes:
        time: simulated time [s].
        state: newest message of the controller, or None; also after `kill`.
        truth: newest ground truth, or None.
        drives: newest state of the drives, or None.
        fans: newest truth about the fans, or None.
        propulsion: newest state of the propulsion unit, or None.
        map_pose: newest pose of the base in `map`, or None.
        navigator: newest state of the navigator, or None.
    """

    _reports: Sequence[Subscription] = ()  # nobody listens before the graph is complete
    _excused: Sequence[str] = ()  # topics of which nothing is expected

    def _listen(self) -> None:
        names = {spec.name for spec in self.specs}
        self._has_legs = not names.isdisjoint(graph.JOINT_BRIDGES)
        self._has_fans = graph.PIXHAWK_BRIDGE in names
        self._has_map = graph.LOCALIZER in names
        self._forget()
        unserved = _Unserved()
        self._reports = [
            self.subscribe(kind, topic, take, unserved)
            for kind, topic, take in (
                (ControllerState, graph.CONTROLLER_STATE, self._on_state),
                (Odometry, graph.GROUND_TRUTH, self._on_truth),
                (DriveStatusArray, graph.DRIVES_STATUS, self._on_drives),
                (FanState, graph.FAN_STATE, self._on_fans),
                (PropulsionState, graph.PROPULSION_STATE, self._on_propulsion),
                (PoseWithCovarianceStamped, graph.MAP_POSE, self._on_map_pose),
                (NavigatorState, graph.NAVIGATOR_STATE, self._on_navigator),
            )
        ]
        self._radio_frames = 0
        self._lost_peers: list[str] | None = None
        self.subscribe(DiagnosticArray, graph.DIAGNOSTICS, self._on_diagnostics)

    def serve(self, patience: float) -> None:
        """Serve a callback of what comes within a while of wall time [s]; fetch the reports."""
        super().serve(patience)
        for report in self._reports:
            for message in waiting(report):
                report.callback(message)

    def _forget(self) -> None:
        """Drop what has been reported: it is of a world that is no more."""
        self._reported = dict.fromkeys(_REPORTS, 0)
        if not self._has_legs:
            del self._reported[graph.CONTROLLER_STATE], self._reported[graph.DRIVES_STATUS]
        if not self._has_fans:
            del self._reported[graph.FAN_STATE]
        if not self._has_map:
            del self._reported[graph.MAP_POSE], self._reported[graph.NAVIGATOR_STATE]
        self.time = 0.0
        self.state: ControllerState | None = None
        self.truth: Odometry | None = None
        self.drives: DriveStatusArray | None = None
        self.fans: FanState | None = None
        self.propulsion: PropulsionState | None = None
        self.map_pose: PoseWithCovarianceStamped | None = None
        self.navigator: NavigatorState | None = None

    def _hears_reports(self) -> bool:
        """Return whether everybody who reports has been found."""
        topics = [graph.GROUND_TRUTH]
        if self._has_legs:
            topics += [graph.CONTROLLER_STATE, graph.DRIVES_STATUS]
        if self._has_fans:
            topics += [graph.FAN_STATE, graph.PROPULSION_STATE]
        if self._has_map:
            topics += [graph.MAP_POSE, graph.NAVIGATOR_STATE]
        return all(self.count_publishers(topic) >= 1 for topic in topics)

    def _catch_up(self) -> None:
        """Wait for the reports of the ticks gone by, of the nodes that do report."""
        now = round(self.time * 1e9)
        deadline, patience = self.now() + _REPORT_PERIOD, _GLANCE
        while late := [
            topic
            for topic, stamp in self._reported.items()
            if stamp <= now - _REPORTS[topic] and topic not in self._excused
        ]:
            if self.now() > deadline:
                for topic in late:
                    del self._reported[topic]
                return
            self.serve(patience)
            patience = min(2.0 * patience, _LOOK)

    @contextmanager
    def unheard(self, node: str) -> Iterator[None]:
        """Meanwhile nobody waits for what a node reports of its ticks: it has none, or is stopped.

        Without that each step waits until it is sure that the node is silent.
        """
        before = self._excused
        self._excused = (*before, *_REPORTERS[node])
        try:
            yield
        finally:
            self._excused = before

    def kill(self, node: str) -> None:
        """Kill a node (SIGKILL), and forget what it has said; the others must do without it."""
        super().kill(node)
        for topic in _REPORTERS.get(node, ()):
            self._reported.pop(topic, None)
        if node == graph.LOW_LEVEL_CONTROLLER:
            self.state = None
        elif node in graph.JOINT_BRIDGES:
            self.drives = None

    @property
    def connected(self) -> bool:
        """Whether the bridge has told that it hears the autopilot."""
        return self.propulsion is not None and bool(self.propulsion.connected)

    # Callbacks ------------------------------------------------------------------------------
    def _on_state(self, state: ControllerState) -> None:
        self.state = state
        self._reported[graph.CONTROLLER_STATE] = stamps.to_ns(state.stamp)

    def _on_truth(self, truth: Odometry) -> None:
        self.truth = truth
        self._reported[graph.GROUND_TRUTH] = stamps.to_ns(truth.header.stamp)

    def _on_map_pose(self, pose: PoseWithCovarianceStamped) -> None:
        self.map_pose = pose
        self._reported[graph.MAP_POSE] = stamps.to_ns(pose.header.stamp)

    def _on_navigator(self, state: NavigatorState) -> None:
        self.navigator = state
        self._reported[graph.NAVIGATOR_STATE] = stamps.to_ns(state.stamp)

    def _on_fans(self, fans: FanState) -> None:
        self.fans = fans
        self._reported[graph.FAN_STATE] = stamps.to_ns(fans.stamp)

    def _on_propulsion(self, propulsion: PropulsionState) -> None:
        self.propulsion = propulsion

    def _on_diagnostics(self, report: DiagnosticArray) -> None:
        for status in report.status:
            for entry in status.values:
                if entry.key == "sbus_frames":
                    self._radio_frames = int(entry.value)
                elif entry.key == "lost_peers":
                    self._lost_peers = entry.value.split()

    def _on_drives(self, drives: DriveStatusArray) -> None:
        self.drives = drives
        self._reported[graph.DRIVES_STATUS] = stamps.to_ns(drives.stamp)
