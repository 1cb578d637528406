"""A robot on bus servos in one process, without ROS: world, servos' law, IMU errors, controller."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from in_process import stand_up
from numba import njit

from husky_control.controller import Controller
from husky_control.estimation.imu_mount import ImuMount
from husky_control.parameters import Parameters
from husky_control.tick_data import CYCLIC_POSITION, CYCLIC_VELOCITY, Measurements
from husky_description.arrays import Array
from husky_description.robot import Robot, load_robot
from husky_drivers.vn200.imu import ImuFigures
from husky_runtime import graph
from husky_sim.devices.vn200.noise import ImuNoise
from husky_sim.scene import WorldOptions, build_scene, physics_step

SPEED_UNIT = 0.229 * math.pi / 30.0
"""In which the servos tell their speed [rad/s]: 0.229 rpm."""


@njit(cache=True)  # NumPy took a tenth of such a test
def _follow(
    goal: Array,
    gains: tuple[float, float],
    limits: tuple[float, float, float],
    joints: tuple[Array, Array],
    torque: Array,
) -> None:
    """Write the torque of each servo (12,).

    Args:
        goal: position [rad], velocity [rad/s] and effort [N m] (3, 12).
        gains: kp [N m/rad] and kd [N m s/rad].
        limits: stall torque [N m], speed without load [rad/s], torque limit [N m].
        joints: position [rad] and velocity [rad/s] (12,).
        torque: written [N m].
    """
    (kp, kd), (stall, no_load_speed, limit), (position, velocity) = gains, limits, joints
    for i in range(len(torque)):
        speed = velocity[i]
        wanted = kp * (goal[0, i] - position[i]) + kd * (goal[1, i] - speed) + goal[2, i]
        generated = stall / no_load_speed * speed
        wanted = max(wanted, max(-stall - generated, -limit))
        torque[i] = min(wanted, min(stall - generated, limit))


@njit(cache=True)
def _note(torque: Array, high: float, step: float, peak: Array, time_at_limit: Array) -> None:
    """Note the greatest torque of each servo [N m], and the time that it is high [s]."""
    for i in range(len(torque)):
        size = abs(torque[i])
        peak[i] = max(peak[i], size)
        time_at_limit[i] += step * (size > high)


class ServoRobot:
    """Advances by ticks of 2 ms; the bus commands and reads at its own, slower cycle.

    A servo follows `kp (q* - q) + kd (v* - v) + effort` as far as its current limit, and what its
    voltage leaves at its speed, let it. Positions are read in counts, speeds in `SPEED_UNIT`.

    Attributes:
        controller: the pure controller.
        measurements: what it gets.
        model, data: the simulated world.
        peak_torque: greatest of each joint so far [N m] (12,).
        time_at_limit: of each joint so far, above 0.98 of the servos' torque limit [s] (12,).
    """

    def __init__(
        self,
        robot: Robot | None = None,
        options: WorldOptions | None = None,
        parameters: Parameters | None = None,
    ):
        """Sit on the perch, servos on; Husky-beta by default."""
        self.robot = robot = robot or load_robot("beta")
        options = options or WorldOptions()
        self.model = build_scene(robot, options).compile()
        self.data = mujoco.MjData(self.model)
        self._step_physics = physics_step(self.model, options)
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key(options.keyframe).id)
        mujoco.mj_forward(self.model, self.data)
        self.controller = Controller(robot, parameters, warm_up=False)
        self.measurements = m = Measurements()
        m.joint_age_ticks = 1
        m.drives_operational = True
        self._noise = ImuNoise(ImuFigures.of(robot.imu), options.seed)
        self._mount = ImuMount(robot)
        self._substeps = round(graph.TICK_PERIOD / options.timestep)
        self._ticks_per_cycle = max(1, round(robot.bus_servo.cycle / graph.TICK_PERIOD))
        self._ticks = 0
        self._goal = np.zeros((3, 12))
        self._gains = (0.0, 0.0)
        servo = robot.bus_servo
        self._limits = (servo.stall_torque, servo.no_load_speed, servo.torque_limit)
        self._joints = (self.data.qpos[7:], self.data.qvel[6:])
        self.peak_torque, self.time_at_limit = np.zeros((2, 12))
        self._read()
        self._feel()

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.data.time)

    @property
    def tilt(self) -> float:
        """Angle of the body's z axis from up [deg]."""
        _, x, y, _ = self.data.qpos[3:7]
        return math.degrees(2.0 * math.asin(min(1.0, math.hypot(x, y))))

    @property
    def above_perch(self) -> float:
        """Height of the middle of the perch's underside over z = 0 [m]."""
        return float(self.data.site("perch").xpos[2])

    def _read(self) -> None:
        """Take what the servos tell: counts, speed units, torque from the current."""
        m, count = self.measurements, 2.0 * math.pi / self.robot.bus_servo.resolution
        m.joint_position[:] = np.round(self.data.qpos[7:] / count) * count
        m.joint_velocity[:] = np.round(self.data.qvel[6:] / SPEED_UNIT) * SPEED_UNIT
        m.joint_torque[:] = self.data.ctrl

    def _feel(self) -> None:
        """Take what the IMU tells."""
        m, data = self.measurements, self.data
        gx, gy, gz, ax, ay, az, hx, hy, hz = self._noise.next()
        w, x, y, z = data.sensor("imu_orientation").data
        q = np.array((x + hx * w, y + hy * w, z + hz * w, w))
        rate = data.sensor("imu_gyro").data + (gx, gy, gz)
        force = data.sensor("imu_accelerometer").data + (ax, ay, az)
        self._mount.tell(q / np.linalg.norm(q), rate, force, m)
        m.imu_age = 0.0
        m.time = data.time

    def tick(self) -> None:
        """Advance by 2 ms."""
        if self._ticks % self._ticks_per_cycle == 0:
            self._read()
        command = self.controller.tick(self.measurements)
        if self._ticks % self._ticks_per_cycle == 0:
            self._goal[:] = command.position, command.velocity, command.effort
            law = self.robot.servo
            follows = command.mode_of_operation == CYCLIC_POSITION
            damps = follows or command.mode_of_operation == CYCLIC_VELOCITY
            self._gains = (law.kp if follows else 0.0, law.kd if damps else 0.0)
        self._ticks += 1
        for _ in range(self._substeps):
            self._drive()
            self._step_physics(self.model, self.data)
        self._feel()

    def _drive(self) -> None:
        _follow(self._goal, self._gains, self._limits, self._joints, self.data.ctrl)
        step, high = self.model.opt.timestep, 0.98 * self.robot.bus_servo.torque_limit
        _note(self.data.ctrl, high, step, self.peak_torque, self.time_at_limit)

    def run(self, duration: float, velocity: tuple[float, float, float] | None = None) -> None:
        """Advance by a duration [s], with a velocity command (m/s, m/s, rad/s) every 0.2 s."""
        for index in range(round(duration / graph.TICK_PERIOD)):
            if velocity is not None and index % 100 == 0:
                self.controller.set_velocity_command(*velocity)
            self.tick()

    def stand(self) -> None:
        """Stand up.

        Raises:
            RuntimeError: it does not.
        """
        self.run(0.3)
        stand_up(self)
