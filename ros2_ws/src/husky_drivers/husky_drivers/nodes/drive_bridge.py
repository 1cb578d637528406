"""Node `drive_bridge`: EtherCAT master of the 12 drives.

One cycle, as on the wire: the frame of tick k carries the command that answers tick k - 1 and
brings back the joints of tick k. So a command acts one tick after the joint states it answers, on
the robot and in simulation alike.
"""

from __future__ import annotations

import sys

from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from husky_description.actuation import DRIVES
from husky_drivers.ethercat.axes import GREATEST_KD, GREATEST_KP, AxisSettings, settings_of
from husky_drivers.ethercat.bus import available_buses, find_bus
from husky_drivers.ethercat.commissioning import DriveError
from husky_drivers.ethercat.master import Master
from husky_drivers.nodes.joint_bridge import JointBridge
from husky_drivers.nodes.pacer import find_pacer
from husky_runtime import graph
from husky_runtime.nodes.parameters import declare
from husky_runtime.nodes.run import run

_MAILBOX_EVERY = 5
"""Ticks between two reads over the mailbox."""


class DriveBridge(JointBridge[Master]):
    """Bridge of an EtherCAT segment: process data each cycle, the mailbox now and then."""

    def __init__(self) -> None:
        """Declare parameters, bring the bus up, serve."""
        super().__init__(graph.DRIVE_BRIDGE, DRIVES, Master)
        name = declare(self, "bus", "sim", "name of the EtherCAT bus", allowed=available_buses())
        settings = self._declare_axes()
        bus = find_bus(name)(self.options.robot)
        self.add_on_set_parameters_callback(self._on_set_parameters)
        master = Master(bus, settings, self.options.robot)
        self._serve(master, find_pacer(name)(self, self, bus), "Elmo Gold Twitter")

    def _declare_axes(self) -> AxisSettings:
        """Declare the gains; return the numbers of the drives."""
        robot = self.options.robot
        what = "position gain of every drive [N m/rad]"
        kp = declare(self, "kp", robot.servo.kp, what, 1.0, GREATEST_KP, read_only=False)
        what = "velocity gain of every drive [N m s/rad]"
        kd = declare(self, "kd", robot.servo.kd, what, 0.01, GREATEST_KD, read_only=False)
        ticks = round(self.options.command_timeout / graph.TICK_PERIOD)
        return settings_of(robot, kp=kp, kd=kd, command_timeout_ticks=ticks)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the bus and write every drive's parameters."""
        try:
            self._master.configure()
        except (DriveError, OSError) as error:
            self.get_logger().error(f"the drives cannot be configured: {error}")
            return TransitionCallbackReturn.FAILURE
        if self._master.changes:
            self.get_logger().info(
                f"{len(self._master.changes)} settings of drives changed: see /diagnostics"
            )
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Exchange process data from now on; the drives stay without torque."""
        try:
            self._master.start()
        except (DriveError, OSError) as error:
            self.get_logger().error(f"the drives do not come to OP: {error}")
            return TransitionCallbackReturn.FAILURE
        self._active = True
        return super().on_activate(state)

    def _exchange(self) -> None:
        complete = self._master.exchange()
        if self._ticks % _MAILBOX_EVERY == 0:
            self._master.poll_mailbox()
        self._tell(known=complete)

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Write new gains to every drive."""
        values = {p.name: p.value for p in parameters if p.name in ("kp", "kd")}
        if values:
            kp = values.get("kp", self.get_parameter("kp").value)
            kd = values.get("kd", self.get_parameter("kd").value)
            try:
                self._master.set_gains(kp, kd)
            except (ValueError, DriveError) as error:
                return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)


def main() -> int:
    """Run the node."""
    return run(DriveBridge)


if __name__ == "__main__":
    sys.exit(main())
