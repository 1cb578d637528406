"""Node `drive_bridge`: EtherCAT master of the 12 drives, and the graph's heart beat at 500 Hz.

One cycle, as on the wire: the frame of tick k carries the command that answers tick k - 1 and
brings back the joints of tick k. So a command acts one tick after the joint states it answers, on
the robot and in simulation alike.
"""

from __future__ import annotations

import array
import sys
import time
from typing import Any, Protocol

import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.timer import Timer
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from husky_description import graph
from husky_description.lockstep import Peer, Presence, Repeats
from husky_description.nodes import diagnostics, qos, stamps
from husky_description.nodes.parameters import declare
from husky_description.nodes.run import run
from husky_description.robot import load_robot
from husky_description.urdf import build_urdf
from husky_drivers.axes import settings_of
from husky_drivers.bus import available_buses, find_bus
from husky_drivers.commissioning import DriveError
from husky_drivers.master import Master, Phase
from husky_msgs.msg import (
    DriveStatus,
    DriveStatusArray,
    JointCommand,
    ServoCommand,
    ServoState,
)
from husky_msgs.srv import InjectFault

_STATUS_EVERY = 50
"""Ticks between two messages of drive status: 10 Hz; a change of phase is told at once."""
_MAILBOX_EVERY = 5
"""Ticks between two reads over the mailbox."""


class SimulatedBus(Protocol):
    """What a bus of simulated drives offers beyond `husky_drivers.bus.Bus`: the motors' side."""

    def set_servo_state(
        self, encoder_count: Any, velocity_count: Any, current: Any, bus_voltage: float
    ) -> None:
        """Take what the motors measured."""

    def servo_command(self) -> Any:
        """Return what the power stages do next."""

    def inject(self, joint: str, fault: str) -> None:
        """Make a drive fail."""

    def clear(self, joint: str | None = None) -> None:
        """End injected faults."""


