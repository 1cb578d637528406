"""Node `teleop`: an operator drives the robot from the keyboard or a `sensor_msgs/Joy`."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import Joy

from husky_bringup.nodes.robot_operator import (
    COMMAND_RATE,
    RobotOperator,
    declare_layout,
    declare_limits,
)
from husky_bringup.outcome import Outcome
from husky_bringup.robot_state import Known, judge
from husky_bringup.teleop_mapping import (
    ACTION_KEYS,
    HELP,
    Action,
    Joystick,
    Keyboard,
    Velocity,
    split_keys,
)
from husky_bringup.terminal import Terminal
from husky_msgs.msg import ControllerState, DriveStatusArray, ModeTable
from husky_runtime import graph
from husky_runtime.nodes import qos
from husky_runtime.nodes.one_clock import OneClock
from husky_runtime.nodes.parameters import declare
from husky_runtime.nodes.run import run


class Teleop(OneClock, Node):
    """Turns keys and joystick messages into what the robot is asked for; tells how it went."""

    def __init__(self) -> None:
        """Declare parameters, open the terminal, connect."""
        super().__init__(graph.TELEOP)
        limits = declare_limits(self)
        hold = declare(
            self, "key_hold", 0.7, "how long a key press counts [s]", lower=0.1, upper=2.0
        )
        what = "age at which a joystick message is stale [s]"
        silence = declare(self, "joy_silence", 0.3, what, lower=0.05, upper=2.0)
        gaits: list[str] = declare(
            self, "gaits", ["trot", "crawl", "bound", "pronk"], "gaits to choose from, in order"
        )
        self._keyboard = Keyboard(limits, hold)
        self._joystick = Joystick(limits, declare_layout(self), silence)
        self._shown = ""
        self._refusal_shown = (Outcome(), "")
        self.hot: Sequence[Subscription] = []
        self._robot = RobotOperator(self, limits)
        self._robot.gaits = gaits
        self._listen()
        self._terminal = Terminal.open()
        if self._terminal is not None:
            print(HELP, flush=True)
        else:
            self.get_logger().info(
                f"no terminal: listening to {self.resolve_topic_name(graph.JOY)} only"
            )
        self.create_timer(1.0 / COMMAND_RATE, self._on_timer)

    def _listen(self) -> None:
        self.create_subscription(Joy, graph.JOY, self._on_joy, qos.COMMAND)
        self.create_subscription(
            ControllerState, graph.CONTROLLER_STATE, self._on_state, qos.STATUS
        )
        self.create_subscription(ModeTable, graph.MODE_TABLE, self._on_table, qos.LATCHED)
        self.create_subscription(DriveStatusArray, graph.DRIVES_STATUS, self._on_drives, qos.STATUS)

    # Inputs ---------------------------------------------------------------------------------
    def _on_joy(self, joy: Joy) -> None:
        for action in self._joystick.joy(joy.axes, joy.buttons, self._robot.now()):
            self._act(action)

    def _on_state(self, state: ControllerState) -> None:
        self._robot.hear(state)

    def _on_table(self, table: ModeTable) -> None:
        self._robot.table = table

    def _on_drives(self, drives: DriveStatusArray) -> None:
        self._robot.drives = drives

    def _on_timer(self) -> None:
        now = self._robot.now()
        if self._terminal is not None:
            for key in split_keys(self._terminal.read()):
                action = self._keyboard.key(key, now)
                if action is not None:
                    self._act(action)
        self._robot.go_on()
        command = self._keyboard.command(now)
        if command is None:
            command = self._joystick.command(now)
        if command is not None:
            command = self._robot.drive(command)
        if self._terminal is not None:
            self._show_refusal()
            self._show(self._robot.known(), command or Velocity())

    def _act(self, action: Action) -> None:
        self._robot.outcome = Outcome()
        self._robot.act(action)

    # The terminal ---------------------------------------------------------------------------
    def _show_refusal(self) -> None:
        """Leave each refusal on a line of its own, whole and with its time of day."""
        outcome = self._robot.outcome
        refusal = (outcome, outcome.text)
        if outcome.refused and refusal != self._refusal_shown:
            self._refusal_shown = refusal
            self._shown = ""
            print(f"\r\x1b[K{outcome.time} {outcome.text}", flush=True)

    def _show(self, known: Known, command: Velocity) -> None:
        """Keep a status line: the mode; the command or why it moves nothing, or the next step."""
        state, robot = known.state, judge(known)
        what = "no controller" if state is None else f"{state.mode} ({state.gait})"
        if state is not None and state.mode in ("settle", "damping", "emergency_stop"):
            what = f"{state.mode}: {state.reason}"
        step = robot.next_step
        if robot.press in _KEYS:
            step = f"{step} (key {_KEYS[robot.press]})"
        if command.moving:
            step = f"vx {command.forward:+.2f} vy {command.left:+.2f} m/s  yaw {command.yaw:+.2f}"
            step = f"moves nothing: {robot.obstacle}" if robot.obstacle else f"{step} rad/s"
        outcome = self._robot.outcome
        line = f"{what}  {step}  {'' if outcome.refused else outcome.text}"
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
        now = self._robot.now()
        if self._keyboard.command(now) is not None or self._joystick.command(now) is not None:
            self._robot.halt()


_KEYS = {action: key.replace(" ", "space") for key, action in ACTION_KEYS.items()}


def main() -> int:
    """Run the node."""
    return run(Teleop)


if __name__ == "__main__":
    sys.exit(main())
