"""Node `low_level_controller`: one control tick for every joint state, at 500 Hz (thesis T7)."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Sequence
from typing import cast

from geometry_msgs.msg import Twist
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from sensor_msgs.msg import JointState

from husky_control.controller import Controller
from husky_control.estimation.imu_mount import ImuMount
from husky_control.nodes.controller_options import (
    WAKE,
    ControllerOptions,
    declare_gains,
    declare_options,
)
from husky_control.nodes.controller_report import REPORT_EVERY, ControllerReport
from husky_control.nodes.fans_link import FansLink
from husky_control.nodes.imu_link import ImuLink
from husky_control.nodes.plan_link import PlanLink
from husky_control.nodes.plan_message import from_message
from husky_control.nodes.pose_link import PoseLink
from husky_control.nodes.stamped_twist import StampedTwist
from husky_control.tick_data import Measurements
from husky_msgs.msg import DriveStatusArray, InclinePlan, JointCommand
from husky_msgs.srv import SetGait, SetMode
from husky_runtime import graph
from husky_runtime.nodes import diagnostics, qos, stamps
from husky_runtime.nodes.executor import WaitSetExecutor
from husky_runtime.nodes.message_guard import refuser
from husky_runtime.nodes.one_clock import OneClock
from husky_runtime.nodes.run import run
from husky_runtime.nodes.tick_clock import TickClock
from husky_runtime.stamp_gate import StampGate, Turn

_WITNESS_LAG_NS = 250_000_000
"""By how much `/drives/status`, told 10 times a second, may be behind the joint states [ns]."""


class LowLevelController(OneClock, Node):
    """Turns joint states and IMU samples into calls of `Controller.tick`.

    The tick of joint states k uses the newest IMU sample that was due before k's stamp. In lockstep
    it waits for that sample; otherwise it takes what is there, and the age of the sample counts.
    """

    def __init__(self) -> None:
        """Declare parameters, make the controller, publishers and subscriptions."""
        super().__init__(graph.LOW_LEVEL_CONTROLLER)
        options = declare_options(self)
        self._lockstep = options.lockstep
        self._robot = options.robot
        self._gains = declare_gains(self, self._robot)
        self._controller = Controller(self._robot, self._gains)
        self._controller.watch.wakes = options.wakes
        self._measurements = Measurements()
        self._joint_state: JointState | None = None
        self._joint_time_ns = -1
        self._gate: StampGate[JointState] = StampGate(
            graph.TICK_PERIOD_NS,
            refuser(self, graph.JOINT_STATES),
            _WITNESS_LAG_NS,
            replay=not self._lockstep,
        )
        self._pending = False
        self._later: deque[Twist] = deque()
        self._operational = False
        self._tick_clock = TickClock(graph.TICK_PERIOD)
        self._command = JointCommand()
        self._command_publisher = self.create_publisher(
            JointCommand, graph.JOINT_COMMAND, qos.CONTROL_OFFERED
        )
        self._connect(options)
        self._report = ControllerReport(self, self._controller, self._tick_clock, self._imu)
        self.create_subscription(InclinePlan, graph.INCLINE_PLAN, self._on_plan, qos.LATCHED)
        self.create_service(SetMode, graph.SET_MODE, self._on_set_mode)
        self.create_service(SetGait, graph.SET_GAIT, self._on_set_gait)
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self._diagnostics = diagnostics.Diagnostics(
            self, "Speedgoat", lambda: self._report.diagnose(self._plans)
        )

    def _connect(self, options: ControllerOptions) -> None:
        """Listen to what makes a tick."""
        grace, lockstep = options.grace, options.lockstep
        self._stamped = StampedTwist(self, self._on_cmd_vel)
        self._imu = ImuLink(self, grace, ImuMount(self._robot), self._on_sample, lockstep=lockstep)
        fans = len(self._robot.rotor_names)
        self._fans = FansLink(self, fans, grace, lockstep=lockstep) if options.fans else None
        poses = PoseLink(self, grace, lockstep=lockstep) if options.fans else None
        self._plans = PlanLink(self, grace, lockstep=lockstep) if options.planner else None
        self._inputs = [each for each in (poses, self._fans, self._imu) if each is not None]
        self._awaited = [*self._inputs, self._plans] if self._plans is not None else self._inputs
        self.hot: Sequence[Subscription] = [
            *(each.hot for each in self._inputs if each is not self._imu),
            self.create_subscription(Twist, graph.CMD_VEL, self._on_cmd_vel, qos.COMMAND),
            self.create_subscription(
                DriveStatusArray, graph.DRIVES_STATUS, self._on_drives_status, qos.STATUS
            ),
            self._imu.hot,
            self.create_subscription(
                JointState, graph.JOINT_STATES, self._on_joint_states, qos.CONTROL
            ),
        ]
        self.hot_timers: list[Timer] = []

    # Inputs ---------------------------------------------------------------------------------
    def _on_cmd_vel(self, twist: Twist) -> None:
        if self._pending and self._lockstep:
            self._later.append(twist)  # of the next tick, however long this one waits for the IMU
            return
        accepted, reason = self._controller.set_velocity_command(
            twist.linear.x, twist.linear.y, twist.angular.z
        )
        if not accepted:
            self.get_logger().warning(
                f"velocity command not followed: {reason}", throttle_duration_sec=1.0
            )

    def _on_plan(self, message: InclinePlan) -> None:
        self._settle()
        try:
            accepted, reason = self._controller.take_plan(from_message(message))
        except ValueError as error:
            accepted, reason = False, str(error)
        if not accepted:
            self.get_logger().warning(f"plan refused: {reason}")

    def _on_drives_status(self, status: DriveStatusArray) -> None:
        stamp = stamps.to_ns(status.stamp)
        self._gate.hear_witness(stamp, status.restarts)
        if stamp < self._joint_time_ns - _WITNESS_LAG_NS:
            return  # of another time; if it is a new one, joint states will say so too
        self._operational = status.operational
        if not status.active and self._controller.lose_drives("the drive bridge is not active"):
            # No joint state will come, and so no tick.
            self._report.tell(self._joint_time_ns, self._measurements)

    def _on_sample(self) -> None:
        if self._pending:
            self._tick_when_complete()

    def _on_joint_states(self, state: JointState) -> None:
        """Tick by joint states that go on from the last ones, or whose new time is confirmed."""
        stamp = stamps.to_ns(state.header.stamp)
        for turn, each in self._gate.admit(stamp, state):
            if turn is Turn.REPEAT:
                # The answer was lost; or we wait for the IMU, and it is a sign of life.
                if self._tick_clock.ticks > 0:
                    self._command_publisher.publish(self._command)
            else:
                self._begin_tick(each, turn)

    def _begin_tick(self, state: JointState, turn: Turn) -> None:
        stamp = stamps.to_ns(state.header.stamp)
        if turn is Turn.RESTART:
            self._restart(stamp)
        gap = 1
        if self._joint_time_ns >= 0:
            gap = (stamp - self._joint_time_ns) // graph.TICK_PERIOD_NS
            self._report.missed += max(0, gap - 1)
        self._measurements.joint_age_ticks = gap
        self._joint_state = state
        self._joint_time_ns = stamp
        for each in self._inputs:
            each.await_tick(stamp)
        self._pending = True
        self._tick_when_complete()

    def _restart(self, time_ns: int) -> None:
        """The world starts again at an earlier time: nothing of before counts, passive."""
        counters = self._controller.counters
        wakes = self._controller.watch.wakes
        self._controller = Controller(self._robot, self._gains)
        self._controller.context.counters, self._controller.watch.wakes = counters, wakes
        self._report.restart(self._controller)
        self._joint_time_ns = -1
        self._operational = False
        for each in self._awaited:
            each.restart(time_ns)
        self._measurements = Measurements()
        self.get_logger().warning("time has gone back: passive")

    def quiet(self) -> None:
        """Go on without who is silent."""
        if self._pending:
            for each in self._awaited:
                each.watch(self._joint_time_ns)
            self._tick_when_complete()

    def _settle(self) -> None:
        """Finish the tick at hand, so that a command falls between two ticks in lockstep."""
        if self._lockstep and self.executor is not None:
            executor = cast(WaitSetExecutor, self.executor)
            executor.drain_hot()
            executor.spin_hot_until(lambda: not self._pending)

    # The tick -------------------------------------------------------------------------------
    def _tick_when_complete(self) -> None:
        complete = [each.ready(self._joint_time_ns) for each in self._awaited]
        if not self._lockstep or all(complete):
            self._pending = False
            self._tick()
            while self._later:
                self._on_cmd_vel(self._later.popleft())

    def _tick(self) -> None:
        self._tick_clock.start()
        state, measurements, now = self._joint_state, self._measurements, self._joint_time_ns
        assert state is not None
        measurements.time = now / 1e9
        measurements.joint_position[:] = state.position
        measurements.joint_velocity[:] = state.velocity
        measurements.joint_torque[:] = state.effort
        measurements.drives_operational = self._operational
        for each in self._inputs:
            each.fill(now, measurements)
        if self._plans is not None:
            self._plans.tick(now, self._controller)
        command, message = self._controller.tick(measurements), self._command
        stamps.fill(message.stamp, now)
        stamps.fill(message.imu_stamp, self._imu.time_ns)
        message.mode_of_operation = command.mode_of_operation
        message.position = command.position
        message.velocity = command.velocity
        message.effort = command.effort
        self._command_publisher.publish(message)
        if self._fans is not None:
            self._fans.tell(now, self._controller)
        self._tick_clock.end()
        self._report.tell_mode()
        if self._tick_clock.ticks % REPORT_EVERY == 0:
            self._report.tell(now, measurements)
            self._stamped.look()

    # Services -------------------------------------------------------------------------------
    def _on_set_mode(
        self, request: SetMode.Request, response: SetMode.Response
    ) -> SetMode.Response:
        self._settle()
        response.success, response.message = self._controller.request_mode(request.mode)
        if not response.success:
            self.get_logger().warning(f"mode not changed: {response.message}")
        return response

    def _on_set_gait(
        self, request: SetGait.Request, response: SetGait.Response
    ) -> SetGait.Response:
        self._settle()
        response.success, response.message = self._controller.request_gait(request.gait)
        if not response.success:
            self.get_logger().warning(f"gait not changed: {response.message}")
        return response

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Take new gains together, all or none; refuse them with what is allowed."""
        self._settle()
        try:
            self._gains.set_own({p.name: p.value for p in parameters})
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        for p in parameters:
            if p.name == WAKE:
                self._controller.watch.wakes = p.value
        return SetParametersResult(successful=True)

    def close(self) -> None:
        """Listen no more; the drive bridge stops the drives when commands end."""
        self._stamped.close()


def main() -> int:
    """Run the node."""
    return run(LowLevelController)


if __name__ == "__main__":
    sys.exit(main())
