"""The robot with its propulsion unit in one process: beside the legs fans, autopilot, T265."""

from __future__ import annotations

import math
from collections import deque

from in_process import InProcessRobot

from husky_control.t265_pose import T265Pose
from husky_description.mujoco_model import flying_inertia
from husky_description.robot import load_robot
from husky_drivers.t265_frames import Confidence, covariance, odometry
from husky_pu.autopilot import Autopilot, AutopilotConfig
from husky_pu.autopilot_imu import SensorSample
from husky_pu.autopilot_setpoints import Setpoint
from husky_pu.failsafes import FlightMode
from husky_pu.mavlink_axes import flip_body, mavlink_attitude
from husky_pu.mixer import Mixer
from husky_sim.t265_device import T265Device
from husky_sim.world import WorldOptions

PAYLOAD = 0.68
"""With it the robot weighs 7.0 kg, and its fans can spare some thrust [kg]."""
BODY = "robot_with_unit"
_DELAY = 5
"""Ticks from a command to the autopilot, and from a pose to the controller: 10 ms."""


class FlyingRobot(InProcessRobot):
    """What the graph's nodes of the unit do, in the graph's order.

    Attributes:
        autopilot: the flight controller.
        camera: the T265.
        frozen: its poses do not arrive.
    """

    def __init__(self, seed: int = 0):
        """Power everything on."""
        robot = load_robot(payload_mass=PAYLOAD)
        super().__init__(WorldOptions(seed=seed, body=BODY), robot)
        self._mixer = Mixer(robot)
        inertia = flying_inertia(robot, BODY)
        self.autopilot = Autopilot(self._mixer, AutopilotConfig(inertia=inertia, seed=seed))
        self.camera = T265Device(robot.t265, seed)
        self.frozen = False
        self._setpoints: deque[Setpoint] = deque()
        self._poses: deque[T265Pose] = deque()

    def tick(self) -> None:
        """Advance by 2 ms."""
        world, m, logic = self.world, self.measurements, self.autopilot.vehicle.logic
        fans = world.fans
        assert fans is not None
        true, unit, now = fans.sample(), fans.unit, world.time_ns
        sensors = SensorSample(
            now,
            tuple(true.angular_velocity.tolist()),
            tuple(true.specific_force.tolist()),
            tuple(true.magnetic_field.tolist()),
            true.pressure,
            unit.battery_voltage,
            unit.battery_current,
        )
        if len(self._setpoints) > _DELAY:
            self.autopilot.vehicle.stream.accept(self._setpoints.popleft(), "test", 1e-9 * now)
        fans.pwm[:] = self.autopilot.tick(sensors)
        m.fans_available = (
            logic.armed and logic.mode is FlightMode.OFFBOARD and logic.failsafe is None
        )
        while self._poses and self._poses[0].stamp <= 1e-9 * (now - 2_000_000 * _DELAY):
            m.pose.take(self._poses.popleft())
        super().tick()
        self._setpoints.append(self._setpoint(now))
        for pose in world.poses:
            self._look(*pose)

    def _setpoint(self, stamp_ns: int) -> Setpoint:
        hover, assist = self.controller.hover, self.controller.assist
        most, scale = self._mixer.max_collective, self._mixer.moment_scale
        if hover.active:
            w, x, y, z = mavlink_attitude(hover.attitude.tolist())
            return Setpoint(stamp_ns, hover.force / most, attitude=(x, y, z, w))
        moments = flip_body((assist.moment / scale).tolist())
        return Setpoint(stamp_ns, assist.force / most, moments=moments)

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
        """Hand the fans to the controller.

        Raises:
            RuntimeError: refused.
        """
        logic = self.autopilot.vehicle.logic
        reason = logic.set_mode(FlightMode.OFFBOARD) or logic.arm()
        if reason:
            raise RuntimeError(f"the autopilot does not arm: {reason}")
        self.run(1.5)
