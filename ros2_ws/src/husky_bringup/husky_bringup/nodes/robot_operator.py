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

from husky_bringup.outcome import Outcome
from husky_bringup.robot_state import RIGHTING, STEPPING, Known
from husky_bringup.teleop_mapping import Action, JoystickLayout, Velocity, next_gait
from husky_msgs.msg import ControllerState, DriveStatusArray, ModeTable
from husky_msgs.srv import ResetWorld, SetGait, SetMode
from husky_runtime import graph
from husky_runtime.nodes import qos
from husky_runtime.nodes.one_clock import longest_look
from husky_runtime.nodes.parameters import declare
from husky_runtime.patient_clock import PatientClock

COMMAND_RATE = 20.0
"""Of velocity commands [Hz]."""
_ENABLE_PERIOD = 5.0
"""How long standing up waits for the drives [s]."""
_MOST_UNANSWERED = 4
"""Requests to one service that wait for an answer before more are refused, other than stops. A
service keeps the ten newest of those that it has not taken yet, and forgets the others."""
_FORGOTTEN = 10.0
"""Operator's time after which a request without an answer is not counted any more [s]."""
_EMERGENCY_STOP = "emergency_stop"
_NOT_FOLLOWED = 6
"""Velocities in a row for which a robot may stand before it is asked to walk."""


