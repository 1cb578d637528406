"""The path of a swing foot: a cubic replanned at every tick, a bump for clearance, late descent."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.kinematics import LEGS

Mask = NDArray[np.bool_]

SHORTEST_REPLAN = 0.03  # s, keeps the acceleration bounded when the foothold moves late


class SwingPaths(NamedTuple):
    """Where the feet swing; centres in m, in the frame of the ground."""

    start: Array  # (4, 3), at liftoff
    foothold: Array  # (4, 3), where they are to stand; z is expected
    position: Array  # (4, 3)
    velocity: Array  # (4, 3) m/s


class SwingShape(NamedTuple):
    """What the swings of one gait have in common."""

    time: float  # s
    height: float  # m, over the line from start to foothold
    search_speed: float  # m/s, of the late descent
    search_depth: float  # m, most of the late descent


@njit(cache=True)
def swing_feet(
    swinging: Mask, progress: Array, paths: SwingPaths, shape: SwingShape, dt: float
) -> None:
    """Move the swing feet by one tick.

    Horizontally each foot follows the cubic from where it is to rest at its foothold, planned anew
    at every tick, so that a foothold may move during the swing. Vertically it rises by the bump
    16 s^2 (1 - s)^2 over the straight line from liftoff to ground; when the clock has run out it
    reaches down for the ground.

    Args:
        swinging: (4,) bool.
        progress: (4,) 0 at liftoff to 1 at the scheduled touchdown.
        paths: positions and velocities are updated.
        shape: of all swings.
        dt: s.
    """
    for leg in range(LEGS):
        if not swinging[leg]:
            continue
        s, start, goal = progress[leg], paths.start[leg], paths.foothold[leg]
        position, velocity = paths.position[leg], paths.velocity[leg]
        remaining = max((1.0 - s) * shape.time, SHORTEST_REPLAN)
        for axis in range(2):
            error = goal[axis] - position[axis]
            acceleration = 6.0 * error / (remaining * remaining) - 4.0 * velocity[axis] / remaining
            position[axis] += velocity[axis] * dt + 0.5 * acceleration * dt * dt
            velocity[axis] += acceleration * dt
        if s < 1.0:
            rise = goal[2] - start[2]
            bump = 16.0 * s * s * (1.0 - s) * (1.0 - s)
            bump_slope = 32.0 * s * (1.0 - s) * (1.0 - 2.0 * s)
            position[2] = start[2] + rise * s * s * (3.0 - 2.0 * s) + shape.height * bump
            velocity[2] = (rise * 6.0 * s * (1.0 - s) + shape.height * bump_slope) / shape.time
        elif position[2] > goal[2] - shape.search_depth:
            position[2] -= shape.search_speed * dt
            velocity[2] = -shape.search_speed
        else:
            velocity[2] = 0.0
