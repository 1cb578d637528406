"""Search for a way to the goal of a world of obstacles, on level ground and over its ridges."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from husky_sim.obstacle_world import FIRST_X, LAST_X, SIDE, GroundPoint, ObstacleWorld

ROBOT_LENGTH, ROBOT_WIDTH = 0.8, 0.5
"""Ground that the robot takes [m]."""
CLEARANCE = 0.3
"""Between the robot and any obstacle, at whatever heading it stands [m]."""
ROBOT_RADIUS = math.hypot(ROBOT_LENGTH, ROBOT_WIDTH) / 2 + CLEARANCE
"""Level ground around the middle of the robot in which it walks and turns [m]."""
_CELL = 0.1
"""Edge of a cell of the raster that is searched [m]."""

Mask = NDArray[np.bool_]
"""A mark for each cell of the raster: rows along x, columns along y."""


def goal_is_reachable(
    world: ObstacleWorld, climbing: bool = True, radius: float = ROBOT_RADIUS
) -> bool:
    """Return True if a way leads from the start to the goal.

    On level ground the robot keeps its distance from every obstacle. It climbs a ridge straight,
    along its centre line, from before one foot to behind the other.

    Args:
        world: the obstacles and the goal.
        climbing: the robot climbs ridges; otherwise they are obstacles alone.
        radius: distance of the middle of the robot from every obstacle [m].
    """
    free = _free_cells(world, radius)
    climbs = []
    if climbing:
        for ridge in world.ridges:
            first, second = (_cell_of(end) for end in ridge.ends(radius + _CELL))
            climbs += [(first, second), (second, first)]
    reached = np.zeros_like(free)
    reached[_cell_of(GroundPoint(0.0, 0.0))] = True
    goal = _cell_of(GroundPoint(world.goal.x, world.goal.y))
    while True:
        grown = _with_neighbours(reached)
        for here, there in climbs:
            grown[there] |= grown[here]
        grown &= free
        if grown[goal] or np.array_equal(grown, reached):
            return bool(grown[goal])
        reached = grown


def _free_cells(world: ObstacleWorld, radius: float) -> Mask:
    """Return the cells whose middle has nothing within a radius [m]."""
    count = round(SIDE / _CELL)
    x, y = np.meshgrid(
        FIRST_X + (np.arange(count) + 0.5) * _CELL,
        -SIDE / 2 + (np.arange(count) + 0.5) * _CELL,
        indexing="ij",
    )
    free: Mask = (x - radius >= FIRST_X) & (x + radius <= LAST_X) & (np.abs(y) + radius <= SIDE / 2)
    for ground in world.grounds:
        free &= ground.distance_to(x, y) >= radius
    return free


def _cell_of(point: GroundPoint) -> tuple[int, int]:
    """Return row and column of the cell around a point."""
    return int((point.x - FIRST_X) / _CELL), int((point.y + SIDE / 2) / _CELL)


def _with_neighbours(cells: Mask) -> Mask:
    """Return marked cells together with the four neighbours of each."""
    grown = cells.copy()
    grown[1:] |= cells[:-1]
    grown[:-1] |= cells[1:]
    grown[:, 1:] |= cells[:, :-1]
    grown[:, :-1] |= cells[:, 1:]
    return grown
