"""Node `low_level_controller`: one control tick for every joint state, at 500 Hz (thesis T7)."""

from __future__ import annotations

import sys
import time
from collections import deque

import numpy as np
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.timer import Timer
from sensor_msgs.msg import Imu, JointState

from husky_control.controller import Controller
from husky_control.modes import Mode
from husky_control.nodes.fans_link import FansLink
from husky_control.nodes.imu_decoder import ImuSample, decode_imu
from husky_control.nodes.plan_link import PlanLink
from husky_control.nodes.plan_message import from_message
from husky_control.nodes.pose_link import PoseLink
from husky_control.parameters import TABLE, Parameters
from husky_control.rotation import matrix_from_quaternion
from husky_control.stability import static_margin
from husky_control.t265_pose import T265Pose
from husky_control.tick_data import Measurements
from husky_description import graph
from husky_description.lockstep import Peer, Presence
from husky_description.nodes import diagnostics, qos, stamps
from husky_description.nodes.parameters import declare, declare_mounting
from husky_description.nodes.run import run
from husky_description.nodes.tick_clock import TickClock, percentile_ms
from husky_description.robot import load_robot
from husky_msgs.msg import ControllerState, DriveStatusArray, InclinePlan, JointCommand
from husky_msgs.srv import SetGait, SetMode

Array = NDArray[np.float64]

_IMU_PERIOD_NS = 1_250_000
"""The VN-200 sends at 800 Hz (thesis T4) [ns]."""
_NEVER = 1e6
"""Age of an IMU sample that has never come [s]."""
_FOREIGN_NS = 100_000_000
"""An IMU sample so far ahead of the joint states is of a time before a reset [ns]."""
_REPORT_EVERY = 10
"""Ticks between two messages of state and odometry: 50 Hz."""


