"""Modified Rodrigues parameters: three numbers for an attitude, free of singularities below a turn.

sigma is the axis times the tangent of a quarter of the angle. Rotation and rate are rational in it,
without sines, which keeps derivatives short. NumPy or CasADi, whichever comes in.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from husky_control.planning.array_namespace import namespace_of


def rotation_from_rodrigues(sigma: Any) -> Any:
    """The rotation (3, 3), body to world, of parameters (3)."""
    xp = namespace_of(sigma)
    square = sigma[0] * sigma[0] + sigma[1] * sigma[1] + sigma[2] * sigma[2]
    cross = xp.skew(sigma)
    return np.eye(3) + (4.0 * (1.0 - square) * cross + 8.0 * (cross @ cross)) / (1.0 + square) ** 2


def rodrigues_rate(sigma: Any, angular_velocity: Any) -> Any:
    """The rate of the parameters (3) [1/s] at an angular velocity in body (3) [rad/s]."""
    xp = namespace_of(sigma, angular_velocity)
    square = sigma[0] * sigma[0] + sigma[1] * sigma[1] + sigma[2] * sigma[2]
    along = sum(sigma[i] * angular_velocity[i] for i in range(3))
    turned = xp.skew(sigma) @ angular_velocity
    return 0.25 * ((1.0 - square) * angular_velocity + 2.0 * turned + 2.0 * along * sigma)
