"""Search for a way to the goal of a world of obstacles: on level ground, over ridges, in flight."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from husky_sim.obstacle_world import GroundPoint, ObstacleWorld, Square

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
    world: ObstacleWorld,
    climbing: bool = True,
    radius: float = ROBOT_RADIUS,
    flight_height: float = 0.0,
) -> bool:
    """Return True if a way leads from the start to the goal.

    On level ground the robot keeps its distance from every obstacle. It climbs a ridge straight,
    along its centre line, from before one foot to behind the other.

    Args:
        world: the obstacles and the goal.
        climbing: the robot climbs ridges; otherwise they are obstacles alone.
        radius: distance of the middle of the robot from every obstacle [m].
        flight_height: height of boxes that the robot flies over [m]; 0 for a robot that only walks.
    """

    def cell_of(point: GroundPoint) -> tuple[int, int]:
        return _cell_of(point, world.square)

    free = _free_cells(world, radius, flight_height)
    climbs = []
    if climbing:
        for ridge in world.ridges:
            first, second = (cell_of(end) for end in ridge.ends(radius + _CELL))
            climbs += [(first, second), (second, first)]
    reached = np.zeros_like(free)
    reached[cell_of(GroundPoint(0.0, 0.0))] = True
    goal = cell_of(GroundPoint(world.goal.x, world.goal.y))
    while True:
        grown = _with_neighbours(reached)
        for here, there in climbs:
            grown[there] |= grown[here]
        grown &= free
        if grown[goal] or np.array_equal(grown, reached):
            return bool(grown[goal])
        reached = grown


def _free_cells(world: ObstacleWorld, radius: float, flight_height: float) -> Mask:
    """Return the cells whose middle has nothing but boxes to fly over within a radius [m]."""
    first_x, last_x, edge = world.square.first_x, world.square.last_x, world.square.side / 2
    count = round(world.square.side / _CELL)
    x, y = np.meshgrid(
        first_x + (np.arange(count) + 0.5) * _CELL,
        -edge + (np.arange(count) + 0.5) * _CELL,
        indexing="ij",
    )
    free: Mask = (x - radius >= first_x) & (x + radius <= last_x) & (np.abs(y) + radius <= edge)
    flown_over = {box.ground for box in world.boxes if box.height <= flight_height}
    for ground in world.grounds:
        if ground not in flown_over:
            free &= ground.distance_to(x, y) >= radius
    return free


def _cell_of(point: GroundPoint, square: Square) -> tuple[int, int]:
    """Return row and column of the cell around a point."""
    return int((point.x - square.first_x) / _CELL), int((point.y + square.side / 2) / _CELL)


def _with_neighbours(cells: Mask) -> Mask:
    """Return marked cells together with the four neighbours of each."""
    grown = cells.copy()
    grown[1:] |= cells[:-1]
    grown[:-1] |= cells[1:]
    grown[:, 1:] |= cells[:, :-1]
    grown[:, :-1] |= cells[:, 1:]
    return grown
