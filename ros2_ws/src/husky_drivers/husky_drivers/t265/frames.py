"""Pose frames of the RealSense T265, and how they look in ROS axes (REP-103).

The T265's own axes: x to the right, y up, z backward, out of the back of the camera. Its world has
the same axes at the start: origin where the camera was, y against gravity, heading zero. Everything
in a frame but the rotation stands in world axes. ROS axes (x forward, y left, z up) follow by
renaming: x = -z', y = -x', z = y'. The conversions and covariances are those of Intel's ROS wrapper
(realsense-ros, `pose_callback`).
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from husky_description.rotation import Quaternion, Vector, conjugate, multiply, rotate

Pose = tuple[float, float, float, float, float, float, float]
"""Position x, y, z [m] and quaternion (x, y, z, w)."""
Twist = tuple[float, float, float, float, float, float]
"""Linear [m/s] and angular velocity [rad/s], both in body axes."""


class Confidence(IntEnum):
    """What the camera thinks of its tracking (librealsense's `rs2_pose`)."""

    FAILED = 0
    LOW = 1
    MEDIUM = 2
    HIGH = 3


class PoseFrame(NamedTuple):
    """One frame of the pose stream, in the T265's own axes, as librealsense hands it out.

    Attributes:
        number: counts the frames of the stream.
        time_ms: the camera's time of the pose [ms].
        translation: of the camera in its world [m].
        velocity: in world axes [m/s].
        acceleration: in world axes, without gravity [m/s^2].
        rotation: camera to world, (x, y, z, w).
        angular_velocity: in world axes [rad/s].
        angular_acceleration: in world axes [rad/s^2].
        tracker_confidence: see `Confidence`.
        mapper_confidence: the same, of the map that it relocalises in.
    """

    number: int
    time_ms: float
    translation: Vector
    velocity: Vector
    acceleration: Vector
    rotation: Quaternion
    angular_velocity: Vector
    angular_acceleration: Vector
    tracker_confidence: int
    mapper_confidence: int

    @property
    def time_ns(self) -> int:
        """The camera's time of the pose [ns]."""
        return round(self.time_ms * 1e6)


# Axes -------------------------------------------------------------------------------------------
def vector_from_ros(vector: Vector) -> Vector:
    """Rename the axes of a vector, from ROS's to the T265's."""
    x, y, z = vector
    return -y, z, -x


def rotation_from_ros(rotation: Quaternion) -> Quaternion:
    """Rename the axes of both world and camera, from ROS's to the T265's."""
    x, y, z, w = rotation
    return -y, z, -x, w


def odometry(frame: PoseFrame) -> tuple[Pose, Twist]:
    """Return what `nav_msgs/Odometry` says of a frame.

    Returns:
        Pose of t265_link in the camera's odometry frame, both in ROS axes, and the twist of
        t265_link in its own axes.
    """
    # Written out: this runs for every frame.
    tx, ty, tz = frame.translation
    qx, qy, qz, qw = frame.rotation
    back = (qz, qx, -qy, qw)  # The inverse of the rotation in ROS axes.
    vx, vy, vz = frame.velocity
    wx, wy, wz = frame.angular_velocity
    linear = rotate(back, (-vz, -vx, vy))
    angular = rotate(back, (-wz, -wx, wy))
    return (-tz, -tx, ty, -qz, -qx, qy, qw), linear + angular


def covariance(confidence: int, linear: float, angular: float) -> list[float]:
    """Return the 6 x 6 covariance of pose and of twist, row by row (36).

    It is diagonal: linear * 10^(3 - confidence) for the first three, angular * 10^(1 - confidence)
    for the others.

    Args:
        confidence: of the tracker.
        linear: the wrapper's parameter `linear_accel_cov`.
        angular: the wrapper's parameter `angular_velocity_cov`.
    """
    diagonal = [linear * 10.0 ** (3 - confidence)] * 3 + [angular * 10.0 ** (1 - confidence)] * 3
    return [diagonal[row] if row == column else 0.0 for row in range(6) for column in range(6)]


def base_pose(pose: Pose, position: Vector, orientation: Quaternion) -> Pose:
    """Return the pose of `base` in the odometry frame, for a pose of t265_link there.

    Args:
        pose: of t265_link in the odometry frame.
        position: of t265_link in base [m].
        orientation: t265_link to base, (x, y, z, w).
    """
    x, y, z = pose[:3]
    base = multiply(pose[3:], conjugate(orientation))
    dx, dy, dz = rotate(base, position)
    return x - dx, y - dy, z - dz, *base
