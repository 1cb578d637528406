"""Rotation vectors: the axis times the angle, the exponential coordinates of SO(3)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
