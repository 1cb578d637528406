"""What a walk is told of the robot each tick; all in the frame of the ground, see `Ground`.

Arrays are contiguous, row by row.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array

Mask = NDArray[np.bool_]


class BodyInGround(NamedTuple):
    """Pose and motion of the base."""

    rotation: Array  # (3, 3), base to the frame of the ground
    angular_velocity: Array  # (3,) rad/s in base
    position: Array  # (3,) m
    velocity: Array  # (3,) m/s


class FeetState(NamedTuple):
    """Places of the feet and what they feel."""

    in_base: Array  # (4, 3) m, measured
    in_ground: Array  # (4, 3) m, estimated
    contact: Mask  # (4,)
    force: Array  # (4, 3) N, of the ground on the feet, estimated