class LowLevelController(Node):
    """Turns joint states and IMU samples into calls of `Controller.tick`.

    The tick of joint states k uses the newest IMU sample that was due before k's stamp. In lockstep
    it waits for that sample; otherwise it takes what is there, and the age of the sample counts.
    """

    def __init__(self) -> None:
        """Declare parameters, make the controller, publishers and subscriptions."""
        super().__init__(graph.LOW_LEVEL_CONTROLLER)
        self._lockstep = (
            declare(
                self,
                "time",
                "lockstep",
                "lockstep: wait for the IMU sample that belongs to a tick; realtime: do not",
                allowed=("lockstep", "realtime"),
            )
            == "lockstep"
        )
        grace = declare(
            self, "grace", 1.0, "wall time a silent IMU is waited for [s]", lower=0.2, upper=60.0
        )
        fans = declare(self, "propulsion", False, "the robot carries the propulsion unit")
        planner = declare(self, "planner", False, "ask the planner for plans on inclines")
        payload = declare(
            self,
            "payload",
            -1.0,
            "payload [kg], negative for 7.6 kg in all",
            lower=-1.0,
            upper=10.0,
        )
        weight = {} if payload < 0.0 else {"payload_mass": payload}
        robot = load_robot(**weight, **declare_mounting(self))
        parameters = Parameters()
        for name, row in TABLE.items():
            value = declare(
                self,
                name,
                row.default,
                f"{row.description} [{row.unit}]",
                lower=row.lower,
                upper=row.upper,
                read_only=False,
            )
            parameters.set(name, value)
        self._gains = parameters
        self._robot = robot
        self._controller = Controller(robot, parameters)
        self._measurements = Measurements()
        self._imu = Peer(graph.VN200_DRIVER, grace, start_grace=None)
        self._samples: deque[ImuSample] = deque(maxlen=16)
        self._joint_state: JointState | None = None
        self._joint_time_ns = -1
        self._imu_time_ns = 0
        self._pending = False
        self._later: deque[Twist] = deque()
        self._operational = False
        self._rotation = np.eye(3)
        self._tick_clock = TickClock(graph.TICK_PERIOD)
        self._missed = 0

        self._command = JointCommand()
        self._command_publisher = self.create_publisher(
            JointCommand, graph.JOINT_COMMAND, qos.CONTROL
        )
        self._state_publisher = self.create_publisher(
            ControllerState, graph.CONTROLLER_STATE, qos.STATUS
        )
        self._odometry_publisher = self.create_publisher(Odometry, graph.ODOMETRY, qos.STATUS)
        # Served in this order: what belongs to a tick before the tick.
        self.hot = [
            self.create_subscription(Twist, graph.CMD_VEL, self._on_cmd_vel, qos.COMMAND),
            self.create_subscription(
                DriveStatusArray, graph.DRIVES_STATUS, self._on_drives_status, qos.STATUS
            ),
            self.create_subscription(Imu, graph.IMU, self._on_imu, qos.CONTROL, raw=True),
            self.create_subscription(
                JointState, graph.JOINT_STATES, self._on_joint_states, qos.CONTROL
            ),
        ]
        self._fans = FansLink(self, grace, lockstep=self._lockstep) if fans else None
        if self._fans is not None:
            self.hot.insert(0, self._fans.hot)
        self._poses = PoseLink(self, grace, lockstep=self._lockstep) if fans else None
        if self._poses is not None:
            self.hot.insert(0, self._poses.hot)
        self._plans = PlanLink(self, grace, lockstep=self._lockstep) if planner else None
        self.create_subscription(InclinePlan, graph.INCLINE_PLAN, self._on_plan, qos.LATCHED)
        self.hot_timers: list[Timer] = []
        self.create_service(SetMode, graph.SET_MODE, self._on_set_mode)
        self.create_service(SetGait, graph.SET_GAIT, self._on_set_gait)
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self._diagnostics = diagnostics.Diagnostics(self, "Speedgoat", self._report)

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
                f"velocity command refused: {reason}", throttle_duration_sec=1.0
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
        self._operational = status.operational

    def _on_imu(self, data: bytes) -> None:
        sample = decode_imu(data)
        stamp = sample.time_ns
        if 0 <= self._joint_time_ns < stamp - _FOREIGN_NS:
            return
        self._samples.append(sample)
        self._imu.answer(stamp)
        if self._pending:
            self._tick_when_complete()

    def _on_joint_states(self, state: JointState) -> None:
        stamp = stamps.to_ns(state.header.stamp)
        if stamp == self._joint_time_ns:
            # The answer was lost; or we wait for the IMU, and the last answer is a sign of life.
            if self._tick_clock.ticks > 0:
                self._command_publisher.publish(self._command)
            return
        if stamp < self._joint_time_ns:
            self._restart(stamp)
        gap = 1
        if self._joint_time_ns >= 0:
            gap = (stamp - self._joint_time_ns) // graph.TICK_PERIOD_NS
            self._missed += max(0, gap - 1)
        self._measurements.joint_age_ticks = gap
        self._joint_state = state
        self._joint_time_ns = stamp
        self._pending = True
        self._tick_when_complete()

    def _restart(self, time_ns: int) -> None:
        """The world starts again at an earlier time: nothing of before counts, passive."""
        counters = self._controller.counters
        self._controller = Controller(self._robot, self._gains)
        self._controller.counters = counters
        newer = [sample for sample in self._samples if sample.time_ns < time_ns + _FOREIGN_NS]
        self._samples.clear()
        self._samples.extend(newer)
        self._imu.restart(newer[-1].time_ns if newer else -1)
        self._joint_time_ns = -1
        self._operational = False
        if self._fans is not None:
            self._fans.restart()
        if self._poses is not None:
            self._poses.restart()
        if self._plans is not None:
            self._plans.restart()
        self._measurements.pose = T265Pose()
        self.get_logger().warning("time has gone back: passive")

    def quiet(self) -> None:
        """Go on without the IMU when it is lost."""
        if self._pending:
            if self._imu.expire(time.monotonic()):
                self.get_logger().warning(f"{self._imu.name} is silent: going on without it")
            if self._fans is not None:
                self._fans.watch(self._joint_time_ns)
            if self._poses is not None:
                self._poses.watch(self._joint_time_ns)
            if self._plans is not None:
                self._plans.watch(self._joint_time_ns)
            self._tick_when_complete()

    def _settle(self) -> None:
        """Finish the tick at hand, so that a command falls between two ticks in lockstep."""
        if self._lockstep and self.executor is not None:
            self.executor.drain_hot()
            self.executor.spin_hot_until(lambda: not self._pending)

    # The tick -------------------------------------------------------------------------------
    def _tick_when_complete(self) -> None:
        due = self._joint_time_ns - _IMU_PERIOD_NS
        fans = self._fans is None or self._fans.ready(self._joint_time_ns)
        poses = self._poses is None or self._poses.ready(self._joint_time_ns)
        plans = self._plans is None or self._plans.ready(self._joint_time_ns)
        if not self._lockstep or (self._imu.ready(due) and fans and poses and plans):
            self._pending = False
            self._tick()
            while self._later:
                self._on_cmd_vel(self._later.popleft())

    def _tick(self) -> None:
        self._tick_clock.start()
        state, measurements = self._joint_state, self._measurements
        assert state is not None
        measurements.time = self._joint_time_ns / 1e9
        measurements.joint_position[:] = state.position
        measurements.joint_velocity[:] = state.velocity
        measurements.joint_torque[:] = state.effort
        measurements.drives_operational = self._operational
        self._take_imu(measurements)
        if self._fans is not None:
            measurements.fans_available = self._fans.available(self._joint_time_ns)
            measurements.fans_limit = self._fans.limit(self._joint_time_ns)
            measurements.fans_yaw = self._fans.yaw(self._joint_time_ns)
        if self._poses is not None:
            self._poses.take(self._joint_time_ns, measurements.pose)
        if self._plans is not None:
            self._plans.tick(self._joint_time_ns, self._controller)
        command, message = self._controller.tick(measurements), self._command
        stamps.fill(message.stamp, self._joint_time_ns)
        stamps.fill(message.imu_stamp, self._imu_time_ns)
        message.mode_of_operation = command.mode_of_operation
        message.position = command.position
        message.velocity = command.velocity
        message.effort = command.effort
        self._command_publisher.publish(message)
        if self._fans is not None:
            self._fans.tell(self._joint_time_ns, self._controller)
        self._tick_clock.end()
        if self._tick_clock.ticks % _REPORT_EVERY == 0:
            self._publish_state()

    def _take_imu(self, measurements: Measurements) -> None:
        """Use the newest sample of before this tick; in realtime simply the newest."""
        samples = self._samples
        while len(samples) > 1 and (not self._lockstep or samples[1].time_ns < self._joint_time_ns):
            samples.popleft()
        if samples:
            sample = samples[0]
            measurements.orientation_base_in_world[:] = sample.orientation
            measurements.angular_velocity_base_in_base[:] = sample.angular_velocity
            measurements.specific_force_base[:] = sample.specific_force
            self._imu_time_ns = sample.time_ns
            measurements.imu_age = (self._joint_time_ns - sample.time_ns) / 1e9
        else:
            measurements.imu_age = _NEVER

    # Reports --------------------------------------------------------------------------------
    def _publish_state(self) -> None:
        controller = self._controller
        matrix_from_quaternion(controller.orientation_base_in_world, self._rotation)
        state = ControllerState()
        stamps.fill(state.stamp, self._joint_time_ns)
        state.mode, state.gait = controller.mode.value, controller.gait
        state.reason = controller.reason
        state.phase = controller.phase
        state.stance = controller.stance.tolist()
        state.contact = controller.contact.tolist()
        state.position = controller.position_base_in_world
        state.orientation = controller.orientation_base_in_world
        state.velocity = controller.velocity_base_in_world
        feet = controller.foot_in_base[np.asarray(controller.contact, dtype=bool)]
        # The legs are light: the base's origin stands for the centre of mass.
        state.static_margin = static_margin(
            controller.position_base_in_world,
            feet @ self._rotation.T + controller.position_base_in_world,
        )
        state.desired_position = controller.desired_position
        state.desired_velocity = controller.desired_velocity
        state.commanded_velocity = controller.commanded_velocity
        state.ticks = self._tick_clock.ticks
        state.overruns = self._tick_clock.overruns
        state.missed_ticks = self._missed
        state.refused_commands = controller.counters.refused_velocity_commands
        durations = self._tick_clock.durations(_REPORT_EVERY)
        state.tick_time_mean, state.tick_time_max = float(durations.mean()), float(durations.max())
        jitter = np.abs(self._tick_clock.periods(_REPORT_EVERY) - graph.TICK_PERIOD)
        state.jitter_max = float(jitter.max())
        self._state_publisher.publish(state)

        odometry = Odometry()
        odometry.header.stamp = state.stamp
        odometry.header.frame_id = graph.FRAME_ODOM
        odometry.child_frame_id = graph.FRAME_BASE
        pose, twist = odometry.pose.pose, odometry.twist.twist
        pose.position.x, pose.position.y, pose.position.z = map(
            float, controller.position_base_in_world
        )
        q = pose.orientation
        q.x, q.y, q.z, q.w = map(float, controller.orientation_base_in_world)
        velocity = controller.velocity_base_in_world @ self._rotation
        twist.linear.x, twist.linear.y, twist.linear.z = map(float, velocity)
        rate = self._measurements.angular_velocity_base_in_base
        twist.angular.x, twist.angular.y, twist.angular.z = map(float, rate)
        self._odometry_publisher.publish(odometry)

    def _report(self) -> diagnostics.Report:
        controller = self._controller
        level, message = diagnostics.OK, controller.mode.value
        if self._imu.presence is Presence.LOST:
            level, message = diagnostics.ERROR, f"{self._imu.name} is lost"
        elif controller.mode in (Mode.DAMPING, Mode.EMERGENCY_STOP):
            level, message = diagnostics.WARN, f"{message}: {controller.reason}"
        return (
            level,
            message,
            {
                "ticks": self._tick_clock.ticks,
                "tick_ms_p50": percentile_ms(self._tick_clock.durations(), 50),
                "tick_ms_p99": percentile_ms(self._tick_clock.durations(), 99),
                "period_ms_p50": percentile_ms(self._tick_clock.periods(), 50),
                "period_ms_p99": percentile_ms(self._tick_clock.periods(), 99),
                "overruns": self._tick_clock.overruns,
                "missed_ticks": self._missed,
                "peer_losses": self._imu.losses,
                "refused_commands": controller.counters.refused_velocity_commands,
                "plans": self._plans.plans if self._plans is not None else 0,
                "plans_refused": self._plans.refusals if self._plans is not None else 0,
            },
        )

    # Services -------------------------------------------------------------------------------
    def _on_set_mode(self, request: SetMode.Request, response: SetMode.Response):  # type: ignore[no-untyped-def]
        self._settle()
        response.success, response.message = self._controller.request_mode(request.mode)
        return response

    def _on_set_gait(self, request: SetGait.Request, response: SetGait.Response):  # type: ignore[no-untyped-def]
        self._settle()
        response.success, response.message = self._controller.request_gait(request.gait)
        return response

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Take new gains whole, or refuse them with the allowed range."""
        self._settle()
        chosen = {p.name: p.value for p in parameters if p.name in TABLE}
        try:
            Parameters(chosen)  # all of them are good, or none is taken
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        for name, value in chosen.items():
            self._gains.set(name, value)
        return SetParametersResult(successful=True)

    def close(self) -> None:
        """Nothing to give back: the drive bridge stops the drives when commands end."""


def main() -> int:
    """Run the node."""
    return run(LowLevelController)


if __name__ == "__main__":
    sys.exit(main())
