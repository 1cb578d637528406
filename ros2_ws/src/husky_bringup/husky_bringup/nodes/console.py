"""Node `console`: the robot in a browser.

The picture and its panels are viser's, and what is on them is the page's affair
(`husky_bringup.console`); around it is a page with which operators steer. This node listens while
somebody looks, and brings the page up to date `rate` times a second of wall time. A topic that is
faster is thinned out in the middleware's queue: no more is decoded than is drawn.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from action_msgs.srv import CancelGoal
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.subscription import Subscription

from husky_bringup.console import page
from husky_bringup.console.clicked_goals import STOP_GOING, ClickedGoals
from husky_bringup.console.frame_tree import Pose
from husky_bringup.console.operator_server import VIEW
from husky_bringup.console.server import PORT, PageServer
from husky_bringup.definitions import message_class
from husky_bringup.nodes.open_gate import open_gate
from husky_bringup.nodes.raw_subscription import RawSubscription
from husky_bringup.nodes.remote_parameters import RemoteParameters
from husky_bringup.nodes.service_calls import ServiceCalls
from husky_bringup.nodes.shown import decode_shown
from husky_bringup.nodes.steering import SOURCES, Steering
from husky_bringup.outcome import Outcome
from husky_description.arrays import Array
from husky_runtime import graph
from husky_runtime.nodes import diagnostics, qos
from husky_runtime.nodes.executor import executor_of, wake
from husky_runtime.nodes.message_guard import MessageGuard, Refused
from husky_runtime.nodes.one_clock import OneClock, longest_look
from husky_runtime.nodes.parameters import declare
from husky_runtime.nodes.run import run
from husky_runtime.patient_clock import PatientClock

_PATIENCE = 10.0
"""Wall time in which a node answers with its parameters [s]."""
_PARAMETER_EVENTS = graph.Topic(
    page.PARAMETER_EVENTS, "rcl_interfaces/msg/ParameterEvent", (), "COMMAND", 0.0
)
_CANCELS = tuple(
    f"{action}/_action/cancel_goal"
    for action in (
        graph.NAVIGATE_TO_POSE,
        graph.NAVIGATE_THROUGH_POSES,
        graph.FOLLOW_PATH,
        graph.FOLLOW_WAYPOINTS,
    )
)
"""Services that end what the robot is sent to."""
_DEPTH = 100
"""Messages that wait for the next look at a topic that is drawn whole; of maps one does."""


@dataclass(slots=True)
class _Source:
    """A subscription, and what takes its messages past the node's guard."""

    subscription: RawSubscription
    enter: Callable[[bytes], None]


