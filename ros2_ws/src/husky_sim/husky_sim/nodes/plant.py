"""Node `plant`: the simulated world on the far side of the wires."""

from __future__ import annotations

import sys
import time

import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool

from husky_drivers.vn200.imu import ImuFigures
from husky_msgs.srv import ApplyWrench, InjectFault, ResetWorld, StepWorld
from husky_runtime import graph
from husky_runtime.lockstep import Presence
from husky_runtime.nodes import diagnostics, stamps
from husky_runtime.nodes.one_clock import OneClock
from husky_runtime.nodes.parameters import declare
from husky_runtime.nodes.run import run
from husky_runtime.nodes.tick_clock import TickClock, percentile_ms
from husky_sim.devices.vn200.device import Vn200Device
from husky_sim.nodes.answered_wire import peer_of
from husky_sim.nodes.camera_wire import CameraWire
from husky_sim.nodes.ground_markers import GroundMarkers
from husky_sim.nodes.ground_truth import GroundTruth
from husky_sim.nodes.joint_wires import open_joint_wires
from husky_sim.nodes.plant_parameters import declare_and_build_world
from husky_sim.nodes.propulsion_wires import PropulsionWires
from husky_sim.nodes.sensor_line import SensorLine
from husky_sim.nodes.world_clock import ImuLatency, WorldClock
from husky_sim.nodes.world_steps import WorldSteps

_TRUTH_EVERY = 5
"""Ticks between two messages of ground truth: 100 Hz."""


