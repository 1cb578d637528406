"""Lifecycle node `pixhawk_bridge`: thrust commands to a Pixhawk over MAVLink, its state back."""

from __future__ import annotations

import math
import sys
import time

from rclpy.timer import Timer
from sensor_msgs.msg import BatteryState
from std_srvs.srv import SetBool, Trigger

from husky_msgs.msg import PropulsionCommand, PropulsionState
from husky_msgs.srv import SetFlightMode
from husky_pu.companion import command_requests as commands
from husky_pu.companion.bridge import BootClock, ThrustSetpoints
from husky_pu.companion.client import MavlinkClient
from husky_pu.companion.link import CompanionLink, opener
from husky_pu.companion.propulsion_force import ForceEstimate
from husky_pu.companion.telemetry import MODES, PX4, Report
from husky_pu.nodes.pixhawk_messages import battery_message, state_message, thrust_command
from husky_pu.nodes.pixhawk_parameters import declare_config, declare_limits
from husky_pu.nodes.pixhawk_report import PixhawkReport
from husky_pu.nodes.thrust_markers import ThrustMarkers
from husky_runtime import graph
from husky_runtime.nodes import diagnostics, qos
from husky_runtime.nodes.device_node import DeviceNode
from husky_runtime.nodes.executor import executor_of
from husky_runtime.nodes.parameters import declare, declare_mounting, declare_robot
from husky_runtime.nodes.presence import default_serial_port
from husky_runtime.nodes.run import run
from husky_runtime.nodes.transitions import stay_active_under_load

_HEARTBEAT_LOOK = 0.1
"""Between two looks whether a heartbeat is due [s]."""
_BATTERY_EVERY = 5
"""Bundles of telemetry between two messages of the battery: 10 Hz."""
_SILENCE = 0.5
"""Age of a command from which on there is none [s]."""
_START_PATIENCE = 5.0
"""Wall time that the first request waits for an autopilot that is not heard yet [s]."""
_MODES = {name: number for number, name in MODES.items() if name in ("STABILIZED", "OFFBOARD")}