class Console(OneClock, Node):
    """Serves the page."""

    def __init__(self) -> None:
        """Declare parameters, open the page and the gate before it."""
        super().__init__(graph.CONSOLE)
        self._rate = declare(
            self, "rate", 30.0, "drawings in a second of wall time [Hz]", 1.0, 60.0
        )
        self._patient_clock = PatientClock(longest_look(self))
        self._server = PageServer()
        self._calls = ServiceCalls(self, partial(wake, self), _PATIENCE)
        parameters = RemoteParameters(self, self._calls)
        self._page = page.Page(self._server, self.get_namespace().strip("/"), parameters)
        self._sources: list[_Source] = []
        self._taken = 0
        self.hot: Sequence[Subscription] = []
        self.create_timer(1.0 / self._rate, self._turn)
        self._steering = Steering(self)
        self._goal_publisher = self.create_publisher(PoseStamped, graph.GOAL_POSE, qos.COMMAND)
        for name in _CANCELS:
            self._calls.meet(name, CancelGoal)
        self._goals = ClickedGoals(self._server.scene, self._go, self._stop_going)
        self._steering.server.goals = self._goals
        self.hot_wires = [self._steering.serve, self._calls.serve]
        places = {VIEW: self._server.get_port()}
        self._gate = open_gate(self, self._steering.server.port, PORT, (), places)
        self._diagnostics = diagnostics.Diagnostics(self, "browser", self._report)
        print(f"the robot is at {self._gate.address('http')}", flush=True)

    def _turn(self) -> None:
        """Take what has come and draw it, while somebody looks."""
        if self._is_looked_at != bool(self._sources):
            (self._leave if self._sources else self._listen)()
        for source in self._sources:
            for _ in range(source.subscription.depth):
                message = source.subscription.take()
                if message is None:
                    break
                self._taken += 1
                source.enter(message)
        if self._sources:
            self._guard.run("the page", self._draw)
        self._goals.turn()

    @property
    def _is_looked_at(self) -> bool:
        return bool(self._server.get_clients()) or len(self._steering) > 0

    @property
    def _guard(self) -> MessageGuard:
        executor = executor_of(self)
        assert executor is not None  # which calls the timer
        return executor.guard

    def _draw(self) -> None:
        now = self.get_clock().now().nanoseconds / 1e9
        self._page.draw(now, self._patient_clock.read(time.monotonic()))

    def _go(self, origin: Array, direction: Array) -> Pose:
        """Send the robot where a ray of the picture leads; raises ValueError, as `Page.pick`."""
        if not self.count_services(self.resolve_service_name(_CANCELS[0])):
            raise ValueError("there is no navigator")
        goal = self._page.pick(origin, direction)
        message = PoseStamped()
        message.header.frame_id = graph.FRAME_MAP
        message.header.stamp = self.get_clock().now().to_msg()
        place, turn = message.pose.position, message.pose.orientation
        place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w = goal
        self._goal_publisher.publish(message)
        return goal

    def _stop_going(self, outcome: Outcome) -> None:
        """Cancel all goals of the navigator, whoever has given them."""
        there = [name for name in _CANCELS if self.count_services(self.resolve_service_name(name))]
        if not there:
            outcome.refuse("", f"{STOP_GOING}: there is no navigator")
            return
        outcome.wait(STOP_GOING)
        calls = [self._calls.call(name, CancelGoal, CancelGoal.Request()) for name in there]

        def note(_: Future[Any]) -> None:
            if not all(call.done() for call in calls):
                return
            errors = [error for call in calls if (error := call.exception()) is not None]
            if errors:
                outcome.refuse(STOP_GOING, f"{STOP_GOING}: {errors[0]}")
            elif any(call.result().goals_canceling for call in calls):
                outcome.finish(STOP_GOING)
            else:
                outcome.refuse(STOP_GOING, f"{STOP_GOING}: no action is under way")

        for call in calls:
            call.add_done_callback(note)

    def _listen(self) -> None:
        """Subscribe to what the page shows; what is latched comes at once."""
        self._steering.forget()
        for row in (*graph.TOPICS, _PARAMETER_EVENTS):
            if row.relative in (*SOURCES, *page.SOURCES):
                topic = replace(row, relative=self.resolve_topic_name(row.relative))
                take = partial(self._take, row.relative, message_class(row.type))
                enter = self._guard.guarded(take, topic.name, bytes, raw=True)
                # Where the next message replaces one that is lost, none need be acknowledged: that
                # is work for who publishes it.
                is_fast = row.rate > self._rate
                follows = is_fast or row.relative == graph.TF
                depth = 1 if is_fast or row.relative == graph.ELEVATION_MAP else _DEPTH
                offered = qos.CONTROL if follows else qos.PROFILES[row.qos]
                subscription = RawSubscription(self, topic, offered, depth)
                self._sources.append(_Source(subscription, enter))

    def _leave(self) -> None:
        for source in self._sources:
            source.subscription.close()
        self._sources.clear()
        self._steering.forget()

    def _take(self, topic: str, kind: Any, data: bytes) -> None:
        """Take a message of a topic as it came; raises Refused for one that is none."""
        try:
            message = decode_shown(topic, data, kind)
            if topic in SOURCES:
                self._steering.take(topic, message)
            if topic in page.SOURCES:
                self._page.take(topic, message, self._patient_clock.read(time.monotonic()))
        except ValueError as error:
            raise Refused(str(error)) from error

    def _report(self) -> diagnostics.Report:
        values = {
            "address": self._gate.address("http").partition("/?")[0],
            "browsers": len(self._server.get_clients()),
            "operators": len(self._steering),
            "refused_from_operators": self._steering.server.refused,
            "connections": self._gate.connections,
            "refused_connections": self._gate.refused,
            "messages": self._taken,
            "skipped": "; ".join(self._page.skipped),
        }
        return diagnostics.OK, "serving", values

    def quiet(self) -> None:
        """Nothing to do: there are no hot subscriptions."""

    def close(self) -> None:
        """Close the gate and the page."""
        self._gate.close()
        self._steering.close()
        self._calls.close()
        self._page.close()
        self._leave()
        self._server.stop()


def main() -> int:
    """Run the node."""
    return run(Console)


if __name__ == "__main__":
    sys.exit(main())
