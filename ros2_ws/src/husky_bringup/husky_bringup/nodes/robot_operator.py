"""What an operator's node asks of the robot: velocities, modes, gaits, drives, emergency stop."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from geometry_msgs.msg import Twist
from rclpy.client import Client
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from husky_bringup.teleop_mapping import Action, JoystickLayout, Velocity, next_gait
from husky_msgs.msg import ControllerState, DriveStatusArray
from husky_msgs.srv import SetGait, SetMode
from husky_runtime import graph
from husky_runtime.nodes import qos
from husky_runtime.nodes.parameters import declare

COMMAND_RATE = 20.0
"""Of velocity commands [Hz]."""
_ENABLE_PERIOD = 5.0
"""How long standing up waits for the drives [s]."""
_NOT_FOLLOWED = 6
"""Velocities in a row for which a robot may stand before it is asked to walk."""


class RobotOperator:
    """Sends velocities, and calls services for everything else; nothing waits for an answer.

    Time here is the operator's, so it is wall time. A service that is not there or refuses is told.

    Attributes:
        state: what the controller has said last, given by the node; None for nothing yet.
        drives: the same of the joints.
        gaits: to choose from, in order.
    """

    def __init__(self, node: Node):
        """Find the robot's topic and services, and say which action calls what."""
        self._node = node
        self.state: ControllerState | None = None
        self.drives: DriveStatusArray | None = None
        self.gaits: Sequence[str] = ()
        self._outcomes: dict[str, str] = {}
        self._stand_up_until = 0.0
        self._not_followed = 0
        self._publisher = node.create_publisher(Twist, graph.CMD_VEL, qos.COMMAND)
        self._mode_client = node.create_client(SetMode, graph.SET_MODE)
        self._gait_client = node.create_client(SetGait, graph.SET_GAIT)
        self._enable_client = node.create_client(Trigger, graph.DRIVES_ENABLE)
        self._reset_client = node.create_client(Trigger, graph.DRIVES_RESET_FAULTS)
        self._stop_client = node.create_client(Trigger, graph.DRIVES_EMERGENCY_STOP)
        self._actions: dict[Action, Callable[[], None]] = {
            Action.STAND_UP: self._stand_up,
            Action.SIT: lambda: self.set_mode("sit"),
            Action.WALK: lambda: self.set_mode("walk"),
            Action.STOP: self._stop,
            Action.NEXT_GAIT: self._next_gait,
            Action.RECOVER: self._recover,
            Action.EMERGENCY_STOP: self._emergency_stop,
        }

    def act(self, action: Action) -> None:
        """Do what an operator asks for."""
        self._actions[action]()

    def drive(self, velocity: Velocity) -> None:
        """Send a velocity; a robot that goes on standing, as it is not woken, is asked to walk."""
        stands = velocity.moving and self._mode == "stand"
        self._not_followed = self._not_followed + 1 if stands else 0
        if self._not_followed > _NOT_FOLLOWED:
            self._not_followed = 0
            self.act(Action.WALK)
        twist = Twist()
        twist.linear.x, twist.linear.y = velocity.forward, velocity.left
        twist.angular.z = velocity.yaw
        self._publisher.publish(twist)

    def go_on(self, now: float) -> None:
        """Stand up, if that was asked for, as soon as the drives are enabled; now [s]."""
        if self._stand_up_until and self._operational:
            self._stand_up_until = 0.0
            self.set_mode("stand_up")
        elif self._stand_up_until and now > self._stand_up_until:
            self._stand_up_until = 0.0
            self.tell("the drives are not enabled")

    def halt(self) -> None:
        """Send zero, and see that it is taken: the node ends."""
        self._publisher.publish(Twist())
        self._publisher.wait_for_all_acked(Duration(seconds=0.5))

    def set_mode(self, mode: str, *, also: bool = False) -> None:
        """Ask for a mode, if need be as a part of what has been asked for just before."""
        what = mode.replace("_", " ")
        self.call(self._mode_client, SetMode.Request(mode=mode), what, also=also)

    def set_gait(self, gait: str) -> None:
        """Ask for a gait."""
        self.call(self._gait_client, SetGait.Request(gait=gait), f"gait {gait}")

    def enable(self) -> None:
        """Enable the drives."""
        self.call(self._enable_client, Trigger.Request(), "enable drives")

    def reset_faults(self) -> None:
        """Reset the faults of the drives."""
        self.call(self._reset_client, Trigger.Request(), "reset faults")

    @property
    def said(self) -> str:
        """How that has gone which was asked for last."""
        return "; ".join(self._outcomes.values())

    def tell(self, outcome: str) -> None:
        """Say how something has gone, from any thread."""
        self._outcomes = {"": outcome}

    def call(self, client: Client, request: Any, what: str, *, also: bool = False) -> None:
        """Call a service without waiting; say how it went when it answers.

        Args:
            client: of the service.
            request: what to ask for.
            what: the same in words.
            also: it belongs to what has been asked for just before.
        """
        outcomes = self._outcomes if also else {}
        self._outcomes = outcomes
        if not client.service_is_ready():
            outcomes[what] = f"{what}: {client.srv_name} is not there"
            return

        def answered(future: Future) -> None:
            response = future.result()
            if response is not None:
                outcome = "done" if response.success else f"refused, {response.message}"
                outcomes[what] = f"{what}: {outcome}"

        outcomes[what] = f"{what} ..."
        client.call_async(request).add_done_callback(answered)

    @property
    def _mode(self) -> str:
        return self.state.mode if self.state is not None else ""

    @property
    def _operational(self) -> bool:
        return self.drives is not None and self.drives.operational

    def _stand_up(self) -> None:
        """Enable the drives if need be, then stand up."""
        if self._operational:
            self.set_mode("stand_up")
        else:
            self._stand_up_until = time.monotonic() + _ENABLE_PERIOD
            self.enable()

    def _stop(self) -> None:
        """Stop walking; asked for in another mode, `stand` would make the robot rise."""
        if self._mode == "walk":
            self.set_mode("stand")

    def _next_gait(self) -> None:
        if self.gaits:
            self.set_gait(next_gait(self.gaits, self.state.gait if self.state is not None else ""))

    def _recover(self) -> None:
        self.reset_faults()
        self.set_mode("passive", also=True)

    def _emergency_stop(self) -> None:
        """Stop the drives, which works without a controller; then tell the controller."""
        self._stand_up_until = 0.0
        self.call(self._stop_client, Trigger.Request(), "EMERGENCY STOP")
        self.set_mode("emergency_stop", also=True)


def declare_limits(node: Node) -> Velocity:
    """Declare the velocities at full command."""
    return Velocity(
        declare(node, "max_forward", 0.5, "forward speed [m/s]", lower=0.0, upper=2.0),
        declare(node, "max_lateral", 0.3, "sideways speed [m/s]", lower=0.0, upper=1.0),
        declare(node, "max_yaw_rate", 0.8, "yaw rate [rad/s]", lower=0.0, upper=2.0),
    )


def declare_layout(node: Node) -> JoystickLayout:
    """Declare what is where on a joystick, as parameters joy_<name>, -1 for nowhere."""
    layout = JoystickLayout()
    return JoystickLayout(
        **{
            name: declare(node, f"joy_{name}", getattr(layout, name), what, lower=-1, upper=31)
            for name, what in _PLACES.items()
        }
    )


_PLACES = {
    "forward": "axis for forward",
    "left": "axis for left",
    "yaw": "axis for turning left",
    "dead_man": "button that must be held to move",
    "stand_up": "button to stand up",
    "emergency_stop": "button for the emergency stop",
    "sit": "button to sit down",
    "next_gait": "button for the next gait",
}
