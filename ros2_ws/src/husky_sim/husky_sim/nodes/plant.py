"""Node `plant`: the simulated world on the far side of the wires."""

from __future__ import annotations

import sys
import time
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from scipy.spatial.transform import Rotation
from std_srvs.srv import SetBool

from husky_description import graph
from husky_description.lockstep import Peer, Presence
from husky_description.nodes import diagnostics, qos, stamps
from husky_description.nodes.parameters import declare, declare_mounting
from husky_description.nodes.run import run
from husky_description.nodes.tick_clock import TickClock, percentile_ms
from husky_description.robot import load_robot
from husky_drivers.vn200_imu import ImuFigures
from husky_msgs.msg import EstimateError, FootContacts, ServoCommand, ServoState
from husky_msgs.srv import ApplyWrench, InjectFault, ResetWorld, StepWorld
from husky_sim.nodes.plant_parameters import declare_world
from husky_sim.nodes.propulsion_wires import PropulsionWires
from husky_sim.nodes.sensor_line import SensorLine, warn_of_silence
from husky_sim.vn200_device import Vn200Device
from husky_sim.world import Array, World

_RESEND_PERIOD = 0.1
"""Wall time after which an unanswered state is sent again: best effort may lose one [s]."""
_TRUTHS_KEPT = 64
"""Ticks for which the truth is kept to compare estimates with."""
_TRUTH_EVERY = 5
"""Ticks between two messages of ground truth: 100 Hz."""


