"""Node `drive_bridge`: EtherCAT master of the 12 drives.

One cycle, as on the wire: the frame of tick k carries the command that answers tick k - 1 and
brings back the joints of tick k. So a command acts one tick after the joint states it answers, on
the robot and in simulation alike.
"""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor

from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from husky_description.actuation import DRIVES
from husky_drivers.ethercat.axes import GREATEST_KD, GREATEST_KP, AxisSettings, settings_of
from husky_drivers.ethercat.bus import BusOptions, available_buses, find_bus
from husky_drivers.ethercat.commissioning import DriveError
from husky_drivers.ethercat.master import Master
from husky_drivers.nodes.joint_bridge import JointBridge
from husky_drivers.nodes.pacer import find_pacer
from husky_drivers.real_time import take_real_time
from husky_runtime import graph
from husky_runtime.lockstep import Peer
from husky_runtime.nodes.executor import executor_of
from husky_runtime.nodes.parameters import declare
from husky_runtime.nodes.presence import make_peer
from husky_runtime.nodes.run import run

_MAILBOX_EVERY = 5
"""Ticks between two reads over the mailbox."""
_IN_PROCESS = "sim"
"""Bus whose mailboxes take no time."""


class DriveBridge(JointBridge[Master]):
    """Bridge of an EtherCAT segment: process data each cycle, the mailbox now and then."""

    def __init__(self) -> None:
        """Declare parameters, bring the bus up, serve."""
        super().__init__(graph.DRIVE_BRIDGE, DRIVES, Master)
        self._failure = ""  # to start, as it was told
        self._ended_ns = -1  # tick of the last cycle
        self._far_side: Peer | None = None  # simulated drives on a network interface, in lockstep
        self._losses = 0  # of them
        options, robot = self.options, self.options.robot
        name = declare(self, "bus", "sim", "name of the EtherCAT bus", allowed=available_buses())
        settings = self._declare_axes()
        bus = find_bus(name)(robot, self._declare_bus())
        self.add_on_set_parameters_callback(self._on_set_parameters)
        # In lockstep the world waits for a mailbox: a run does not depend on how long it takes.
        waits = name == _IN_PROCESS or options.lockstep
        mailbox = None if waits else ThreadPoolExecutor(1, "mailbox")
        master = Master(bus, settings, robot, mailbox)
        pacer = find_pacer(name, options.pace)(self, self, bus)
        self._declare_priority()
        self._serve(master, pacer, "Elmo Gold Twitter")

    def _declare_bus(self) -> BusOptions:
        """Declare what a bus on a network interface needs to know; return it."""
        what = "network interface of the bus soem"
        interface = declare(self, "interface", BusOptions.interface, what)
        live = declare(
            self,
            "frame_timeout",
            BusOptions.patience,
            "time after which a frame on a network interface counts as lost; in lockstep it is "
            "awaited until drive_segment has been silent for `grace` [s]",
            0.0005,
            1.0,
        )
        if not self.options.lockstep:
            return BusOptions(interface, live, graph.TICK_PERIOD)
        self._far_side = make_peer(self, graph.DRIVE_SEGMENT, self.options.grace)
        return BusOptions(interface, self.options.grace, graph.TICK_PERIOD, self._far_side)

    def _declare_priority(self) -> None:
        """Declare the priority of this process and take it where the drives are real; warn of what
        hard real time lacks.
        """
        what = "priority of SCHED_FIFO with time hardware, memory locked; 0: neither"
        priority = declare(self, "priority", 80, what, 0, 98)
        if self.options.pace == "hardware":
            for lack in take_real_time(priority):
                self.get_logger().warning(str(lack))

    def _declare_axes(self) -> AxisSettings:
        """Declare gains and serial numbers; return the numbers of the drives."""
        robot = self.options.robot
        what = "position gain of every drive [N m/rad]"
        kp = declare(self, "kp", robot.servo.kp, what, 1.0, GREATEST_KP, read_only=False)
        what = "velocity gain of every drive [N m s/rad]"
        kd = declare(self, "kd", robot.servo.kd, what, 0.01, GREATEST_KD, read_only=False)
        ticks = round(self.options.command_timeout / graph.TICK_PERIOD)
        serials = self._declare_serial_numbers()
        return settings_of(robot, kp=kp, kd=kd, command_timeout_ticks=ticks, serial_numbers=serials)

    def _declare_serial_numbers(self) -> tuple[int, ...]:
        """Declare which drive belongs to which joint; raises ValueError."""
        what = "serial numbers of the drives in joint order (0x1018:4), [] takes any"
        given = declare(self, "serial_numbers", [], what)
        count = len(self.options.robot.joint_names)
        if given and (len(given) != count or not all(text.isdecimal() for text in given)):
            raise ValueError(
                f"parameter serial_numbers is {given!r}, it must be [] or {count} whole numbers"
            )
        return tuple(int(text) for text in given)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the bus and write every drive's parameters."""
        try:
            self._master.configure()
        except (DriveError, OSError) as error:
            return self._fail(f"the drives cannot be configured: {error}")
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
            return self._fail(f"the drives do not come to OP: {error}")
        self._active = True
        return super().on_activate(state)

    def _fail(self, text: str) -> TransitionCallbackReturn:
        """Log why the drives cannot be used, unless that was the last that was logged."""
        if text != self._failure:
            self._failure = text
            self.get_logger().error(text)
        return TransitionCallbackReturn.FAILURE

    def _cycle(self) -> None:
        """Have the cycle of a tick; at the start it waits until the drives are there."""
        if not self._is_starting:
            self._ended_ns = self._tick_ns
            super()._cycle()

    def tell_again(self) -> None:
        """Tell the joints of the last cycle again, or have the cycle that waited for the drives."""
        if not self._waiting and self._ended_ns != self._tick_ns:
            self._cycle()
        else:
            super().tell_again()

    def _exchange(self) -> None:
        complete = self._master.exchange()
        if self._far_side is not None and self._far_side.losses > self._losses:
            self._losses = self._far_side.losses
            self.get_logger().warning(f"{self._far_side.name} is silent: going on without it")
        if self._ticks % _MAILBOX_EVERY == 0:
            self._master.poll_mailbox()
        self._tell(known=complete)

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Write new gains to every drive."""
        values = {p.name: p.value for p in parameters if p.name in ("kp", "kd")}
        if values:
            kp = values.get("kp", self.get_parameter("kp").value)
            kd = values.get("kd", self.get_parameter("kd").value)
            executor, written = executor_of(self), self._master.set_gains(kp, kd)
            if executor is not None:
                executor.spin_hot_until(written.done)  # no tick waits for a mailbox
            try:
                written.result()
            except (ValueError, DriveError) as error:
                return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)


def main() -> int:
    """Run the node."""
    return run(DriveBridge)


if __name__ == "__main__":
    sys.exit(main())
