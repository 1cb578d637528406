"""Rotations as plain numbers, quaternions (x, y, z, w) as in ROS messages.

For one rotation in a tick this is faster than arrays, and needs neither numba nor SciPy, which take
a second and a fifth of one to import. Kernels have their own (`husky_control.rotation`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

_HALF_ROOT = math.sqrt(0.5)


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the product of two quaternions: the rotation b, then a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def conjugate(rotation: Quaternion) -> Quaternion:
    """Return the inverse of a unit quaternion."""
    x, y, z, w = rotation
    return -x, -y, -z, w


def rotate(rotation: Quaternion, vector: Vector) -> Vector:
    """Return a vector rotated by a unit quaternion."""
    x, y, z, w = rotation
    a, b, c = vector
    p, q, r = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return (
        a + w * p + y * r - z * q,
        b + w * q + z * p - x * r,
        c + w * r + x * q - y * p,
    )


def from_rows(matrix: Sequence[float]) -> Quaternion:
    """Return the quaternion of a rotation matrix (9,), row by row."""
    a, b, c, d, e, f, g, h, i = matrix
    x, y, z, w = (
        0.5 * math.sqrt(max(0.0, square))
        for square in (1 + a - e - i, 1 - a + e - i, 1 - a - e + i, 1 + a + e + i)
    )
    if w >= max(x, y, z):
        return 0.25 * (h - f) / w, 0.25 * (c - g) / w, 0.25 * (d - b) / w, w
    if x >= max(y, z):
        return x, 0.25 * (b + d) / x, 0.25 * (c + g) / x, 0.25 * (h - f) / x
    if y >= z:
        return 0.25 * (b + d) / y, y, 0.25 * (f + h) / y, 0.25 * (c - g) / y
    return 0.25 * (c + g) / z, 0.25 * (f + h) / z, z, 0.25 * (d - b) / z


def from_roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Return the quaternion of fixed-axis roll, pitch, yaw [rad], as in URDF."""
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def to_roll_pitch_yaw(rotation: Quaternion) -> Vector:
    """Return roll, pitch, yaw [rad] of a unit quaternion."""
    x, y, z, w = rotation
    return (
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))),
        math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )


def to_rotation_vector(rotation: Quaternion) -> Vector:
    """Return the axis times the angle, at most half a turn [rad], of a unit quaternion."""
    x, y, z, w = rotation
    sine = math.sqrt(x * x + y * y + z * z)
    scale = math.copysign(2.0 * math.atan2(sine, abs(w)) / sine if sine else 2.0, w)
    return scale * x, scale * y, scale * z


def tilt_of(rotation: Quaternion) -> float:
    """Return the angle between the body's z axis and the world's [rad]."""
    x, y, _, _ = rotation
    return math.acos(max(-1.0, min(1.0, 1 - 2 * (x * x + y * y))))


def about_z(angle: float) -> Quaternion:
    """Return the turn about z by an angle [rad]."""
    return 0.0, 0.0, math.sin(0.5 * angle), math.cos(0.5 * angle)


def swap_world_and_body(rotation: Quaternion) -> Quaternion:
    """Turn a rotation FRD body to NED into FLU body to ENU, or back: it is its own inverse.

    NED to ENU is half a turn about (1, 1, 0), FRD to FLU half a turn about (1, 0, 0); the product
    of the three quaternions comes down to sums and differences.
    """
    x, y, z, w = rotation
    return _HALF_ROOT * (x + y), _HALF_ROOT * (x - y), _HALF_ROOT * (w - z), _HALF_ROOT * (w + z)


def swap_body(vector: Vector) -> Vector:
    """Turn a vector in FRD body axes into FLU, or back."""
    x, y, z = vector
    return x, -y, -z
