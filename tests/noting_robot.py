"""A robot for tests of who operates it: it notes what it is asked for, and does as it is told."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

from action_msgs.msg import GoalInfo
from action_msgs.srv import CancelGoal
from geometry_msgs.msg import PoseStamped, Twist
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from husky_msgs.msg import (
    ControllerMode,
    ControllerState,
    DriveStatus,
    DriveStatusArray,
    ModeTable,
    PropulsionState,
)
from husky_msgs.srv import ResetWorld, SetFlightMode, SetGait, SetMode
from husky_runtime import graph
from husky_runtime.nodes import qos

MODES = {
    "passive": ["stand_up", "righting"],
    "stand": ["walk", "sit"],
    "walk": ["stand"],
    "sit": ["stand_up"],
    "righting": [],
}
"""Modes, and what may be asked for in them."""


class NotingRobot:
    """Services and topics of drives, controller and fans.

    Attributes:
        calls: what has been asked for, in order.
        velocities: that have come.
        state: of the controller, told fifty times a second.
        drives: theirs, likewise.
        fans: theirs, None for a robot without any.
        broken: services that refuse.
    """

    def __init__(self, node: Node):
        """Offer all that a robot offers, through a node."""
        self._node = node
        self.calls: list[str] = []
        self.velocities: list[tuple[float, float, float]] = []
        self.state = ControllerState(mode="passive", gait="trot", velocity_limit=(1.6, 0.3, 0.8))
        self.drives = DriveStatusArray(drives=[DriveStatus() for _ in range(12)])
        self.fans: PropulsionState | None = None
        self.broken: set[str] = set()
        node.create_subscription(Twist, graph.CMD_VEL, self._on_velocity, qos.COMMAND)
        node.create_service(SetMode, graph.SET_MODE, self._on_mode)
        node.create_service(SetGait, graph.SET_GAIT, self._on_gait)
        node.create_service(SetBool, graph.PROPULSION_ARM, self._on_arm)
        node.create_service(SetFlightMode, graph.PROPULSION_SET_MODE, self._on_flight_mode)
        for name in (
            graph.DRIVES_ENABLE,
            graph.DRIVES_DISABLE,
            graph.DRIVES_RESET_FAULTS,
            graph.DRIVES_EMERGENCY_STOP,
            graph.DRIVES_CUT,
            graph.PROPULSION_KILL,
        ):
            node.create_service(Trigger, name, self._trigger(name))
        node.create_service(ResetWorld, graph.PLANT_RESET, self._on_reset)
        make = node.create_publisher
        self.states = make(ControllerState, graph.CONTROLLER_STATE, qos.STATUS)
        self._drives_publisher = make(DriveStatusArray, graph.DRIVES_STATUS, qos.STATUS)
        self._fans_publisher = make(PropulsionState, graph.PROPULSION_STATE, qos.STATUS)
        modes = [ControllerMode(name=name, requests=requests) for name, requests in MODES.items()]
        self._table = make(ModeTable, graph.MODE_TABLE, qos.LATCHED)
        self._table.publish(ModeTable(modes=modes, gaits=["trot", "crawl"]))
        node.create_timer(0.02, self._report)

    @contextlib.contextmanager
    def navigator(self) -> Iterator[list[PoseStamped]]:
        """Have a navigator meanwhile, with a goal that can be cancelled once.

        Yields:
            The goals that come by topic.
        """
        goals: list[PoseStamped] = []
        cancelable = [GoalInfo()]

        def cancel(request: Any, response: Any) -> Any:
            self.calls.append("cancel")
            assert request == CancelGoal.Request()  # all of them
            response.goals_canceling = [cancelable.pop()] if cancelable else []
            return response

        name = f"{graph.NAVIGATE_TO_POSE}/_action/cancel_goal"
        service = self._node.create_service(CancelGoal, name, cancel)
        ear = self._node.create_subscription(
            PoseStamped, graph.GOAL_POSE, goals.append, qos.COMMAND
        )
        try:
            yield goals
        finally:
            self._node.destroy_service(service)
            self._node.destroy_subscription(ear)

    def _report(self) -> None:
        self.states.publish(self.state)
        self._drives_publisher.publish(self.drives)
        if self.fans is not None:
            self._fans_publisher.publish(self.fans)

    def _on_velocity(self, twist: Twist) -> None:
        self.velocities.append((twist.linear.x, twist.linear.y, twist.angular.z))

    def _on_mode(self, request: Any, response: Any) -> Any:
        self.calls.append(request.mode)
        response.success = request.mode not in MODES or self.state.mode != request.mode
        response.message = "" if response.success else f"already in {request.mode}"
        self.state.mode = {"stand_up": "stand"}.get(request.mode, request.mode)
        return response

    def _on_gait(self, request: Any, response: Any) -> Any:
        self.calls.append(f"gait {request.gait}")
        self.state.gait = request.gait
        response.success = True
        return response

    def _on_arm(self, request: Any, response: Any) -> Any:
        self.calls.append(f"arm {request.data}")
        response.success = True
        return response

    def _on_flight_mode(self, request: Any, response: Any) -> Any:
        self.calls.append(request.mode)
        response.success = True
        return response

    def _on_reset(self, request: Any, response: Any) -> Any:
        self.calls.append(f"reset {request.keyframe!r} {request.seed}")
        response.success = True
        return response

    def _trigger(self, name: str) -> Callable[[Any, Any], Any]:
        def answer(request: Any, response: Any) -> Any:
            self.calls.append(name)
            self.drives.operational = name == graph.DRIVES_ENABLE
            response.success, response.message = name not in self.broken, "it is broken"
            return response

        return answer
