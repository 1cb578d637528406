"""What the tracking camera says of the base: its pose, moved from the camera to the body.

Frames: `t265_odom` is where the camera was when it started, levelled; z is up. Confidence comes as
a variance of the position: 0.01 m^2 high, 0.1 medium, 1 low, 10 failed.
"""

from __future__ import annotations

import math

import numpy as np

from husky_control.rotation import (
    matrix_from_quaternion,
    matrix_from_roll_pitch_yaw,
    wrap_angle,
    yaw_of,
)
from husky_control.tick_data import T265Pose
from husky_description.arrays import Array
from husky_description.robot import Robot

JUMP_DISTANCE = 0.05
"""A pose this far from where the last one and its velocity lead has jumped [m]."""
JUMP_ANGLE = 0.1
"""The same for the heading, compared with the IMU's [rad]."""


class BaseTracker:
    """Follows the base through the camera's poses; a jump is told apart from a motion.

    Attributes:
        stamp: of the last pose that was used [s].
        position: of base in t265_odom at that time [m] (3,).
        velocity: the same [m/s] (3,).
        yaw: heading of base in t265_odom [rad].
        jumps: poses that did not follow from the one before.
    """

    def __init__(self, robot: Robot) -> None:
        """Nothing seen."""
        self._lever = np.array(robot.t265.position, dtype=np.float64)
        self._mount = np.eye(3)
        roll, pitch, yaw = (float(angle) for angle in robot.t265.rpy)
        matrix_from_roll_pitch_yaw(roll, pitch, yaw, self._mount)
        self._rotation = np.eye(3)
        self._imu_yaw = 0.0
        self.stamp = -math.inf
        self.position, self.velocity = np.zeros(3), np.zeros(3)
        self.yaw = 0.0
        self.jumps = 0

    def begin(self, pose: T265Pose, imu_yaw: float) -> None:
        """Start from a usable pose: what was before does not count."""
        self._see(pose)
        self._imu_yaw = imu_yaw
        self.jumps = 0

    def follow(self, pose: T265Pose, imu_yaw: float) -> tuple[Array, float] | None:
        """Take a usable pose that is newer than the last.

        Args:
            pose: see `T265Pose`.
            imu_yaw: heading by the IMU now [rad].

        Returns:
            None, or for a jump the position [m] (3,) and the heading [rad] that were expected in
            its place.
        """
        dt = pose.stamp - self.stamp
        expected = self.position + dt * self.velocity
        expected_yaw = wrap_angle(self.yaw + imu_yaw - self._imu_yaw)
        self._imu_yaw = imu_yaw
        self._see(pose)
        step = math.dist(self.position, expected)
        turn = abs(wrap_angle(self.yaw - expected_yaw))
        if step < JUMP_DISTANCE + 5.0 * dt * dt and turn < JUMP_ANGLE:
            return None
        self.jumps += 1
        return expected, expected_yaw

    def _see(self, pose: T265Pose) -> None:
        matrix_from_quaternion(pose.orientation, self._rotation)
        base = self._rotation @ self._mount.T
        turning = self._rotation @ pose.angular_velocity
        arm = base @ self._lever
        self.stamp = pose.stamp
        self.position[:] = pose.position - arm
        self.velocity[:] = self._rotation @ pose.velocity - np.cross(turning, arm)
        self.yaw = yaw_of(base)
