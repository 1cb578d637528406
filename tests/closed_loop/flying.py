"""Robots that fly in one process: beside the legs fans or propellers, autopilot and T265."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable

from in_process import InProcessRobot

from husky_control.controller import Controller
from husky_control.tick_data import Measurements, T265Pose
from husky_description.mujoco_model import flying_inertia
from husky_description.robot import Robot, load_robot
from husky_description.rotation import swap_body
from husky_drivers.t265.frames import Confidence, covariance, odometry
from husky_pu.autopilot.airframe import airframe_parameters
from husky_pu.autopilot.autopilot import Autopilot, AutopilotConfig
from husky_pu.autopilot.failsafes import FlightMode
from husky_pu.autopilot.imu import SensorSample
from husky_pu.autopilot.setpoints import AttitudeSetpoint
from husky_pu.autopilot.weighted_mixer import mixer_of
from husky_pu.mavlink.axes import mavlink_attitude
from husky_sim.devices.t265.device import T265Device
from husky_sim.propulsion.fans_in_world import FansInWorld
from husky_sim.world import PoseSample, WorldOptions

PAYLOAD = 0.68
"""With it the robot weighs 7.0 kg, and its fans can spare some thrust [kg]."""
BODY = "robot_with_unit"
_DELAY = 5
"""Ticks from a command to the autopilot, and from a pose to the controller: 10 ms."""


class FlightGear:
    """Flight controller and tracking camera of a robot, and what the nodes of the unit carry.

    Attributes:
        autopilot: the flight controller.
        camera: the T265.
        frozen: its poses do not arrive.
        silent: nor do the controller's setpoints at the autopilot.
    """

    def __init__(self, robot: Robot, body: str, seed: int):
        """Power everything on."""
        self._mixer = mixer_of(robot)
        config = AutopilotConfig(
            inertia=flying_inertia(robot, body), seed=seed, parameters=airframe_parameters(robot)
        )
        self.autopilot = Autopilot(self._mixer, config)
        self.camera = T265Device(robot.t265, seed)
        self.frozen = self.silent = False
        self._setpoints: deque[AttitudeSetpoint] = deque()
        self._poses: deque[T265Pose] = deque()

    def fly(self, now: int, fans: FansInWorld, m: Measurements) -> None:
        """Answer the fans' sensors at a time [ns]; tell the controller what it hears of them."""
        logic, true, unit = self.autopilot.vehicle.logic, fans.sample(), fans.unit
        sensors = SensorSample(
            now,
            tuple(true.angular_velocity.tolist()),
            tuple(true.specific_force.tolist()),
            tuple(true.magnetic_field.tolist()),
            true.pressure,
            unit.battery_voltage,
            unit.battery_current,
            tuple(unit.speed.tolist()),
            tuple(unit.current.tolist()),
        )
        if len(self._setpoints) > _DELAY:
            self.autopilot.vehicle.stream.accept(self._setpoints.popleft(), "test", 1e-9 * now)
        fans.pwm[:] = self.autopilot.tick(sensors)
        offboard = logic.mode is FlightMode.OFFBOARD
        m.fans_available = logic.armed and offboard and logic.failsafe is None
        m.fans_disarmed = not logic.armed
        m.fans_lost = logic.fans_ok.index(False) if not all(logic.fans_ok) else -1
        while self._poses and self._poses[0].stamp <= 1e-9 * (now - 2_000_000 * _DELAY):
            m.pose.copy_from(self._poses.popleft())

    def hear(self, now: int, controller: Controller, poses: Iterable[PoseSample]) -> None:
        """Take what the controller wants of the fans, and where the camera has been."""
        if not self.silent:
            self._setpoints.append(self._setpoint(now, controller))
        for pose in poses:
            self._look(*pose)

    def arm(self) -> None:
        """Hand the fans to the controller.

        Raises:
            RuntimeError: refused.
        """
        logic = self.autopilot.vehicle.logic
        reason = logic.set_mode(FlightMode.OFFBOARD) or logic.arm()
        if reason:
            raise RuntimeError(f"the autopilot does not arm: {reason}")

    def _setpoint(self, stamp_ns: int, controller: Controller) -> AttitudeSetpoint:
        hover, assist = controller.hover, controller.assist
        most, scale = self._mixer.max_collective, self._mixer.moment_scale
        if hover.active:
            w, x, y, z = mavlink_attitude(hover.attitude.tolist())
            return AttitudeSetpoint(stamp_ns, hover.force / most, attitude=(x, y, z, w))
        moments = swap_body((assist.moment / scale).tolist())
        return AttitudeSetpoint(stamp_ns, assist.force / most, moments=moments)

    def _look(self, time_ns, position, orientation, velocity, rate) -> None:  # type: ignore[no-untyped-def]
        frame = self.camera.track(
            time_ns, tuple(position), orientation, tuple(velocity), tuple(rate)
        )
        at, twist = odometry(frame)
        pose = T265Pose(1e-9 * time_ns)
        pose.position[:], pose.orientation[:] = at[:3], at[3:]
        pose.velocity[:], pose.angular_velocity[:] = twist[:3], twist[3:]
        pose.variance = covariance(Confidence(frame.tracker_confidence), 0.01, 0.01)[0]
        if not self.frozen:
            self._poses.append(pose)


class FlyingRobot(InProcessRobot):
    """What the graph's nodes of the unit do, in the graph's order.

    Attributes:
        gear: flight controller and camera.
    """

    def __init__(self, seed: int = 0, robot: Robot | None = None):
        """Power everything on; Carbon by default, with `PAYLOAD`."""
        robot = robot or load_robot(payload_mass=PAYLOAD)
        super().__init__(WorldOptions(seed=seed, body=BODY), robot)
        self.gear = FlightGear(robot, BODY, seed)
        self.autopilot = self.gear.autopilot

    def tick(self) -> None:
        """Advance by 2 ms."""
        world = self.world
        assert world.fans is not None
        now = world.time_ns
        self.gear.fly(now, world.fans, self.measurements)
        super().tick()
        self.gear.hear(now, self.controller, world.poses)

    @property
    def thrust(self) -> float:
        """Of all fans [N]."""
        assert self.world.fans is not None
        return float(self.world.fans.unit.wrench_in_base[2])

    @property
    def tilt(self) -> float:
        """Of the body [rad]."""
        x, y, _, _ = self.world.base_orientation
        return math.acos(1.0 - 2.0 * (x * x + y * y))

    def arm(self) -> None:
        """Hand the fans to the controller."""
        self.gear.arm()
        self.run(1.5)
