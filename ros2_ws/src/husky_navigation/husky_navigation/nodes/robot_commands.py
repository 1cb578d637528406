"""Commands of the navigator to the robot, by the interface that an operator has too."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import Twist
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool

from husky_msgs.msg import PropulsionState
from husky_msgs.srv import SetFlightMode, SetMode
from husky_navigation.following.navigation import STAND, TROT, WAIR, Wish
from husky_runtime import graph
from husky_runtime.nodes import qos

_AGAIN = 0.4
"""Between two requests of a kind [s]; what was refused right after a stop is allowed then."""
_LOST = 3.0
"""Time after which a request without an answer counts as lost [s]."""
_ARMING = 2.0
"""Time after which fans that were asked to arm are told as armed [s]."""
_SPIN_UP = 1.5
"""Time for which fans are armed before they are used: their controllers want a second of low pulses
[s]."""
_STEPPING = (TROT, WAIR)


class RobotCommands:
    """Brings a robot to what is wished for: flight mode and arming, mode, velocity.

    Attributes:
        refusal: why the controller, or the autopilot, has refused the last request; "" if it has
            not.
    """

    def __init__(self, node: Node, on_answer: Callable[[], None]) -> None:
        """Make the clients.

        Args:
            node: of the navigator.
            on_answer: called when a request has been answered.
        """
        self._on_answer = on_answer
        self._velocity = node.create_publisher(Twist, graph.CMD_VEL, qos.COMMAND)
        self._mode = node.create_client(SetMode, graph.SET_MODE)
        self._flight_mode = node.create_client(SetFlightMode, graph.PROPULSION_SET_MODE)
        self._arm = node.create_client(SetBool, graph.PROPULSION_ARM)
        self._requests: dict[str, tuple[float, Client, Future]] = {}  # when each was sent [s]
        self._fans: PropulsionState | None = None
        self._armed_at: float | None = None
        self._armed_by_us = False
        self.refusal = ""

    def hear(self, fans: PropulsionState) -> None:
        """Take a word of the propulsion unit."""
        self._fans = fans

    @property
    def can_climb(self) -> bool:
        """True if there are fans, and none is lost."""
        fans = self._fans
        return fans is not None and bool(fans.connected) and all(fans.fan_ok)

    def fans_ready(self, now: float) -> bool:
        """Return whether the fans follow the controller, at a time [s]."""
        fans = self._fans
        if fans is None or not fans.armed:
            self._armed_at = None
        elif self._armed_at is None:
            self._armed_at = now
        ready = self._armed_at is not None and now >= self._armed_at + _SPIN_UP
        return fans is not None and fans.mode == "OFFBOARD" and ready

    def follow(self, wish: Wish, mode: str, now: float) -> None:
        """Ask for what is missing.

        Args:
            wish: what is wanted.
            mode: of the controller.
            now: time [s].
        """
        self._forget_lost(now)
        self._set_fans(wish.fans, mode, now)
        if mode in _STEPPING:
            twist = Twist()
            if wish.mode == mode:
                twist.linear.x, twist.linear.y, twist.angular.z = wish.velocity
            self._velocity.publish(twist)
        # From one mode that steps to the other through standing.
        wanted = STAND if mode in _STEPPING and wish.mode != mode else wish.mode
        if wanted == mode or (wanted == WAIR and not self.fans_ready(now)):
            return
        self._request("mode", self._mode, SetMode.Request(mode=wanted), now)

    def rest(self, mode: str, now: float) -> None:
        """Disarm fans that were armed here, once nothing hangs on them."""
        self._forget_lost(now)
        self._set_fans(False, mode, now)

    def _set_fans(self, wanted: bool, mode: str, now: float) -> None:
        """Arm the fans and hand them over; disarm what was armed here, once nothing hangs on it."""
        fans = self._fans
        if fans is None:
            return
        if wanted and fans.mode != "OFFBOARD":
            request = SetFlightMode.Request(mode="OFFBOARD")
            self._request("flight_mode", self._flight_mode, request, now)
        elif wanted and not fans.armed:
            self._request("arm", self._arm, SetBool.Request(data=True), now)
            self._armed_by_us = True
        elif not wanted and fans.armed and self._armed_by_us and mode in (STAND, TROT):
            self._request("arm", self._arm, SetBool.Request(data=False), now)
        elif not wanted and not fans.armed and now > self._sent("arm") + _ARMING:
            self._armed_by_us = False

    def _sent(self, kind: str) -> float:
        """Return when a kind of request was sent last [s]."""
        return self._requests[kind][0] if kind in self._requests else -math.inf

    def _request(self, kind: str, client: Client, request: Any, now: float) -> None:
        """Send a request unless one of its kind is on its way, or was not long ago."""
        if kind in self._requests:
            sent, _, pending = self._requests[kind]
            if not pending.done() or 0.0 <= now - sent < _AGAIN:
                return
        if not client.service_is_ready():
            return
        future = client.call_async(request)
        self._requests[kind] = now, client, future
        future.add_done_callback(self._note)

    def _forget_lost(self, now: float) -> None:
        """Wait no longer for answers that do not come."""
        for sent, client, future in self._requests.values():
            if not future.done() and not 0.0 <= now - sent < _LOST:
                client.remove_pending_request(future)
                future.cancel()

    def _note(self, future: Future) -> None:
        answer = None if future.cancelled() else future.result()
        self.refusal = "" if answer is None or answer.success else answer.message
        self._on_answer()

    @property
    def waits(self) -> bool:
        """True as long as a request has no answer."""
        return any(not future.done() for *_, future in self._requests.values())
