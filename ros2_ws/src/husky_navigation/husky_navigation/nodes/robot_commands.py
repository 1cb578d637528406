"""Commands of the navigator to the robot, by the interface that an operator has too."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from geometry_msgs.msg import Twist
from rcl_interfaces.srv import SetParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import SetBool

from husky_msgs.msg import PropulsionState
from husky_msgs.srv import SetFlightMode, SetMode
from husky_navigation.following.robot_wish import (
    PERCH,
    QUADROTOR,
    SPLAY,
    STAND,
    TROT,
    WAIR,
    FlightHeights,
    Wish,
)
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
_FOLLOWS_VELOCITY = (*_STEPPING, QUADROTOR)
_USES_FANS = (WAIR, QUADROTOR)
_NOTHING_HANGS_ON_FANS = (STAND, TROT, SPLAY)
_INTO_THE_AIR = {TROT: STAND, WAIR: STAND, STAND: PERCH, PERCH: SPLAY, SPLAY: QUADROTOR}
_ONTO_LEGS = {QUADROTOR: SPLAY, SPLAY: PERCH, PERCH: "stand_up"}
"""Mode that follows one, on the way to mode `quadrotor` and back."""


class RobotCommands:
    """Brings a robot to what is wished for: flight mode and arming, mode, velocity.

    Attributes:
        refusal: why the controller, or the autopilot, has refused the last request; "" if it has
            not.
        lands: the last mode that was asked for was the landing of a flight.
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
        node_name = graph.LOW_LEVEL_CONTROLLER
        self._parameters = node.create_client(SetParameters, f"{node_name}/set_parameters")
        self._heights: FlightHeights | None = None  # that are set at the controller
        self._requests: dict[str, tuple[float, Client, Future]] = {}  # when each was sent [s]
        self._fans: PropulsionState | None = None
        self._armed_at: float | None = None
        self._armed_by_us = False
        self.refusal = ""
        self.lands = False

    def hear(self, fans: PropulsionState) -> None:
        """Take a word of the propulsion unit."""
        self._fans = fans

    @property
    def has_fans(self) -> bool:
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
        self._begin_step(mode, now)
        self._set_fans(wish.fans, mode, now)
        if mode in _FOLLOWS_VELOCITY:
            twist = Twist()
            if wish.mode == mode:
                twist.linear.x, twist.linear.y, twist.angular.z = wish.velocity
            self._velocity.publish(twist)
        if wish.heights is not None and not self._set_heights(wish.heights, now):
            return
        wanted = _next_mode(mode, wish.mode)
        if wanted == mode or (wanted in _USES_FANS and not self.fans_ready(now)):
            return
        self.lands = mode == QUADROTOR
        self._request("mode", self._mode, SetMode.Request(mode=wanted), now)

    def rest(self, mode: str, now: float) -> None:
        """Disarm fans that were armed here, once nothing hangs on them."""
        self._begin_step(mode, now)
        self._set_fans(False, mode, now)

    def _begin_step(self, mode: str, now: float) -> None:
        """Forget what does not hold any more.

        Others set the heights of a flight too, before it; none of ours count for the next one.
        """
        self._forget_lost(now)
        if mode not in (SPLAY, QUADROTOR):
            self._heights, self.lands = None, False

    def _set_heights(self, heights: FlightHeights, now: float) -> bool:
        """Set the heights of a flight at the controller; return whether they are set."""
        if heights == self._heights:
            return True
        request = SetParameters.Request(
            parameters=[
                Parameter(f"quadrotor.{name}", value=value).to_parameter_msg()
                for name, value in heights._asdict().items()
            ]
        )
        take = partial(self._take_heights, heights)
        self._request("heights", self._parameters, request, now, take)
        return False

    def _take_heights(self, heights: FlightHeights, response: SetParameters.Response) -> str:
        """Note that heights are set; return why they are not."""
        refusals = [result.reason for result in response.results if not result.successful]
        if not refusals:
            self._heights = heights
        return "; ".join(refusals)

    def _set_fans(self, wanted: bool, mode: str, now: float) -> None:
        """Arm the fans and hand them over; disarm what was armed here, once nothing hangs on it.

        A mode that uses the fans began with them: if they do not follow the controller any more, a
        pilot has taken over, and is not to lose them again.
        """
        fans = self._fans
        if fans is None or (wanted and mode in _USES_FANS):
            return
        if wanted and fans.mode != "OFFBOARD":
            request = SetFlightMode.Request(mode="OFFBOARD")
            self._request("flight_mode", self._flight_mode, request, now)
        elif wanted and not fans.armed:
            self._request("arm", self._arm, SetBool.Request(data=True), now)
            self._armed_by_us = True
        elif not wanted and fans.armed and self._armed_by_us and mode in _NOTHING_HANGS_ON_FANS:
            self._request("arm", self._arm, SetBool.Request(data=False), now)
        elif not wanted and not fans.armed and now > self._sent("arm") + _ARMING:
            self._armed_by_us = False

    def _sent(self, kind: str) -> float:
        """Return when a kind of request was sent last [s]."""
        return self._requests[kind][0] if kind in self._requests else -math.inf

    def _request(
        self,
        kind: str,
        client: Client,
        request: Any,
        now: float,
        take: Callable[[Any], str] | None = None,
    ) -> None:
        """Send a request unless one of its kind is on its way, or was not long ago.

        Args:
            kind: of the request.
            client: of its service.
            request: of that service.
            now: time [s].
            take: takes the answer, returns why it refuses; None for an answer with `success`.
        """
        if kind in self._requests:
            sent, _, pending = self._requests[kind]
            if not pending.done() or 0.0 <= now - sent < _AGAIN:
                return
        if not client.service_is_ready():
            return
        future = client.call_async(request)
        self._requests[kind] = now, client, future
        future.add_done_callback(partial(self._note, take or _refusal_of))

    def _forget_lost(self, now: float) -> None:
        """Wait no longer for answers that do not come."""
        for sent, client, future in self._requests.values():
            if not future.done() and not 0.0 <= now - sent < _LOST:
                client.remove_pending_request(future)
                future.cancel()

    def _note(self, take: Callable[[Any], str], future: Future) -> None:
        answer = None if future.cancelled() else future.result()
        self.refusal = "" if answer is None else take(answer)
        self._on_answer()

    @property
    def waits(self) -> bool:
        """True as long as a request has no answer."""
        return any(not future.done() for *_, future in self._requests.values())


def _next_mode(mode: str, wanted: str) -> str:
    """Return the mode to ask for in a mode, on the way to the one that is wanted."""
    if wanted == QUADROTOR:
        return _INTO_THE_AIR.get(mode, mode)
    if mode in _ONTO_LEGS:
        return _ONTO_LEGS[mode]
    # From one mode that steps to the other through standing.
    return STAND if mode in _STEPPING and wanted != mode else wanted


def _refusal_of(answer: Any) -> str:
    """Return why a request was refused, "" if it was not."""
    return "" if answer.success else str(answer.message)