class DriveBridge(LifecycleNode):
    """Carries joint commands to the drives and their states back, and stops them when in doubt."""

    def __init__(self) -> None:
        """Declare parameters, make publishers, subscriptions and services; bring the bus up."""
        super().__init__(graph.DRIVE_BRIDGE)
        self._lockstep = (
            declare(
                self,
                "time",
                "lockstep",
                "lockstep: wait for the command of each tick; realtime, hardware: do not",
                allowed=("lockstep", "realtime", "hardware"),
            )
            == "lockstep"
        )
        grace = declare(
            self,
            "grace",
            1.0,
            "wall time a silent controller is waited for [s]",
            lower=0.2,
            upper=60.0,
        )
        bus = declare(self, "bus", "sim", "name of the EtherCAT bus", allowed=available_buses())
        autostart = declare(self, "autostart", True, "configure and activate at start")
        robot = load_robot()
        kp = declare(
            self,
            "kp",
            robot.servo.kp,
            "position gain of every drive [N m/rad]",
            lower=1.0,
            upper=1000.0,
            read_only=False,
        )
        kd = declare(
            self,
            "kd",
            robot.servo.kd,
            "velocity gain of every drive [N m s/rad]",
            lower=0.01,
            upper=50.0,
            read_only=False,
        )
        timeout = declare(
            self,
            "command_timeout",
            0.01,
            "all drives brake when no joint command has come for so long; with the braking "
            "it stays below 0.1 s [s]",
            lower=0.004,
            upper=0.03,
        )
        self._robot = robot
        self._bus = find_bus(bus)(robot)
        settings = settings_of(
            robot, kp=kp, kd=kd, command_timeout_ticks=round(timeout / graph.TICK_PERIOD)
        )
        self._master = Master(self._bus, settings)
        self._sim: SimulatedBus | None = self._bus if hasattr(self._bus, "servo_command") else None
        self._active = False
        self._controller = Peer(graph.LOW_LEVEL_CONTROLLER, grace)
        self._tick_ns = -1
        self._joints_ns = -1  # stamp of the joint states that were told last
        self._command_ns = -1
        self._waiting = False
        self._repeats = Repeats()
        self._told = (Phase.OFF, "")
        self._ticks = self._reported_ticks = 0
        self.hot_timers: list[Timer] = []

        self._joints = JointState()
        self._joints.header.frame_id = graph.FRAME_BASE
        self._joints.name = list(robot.joint_names)
        self._servo_command = ServoCommand()
        self._joint_publisher = self.create_publisher(JointState, graph.JOINT_STATES, qos.CONTROL)
        self._status_publisher = self.create_publisher(
            DriveStatusArray, graph.DRIVES_STATUS, qos.STATUS
        )
        description = self.create_publisher(String, graph.ROBOT_DESCRIPTION, qos.LATCHED)
        description.publish(String(data=build_urdf(robot)))
        self._commands = self.create_subscription(
            JointCommand, graph.JOINT_COMMAND, self._on_joint_command, qos.CONTROL
        )
        self.hot = [self._commands]
        if self._sim is not None:
            self._servo_publisher = self.create_publisher(
                ServoCommand, graph.SERVO_COMMAND, qos.CONTROL
            )
            self.hot.append(
                self.create_subscription(
                    ServoState, graph.SERVO_STATE, self._on_servo_state, qos.CONTROL
                )
            )
            self.create_service(InjectFault, graph.DRIVES_INJECT_FAULT, self._on_inject_fault)
        else:
            self.hot_timers.append(self.create_timer(graph.TICK_PERIOD, self._on_period))
        self.create_service(Trigger, graph.DRIVES_ENABLE, self._on_enable)
        self.create_service(Trigger, graph.DRIVES_DISABLE, self._on_disable)
        self.create_service(Trigger, graph.DRIVES_RESET_FAULTS, self._on_reset_faults)
        self.create_service(Trigger, graph.DRIVES_EMERGENCY_STOP, self._on_emergency_stop)
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self._diagnostics = diagnostics.Diagnostics(self, "Elmo Gold Twitter x 12", self._report)
        if autostart:
            self.trigger_configure()
            self.trigger_activate()

    # Life cycle -----------------------------------------------------------------------------
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the bus and write every drive's parameters."""
        try:
            self._master.configure()
        except (DriveError, OSError) as error:
            self.get_logger().error(f"the drives cannot be configured: {error}")
            return TransitionCallbackReturn.FAILURE
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

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take torque off and stop exchanging."""
        self._active = False
        self._master.stop()
        self._answer_plant()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Nothing is left to do: deactivation has closed the bus."""
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take torque off."""
        self.close()
        return TransitionCallbackReturn.SUCCESS

    def close(self) -> None:
        """Leave nothing moving."""
        if self._active:
            self._active = False
            self._master.stop()
            self._answer_plant()

    # The cycle ------------------------------------------------------------------------------
    def _on_servo_state(self, state: ServoState) -> None:
        """A cycle of simulated drives begins when their motors have moved on."""
        assert self._sim is not None
        stamp = stamps.to_ns(state.stamp)
        if stamp == self._tick_ns:
            self._answer_again()
            return
        if stamp < self._tick_ns:
            self._restart()
        self._tick_ns = stamp
        self._sim.set_servo_state(
            state.encoder_count, state.velocity_count, state.current, state.bus_voltage
        )
        self._waiting = True
        self._cycle_when_complete()

    def _restart(self) -> None:
        """The world starts again at an earlier time: nothing of before counts, nothing may move."""
        self._controller.restart()
        self._joints_ns = self._command_ns = -1
        self._repeats.clear()
        self._master.restart("the world has been reset")
        self.get_logger().warning("time has gone back: the drives are off")

    def _on_period(self) -> None:
        """A cycle of real drives begins by the clock."""
        self._tick_ns = self.get_clock().now().nanoseconds
        self._cycle()

    def _on_joint_command(self, command: JointCommand) -> None:
        stamp = stamps.to_ns(command.stamp)
        if stamp > self._tick_ns:
            return  # of a time before a reset
        if stamp <= self._command_ns:
            if self._repeats.take(stamp):
                self._controller.answer(stamp)
                return
            self._master.emergency_stop("two sources command the joints")
            self.get_logger().error(
                "two nodes answer the same joint states: emergency stop", throttle_duration_sec=1.0
            )
            return
        self._command_ns = stamp
        self._repeats.pass_by(stamp)
        refusal = self._master.set_command(
            command.mode_of_operation, command.position, command.velocity, command.effort
        )
        if refusal:
            self.get_logger().warning(
                f"joint command refused: {refusal}", throttle_duration_sec=1.0
            )
        self._servo_command.imu_stamp = command.imu_stamp
        self._controller.answer(stamp)
        if self._waiting:
            self._cycle_when_complete()

    def quiet(self) -> None:
        """Go on without the controller when it is lost."""
        self._watch_controller()
        if self._waiting:
            self._cycle_when_complete()

    def _watch_controller(self) -> None:
        """Declare the controller lost when it has not answered for too long."""
        peer = self._controller
        if not peer.ready(self._joints_ns) and peer.expire(time.monotonic()):
            self.get_logger().warning(f"{peer.name} is silent: going on without it")

    def _cycle_when_complete(self) -> None:
        if not self._lockstep or self._controller.ready(self._joints_ns):
            self._waiting = False
            self._cycle()

    def _cycle(self) -> None:
        """Exchange one frame; tell the joints to the controller and the servos to the plant."""
        master = self._master
        self._watch_controller()
        if self._active:
            complete = master.exchange()
            self._ticks += 1
            if self._ticks % _MAILBOX_EVERY == 0:
                master.poll_mailbox()
            told = (master.phase, master.reason)
            if told != self._told or self._ticks % _STATUS_EVERY == 0:
                self._told = told
                self._publish_status()
            if complete:
                self._publish_joints()
        self._answer_plant()

    def _publish_joints(self) -> None:
        joints, master = self._joints, self._master
        stamps.fill(joints.header.stamp, self._tick_ns)
        joints.position = array.array("d", master.position.tobytes())
        joints.velocity = array.array("d", master.velocity.tobytes())
        joints.effort = array.array("d", master.effort.tobytes())
        self._joints_ns = self._tick_ns
        self._joint_publisher.publish(joints)

    def _answer_plant(self) -> None:
        if self._sim is None or self._tick_ns < 0:
            return
        servos, message = self._sim.servo_command(), self._servo_command
        stamps.fill(message.stamp, self._tick_ns)
        message.kind = np.ascontiguousarray(servos["kind"])
        message.position = np.ascontiguousarray(servos["position"])
        message.velocity = np.ascontiguousarray(servos["velocity"])
        message.torque = np.ascontiguousarray(servos["torque"])
        message.kp = np.ascontiguousarray(servos["kp"])
        message.kd = np.ascontiguousarray(servos["kd"])
        message.torque_limit = np.ascontiguousarray(servos["torque_limit"])
        self._servo_publisher.publish(message)

    def _answer_again(self) -> None:
        """The plant has sent its state again: a message was lost, or we wait for the controller."""
        if self._joints_ns >= 0:
            self._repeats.tell(self._joints_ns)
            self._joint_publisher.publish(self._joints)
        self._servo_publisher.publish(self._servo_command)

    def _settle(self) -> None:
        """Let the cycle at hand be answered, so that a request falls between two ticks."""
        if self._lockstep and self.executor is not None:
            self.executor.drain_hot()
            self.executor.spin_hot_until(
                lambda: not self._waiting and self._controller.ready(self._joints_ns)
            )

    # Reports --------------------------------------------------------------------------------
    def _publish_status(self) -> None:
        master = self._master
        status = DriveStatusArray()
        stamps.fill(status.stamp, self._tick_ns)
        status.operational = master.phase is Phase.ENABLED
        status.emergency_stop = master.emergency_stopped
        status.working_counter = master.working_counter
        status.expected_working_counter = self._bus.expected_working_counter
        status.short_cycles = master.short_cycles
        status.refused_commands = master.refused_commands
        status.reason = master.reason
        status.drives = [
            DriveStatus(
                joint=axis.joint,
                statusword=axis.statusword,
                state=axis.state.name.lower().replace("_", " "),
                error_code=axis.error_code,
                error=axis.error,
                mode_of_operation=axis.mode_of_operation,
                safe_torque_off=axis.safe_torque_off,
                bus_voltage=axis.bus_voltage,
                current=axis.current,
                following_error=axis.following_error,
            )
            for axis in master.status()
        ]
        self._status_publisher.publish(status)

    def _report(self) -> diagnostics.Report:
        master = self._master
        level, message = diagnostics.OK, master.phase.value
        if master.reason and master.phase is not Phase.ENABLED:
            message = f"{message}: {master.reason}"
        stands, self._reported_ticks = self._ticks == self._reported_ticks, self._ticks
        if stands:
            level, message = diagnostics.WARN, f"no cycle since the last report ({message})"
        if self._controller.presence is Presence.LOST:
            level, message = diagnostics.ERROR, f"{self._controller.name} is lost"
        elif master.emergency_stopped or np.any(master.error_code):
            level = diagnostics.ERROR
        return (
            level,
            message,
            {
                "cycles": self._ticks,
                "working_counter": master.working_counter,
                "short_cycles": master.short_cycles,
                "refused_commands": master.refused_commands,
                "peer_losses": self._controller.losses,
            },
        )

    # Services -------------------------------------------------------------------------------
    def _on_enable(self, request: Trigger.Request, response: Trigger.Response):  # type: ignore[no-untyped-def]
        self._settle()
        sources = self._commands.get_publisher_count()
        if self._master.phase is Phase.ENABLED:
            response.success, response.message = True, "enabled"
            return response
        if not self._active:
            response.message = "the node is not active"
        elif sources != 1:
            response.message = f"{sources} nodes publish {graph.JOINT_COMMAND}, it must be 1"
        else:
            response.message = self._master.enable()
        response.success = not response.message
        return response

    def _on_disable(self, request: Trigger.Request, response: Trigger.Response):  # type: ignore[no-untyped-def]
        self._settle()
        self._master.disable()
        response.success = True
        return response

    def _on_reset_faults(self, request: Trigger.Request, response: Trigger.Response):  # type: ignore[no-untyped-def]
        self._settle()
        response.message = self._master.reset_faults()
        response.success = not response.message
        return response

    def _on_emergency_stop(self, request: Trigger.Request, response: Trigger.Response):  # type: ignore[no-untyped-def]
        self._master.emergency_stop()
        response.success, response.message = True, "drives brake and lose torque"
        return response

    def _on_inject_fault(self, request: InjectFault.Request, response: InjectFault.Response):  # type: ignore[no-untyped-def]
        assert self._sim is not None
        try:
            if request.fault:
                self._sim.inject(request.target, request.fault)
            else:
                self._sim.clear(request.target or None)
        except ValueError as error:
            response.message = str(error)
        response.success = not response.message
        return response

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
