"""Node `servo_bridge`: master of a bus of servos.

What `drive_bridge` is for drives, with the same topics and services. The bus is slower than the
graph: it reads and commands all servos every `bus_servo.cycle`; in the ticks between, the joint
states go on at the joints' speeds. The command that answers the joints of tick k - 1 is on the wire
in tick k, where that tick begins a cycle.
"""

from __future__ import annotations

import sys
import time

from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from husky_description.actuation import BUS_SERVOS
from husky_drivers.dynamixel.chain import ServoChain
from husky_drivers.dynamixel.port import DynamixelPort
from husky_drivers.dynamixel.servo_master import ServoMaster
from husky_drivers.dynamixel.settings import servo_settings
from husky_drivers.nodes.joint_bridge import JointBridge
from husky_drivers.nodes.pacer import ClockPacer, Pacer, WorldClockPacer
from husky_runtime import graph
from husky_runtime.log_budget import LogBudget
from husky_runtime.nodes.one_clock import longest_look
from husky_runtime.nodes.parameters import declare
from husky_runtime.nodes.presence import default_serial_port
from husky_runtime.nodes.run import run
from husky_runtime.ports.port_thread import PORT_ERRORS

_RETRY_PERIOD = 0.05
"""Wall time between two attempts to open a line that is not there [s]."""


class ServoBridge(JointBridge[ServoMaster]):
    """Bridge of a serial line of servos, opened again whenever it is lost."""

    def __init__(self) -> None:
        """Declare parameters, prepare the line, serve."""
        super().__init__(graph.SERVO_BRIDGE, BUS_SERVOS, ServoMaster)
        options, servo = self.options, self.options.robot.bus_servo
        default = default_serial_port(self, "servos")
        path = declare(self, "port", default, "serial port of the servo bus")
        live = declare(
            self,
            "answer_patience",
            0.02,
            "wall time that an answer of the servos may take beyond its bytes' own; in lockstep "
            "0.6 of `grace`, as a simulated answer comes when it can [s]",
            0.001,
            1.0,
        )
        patience = 0.6 * options.grace if options.lockstep else live
        port = DynamixelPort(path, servo.baud_rate, patience, longest_look=longest_look(self))
        chain = ServoChain(port)
        offsets = declare(
            self,
            "homing_offsets",
            [0] * len(options.robot.joint_names),
            "homing offset (register 20) that each servo must hold, in joint order [count]",
        )
        settings = servo_settings(options.robot, servo, options.command_timeout, offsets)
        master = ServoMaster(chain, settings)
        self._on_robot = options.pace == "hardware"
        self._beats = 0
        pacer: Pacer = ClockPacer(self, self) if self._on_robot else WorldClockPacer(self, self)
        self._budget = LogBudget()
        self._retry = self.create_timer(_RETRY_PERIOD, self._open_line)
        self._serve(master, pacer, servo.model)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the line, now or as soon as it is there; the servos stay without torque."""
        self._active = True
        self._open_line()
        return super().on_activate(state)

    # The line -------------------------------------------------------------------------------
    def _open_line(self) -> None:
        """Open the line if it is not, and set the servos up."""
        if not self._active or self._master.is_connected:
            return
        try:
            self._master.connect()
        except PORT_ERRORS as error:
            self._lose_line(error)
            return
        troubles = self._master.troubles
        told = troubles.describe(sorted(troubles.unusable)) or "all servos answer"
        self._say(f"line open: {told}")
        if self._master.changes:
            self._say(f"{len(self._master.changes)} settings of servos changed: see /diagnostics")

    def _lose_line(self, error: Exception) -> None:
        reason = f"no line: {error}"
        if self._master.reason != reason:
            self._say(reason)
        self._master.disconnect(reason)
        self._publish_status()

    def _say(self, text: str) -> None:
        line = self._budget.line(text, time.monotonic())
        if line is not None:
            self.get_logger().info(line)

    # The cycle ------------------------------------------------------------------------------
    def _exchange(self) -> None:
        """Bring the joints up to now, tell them to the controller, and speak to the servos."""
        self._beats += 1
        number = self._beats if self._on_robot else self._tick_ns // graph.TICK_PERIOD_NS
        cycle = number % self._master.settings.ticks_per_cycle == 0
        try:
            self._tell(known=self._master.measure(cycle))
            self._master.act(cycle)
        except PORT_ERRORS as error:
            self._lose_line(error)

    def tell_again(self) -> None:
        """Tell the joints of the last tick again; give a sign of life while we wait ourselves."""
        super().tell_again()
        if self._waiting and self._active and self._master.is_connected:
            try:
                self._master.give_sign()
            except PORT_ERRORS as error:
                self._lose_line(error)

    def _reset_faults(self) -> str:
        try:
            return super()._reset_faults()
        except PORT_ERRORS as error:
            self._lose_line(error)
            return self._master.reason


def main() -> int:
    """Run the node."""
    return run(ServoBridge)


if __name__ == "__main__":
    sys.exit(main())
