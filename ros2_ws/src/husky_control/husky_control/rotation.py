"""Rotations for the control tick: quaternions (x, y, z, w), matrices, yaw, tilt, rotation vectors.

A rotation vector is the axis times the angle, the exponential coordinates of SO(3).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from husky_description.arrays import Array


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


def skew(vector: Array) -> Array:
    """The matrix [v]x (3, 3) with [v]x u = v x u."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_from_vector(vector: Array) -> Array:
    """The rotation (3, 3) about a rotation vector (3,) [rad] (Rodrigues)."""
    angle = math.sqrt(float(vector @ vector))
    cross = skew(vector)
    if angle < 1e-6:
        return np.eye(3) + cross + 0.5 * cross @ cross
    first, second = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle**2
    rotation: Array = np.eye(3) + first * cross + second * (cross @ cross)
    return rotation


def vector_from_rotation(rotation: Array) -> Array:
    """The rotation vector (3,) [rad] of a rotation (3, 3) by less than a half turn."""
    twice_sine = np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    sine = 0.5 * math.sqrt(float(twice_sine @ twice_sine))
    angle = math.atan2(sine, 0.5 * (float(np.trace(rotation)) - 1.0))
    scale = 0.5 if sine < 1e-9 else 0.5 * angle / sine
    vector: Array = scale * twice_sine
    return vector


def vector_rate(vector: Array, angular_velocity: Array) -> Array:
    """The rate of a rotation vector (3,) [rad/s] at an angular velocity in body (3,) [rad/s].

    The inverse of the right Jacobian of SO(3), for less than a whole turn.
    """
    angle = math.sqrt(float(vector @ vector))
    cross = np.cross(vector, angular_velocity)
    if angle < 1e-4:
        share = 1.0 / 12.0
    else:
        share = (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / angle**2
    rate: Array = angular_velocity + 0.5 * cross + share * np.cross(vector, cross)
    return rate