class Plant(OneClock, Node):
    """Steps the world and speaks for the motors, the IMU and the ground truth.

    In lockstep a tick goes: tell the state of tick k, wait until who commands the joints has
    answered it (`husky_sim.nodes.joint_wires`), step by 2 ms. In realtime a wall timer steps and
    the newest answer counts.
    """

    def __init__(self) -> None:
        """Declare parameters, build the world, open the wires."""
        super().__init__(graph.PLANT)
        paces = ("lockstep", "realtime")
        pace = declare(self, "time", "lockstep", "who sets the pace", allowed=paces)
        self._lockstep = pace == "lockstep"
        grace = declare(self, "grace", 1.0, "wall time a silent peer is waited for [s]", 0.2, 60.0)
        what = "realtime: delay that the world makes up for; after a longer one it goes on late [s]"
        self._catch_up = declare(self, "catch_up", 0.0, what, 0.0, 1.0)
        self._world = declare_and_build_world(self)
        self._seed = self._world.options.seed
        device = Vn200Device(ImuFigures.of(self._world.robot.imu), self._seed)
        driver = peer_of(self, self._world, graph.VN200_DRIVER, grace)
        self._imu = SensorLine(self, device, "imu_port", "the IMU's serial line", driver)
        self._paused = declare(self, "start_paused", False, "wait for the step or pause service")
        self._steps = WorldSteps()
        self._started = False
        self._overruns = 0
        self._tick_clock = TickClock(graph.TICK_PERIOD)
        self._latency = ImuLatency()
        self._next_due = time.monotonic()
        self._world_clock = WorldClock(self)
        self._truth = GroundTruth(self, self._world)
        self._ground = GroundMarkers(self, self._world.model)
        self._joints = open_joint_wires(
            self, self._world, grace, self._world_clock, self._latency, self._on_answer
        )
        self.hot = [self._truth.subscription, *self._joints.hot]
        self.hot_wires = self._joints.hot_wires
        self._wires: PropulsionWires | None = None
        if self._world.fans is not None:
            self._wires = PropulsionWires(self, self._world, self._seed, grace, self._on_answer)
            self.hot.append(self._wires.hot)
        self._camera: CameraWire | None = None
        if declare(self, "camera", False, "switches the depth camera on"):
            self._camera = CameraWire(self, self._world, self._seed, grace, self._lockstep)
            self.hot_wires = [*self.hot_wires, self._serve_camera]
        wires = (self._joints, self._wires, self._camera)
        self._answered_wires = [each for each in wires if each is not None]
        self._offer_services()
        self._diagnostics = diagnostics.Diagnostics(self, "MuJoCo", self._report)
        self.hot_timers = []
        if not self._lockstep:
            self.hot_timers.append(self.create_timer(graph.TICK_PERIOD, self._on_period))

    def _offer_services(self) -> None:
        self.create_service(ResetWorld, graph.PLANT_RESET, self._on_reset)
        self.create_service(SetBool, graph.PLANT_PAUSE, self._on_pause)
        self.create_service(StepWorld, graph.PLANT_STEP, self._on_step)
        self.create_service(ApplyWrench, graph.PLANT_APPLY_WRENCH, self._on_apply_wrench)
        self.create_service(SetBool, graph.PLANT_HOLD, self._on_hold)
        self.create_service(InjectFault, graph.PLANT_INJECT_FAULT, self._on_inject_fault)
        self.add_on_set_parameters_callback(self._on_set_parameters)

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Move the trolley, let the wind blow."""
        for parameter in parameters:
            if parameter.name == "wind":
                try:
                    self._world.blow(parameter.value)
                except ValueError as error:
                    return SetParametersResult(successful=False, reason=str(error))
            if parameter.name == "trolley_position" and self._world.gantry is not None:
                self._world.gantry.move_to(parameter.value)
        return SetParametersResult(successful=True)

    # The tick -------------------------------------------------------------------------------
    def _on_answer(self) -> None:
        if self._lockstep:
            self._advance()
            self._settle()

    def _serve_camera(self) -> bool:
        """Carry what is on the camera's wire; go on when its driver has taken an image."""
        assert self._camera is not None
        # While the world steps, each tick and each quiet moment look at the wire anyway.
        if self._lockstep and self._started and self._camera.ready():
            return False
        if not self._camera.service():
            return False
        self._on_answer()
        return True

    def quiet(self) -> None:
        """Talk to the IMU's driver, say again what was lost, go on without a lost peer."""
        self._imu.service()
        if not self._lockstep:
            return
        if self._started:
            self._joints.await_answer(time.monotonic())
        if self._wires is not None:
            self._wires.serve()
            if self._started:
                self._wires.await_answer(time.monotonic())
        if self._camera is not None and self._started:
            self._camera.await_answer(time.monotonic())
        self._advance()
        self._settle()
        if self._started:
            self._world_clock.repeat(time.monotonic())

    def _advance(self) -> None:
        """Step if the tick is complete and the world may go on; then publish the new state."""
        if self._running() and self._started and self._is_answered():
            self._tick()
        if self._running() and not self._started and self._sensors_are_set_up():
            # The first state of a run: nobody has answered it yet. A time that starts again is
            # believed when it is told twice.
            self._started = True
            self._world_clock.tell(self._world.time_ns)
            self._publish_state()
            self._publish_state()

    def _is_answered(self) -> bool:
        """Return whether everyone who takes part has answered the state of now."""
        return all(each.ready() for each in self._answered_wires)

    def _sensors_are_set_up(self) -> bool:
        """Return whether the drivers have told their devices to stream: no run misses a sample."""
        imu, joints = self._imu.is_set_up(), self._joints.is_set_up()
        camera = self._camera is None or self._camera.is_set_up()
        return (self._wires is None or self._wires.driver_is_set_up()) and imu and joints and camera

    def _running(self) -> bool:
        return self._steps.left > 0 or not self._paused

    def _tick(self) -> None:
        world = self._world
        self._tick_clock.start()
        samples = world.step_tick()
        self._joints.advance()
        self._steps.count()
        self._publish_state()  # first: the others work while the IMU's bytes are written
        for sample in samples:
            self._imu.device.sample(
                sample.time_ns, sample.orientation, sample.angular_velocity, sample.specific_force
            )
            self._latency.begin(sample.time_ns)
        self._imu.service()
        if self._wires is not None:
            self._wires.serve()
        if self._camera is not None:
            self._camera.advance()
        self._truth.remember()
        world.measure_sliding()
        if (world.time_ns // graph.TICK_PERIOD_NS) % _TRUTH_EVERY == 0:
            if self._world_clock.time_ns != world.time_ns:  # told already where it makes the tick
                self._world_clock.tell(world.time_ns)
            self._truth.publish()
            if self._wires is not None:
                self._wires.publish_state()
        self._tick_clock.end()

    def _publish_state(self) -> None:
        if self._wires is not None:
            self._wires.publish()
        self._joints.tell()

    def _on_period(self) -> None:
        """Realtime: one tick every 2 ms of wall time, two while a delay is made up for."""
        now = time.monotonic()
        late = now - self._next_due
        if late > graph.TICK_PERIOD:
            self._overruns += 1
            if late > self._catch_up:
                self._next_due = now
        self._next_due += graph.TICK_PERIOD
        if not self._running():
            return
        self._joints.watch(now)
        if self._wires is not None:
            self._wires.watch(now)
        self._tick()
        if now - self._next_due > graph.TICK_PERIOD:
            # One at a time: to drives that count ticks a burst of them would be a silent bus.
            self._next_due += graph.TICK_PERIOD
            self._tick()

    # Services -------------------------------------------------------------------------------
    def _on_reset(self, request: ResetWorld.Request, response: ResetWorld.Response):  # type: ignore[no-untyped-def]
        try:
            self._world.reset(request.keyframe or self._world.options.keyframe)
        except ValueError as error:
            response.success, response.message = False, str(error)
            return response
        self._latency.restart()
        self._truth.restart()
        self._seed = self._seed if request.seed < 0 else int(request.seed)
        self._imu.device.restart(self._seed)
        self._joints.restart()
        if self._wires is not None:
            self._wires.restart(self._seed)
        if self._camera is not None:
            self._camera.restart(self._seed)
        self._world_clock.time_ns = 0
        self._started = False
        self._end_step("a reset")
        response.success, response.message = True, "the world is back at time 0"
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response):  # type: ignore[no-untyped-def]
        self._paused = request.data
        if request.data:
            self._steps.end("a pause")  # answered as soon as its last tick is
        else:
            self._end_step("the world that runs again")
        response.success = True
        response.message = f"{'paused' if request.data else 'running'} at {self._world.time_ns} ns"
        return response

    def _on_step(self, request: StepWorld.Request, response: StepWorld.Response):  # type: ignore[no-untyped-def]
        """Begin a step; it is answered when it is done, and others are heard meanwhile."""
        if self._lockstep and self._paused:
            response.message = self._steps.refusal(request.ticks)
        else:
            response.message = "stepping needs the lockstep clock and a paused world"
        if response.message:
            stamps.fill(response.stamp, self._world.time_ns)
            response.trajectory_sha256 = self._world.trajectory_sha256
            return response
        answer = self._steps.begin(request.ticks, response)
        self._advance()
        self._settle()
        return answer

    def _settle(self) -> None:
        """Answer a step when it is done and the bridge has told everybody of its last tick.

        So whatever the asker sends next comes after that tick, at any node.
        """
        if self._steps.under_way and self._steps.left == 0 and self._is_answered():
            self._steps.answer(self._world.time_ns, self._world.trajectory_sha256)

    def _end_step(self, reason: str) -> None:
        """Answer a step at once: its ticks will not be done."""
        self._steps.end(reason)
        self._steps.answer(self._world.time_ns, self._world.trajectory_sha256)

    def _on_hold(self, request: SetBool.Request, response: SetBool.Response):  # type: ignore[no-untyped-def]
        self._world.hold(request.data)
        response.success = True
        response.message = f"the base is {'held' if request.data else 'free'}"
        return response

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
            wires = self._answered_wires
            if any(each.inject(request.target, request.fault) for each in wires):
                response.success = True
                return response
            if request.target != "imu":
                targets = ["imu", *(name for each in wires for name in each.targets())]
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
        peers = [each.peer for each in self._answered_wires]
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
                "imu_to_target_ms_p50": percentile_ms(self._latency.durations(), 50),
                "imu_to_target_ms_p99": percentile_ms(self._latency.durations(), 99),
                "peer_losses": sum(peer.losses for peer in peers),
                "lost_peers": " ".join(lost),
                "trajectory_sha256": self._world.trajectory_sha256,
            },
        )

    def close(self) -> None:
        """Give the serial line back."""
        self._imu.close()
        for wire in self._answered_wires:
            wire.close()


def main() -> int:
    """Run the node."""
    return run(Plant)


if __name__ == "__main__":
    sys.exit(main())
