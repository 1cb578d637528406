"""The ground on which a route begins: free cells beside the robot, the lane on which it stands."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from husky_description.arrays import Array
from husky_navigation.planning.climb_lanes import Lanes
from husky_navigation.planning.planning_grid import (
    HEADINGS,
    Cell,
    PlanningGrid,
    cells_between,
    heading_of,
)

_OFF_LANE, _SKEW = 0.4, 0.35
"""Distance from a lane [m] plus angle to it [rad] at which a robot still stands on it, and most of
that angle.
"""
_BESIDE = 4
"""Cells to each side among which one is looked for that is free, of a robot near an obstacle."""


class OnLane(NamedTuple):
    """A lane on which a robot stands.

    Attributes:
        lane: its number.
        downwards: the robot looks down it.
        left: horizontal way to the end to which it looks [m].
        end: place of that end in `map` [m] (2,).
    """

    lane: int
    downwards: bool
    left: float
    end: Array


def lane_below(grid: PlanningGrid, lanes: Lanes, pose: tuple[float, float, float]) -> OnLane | None:
    """Return the lane on which a robot stands, None for no lane.

    Args:
        grid: the ground.
        lanes: of it.
        pose: x, y [m] and yaw [rad] in `map`.
    """
    x, y = grid.lattice.cell_centers()
    ends = [np.stack((x[each[:, 0]], y[each[:, 1]]), axis=1) for each in (lanes.foot, lanes.top)]
    cosine, sine = np.cos(lanes.direction), np.sin(lanes.direction)
    dx, dy = (np.array(pose[:2]) - ends[0]).T
    along, across = cosine * dx + sine * dy, cosine * dy - sine * dx
    turned = np.abs((pose[2] - lanes.direction + math.pi) % (2.0 * math.pi) - math.pi)
    downwards = turned > 0.5 * math.pi
    skew = np.minimum(turned, math.pi - turned)
    on_lane = (along > 0.0) & (along < lanes.length)
    score = np.where(on_lane & (skew < _SKEW), np.abs(across) + skew, np.inf)
    if score.size == 0 or score.min() > _OFF_LANE:
        return None
    k = int(np.argmin(score))
    down = bool(downwards[k])
    left = float(along[k] if down else lanes.length[k] - along[k])
    return OnLane(k, down, left, ends[0 if down else 1][k])


def free_beside(
    grid: PlanningGrid, cell: Cell, yaw: float, reach: int = _BESIDE
) -> tuple[int, int, int] | None:
    """Return the free heading and cell next to a robot's, of its heading if one is near.

    Args:
        grid: the ground.
        cell: in which the robot stands.
        yaw: its heading [rad].
        reach: cells to each side among which a free one is looked for.

    Returns:
        Heading and cell [i, j], None where none is near.
    """
    own = int(heading_of(yaw))
    n = grid.lattice.cells
    i, j = (range(max(0, k - reach), min(n, k + reach + 1)) for k in cell)
    nearby = grid.free[:, i.start : i.stop, j.start : j.stop]
    turn = (np.arange(HEADINGS) - own + HEADINGS // 2) % HEADINGS - HEADINGS // 2
    away = np.hypot(np.array(i)[:, None] - cell[0], np.array(j)[None, :] - cell[1])
    score = np.where(nearby, away[None] + np.abs(turn)[:, None, None], np.inf)
    best = np.unravel_index(np.argmin(score), score.shape)
    if not nearby[best]:
        return None
    found = i[best[1]], j[best[2]]
    if grid.rough[cells_between(cell, found)].any():
        return None
    return int(best[0]), *found
