"""Rotations for the control tick: quaternions (x, y, z, w), matrices, yaw, tilt."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True)
def matrix_from_quaternion(quaternion: Array, matrix: Array) -> None:
    """Write the rotation matrix (3, 3) of a unit quaternion (x, y, z, w)."""
    x, y, z, w = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    s = 2.0 / (x * x + y * y + z * z + w * w)
    matrix[0, 0] = 1.0 - s * (y * y + z * z)
    matrix[0, 1] = s * (x * y - z * w)
    matrix[0, 2] = s * (x * z + y * w)
    matrix[1, 0] = s * (x * y + z * w)
    matrix[1, 1] = 1.0 - s * (x * x + z * z)
    matrix[1, 2] = s * (y * z - x * w)
    matrix[2, 0] = s * (x * z - y * w)
    matrix[2, 1] = s * (y * z + x * w)
    matrix[2, 2] = 1.0 - s * (x * x + y * y)


@njit(cache=True)
def matrix_from_roll_pitch_yaw(roll: float, pitch: float, yaw: float, matrix: Array) -> None:
    """Write R_z(yaw) R_y(pitch) R_x(roll), angles in rad, as a matrix (3, 3)."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    matrix[0, 0], matrix[1, 0], matrix[2, 0] = cy * cp, sy * cp, -sp
    matrix[0, 1] = cy * sp * sr - sy * cr
    matrix[1, 1] = sy * sp * sr + cy * cr
    matrix[2, 1] = cp * sr
    matrix[0, 2] = cy * sp * cr + sy * sr
    matrix[1, 2] = sy * sp * cr - cy * sr
    matrix[2, 2] = cp * cr


def yaw_of(rotation: Array) -> float:
    """Heading of the x axis of a rotation matrix (3, 3), rad."""
    return math.atan2(float(rotation[1, 0]), float(rotation[0, 0]))


def tilt_of(rotation: Array) -> float:
    """Angle between the z axis of a rotation matrix (3, 3) and the vertical, rad."""
    return math.acos(min(1.0, max(-1.0, float(rotation[2, 2]))))


def wrap_angle(angle: float) -> float:
    """The same angle in (-pi, pi], rad."""
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped == -math.pi else wrapped
