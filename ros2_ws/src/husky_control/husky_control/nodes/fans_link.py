"""The controller's side of the propulsion unit: commands at 100 Hz, and whether it can be used."""

from __future__ import annotations

import math

from rclpy.node import Node
from rclpy.subscription import Subscription

from husky_control.controller import Controller
from husky_control.nodes.tick_input import TickInput
from husky_control.tick_data import Measurements
from husky_description.rotation import to_roll_pitch_yaw
from husky_msgs.msg import PropulsionCommand, PropulsionState
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps
from husky_runtime.nodes.message_guard import check_count
from husky_runtime.nodes.presence import make_peer

COMMAND_PERIOD_NS = 10_000_000
"""Between two commands [ns]."""
_STATE_DELAY_NS = 60_000_000
"""In lockstep a tick knows the unit's state of this long ago: the period and the way [ns]."""
_STATE_TIMEOUT_NS = 300_000_000
"""A unit that has not been heard for so long is not used [ns]."""
_NOTHING_KNOWN = PropulsionState()


class FansLink(TickInput[PropulsionState]):
    """Tells the bridge what the controller asks for, and the controller what the bridge knows.

    Attributes:
        hot: subscription to the unit's state.
    """

    def __init__(self, node: Node, fans: int, grace: float, *, lockstep: bool):
        """Open publisher and subscription.

        Args:
            node: the controller's.
            fans: how many the robot has.
            lockstep: a tick takes the state of a fixed time before it; otherwise the newest.
            grace: wall time a silent bridge is waited for in lockstep, once heard [s].
        """
        peer = make_peer(node, graph.PIXHAWK_BRIDGE, grace, start_grace=None)
        super().__init__(
            node, graph.PROPULSION_STATE, peer, _STATE_DELAY_NS, 32, "the fans are not used"
        )
        self._fans = fans
        self._known_after_ns = _STATE_DELAY_NS if lockstep else 0
        self._command = PropulsionCommand()
        self._publisher = node.create_publisher(
            PropulsionCommand, graph.PROPULSION_COMMAND, qos.CONTROL_OFFERED
        )
        self.hot: Subscription = node.create_subscription(
            PropulsionState, graph.PROPULSION_STATE, self._on_state, qos.STATUS
        )

    def _on_state(self, state: PropulsionState) -> None:
        check_count("fan_ok", state.fan_ok, self._fans)
        check_count("fan_speed", state.fan_speed, self._fans)
        self._keep(stamps.to_ns(state.stamp), state)

    def fill(self, time_ns: int, measurements: Measurements) -> None:
        """Write what a tick of this time knows of the unit."""
        known = self._messages.known(time_ns - self._known_after_ns)
        m, state = measurements, known[1] if known is not None else _NOTHING_KNOWN
        m.fans_available = _follows(state, time_ns)
        m.fans_disarmed = state.connected and not state.armed
        # With a fan lost, what the others may give.
        lost = known is not None and not all(state.fan_ok)
        m.fans_limit = float(state.thrust_limit) if lost else math.inf
        m.fans_lost = [bool(ok) for ok in state.fan_ok].index(False) if lost else -1
        m.fans_yaw = _heading(state) if state.connected else math.nan

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
            force = controller.context.thrust_in_base
            command.force.x, command.force.y, command.force.z = force.tolist()
            attitude.x, attitude.y, attitude.z, attitude.w = 0.0, 0.0, 0.0, 1.0
            moment.x, moment.y, moment.z = assist.moment.tolist()
        self._publisher.publish(command)


def _follows(state: PropulsionState, time_ns: int) -> bool:
    """Return whether the unit is armed, follows commands, and has been heard of late."""
    return (
        time_ns - stamps.to_ns(state.stamp) < _STATE_TIMEOUT_NS
        and state.connected
        and state.armed
        and state.mode == "OFFBOARD"
        and not state.failsafe
    )


def _heading(state: PropulsionState) -> float:
    """Return the heading of base by the flight controller [rad]."""
    q = state.attitude
    return to_roll_pitch_yaw((q.x, q.y, q.z, q.w))[2]
