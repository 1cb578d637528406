"""The controller's side of the propulsion unit: commands at 100 Hz, and whether it can be used."""

from __future__ import annotations

import math
import time
from collections import deque

from rclpy.node import Node
from rclpy.subscription import Subscription

from husky_control.controller import Controller
from husky_description import graph
from husky_description.lockstep import Peer
from husky_description.nodes import qos, stamps
from husky_msgs.msg import PropulsionCommand, PropulsionState

COMMAND_PERIOD_NS = 10_000_000
"""Between two commands [ns]."""
_STATE_DELAY_NS = 60_000_000
"""In lockstep a tick knows the unit's state of this long ago: the period and the way [ns]."""
_STATE_TIMEOUT_NS = 300_000_000
"""A unit that has not been heard for so long is not used [ns]."""


class FansLink:
    """Tells the bridge what the controller asks for.

    Attributes:
        hot: subscription to the unit's state.
    """

    def __init__(self, node: Node, grace: float, *, lockstep: bool):
        """Open publisher and subscription.

        Args:
            node: the controller's.
            lockstep: a tick takes the state of a fixed time before it; otherwise the newest.
            grace: wall time a silent bridge is waited for in lockstep, once heard [s].
        """
        self._node = node
        self._peer = Peer(graph.PIXHAWK_BRIDGE, grace, start_grace=None)
        self._delay_ns = _STATE_DELAY_NS if lockstep else 0
        self._states: deque[PropulsionState] = deque(maxlen=32)
        self._command = PropulsionCommand()
        self._publisher = node.create_publisher(
            PropulsionCommand, graph.PROPULSION_COMMAND, qos.CONTROL
        )
        self.hot: Subscription = node.create_subscription(
            PropulsionState, graph.PROPULSION_STATE, self._on_state, qos.STATUS
        )

    def _on_state(self, state: PropulsionState) -> None:
        self._states.append(state)
        self._peer.answer(stamps.to_ns(state.stamp))

    def ready(self, time_ns: int) -> bool:
        """Return whether a tick of this time knows what it is to know of the unit."""
        return self._peer.ready(time_ns - _STATE_DELAY_NS)

    def watch(self, time_ns: int) -> None:
        """Give a silent bridge up."""
        if not self.ready(time_ns) and self._peer.expire(time.monotonic()):
            self._node.get_logger().warning(f"{self._peer.name} is silent: the fans are not used")

    def _known(self, time_ns: int) -> PropulsionState | None:
        """Return the state that a tick of this time knows."""
        states, due = self._states, time_ns - self._delay_ns
        while len(states) > 1 and stamps.to_ns(states[1].stamp) <= due:
            states.popleft()
        return states[0] if states and stamps.to_ns(states[0].stamp) <= due else None

    def yaw(self, time_ns: int) -> float:
        """Return the heading of base by the flight controller [rad], nan when it is not known."""
        state = self._known(time_ns)
        if state is None or not state.connected:
            return math.nan
        q = state.attitude
        return math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))

    def available(self, time_ns: int) -> bool:
        """Return whether the unit is armed, follows commands, and has been heard of late."""
        state = self._known(time_ns)
        return (
            state is not None
            and time_ns - stamps.to_ns(state.stamp) < _STATE_TIMEOUT_NS
            and state.connected
            and state.armed
            and state.mode == "OFFBOARD"
            and not state.failsafe
        )

    def limit(self, time_ns: int) -> float:
        """Return the most thrust that is left without a lost fan [N], infinite with all of them."""
        state = self._known(time_ns)
        if state is None or all(state.fan_ok):
            return math.inf
        return float(state.thrust_limit)

    def tell(self, time_ns: int, controller: Controller) -> None:
        """Send the command when it is due: an attitude in flight, a wrench otherwise.

        On an incline the wrench is a force at the centre of mass in any direction.
        """
        if time_ns % COMMAND_PERIOD_NS:
            return
        assist, hover, command = controller.assist, controller.hover, self._command
        stamps.fill(command.stamp, time_ns)
        moment, attitude = command.moment, command.attitude
        if hover.active:
            command.kind = PropulsionCommand.ATTITUDE
            command.force.x = command.force.y = 0.0
            command.force.z = float(hover.force)
            attitude.x, attitude.y, attitude.z, attitude.w = hover.attitude.tolist()
            moment.x = moment.y = moment.z = 0.0
        else:
            command.kind = PropulsionCommand.WRENCH
            force = controller.thrust_in_base
            command.force.x, command.force.y, command.force.z = force.tolist()
            attitude.x, attitude.y, attitude.z, attitude.w = 0.0, 0.0, 0.0, 1.0
            moment.x, moment.y, moment.z = assist.moment.tolist()
        self._publisher.publish(command)

    def restart(self) -> None:
        """The world starts again: what was known is of another time."""
        self._peer.restart()
        self._states.clear()