class PixhawkBridge(DeviceNode[CompanionLink]):
    """Sends one setpoint for each good command, and publishes each bundle of telemetry.

    The line belongs to the active state. The link's thread reads it and publishes; commands and
    services run in the executor's thread, which is also the one that sends heartbeats.
    """

    def __init__(self) -> None:
        """Declare parameters, make publishers, subscriptions and services; open the line."""
        super().__init__(graph.PIXHAWK_BRIDGE)
        what = (
            "lockstep, realtime: stamps are the autopilot's time; hardware: they are this "
            "machine's. In lockstep the autopilot may stand still without being lost"
        )
        clocks = ("lockstep", "realtime", "hardware")
        mode = declare(self, "time", "lockstep", what, allowed=clocks)
        line = f"serial:{default_serial_port(self, 'pixhawk')}:921600"
        what = "serial:<path>:<baud>, udpin:<address>:<port> or udpout:<address>:<port>"
        self._connection = declare(self, "connection", line, what)
        self._open = opener(self._connection)
        robot = declare_robot(self, **declare_mounting(self))
        self._config = declare_config(self, robot, lockstep=mode == "lockstep")
        self._limits = declare_limits(self, robot)
        self._force = ForceEstimate(robot)
        self._boot_clock = BootClock() if mode == "hardware" else None
        self._setpoints = ThrustSetpoints(self._limits)
        self._client = MavlinkClient(self._config)
        self._killed = False
        self._command_at = -math.inf
        self._bundles = 0
        self._heard = False
        self._report = PixhawkReport(self._connection, robot.rotor_names)
        offer = self.create_lifecycle_publisher
        self._state_publisher = offer(PropulsionState, graph.PROPULSION_STATE, qos.STATUS)
        self._battery_publisher = offer(BatteryState, graph.BATTERY, qos.STATUS)
        self._markers = ThrustMarkers(self, robot)
        self._commands = self.create_subscription(
            PropulsionCommand, graph.PROPULSION_COMMAND, self._on_command, qos.CONTROL
        )
        self.hot = [self._commands]
        self.hot_timers: list[Timer] = [self.create_timer(_HEARTBEAT_LOOK, self._on_timer)]
        self.create_service(SetBool, graph.PROPULSION_ARM, self._on_arm)
        self.create_service(SetFlightMode, graph.PROPULSION_SET_MODE, self._on_set_mode)
        self.create_service(Trigger, graph.PROPULSION_KILL, self._on_kill)
        self._diagnostics = diagnostics.Diagnostics(self, "Pixhawk", self._diagnose)
        stay_active_under_load(self, self._load, "armed fans are asked for thrust")
        self.autostart()

    # Lifecycle ----------------------------------------------------------------------------------
    def make_link(self) -> CompanionLink:
        """Return a link on which nothing has been said yet."""
        self._client = MavlinkClient(self._config)
        self._setpoints = ThrustSetpoints(self._limits)
        self._report = PixhawkReport(self._connection, self._report.fans)
        return CompanionLink(self._client, self._open, self._publish, self._on_link_state)

    def _load(self) -> str:
        """Return what hangs on this node's activity now, "" for nothing."""
        if self._link is None:
            return ""
        with self._link.talk() as client:
            armed = client.connected and client.telemetry.report.armed
        newest = self._setpoints.newest
        if not armed or newest is None or not (newest.thrust or any(newest.force or ())):
            return ""
        return "the fans are armed and asked for thrust; land, take it back or disarm first"

    def part(self, link: CompanionLink) -> None:
        """Ask for no thrust."""
        with link.talk() as client:
            self._setpoints.enable(False)
            newest = self._setpoints.newest
            if client.connected and newest is not None:
                stamp = self._setpoints.stamp_ns
                newest.without_thrust().send(client, self._boot_us(stamp))

    # Commands -----------------------------------------------------------------------------------
    def _on_command(self, message: PropulsionCommand) -> None:
        link = self._link
        if link is None:
            return
        now = time.monotonic()
        self._command_at = now
        command = thrust_command(message)
        setpoints = self._setpoints
        with link.talk() as client:
            client.heartbeat(now)
            client.advance(command.stamp_ns)
            armed = client.connected and client.telemetry.report.armed
            setpoints.enable(armed and not self._killed)
            refused, projected = setpoints.refused, setpoints.projected
            setpoint = setpoints.convert(command)
            if client.connected:
                boot_us = self._boot_us(command.stamp_ns)
                if setpoint is not None:
                    setpoint.send(client, boot_us)
                elif self._config.lockstep:
                    client.system_time(boot_us // 1000)  # the world need not wait for a setpoint
        if setpoints.refused != refused:
            self.get_logger().warning(
                f"thrust command refused: {setpoints.refusal}", throttle_duration_sec=1.0
            )
        if setpoints.projected != projected:
            self.get_logger().warning(
                f"left out of a thrust command: {setpoints.projection}", throttle_duration_sec=1.0
            )

    def _on_timer(self) -> None:
        if self._link is not None:
            with self._link.talk() as client:
                client.heartbeat(time.monotonic())

    def _boot_us(self, stamp_ns: int) -> int:
        """Return a stamp in the autopilot's time [us]."""
        if self._boot_clock is None:
            return stamp_ns // 1000
        return self._boot_clock.boot_us(stamp_ns) if self._boot_clock.known else 0

    # In the link's thread -----------------------------------------------------------------------
    def _publish(self, report: Report) -> None:
        if self._boot_clock is not None:
            self._boot_clock.observe(report.boot_us, time.time_ns())
        self._bundles += 1
        stamp_ns = self._stamp_ns(report)
        force = self._force.of(report)
        self._state_publisher.publish(state_message(report, force, stamp_ns, True))
        self._markers.tell(stamp_ns, force)
        if self._bundles % _BATTERY_EVERY == 0:
            self._battery_publisher.publish(battery_message(report, stamp_ns))

    def _on_link_state(self, text: str, heard: bool) -> None:
        self.say(text)
        if self._heard and not heard:
            report = self._client.telemetry.report
            force = self._force.of(report)
            self._state_publisher.publish(
                state_message(report, force, self._stamp_ns(report), False)
            )
        self._heard = heard

    def _stamp_ns(self, report: Report) -> int:
        boot_us = report.boot_us
        return self._boot_clock.host_ns(boot_us) if self._boot_clock is not None else 1000 * boot_us

    # Services -----------------------------------------------------------------------------------
    def _ask(self, number: int, *parameters: float) -> tuple[bool, str]:
        """Send a command and serve commands and heartbeats until its answer, 1 s at most."""
        link = self._link
        if link is None:
            return False, "the node is not active"
        if self._bundles == 0 and not self._killed:
            self._await_autopilot()
        with link.talk() as client:
            if not client.connected:
                return False, f"no autopilot is heard on {self._connection}; try again when it is"
            command = client.command(number, *parameters)
            client.poll(time.monotonic())
        executor = executor_of(self)
        assert executor is not None
        executor.spin_hot_until(lambda: command.done(time.monotonic()))
        return command.accepted, "" if command.accepted else command.text

    def _await_autopilot(self) -> None:
        """Serve commands until the autopilot is heard: it starts more slowly than this node."""
        executor = executor_of(self)
        assert executor is not None
        end = time.monotonic() + _START_PATIENCE
        executor.spin_hot_until(lambda: self._client.connected or time.monotonic() > end)

    def _on_arm(self, request: SetBool.Request, response: SetBool.Response):  # type: ignore[no-untyped-def]
        conflict = self._client.conflict(time.monotonic())
        if request.data and conflict:
            response.message = conflict
            return response
        if request.data and (unsafe := self._unsafe_settings()):
            response.message = f"the autopilot's parameters: {'; '.join(unsafe)}"
            return response
        accepted, response.message = self._ask(commands.ARM_DISARM, float(request.data))
        response.success = accepted
        if accepted:
            self._settle(armed=request.data)
            self._killed = self._killed and not request.data
        return response

    def _unsafe_settings(self) -> list[str]:
        """Return why the autopilot must not be armed as it is set; wait until it has told."""
        if self._link is None:
            return []
        if not self._client.connected:
            self._await_autopilot()
        executor, client = executor_of(self), self._client
        assert executor is not None
        end = time.monotonic() + _START_PATIENCE
        executor.spin_hot_until(
            lambda: client.settings.settled or not client.connected or time.monotonic() > end
        )
        if not client.connected:
            return []  # the command itself says so
        if not client.settings.settled:
            return ["not told yet"]
        return client.settings.problems(unsafe=True)

    def _on_set_mode(self, request: SetFlightMode.Request, response: SetFlightMode.Response):  # type: ignore[no-untyped-def]
        number = _MODES.get(request.mode)
        autopilot = self._client.telemetry.autopilot
        if number is None:
            response.message = f"mode {request.mode!r}, it must be one of {', '.join(_MODES)}"
        elif self._client.connected and autopilot != PX4:
            response.message = f"the autopilot (MAV_AUTOPILOT {autopilot}) has not PX4's modes"
        else:
            # 1: a mode of the autopilot's own, and which.
            response.success, response.message = self._ask(commands.DO_SET_MODE, 1.0, number)
            if response.success:
                self._settle(mode=request.mode)
        return response

    def _on_kill(self, request: Trigger.Request, response: Trigger.Response):  # type: ignore[no-untyped-def]
        self._killed = True
        self._setpoints.enable(False)
        response.success, response.message = self._ask(commands.ARM_DISARM, 0.0, commands.FORCE)
        if response.success:
            self._settle(armed=False)
            response.message = "the fans stop; arm to go on"
        return response

    def _settle(self, *, armed: bool | None = None, mode: str | None = None) -> None:
        if self._link is not None:
            with self._link.talk() as client:
                client.telemetry.settle(armed=armed, mode=mode)

    def _diagnose(self) -> diagnostics.Report:
        """Return level, message and values for `/diagnostics`."""
        if self._link is None:
            return diagnostics.WARN, "not active", {"connection": self._connection}
        silent = time.monotonic() - self._command_at > _SILENCE
        return self._report.make(
            self._link,
            self._client,
            self._setpoints,
            {
                "killed": self._killed,
                "commands": "none" if silent else "streaming",
                "command_sources": self._commands.get_publisher_count(),
            },
        )


def main() -> int:
    """Run the node; return the process's exit code."""
    return run(PixhawkBridge)


if __name__ == "__main__":
    sys.exit(main())