class Plant(Node):
    """Steps the world and speaks for the motors, the IMU and the ground truth.

    In lockstep a tick goes: publish the state of tick k, wait until the drive bridge has answered
    with k's stamp, step by 2 ms. In realtime a wall timer steps and the newest answer counts.
    """

    def __init__(self) -> None:
        """Declare parameters, build the world, open the wires."""
        super().__init__(graph.PLANT)
        self._lockstep = (
            declare(self, "time", "lockstep", "who sets the pace", allowed=("lockstep", "realtime"))
            == "lockstep"
        )
        grace = declare(
            self, "grace", 1.0, "wall time a silent peer is waited for [s]", lower=0.2, upper=60.0
        )
        payload = declare(
            self,
            "payload",
            -1.0,
            "payload [kg], negative for 7.6 kg in all",
            lower=-1.0,
            upper=10.0,
        )
        scene = declare(self, "save_scene", "", "file that gets the world as MuJoCo XML")
        options = declare_world(self)
        changes: dict[str, Any] = {} if payload < 0.0 else {"payload_mass": payload}
        robot = load_robot(**changes, **declare_mounting(self))
        self._world = World(robot, options)
        if scene:
            Path(scene).write_text(self._world.scene_xml)
        self._seed = options.seed
        self._imu = SensorLine(
            self,
            Vn200Device(ImuFigures.of(robot.imu), self._seed),
            "imu_port",
            "the IMU's serial line",
            Peer(graph.VN200_DRIVER, grace),
        )
        self._bridge = Peer(graph.DRIVE_BRIDGE, grace)
        self._command_ns = -1
        self._paused = declare(self, "start_paused", False, "wait for the step or pause service")
        self._steps_left = 0
        self._started = False
        self._overruns = 0
        self._wires: PropulsionWires | None = None
        self._tick_clock = TickClock(graph.TICK_PERIOD)
        self._imu_sent: dict[int, float] = {}
        self._truths: dict[int, tuple[Array, Array, Array]] = {}
        self._latencies: deque[float] = deque(maxlen=2048)
        self._next_due = self._sent_at = time.monotonic()

        self._state = ServoState()
        self._clock_message = Clock()
        self._clock_ns, self._clock_at = 0, 0.0
        self._state_publisher = self.create_publisher(ServoState, graph.SERVO_STATE, qos.CONTROL)
        self._clock_publisher = self.create_publisher(Clock, graph.CLOCK, qos.CLOCK)
        self._truth_publisher = self.create_publisher(Odometry, graph.GROUND_TRUTH, qos.STATUS)
        self._contacts_publisher = self.create_publisher(
            FootContacts, graph.FOOT_CONTACTS, qos.STATUS
        )
        self._error_publisher = self.create_publisher(
            EstimateError, graph.ESTIMATE_ERROR, qos.STATUS
        )
        # An estimate is compared before the world moves on.
        self.hot = [
            self.create_subscription(Odometry, graph.ODOMETRY, self._on_estimate, qos.STATUS),
            self.create_subscription(
                ServoCommand, graph.SERVO_COMMAND, self._on_command, qos.CONTROL
            ),
        ]
        if self._world.fans is not None:
            self._wires = PropulsionWires(self, self._world, self._seed, grace, self._on_answer)
            self.hot.append(self._wires.hot)
        if not self._world.has_legs:
            self._bridge = Peer(graph.DRIVE_BRIDGE, grace, start_grace=None)
            self._imu.expect(Peer(graph.VN200_DRIVER, grace, start_grace=None))
        self.create_service(ResetWorld, graph.PLANT_RESET, self._on_reset)
        self.create_service(SetBool, graph.PLANT_PAUSE, self._on_pause)
        self.create_service(StepWorld, graph.PLANT_STEP, self._on_step)
        self.create_service(ApplyWrench, graph.PLANT_APPLY_WRENCH, self._on_apply_wrench)
        self.create_service(SetBool, graph.PLANT_HOLD, self._on_hold)
        self.create_service(InjectFault, graph.PLANT_INJECT_FAULT, self._on_inject_fault)
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self._diagnostics = diagnostics.Diagnostics(self, "MuJoCo", self._report)
        self.hot_timers = []
        if not self._lockstep:
            self.hot_timers.append(self.create_timer(graph.TICK_PERIOD, self._on_period))

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Move the trolley."""
        for parameter in parameters:
            if parameter.name == "trolley_position" and self._world.gantry is not None:
                self._world.gantry.move_to(parameter.value)
        return SetParametersResult(successful=True)

    # The tick -------------------------------------------------------------------------------
    def _on_command(self, command: ServoCommand) -> None:
        stamp = stamps.to_ns(command.stamp)
        if stamp > self._world.time_ns:
            return  # of a time before a reset
        self._bridge.answer(stamp)
        if stamp < self._command_ns:
            return  # a sign of life
        self._command_ns = stamp
        self._measure_latency(stamps.to_ns(command.imu_stamp))
        self._world.servos.set_command(
            command.kind,
            command.position,
            command.velocity,
            command.torque,
            command.kp,
            command.kd,
            command.torque_limit,
        )
        self._on_answer()

    def _on_answer(self) -> None:
        if self._lockstep:
            self._advance()

    def _measure_latency(self, imu_ns: int) -> None:
        """The first command that stands on an IMU sample has come: how old is the sample?"""
        sent = self._imu_sent.pop(imu_ns, None)
        if sent is not None:
            self._latencies.append(time.perf_counter() - sent)
            for older in [key for key in self._imu_sent if key < imu_ns]:
                del self._imu_sent[older]

    def quiet(self) -> None:
        """Talk to the IMU's driver, say again what was lost, go on without a lost peer."""
        self._imu.service()
        if not self._lockstep:
            return
        if self._started and self._bridge.owes(self._world.time_ns):
            now = time.monotonic()
            if now - self._sent_at > _RESEND_PERIOD:
                self._send_state()
            self._await_bridge(now)
        if self._wires is not None:
            self._wires.serve()
            if self._started:
                self._wires.await_answer(time.monotonic())
        self._advance()
        if self._started and not self._running():
            self._repeat_clock(time.monotonic())

    def _repeat_clock(self, now: float) -> None:
        """Tell the time of a world that stands still to who did not hear it or comes later."""
        if now - self._clock_at > _RESEND_PERIOD and self._clock_ns > 0:
            self._send_clock(self._clock_ns)

    def _send_clock(self, time_ns: int) -> None:
        self._clock_ns, self._clock_at = time_ns, time.monotonic()
        stamps.fill(self._clock_message.clock, time_ns)
        self._clock_publisher.publish(self._clock_message)

    def _await_bridge(self, now: float) -> None:
        if self._bridge.expire(now):
            warn_of_silence(self, self._bridge)

    def _advance(self) -> None:
        """Step if the tick is complete and the world may go on; then publish the new state."""
        if self._running() and self._started and self._is_answered():
            self._tick()
        if self._running() and not self._started and self._sensors_are_set_up():
            # The first state of a run: nobody has answered it yet.
            self._started = True
            self._publish_state()

    def _is_answered(self) -> bool:
        """Return whether everyone who takes part has answered the state of now."""
        wires = self._wires
        return self._bridge.ready(self._world.time_ns) and (wires is None or wires.ready())

    def _sensors_are_set_up(self) -> bool:
        """Return whether the drivers have told their devices to stream: no run misses a sample."""
        imu = self._imu.is_set_up()
        return (self._wires is None or self._wires.driver_is_set_up()) and imu

    def _running(self) -> bool:
        return self._steps_left > 0 or not self._paused

    def _tick(self) -> None:
        world = self._world
        self._tick_clock.start()
        samples = world.step_tick()
        self._steps_left = max(0, self._steps_left - 1)
        self._publish_state()  # first: the others work while the IMU's bytes are written
        for sample in samples:
            self._imu.device.sample(
                sample.time_ns,
                sample.orientation,
                sample.angular_velocity,
                sample.specific_force,
            )
            self._imu_sent[sample.time_ns] = time.perf_counter()
        self._imu.service()
        if self._wires is not None:
            self._wires.serve()
        self._remember_truth()
        if (world.time_ns // graph.TICK_PERIOD_NS) % _TRUTH_EVERY == 0:
            self._publish_truth()
        self._tick_clock.end()

    def _publish_state(self) -> None:
        if self._wires is not None:
            self._wires.publish()
        if not self._world.has_legs:
            return
        state, servos = self._state, self._world.servos
        stamps.fill(state.stamp, self._world.time_ns)
        state.encoder_count = servos.encoder_count
        state.velocity_count = servos.velocity_count
        state.current = servos.current
        state.bus_voltage = servos.bus_voltage
        self._send_state()

    def _send_state(self) -> None:
        self._sent_at = time.monotonic()
        self._state_publisher.publish(self._state)

    def _on_period(self) -> None:
        """Realtime: one tick every 2 ms of wall time."""
        now = time.monotonic()
        if now - self._next_due > graph.TICK_PERIOD:
            self._overruns += 1
            self._next_due = now
        self._next_due += graph.TICK_PERIOD
        if self._running():
            if not self._bridge.ready(self._world.time_ns):
                self._await_bridge(now)
            if self._wires is not None:
                self._wires.watch(now)
            self._tick()

    # Ground truth ---------------------------------------------------------------------------
    def _publish_truth(self) -> None:
        world = self._world
        self._send_clock(world.time_ns)
        truth = Odometry()
        truth.header.frame_id = graph.FRAME_WORLD
        truth.child_frame_id = graph.FRAME_BASE
        stamps.fill(truth.header.stamp, world.time_ns)
        pose, twist = truth.pose.pose, truth.twist.twist
        pose.position.x, pose.position.y, pose.position.z = map(float, world.base_position)
        orientation = world.base_orientation
        q = pose.orientation
        q.x, q.y, q.z, q.w = map(float, orientation)
        velocity = world.base_velocity_in_base()
        twist.linear.x, twist.linear.y, twist.linear.z = velocity.tolist()
        rate = world.base_angular_velocity
        twist.angular.x, twist.angular.y, twist.angular.z = map(float, rate)
        self._truth_publisher.publish(truth)
        if self._wires is not None:
            self._wires.publish_state()
        if not world.has_legs:
            return

        contacts = FootContacts()
        stamps.fill(contacts.stamp, world.time_ns)
        forces, normals = world.foot_contacts()
        contacts.contact = np.any(forces, axis=1).tolist()
        for values, vectors in (
            (forces, contacts.force),
            (normals, contacts.normal),
            (world.foot_positions(), contacts.position),
        ):
            for value, vector in zip(values.tolist(), vectors, strict=True):
                vector.x, vector.y, vector.z = value
        point = contacts.center_of_mass
        point.x, point.y, point.z = world.center_of_mass().tolist()
        self._contacts_publisher.publish(contacts)

    def _on_estimate(self, estimate: Odometry) -> None:
        """Compare the controller's estimate with the truth of its stamp, if that is recent."""
        truth = self._truths.get(stamps.to_ns(estimate.header.stamp))
        if truth is None:
            return
        true_position, true_orientation, true_velocity = truth
        position, q = estimate.pose.pose.position, estimate.pose.pose.orientation
        linear = estimate.twist.twist.linear
        estimated = Rotation.from_quat((q.x, q.y, q.z, q.w))
        true = Rotation.from_quat(true_orientation, scalar_first=True)
        error = EstimateError()
        error.stamp = estimate.header.stamp
        error.position = np.array((position.x, position.y, position.z)) - true_position
        error.velocity = estimated.apply((linear.x, linear.y, linear.z)) - true_velocity
        error.attitude = (true.inv() * estimated).as_rotvec()
        self._error_publisher.publish(error)

    def _remember_truth(self) -> None:
        """Keep the truth of the last ticks: estimates come a little later."""
        qpos, qvel = self._world.data.qpos, self._world.data.qvel
        self._truths[self._world.time_ns] = (qpos[0:3].copy(), qpos[3:7].copy(), qvel[0:3].copy())
        self._truths.pop(self._world.time_ns - _TRUTHS_KEPT * graph.TICK_PERIOD_NS, None)

    # Services -------------------------------------------------------------------------------
    def _on_reset(self, request: ResetWorld.Request, response: ResetWorld.Response):  # type: ignore[no-untyped-def]
        try:
            self._world.reset(request.keyframe or self._world.options.keyframe)
        except ValueError as error:
            response.success, response.message = False, str(error)
            return response
        self._imu_sent.clear()
        self._truths.clear()
        self._seed = self._seed if request.seed < 0 else int(request.seed)
        self._imu.device.restart(self._seed)
        self._bridge.restart()
        if self._wires is not None:
            self._wires.restart(self._seed)
        self._command_ns = -1
        self._clock_ns = 0
        self._started = False
        response.success, response.message = True, "the world is back at time 0"
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response):  # type: ignore[no-untyped-def]
        self._paused = request.data
        response.success = True
        response.message = f"{'paused' if request.data else 'running'} at {self._world.time_ns} ns"
        return response

    def _on_step(self, request: StepWorld.Request, response: StepWorld.Response):  # type: ignore[no-untyped-def]
        if not (self._lockstep and self._paused):
            response.message = "stepping needs the lockstep clock and a paused world"
        elif request.ticks < 1:
            response.message = f"ticks is {request.ticks}, it must be at least 1"
        else:
            self._steps_left = request.ticks
            self._advance()
            self.executor.spin_hot_until(self._has_settled)
            response.success = True
        stamps.fill(response.stamp, self._world.time_ns)
        response.trajectory_sha256 = self._world.trajectory_sha256
        return response

    def _on_hold(self, request: SetBool.Request, response: SetBool.Response):  # type: ignore[no-untyped-def]
        self._world.hold(request.data)
        response.success = True
        response.message = f"the base is {'held' if request.data else 'free'}"
        return response

    def _has_settled(self) -> bool:
        """Whether the steps asked for are done and the bridge has told everybody of the last one.

        So whatever the asker sends next comes after that tick, at any node.
        """
        return self._steps_left == 0 and self._is_answered()

    def _on_apply_wrench(self, request: ApplyWrench.Request, response: ApplyWrench.Response):  # type: ignore[no-untyped-def]
        force, torque = request.wrench.force, request.wrench.torque
        try:
            self._world.push(
                request.body,
                np.array((force.x, force.y, force.z)),
                np.array((torque.x, torque.y, torque.z)),
                request.duration,
            )
        except ValueError as error:
            response.success, response.message = False, str(error)
            return response
        response.success = True
        return response

    def _on_inject_fault(self, request: InjectFault.Request, response: InjectFault.Response):  # type: ignore[no-untyped-def]
        try:
            if self._wires is not None and self._wires.inject(request.target, request.fault):
                response.success = True
                return response
            if request.target != "imu":
                targets = ["imu", *(self._wires.targets() if self._wires is not None else ())]
                response.message = (
                    f"target is {request.target!r}, the plant has: {', '.join(targets)}"
                )
                return response
            self._imu.inject(request.fault)
        except ValueError as error:
            response.message = f"{error}, unplug"
            return response
        response.success = True
        return response

    def _report(self) -> diagnostics.Report:
        peers = [self._bridge]
        if self._wires is not None:
            peers.append(self._wires.flight_controller)
        lost = [peer.name for peer in peers if peer.presence is Presence.LOST]
        level, message = diagnostics.OK, "running"
        if lost:
            level = diagnostics.ERROR
            message = ", ".join(f"{name} is lost" for name in lost)
        elif self._paused:
            message = "paused"
        elif self._overruns:
            level, message = diagnostics.WARN, "the wall clock could not be kept"
        return (
            level,
            message,
            {
                "simulated_time_s": self._world.time_ns / 1e9,
                "overruns": self._overruns,
                "tick_ms_p50": percentile_ms(self._tick_clock.durations(), 50),
                "period_ms_p50": percentile_ms(self._tick_clock.periods(), 50),
                "period_ms_p99": percentile_ms(self._tick_clock.periods(), 99),
                "imu_to_target_ms_p50": percentile_ms(np.array(self._latencies), 50),
                "imu_to_target_ms_p99": percentile_ms(np.array(self._latencies), 99),
                "peer_losses": sum(peer.losses for peer in peers),
                "lost_peers": " ".join(lost),
                "trajectory_sha256": self._world.trajectory_sha256,
            },
        )

    def close(self) -> None:
        """Give the serial line back."""
        self._imu.close()
        if self._wires is not None:
            self._wires.close()


def main() -> int:
    """Run the node."""
    return run(Plant)


if __name__ == "__main__":
    sys.exit(main())
