"""What the tracking camera says of the base: its pose, moved from the camera to the body.

Frames: `t265_odom` is where the camera was when it started, levelled; z is up. Confidence comes as
a variance of the position: 0.01 m^2 high, 0.1 medium, 1 low, 10 failed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from husky_control.rotation import (
    matrix_from_quaternion,
    matrix_from_roll_pitch_yaw,
    wrap_angle,
    yaw_of,
)
from husky_description.arrays import Array
from husky_description.robot import Robot

GOOD_VARIANCE = 0.5
"""Of the position, below which the camera says it tracks with medium confidence or better [m^2]."""
FRESH = 0.1
"""Age of a pose that may be flown with [s]."""
JUMP_DISTANCE = 0.05
"""A pose this far from where the last one and its velocity lead has jumped [m]."""
JUMP_ANGLE = 0.1
"""The same for the heading, compared with the IMU's [rad]."""


@dataclass(slots=True)
class T265Pose:
    """One message of the camera, as it came: of t265_link in t265_odom, twist in t265_link."""

    stamp: float = -math.inf  # s
    position: Array = field(default_factory=lambda: np.zeros(3))  # m
    orientation: Array = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))
    velocity: Array = field(default_factory=lambda: np.zeros(3))  # m/s
    angular_velocity: Array = field(default_factory=lambda: np.zeros(3))  # rad/s
    variance: float = math.inf  # m^2, of the position

    def take(self, other: T265Pose) -> None:
        """Copy the values of another one."""
        self.stamp, self.variance = other.stamp, other.variance
        self.position[:] = other.position
        self.orientation[:] = other.orientation
        self.velocity[:] = other.velocity
        self.angular_velocity[:] = other.angular_velocity

    def usable(self, time: float) -> bool:
        """Return whether it is fresh at a time [s], confident and a number."""
        return (
            -FRESH < time - self.stamp < FRESH
            and self.variance <= GOOD_VARIANCE
            and bool(np.isfinite(self.position).all() and np.isfinite(self.orientation).all())
            and bool(np.isfinite(self.velocity).all() and np.isfinite(self.angular_velocity).all())
        )


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
