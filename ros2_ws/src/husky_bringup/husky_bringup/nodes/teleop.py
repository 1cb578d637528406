"""Node `teleop`: an operator drives the robot from the keyboard or a `sensor_msgs/Joy`."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

from geometry_msgs.msg import Twist
from rclpy.client import Client
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.task import Future
from sensor_msgs.msg import Joy
from std_srvs.srv import Trigger

from husky_bringup.teleop_mapping import (
    HELP,
    Action,
    Joystick,
    JoystickLayout,
    Keyboard,
    Velocity,
    next_gait,
    split_keys,
)
from husky_bringup.terminal import Terminal
from husky_msgs.msg import ControllerState, DriveStatusArray
from husky_msgs.srv import SetGait, SetMode
from husky_runtime import graph
from husky_runtime.nodes import qos
from husky_runtime.nodes.one_clock import OneClock
from husky_runtime.nodes.parameters import declare
from husky_runtime.nodes.run import run

_RATE = 20.0
"""Of velocity commands [Hz]."""
_ENABLE_PERIOD = 5.0
"""How long standing up waits for the drives [s]."""


class Teleop(OneClock, Node):
    """Sends velocities while they are given, and calls services for everything else.

    Time here is the operator's, so it is wall time. Nothing waits for an answer: a service that is
    not there or refuses is reported on the status line.
    """

    def __init__(self) -> None:
        """Declare parameters, open the terminal, connect."""
        super().__init__(graph.TELEOP)
        limits = Velocity(
            declare(self, "max_forward", 0.5, "forward speed [m/s]", lower=0.0, upper=2.0),
            declare(self, "max_lateral", 0.3, "sideways speed [m/s]", lower=0.0, upper=1.0),
            declare(self, "max_yaw_rate", 0.8, "yaw rate [rad/s]", lower=0.0, upper=2.0),
        )
        hold = declare(
            self, "key_hold", 0.7, "how long a key press counts [s]", lower=0.1, upper=2.0
        )
        what = "age at which a joystick message is stale [s]"
        silence = declare(self, "joy_silence", 0.3, what, lower=0.05, upper=2.0)
        self._gaits: list[str] = declare(
            self, "gaits", ["trot", "crawl", "bound", "pronk"], "gaits to choose from, in order"
        )
        layout = JoystickLayout()
        places = {
            name: declare(self, f"joy_{name}", getattr(layout, name), what, lower=-1, upper=31)
            for name, what in _JOYSTICK_PLACES.items()
        }
        self._keyboard = Keyboard(limits, hold)
        self._joystick = Joystick(limits, JoystickLayout(**places), silence)
        self._state: ControllerState | None = None
        self._drives: DriveStatusArray | None = None
        self._stand_up_until = 0.0
        self._walk_asked = 0.0
        self._said = ""
        self._shown = ""

        self.hot: Sequence[Subscription] = []
        self._connect()
        self._terminal = Terminal.open()
        if self._terminal is not None:
            print(HELP, flush=True)
        else:
            self.get_logger().info(
                f"no terminal: listening to {self.resolve_topic_name(graph.JOY)} only"
            )
        self.create_timer(1.0 / _RATE, self._on_timer)

    def _connect(self) -> None:
        """Find the robot's topics and services, and say which action calls what."""
        self._publisher = self.create_publisher(Twist, graph.CMD_VEL, qos.COMMAND)
        self.create_subscription(Joy, graph.JOY, self._on_joy, qos.COMMAND)
        self.create_subscription(
            ControllerState, graph.CONTROLLER_STATE, self._on_state, qos.STATUS
        )
        self.create_subscription(DriveStatusArray, graph.DRIVES_STATUS, self._on_drives, qos.STATUS)
        self._mode_client = self.create_client(SetMode, graph.SET_MODE)
        self._gait_client = self.create_client(SetGait, graph.SET_GAIT)
        self._enable_client = self.create_client(Trigger, graph.DRIVES_ENABLE)
        self._reset_client = self.create_client(Trigger, graph.DRIVES_RESET_FAULTS)
        self._stop_client = self.create_client(Trigger, graph.DRIVES_EMERGENCY_STOP)
        self._actions: dict[Action, Callable[[], None]] = {
            Action.STAND_UP: self._stand_up,
            Action.SIT: lambda: self._set_mode("sit"),
            Action.WALK: lambda: self._set_mode("walk"),
            Action.STOP: self._stop,
            Action.NEXT_GAIT: self._next_gait,
            Action.RECOVER: self._recover,
            Action.EMERGENCY_STOP: self._emergency_stop,
        }

    # Inputs ---------------------------------------------------------------------------------
    def _on_joy(self, joy: Joy) -> None:
        for action in self._joystick.joy(joy.axes, joy.buttons, time.monotonic()):
            self._actions[action]()

    def _on_state(self, state: ControllerState) -> None:
        self._state = state

    def _on_drives(self, drives: DriveStatusArray) -> None:
        self._drives = drives

    def _on_timer(self) -> None:
        now = time.monotonic()
        if self._terminal is not None:
            for key in split_keys(self._terminal.read()):
                action = self._keyboard.key(key, now)
                if action is not None:
                    self._actions[action]()
        self._go_on_standing_up(now)
        command = self._keyboard.command(now)
        if command is None:
            command = self._joystick.command(now)
        if command is not None:
            self._send(command, now)
        self._show(command or Velocity())

    # Outputs --------------------------------------------------------------------------------
    def _send(self, command: Velocity, now: float) -> None:
        """Send a velocity; a robot that stands is asked to walk first."""
        if command.moving and self._mode == "stand" and now - self._walk_asked > 0.5:
            self._walk_asked = now
            self._actions[Action.WALK]()
        twist = Twist()
        twist.linear.x, twist.linear.y, twist.angular.z = command.forward, command.left, command.yaw
        self._publisher.publish(twist)

    @property
    def _mode(self) -> str:
        return self._state.mode if self._state is not None else ""

    @property
    def _operational(self) -> bool:
        return self._drives is not None and self._drives.operational

    def _stand_up(self) -> None:
        """Enable the drives if need be, then stand up."""
        if self._operational:
            self._set_mode("stand_up")
        else:
            self._stand_up_until = time.monotonic() + _ENABLE_PERIOD
            self._call(self._enable_client, Trigger.Request(), "enable drives")

    def _go_on_standing_up(self, now: float) -> None:
        """Stand up as soon as the drives are enabled."""
        if self._stand_up_until and self._operational:
            self._stand_up_until = 0.0
            self._set_mode("stand_up")
        elif self._stand_up_until and now > self._stand_up_until:
            self._stand_up_until = 0.0
            self._said = "the drives are not enabled"

    def _stop(self) -> None:
        """Stop walking; asked for in another mode, `stand` would make the robot rise."""
        if self._mode == "walk":
            self._set_mode("stand")

    def _next_gait(self) -> None:
        gait = next_gait(self._gaits, self._state.gait if self._state is not None else "")
        self._call(self._gait_client, SetGait.Request(gait=gait), f"gait {gait}")

    def _recover(self) -> None:
        self._call(self._reset_client, Trigger.Request(), "reset faults")
        self._set_mode("passive")

    def _emergency_stop(self) -> None:
        """Stop the drives, which works without a controller; then tell the controller."""
        self._stand_up_until = 0.0
        self._call(self._stop_client, Trigger.Request(), "EMERGENCY STOP")
        self._set_mode("emergency_stop")

    def _set_mode(self, mode: str) -> None:
        self._call(self._mode_client, SetMode.Request(mode=mode), mode.replace("_", " "))

    def _call(self, client: Client, request: Any, what: str) -> None:
        """Call a service without waiting; say how it went when it answers."""
        if not client.service_is_ready():
            self._said = f"{what}: {client.srv_name} is not there"
            return

        def answered(future: Future) -> None:
            response = future.result()
            if response is not None:
                outcome = "done" if response.success else f"refused, {response.message}"
                self._said = f"{what}: {outcome}"

        self._said = f"{what} ..."
        client.call_async(request).add_done_callback(answered)

    def _show(self, command: Velocity) -> None:
        """Keep a status line on the terminal."""
        if self._terminal is None:
            return
        state = self._state
        what = "no controller" if state is None else f"{state.mode} ({state.gait})"
        if state is not None and state.mode in ("settle", "damping", "emergency_stop"):
            what = f"{state.mode}: {state.reason}"
        line = (
            f"{what}  "
            f"vx {command.forward:+.2f} vy {command.left:+.2f} m/s  yaw {command.yaw:+.2f} rad/s  "
            f"{self._said}"
        )
        if line != self._shown:
            self._shown = line
            print(f"\r\x1b[K{line[:118]}", end="", flush=True)

    # The end --------------------------------------------------------------------------------
    def quiet(self) -> None:
        """Nothing to do: there are no hot subscriptions."""

    def close(self) -> None:
        """Stop the robot if it was being moved, and give the terminal back."""
        if self._terminal is not None:
            self._terminal.restore()
            print(flush=True)
        now = time.monotonic()
        if self._keyboard.command(now) is not None or self._joystick.command(now) is not None:
            self._publisher.publish(Twist())
            self._publisher.wait_for_all_acked(Duration(seconds=0.5))


_JOYSTICK_PLACES = {
    "forward": "axis for forward",
    "left": "axis for left",
    "yaw": "axis for turning left",
    "dead_man": "button that must be held to move",
    "stand_up": "button to stand up",
    "emergency_stop": "button for the emergency stop",
    "sit": "button to sit down",
    "next_gait": "button for the next gait",
}
"""Parameters joy_<name>: what is where in sensor_msgs/Joy, -1 for nowhere."""


def main() -> int:
    """Run the node."""
    return run(Teleop)


if __name__ == "__main__":
    sys.exit(main())
