"""What the IMU tells of itself, told of the base: it may be turned, and sit off its origin."""

from __future__ import annotations

import numpy as np
from numba import njit

from husky_control.rotation import matrix_from_quaternion, matrix_from_roll_pitch_yaw
from husky_control.tick_data import Measurements
from husky_description.arrays import Array
from husky_description.robot import Robot
from husky_description.rotation import Quaternion, conjugate, from_roll_pitch_yaw, multiply
from husky_description.vectors import cross, product, vector
from husky_runtime import graph


@njit(cache=True)
def _velocity_of_arm(rotation: Array, angular_velocity: Array, lever: Array, arm: Array) -> None:
    """Write the velocity in world of a lever's end relative to its start [m/s] (3,)."""
    velocity = product(rotation, cross(vector(angular_velocity), vector(lever)))
    for axis in range(3):
        arm[axis] = velocity[axis]


class ImuMount:
    """Where the IMU of a robot sits, see `imu` in `carbon.yaml`.

    The specific force of base is that of the IMU without the lever arm's own acceleration: what
    the velocity at its end, of base's origin, has changed by since the last tick. Its sum over time
    is exact, and the gyroscope's noise is not integrated.
    """

    def __init__(self, robot: Robot) -> None:
        """Of one robot."""
        roll, pitch, yaw = (float(angle) for angle in robot.imu.rpy)
        self._turned = any((roll, pitch, yaw))
        self._into_base = np.eye(3)
        matrix_from_roll_pitch_yaw(roll, pitch, yaw, self._into_base)
        self._base_in_imu: Quaternion = conjugate(from_roll_pitch_yaw(roll, pitch, yaw))
        self._lever = np.array(robot.imu.position, dtype=np.float64)
        self._arm, self._last_arm = np.zeros(3), np.zeros(3)  # m/s in world
        self._known = False

    def tell(
        self,
        orientation: Array,
        angular_velocity: Array,
        specific_force: Array,
        measurements: Measurements,
    ) -> None:
        """Write the attitude, angular velocity and specific force of base, once a tick.

        Args:
            orientation: quaternion (x, y, z, w), IMU in world.
            angular_velocity: on the IMU's axes [rad/s] (3,).
            specific_force: of the IMU on its axes [m/s^2] (3,).
            measurements: of base, written.
        """
        m = measurements
        if self._turned:
            x, y, z, w = orientation.tolist()
            m.orientation_base_in_world[:] = multiply((x, y, z, w), self._base_in_imu)
            np.dot(self._into_base, angular_velocity, out=m.angular_velocity_base_in_base)
            np.dot(self._into_base, specific_force, out=m.specific_force_base)
        else:
            m.orientation_base_in_world[:] = orientation
            m.angular_velocity_base_in_base[:] = angular_velocity
            m.specific_force_base[:] = specific_force
        self._arm, self._last_arm = self._last_arm, self._arm
        rotation = m.rotation_base_in_world
        matrix_from_quaternion(m.orientation_base_in_world, rotation)
        _velocity_of_arm(rotation, m.angular_velocity_base_in_base, self._lever, self._arm)
        if self._known:
            change = self._arm - self._last_arm
            m.specific_force_base -= change @ rotation / graph.TICK_PERIOD
        self._known = True

    def variance(self, variance: Array) -> Array:
        """Return variances (3,) on the axes of base, of independent ones on the IMU's axes."""
        return self._into_base**2 @ variance

    def restart(self) -> None:
        """Time starts again: what was measured last is of another time."""
        self._known = False
