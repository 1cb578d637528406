"""The path of a swing foot: a cubic replanned at every tick, a bump for clearance, late descent."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from husky_control.kinematics import LEGS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SHORTEST_REPLAN = 0.03  # s, keeps the acceleration bounded when the foothold moves late


@njit(cache=True)
def swing_feet(
    swinging: Mask,
    progress: Array,
    swing_time: float,
    foothold: Array,
    ground: Array,
    swing_height: float,
    search_speed: float,
    search_depth: float,
    start_height: Array,
    dt: float,
    position: Array,
    velocity: Array,
) -> None:
    """Move the swing feet by one tick.

    Horizontally each foot follows the cubic from where it is to rest at its foothold, planned anew
    at every tick, so that a foothold may move during the swing. Vertically it rises by the bump
    16 s^2 (1 - s)^2 over the straight line from liftoff to ground; when the clock has run out it
    reaches down for the ground.

    Args:
        swinging: (4,) bool.
        progress: (4,) 0 at liftoff to 1 at the scheduled touchdown.
        swing_time: s.
        foothold: (4, 2) m in world.
        ground: (4,) m, height in world of each foot's centre when it stands on its foothold.
        swing_height: m.
        search_speed: m/s, of the late descent.
        search_depth: m, most of the late descent.
        start_height: (4,) m, height at liftoff in world.
        dt: s.
        position: (4, 3) m in world, updated.
        velocity: (4, 3) m/s in world, updated.
    """
    for leg in range(LEGS):
        if not swinging[leg]:
            continue
        s = progress[leg]
        remaining = max((1.0 - s) * swing_time, SHORTEST_REPLAN)
        for axis in range(2):
            error = foothold[leg, axis] - position[leg, axis]
            acceleration = (
                6.0 * error / (remaining * remaining) - 4.0 * velocity[leg, axis] / remaining
            )
            position[leg, axis] += velocity[leg, axis] * dt + 0.5 * acceleration * dt * dt
            velocity[leg, axis] += acceleration * dt
        if s < 1.0:
            rise = ground[leg] - start_height[leg]
            bump = 16.0 * s * s * (1.0 - s) * (1.0 - s)
            bump_slope = 32.0 * s * (1.0 - s) * (1.0 - 2.0 * s)
            position[leg, 2] = (
                start_height[leg] + rise * s * s * (3.0 - 2.0 * s) + swing_height * bump
            )
            velocity[leg, 2] = (
                rise * 6.0 * s * (1.0 - s) + swing_height * bump_slope
            ) / swing_time
        elif position[leg, 2] > ground[leg] - search_depth:
            position[leg, 2] -= search_speed * dt
            velocity[leg, 2] = -search_speed
        else:
            velocity[leg, 2] = 0.0