class RobotOperator:
    """Sends velocities, and calls services for everything else; nothing waits for an answer.

    Time here is the operator's, so it is wall time, without that in which the node did not run
    where there is a simulation. A service that is not there or refuses is told.

    Attributes:
        drives: what the joints' drives have said last, given by the node; None for nothing yet.
        table: the robot's modes, likewise.
        gaits: to choose from, in order.
        outcome: of what is asked for from now on; a new request has a new one.
    """

    def __init__(self, node: Node, full: Velocity):
        """Find the robot's topic and services, and say which action calls what.

        Args:
            node: that the operator has.
            full: velocities at full command.
        """
        self._node, self._full = node, full
        self.drives: DriveStatusArray | None = None
        self.table = ModeTable()
        self.gaits: Sequence[str] = ()
        self.outcome = Outcome()
        self._state: ControllerState | None = None
        self._clock = PatientClock(longest_look(node))
        self._heard = self.now()
        self._stand_up_until = 0.0
        self._standing_up = Outcome()
        self._not_followed = 0
        self._unanswered: dict[Client, dict[Future, float]] = {}  # when each was sent [s]
        self._publisher = node.create_publisher(Twist, graph.CMD_VEL, qos.COMMAND)
        self._mode_client = node.create_client(SetMode, graph.SET_MODE)
        self._gait_client = node.create_client(SetGait, graph.SET_GAIT)
        self._enable_client = node.create_client(Trigger, graph.DRIVES_ENABLE)
        self._reset_client = node.create_client(Trigger, graph.DRIVES_RESET_FAULTS)
        self._stop_client = node.create_client(Trigger, graph.DRIVES_EMERGENCY_STOP)
        self._cut_client = node.create_client(Trigger, graph.DRIVES_CUT)
        self._reset_world_client = node.create_client(ResetWorld, graph.PLANT_RESET)
        self._actions: dict[Action, Callable[[], None]] = {
            Action.STAND_UP: self._stand_up,
            Action.SIT: lambda: self.set_mode("sit"),
            Action.WALK: lambda: self.set_mode("walk"),
            Action.STOP: self._stop,
            Action.NEXT_GAIT: self._next_gait,
            Action.RECOVER: self._recover,
            Action.RIGHTING: self._right_itself,
            Action.RESET_SIMULATION: self._reset_simulation,
            Action.EMERGENCY_STOP: self._emergency_stop,
            Action.CUT: self._cut,
        }

    def now(self) -> float:
        """Return the operator's time [s]; the node's timer reads it again and again."""
        return self._clock.read(time.monotonic())

    def hear(self, state: ControllerState) -> None:
        """Take a word of the controller."""
        self._state, self._heard = state, self.now()

    def forget(self) -> None:
        """Forget what the robot has said: nobody has listened up to now."""
        self._state = self.drives = None
        self._heard = self.now()

    def known(self) -> Known:
        """Return what is known of the robot."""
        is_simulated = self._reset_world_client.service_is_ready()
        return Known(self._state, self.drives, self.table, self.now() - self._heard, is_simulated)

    def act(self, action: Action) -> None:
        """Do what an operator asks for."""
        self._actions[action]()

    def drive(self, velocity: Velocity) -> Velocity:
        """Send a velocity; a robot that goes on standing, as it is not woken, is asked to walk.

        Returns:
            The velocity that was sent, on an axis where the robot accepts less than full command
            the same share of what it accepts.
        """
        if self._state is not None:
            velocity = velocity.fitted(self._full, Velocity(*self._state.velocity_limit))
        stands = velocity.moving and self._mode == "stand"
        self._not_followed = self._not_followed + 1 if stands else 0
        if self._not_followed > _NOT_FOLLOWED:
            self._not_followed = 0
            self._wake()
        twist = Twist()
        twist.linear.x, twist.linear.y = velocity.forward, velocity.left
        twist.angular.z = velocity.yaw
        self._publisher.publish(twist)
        return velocity

    def go_on(self) -> None:
        """Stand up, if that was asked for, as soon as the drives are enabled."""
        if self._stand_up_until and self._operational:
            self._stand_up_until = 0.0
            self.set_mode("stand_up", outcome=self._standing_up)
        elif self._stand_up_until and self.now() > self._stand_up_until:
            self._stand_up_until = 0.0
            self._standing_up.refuse("stand up", "stand up: the drives are not enabled")

    def halt(self) -> None:
        """Send zero, and see that it is taken: the node ends."""
        self._publisher.publish(Twist())
        self._publisher.wait_for_all_acked(Duration(seconds=0.5))

    def set_mode(self, mode: str, outcome: Outcome | None = None) -> None:
        """Ask for a mode; the outcome is of a request made before, else of this one."""
        what, stops = mode.replace("_", " "), mode == _EMERGENCY_STOP
        self.call(self._mode_client, SetMode.Request(mode=mode), what, outcome, stops=stops)

    def set_gait(self, gait: str) -> None:
        """Ask for a gait."""
        self.call(self._gait_client, SetGait.Request(gait=gait), f"gait {gait}")

    def enable(self) -> None:
        """Enable the drives."""
        self.call(self._enable_client, Trigger.Request(), "enable drives")

    def reset_faults(self) -> None:
        """Reset the faults of the drives."""
        self.call(self._reset_client, Trigger.Request(), "reset faults")

    def call(
        self,
        client: Client,
        request: Any,
        what: str,
        outcome: Outcome | None = None,
        *,
        stops: bool = False,
    ) -> None:
        """Call a service without waiting; note how it went when it answers.

        A request is refused while many are not answered; one that stops the robot is not.

        Args:
            client: of the service.
            request: what to ask for.
            what: the same in words.
            outcome: of the request that it is a part of, that of the present one where None.
            stops: it stops the robot.
        """
        outcome = outcome or self.outcome
        outcome.wait(what)
        crowded = client.service_is_ready() and self._count_unanswered(client) >= _MOST_UNANSWERED
        if crowded and not stops:
            outcome.refuse(what, f"{what}: too much is asked at once")
            return
        self._answer(client, request, what, outcome)

    def _count_unanswered(self, client: Client) -> int:
        """Return how many requests to a service wait for an answer; drop those of long ago."""
        since = self.now() - _FORGOTTEN
        sent = self._unanswered.get(client, {})
        for future in [future for future, begun in sent.items() if begun < since]:
            del sent[future]
        return len(sent)

    def _answer(
        self, client: Client, request: Any, what: str, outcome: Outcome, *, alone: bool = False
    ) -> None:
        """Call a service; the answer is a part of the outcome, or all of it."""
        if not client.service_is_ready():
            self._unanswered.pop(client, None)  # nobody will answer them
            outcome.refuse(what, f"{what}: {client.srv_name} is not there")
            return

        def answered(future: Future) -> None:
            sent.pop(future, None)
            response = future.result()
            if response is None:
                return
            if alone:
                outcome.clear()
            if response.success:
                outcome.finish(what)
            else:
                outcome.refuse(what, f"{what}: refused, {response.message}")

        sent = self._unanswered.setdefault(client, {})
        future = client.call_async(request)
        sent[future] = self.now()
        future.add_done_callback(answered)

    @property
    def _mode(self) -> str:
        return self._state.mode if self._state is not None else ""

    @property
    def _operational(self) -> bool:
        return self.drives is not None and self.drives.operational

    def _wake(self) -> None:
        """Ask a robot to walk that stands though a velocity comes; asked again until it does.

        The outcome stays as it is until the answer has come, or it would flicker.
        """
        request = SetMode.Request(mode="walk")
        self._answer(self._mode_client, request, "walk", self.outcome, alone=True)

    def _stand_up(self) -> None:
        """Enable the drives if need be, then stand up."""
        if self._operational:
            self.set_mode("stand_up")
        else:
            self._stand_up_until = self.now() + _ENABLE_PERIOD
            self._standing_up = self.outcome
            self.enable()

    def _stop(self) -> None:
        """Stop walking; asked for in another mode, `stand` would make the robot rise."""
        if self._mode in STEPPING:
            self.set_mode("stand")
        else:
            self.outcome.refuse("", "stop walking: it does not walk")

    def _next_gait(self) -> None:
        if self.gaits:
            present = self._state.gait if self._state is not None else ""
            self.set_gait(next_gait(self.gaits, present))

    def _recover(self) -> None:
        """Reset the drives, then have the controller leave the mode of the stop."""
        self.reset_faults()
        self.set_mode("passive")

    def _right_itself(self) -> None:
        if self.table.modes and not any(row.name == RIGHTING for row in self.table.modes):
            self.outcome.refuse("", f"right itself: this robot has no mode {RIGHTING}")
        else:
            self.set_mode(RIGHTING)

    def _reset_simulation(self) -> None:
        """Put the world back to its start; the robot's own services are not asked for anything."""
        request = ResetWorld.Request(keyframe="", seed=-1)
        self.call(self._reset_world_client, request, "reset simulation")

    def _emergency_stop(self) -> None:
        """Stop the drives, which works without a controller; then tell the controller."""
        self._stop_with(self._stop_client, "EMERGENCY STOP")

    def _cut(self) -> None:
        """Cut the power of the drives, which lets the robot fall; then tell the controller.

        Where the drives cannot, they are stopped at least.
        """
        self._stop_with(self._cut_client, "CUT")
        if not self._cut_client.service_is_ready():
            self.call(self._stop_client, Trigger.Request(), "EMERGENCY STOP", stops=True)

    def _stop_with(self, client: Client, what: str) -> None:
        self._stand_up_until = 0.0
        self.call(client, Trigger.Request(), what, stops=True)
        self.set_mode(_EMERGENCY_STOP)


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
