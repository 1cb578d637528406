"""The controller's side of the planner: asks for a plan when the slope has changed (T28-T31)."""

from __future__ import annotations

import time
from typing import Any

from rclpy.node import Node

from husky_control.controller import Controller
from husky_control.nodes.plan_message import from_message
from husky_control.plan_query import PlanQuery, next_query
from husky_msgs.srv import PlanCycle
from husky_runtime import graph
from husky_runtime.lockstep import Presence
from husky_runtime.nodes.presence import make_peer

_DELAY_NS = 200_000_000
"""In lockstep a plan is followed from so long after it has been asked for [ns]."""
_PATIENCE_NS = 10_000_000_000
"""After which a query of a planner that has been given up is made anew [ns]."""


class PlanLink:
    """Asks for one plan at a time; the robot climbs on by the last one, or by statics, meanwhile.

    Attributes:
        plans: how many have been followed.
        refusals: how many times there was none.
    """

    def __init__(self, node: Node, grace: float, *, lockstep: bool):
        """Make the client.

        Args:
            node: the controller's.
            grace: wall time a silent planner is waited for in lockstep [s].
            lockstep: a plan is followed from a fixed time after its query; otherwise from its
                arrival.
        """
        self.plans = self.refusals = 0
        self._node = node
        self._client = node.create_client(PlanCycle, graph.PLAN_CYCLE)
        self._peer = make_peer(node, graph.PLANNER, grace, start_grace=None)
        self._lockstep = lockstep
        self._last: PlanQuery | None = None
        self._waiting = False
        self._future: Any = None
        self._due_ns = 0

    def ready(self, time_ns: int) -> bool:
        """Return whether a tick of this time knows the plan that it is to know."""
        if not self._waiting or time_ns < self._due_ns:
            return True
        self._poll()
        return self._answered() or self._peer.presence is Presence.LOST

    def watch(self, time_ns: int) -> None:
        """Give a silent planner up."""
        self._send()
        if not self.ready(time_ns) and self._peer.expire(time.monotonic()):
            self._node.get_logger().warning(f"{self._peer.name} is silent: climbing without plans")

    def tick(self, time_ns: int, controller: Controller) -> None:
        """Before the controller's tick: hand it a plan that is due, ask for the next one."""
        if self._waiting:
            self._send()
            if self._answered() and (time_ns >= self._due_ns or not self._lockstep):
                self._take(controller)
            elif time_ns > self._due_ns + _PATIENCE_NS:
                self._waiting, self._last, self._future = False, None, None
            return
        query = next_query(controller, self._last)
        if query is None:
            return
        self._last, self._waiting, self._due_ns = query, True, time_ns + _DELAY_NS
        self._peer.expect()
        self._send()

    def restart(self, _: int) -> None:
        """The world starts again: what was asked for is of another time."""
        self._peer.restart()
        self._last, self._waiting, self._future = None, False, None

    def _send(self) -> None:
        """Send the query, once, as soon as the planner is there."""
        if self._waiting and self._future is None and self._client.service_is_ready():
            query = self._last
            assert query is not None
            request = PlanCycle.Request(
                slope=query.slope,
                speed=query.speed,
                load_slope=query.load_slope,
                thrust_mode=query.thrust_mode,
                thrust_limit=query.thrust_limit,
            )
            self._future = self._client.call_async(request)

    def _poll(self) -> None:
        """Look for the answer: whoever waits for this tick does not look at services."""
        if self._future is None or self._future.done():
            return
        header, response = self._client.handle.take_response(PlanCycle.Response)
        if header is not None:
            number = header.request_id.sequence_number
            self._client.get_pending_request(number).set_result(response)

    def _answered(self) -> bool:
        return self._future is not None and bool(self._future.done())

    def _take(self, controller: Controller) -> None:
        response: PlanCycle.Response = self._future.result()
        self._waiting, self._future = False, None
        self._peer.answer(0)
        accepted, reason = response.success, response.message
        if accepted:
            try:
                accepted, reason = controller.take_plan(from_message(response.plan))
            except ValueError as error:
                accepted, reason = False, str(error)
        if accepted:
            self.plans += 1
            return
        self.refusals += 1
        self._node.get_logger().warning(f"climbing on without a new plan: {reason}")
