"""The robot in one process, without ROS: world, drives, master, IMU errors, controller.

Each tick does what the graph does, in the graph's order: the frame of tick k carries the command of
tick k - 1.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from husky_control.controller import Controller
from husky_control.estimation.imu_mount import ImuMount
from husky_control.tick_data import Measurements
from husky_description.robot import Robot, load_robot
from husky_drivers.ethercat.axes import settings_of
from husky_drivers.ethercat.master import Master
from husky_drivers.joint_master.phase import Phase
from husky_drivers.vn200.imu import ImuFigures
from husky_runtime import graph
from husky_sim.devices.drives.segment import SimulatedSegment
from husky_sim.devices.vn200.noise import ImuNoise
from husky_sim.world import World, WorldOptions


def stand_up(robot: Any) -> None:
    """Let a robot in one process, whose joints are enabled, stand up, and stand for half a second.

    Raises:
        RuntimeError: it does not within 5 s.
    """
    controller = robot.controller
    accepted, message = controller.request_mode("stand_up")
    if not accepted:
        raise RuntimeError(f"the robot does not stand up: {message}")
    for _ in range(100):
        if controller.mode.value == "stand":
            break
        robot.run(0.05)
    robot.run(0.5)
    if controller.mode.value != "stand":
        raise RuntimeError(f"the robot does not stand: {controller.reason}")


class InProcessRobot:
    """Advances by ticks; keeps how long the controller's ticks took.

    Attributes:
        world: the simulated world.
        controller: the pure controller.
        measurements: what it gets.
        tick_seconds: wall time of each controller tick [s].
        refusal: why the drives' master last refused a command, "" when it never did.
        master: of the drives.
        segment: of the simulated drives.
        alive: the controller commands the drives.
    """

    def __init__(
        self,
        options: WorldOptions | None = None,
        robot: Robot | None = None,
    ):
        """Power everything on.

        Args:
            options: of the world.
            robot: the configured one by default.
        """
        robot = robot or load_robot()
        self.world = World(robot, options or WorldOptions())
        self.alive = True
        self.controller = Controller(robot, warm_up=False)
        self.segment = SimulatedSegment(robot)
        self.master = Master(self.segment, settings_of(robot), robot)
        self.master.configure()
        self.master.start()
        self._noise = ImuNoise(ImuFigures.of(robot.imu), self.world.options.seed)
        self._mount = ImuMount(robot)
        self.measurements = Measurements()
        self._imu_time_ns = 0
        self.tick_seconds: list[float] = []
        self.refusal = ""

    def tick(self) -> None:
        """Advance by 2 ms."""
        world, servos, master, m = self.world, self.world.servos, self.master, self.measurements
        self.segment.set_servo_state(
            servos.encoder_count, servos.velocity_count, servos.current, servos.bus_voltage
        )
        master.exchange()
        m.joint_position[:] = master.position
        m.joint_velocity[:] = master.velocity
        m.joint_torque[:] = master.effort
        m.joint_age_ticks = 1
        m.drives_operational = master.phase is Phase.ENABLED
        m.time = world.time_ns / 1e9
        m.imu_age = (world.time_ns - self._imu_time_ns) / 1e9
        start = time.perf_counter()
        command = self.controller.tick(m)
        self.tick_seconds.append(time.perf_counter() - start)
        servo = self.segment.servo_command()
        servos.set_command(*(np.ascontiguousarray(servo[name]) for name in servo.dtype.names))
        if self.alive:
            self.refusal = (
                master.set_command(
                    command.mode_of_operation, command.position, command.velocity, command.effort
                )
                or self.refusal
            )
        for sample in world.step_tick():
            gx, gy, gz, ax, ay, az, hx, hy, hz = self._noise.next()
            x, y, z, w = sample.orientation
            q = np.array((x + hx * w, y + hy * w, z + hz * w, w))
            seen = (
                q / np.linalg.norm(q),
                np.add(sample.angular_velocity, (gx, gy, gz)),
                np.add(sample.specific_force, (ax, ay, az)),
            )
            self._imu_time_ns = sample.time_ns
        self._mount.tell(*seen, m)

    def run(self, duration: float, velocity: tuple[float, float, float] | None = None) -> None:
        """Advance by a duration [s], with a velocity command (m/s, m/s, rad/s) every 0.2 s."""
        for index in range(round(duration / graph.TICK_PERIOD)):
            if velocity is not None and index % 100 == 0:
                self.controller.set_velocity_command(*velocity)
            self.tick()

    @property
    def tilt(self) -> float:
        """True angle of the body's z axis from up [deg]."""
        x, y, _, _ = self.world.base_orientation
        return math.degrees(2.0 * math.asin(min(1.0, math.hypot(x, y))))

    def enable(self) -> None:
        """Enable the drives.

        Raises:
            RuntimeError: they refuse.
        """
        self.run(0.1)
        refusal = self.master.enable()
        self.run(0.2)
        if refusal:
            raise RuntimeError(f"the drives are not enabled: {refusal}")

    def stand(self) -> None:
        """Enable the drives and stand up.

        Raises:
            RuntimeError: it does not stand.
        """
        self.enable()
        stand_up(self)
