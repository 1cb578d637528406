"""The ground on which a route begins: free cells beside the robot, the lane on which it stands."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from husky_description.arrays import Array
from husky_navigation.planning.abilities import ClimbAbility
from husky_navigation.planning.climb_lanes import Lanes, first_end
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


class WayOff(NamedTuple):
    """Straight way off a slope, on the side to which a robot looks.

    Attributes:
        end: place in `map` [m] (2,).
        slope: its mean inclination, positive uphill [rad].
        yaw: its direction [rad].
    """

    end: Array
    slope: float
    yaw: float


def way_along_lane(
    grid: PlanningGrid, lanes: Lanes, pose: tuple[float, float, float]
) -> WayOff | None:
    """Return the way along the lane on which a robot stands, None for no lane.

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
    slope = float(lanes.slope[k][lanes.slope[k] > 0.0].mean())
    return _way_off(
        ends[0 if downwards[k] else 1][k], slope, float(lanes.direction[k]), downwards[k]
    )


def way_ahead(
    grid: PlanningGrid, climb: ClimbAbility, pose: tuple[float, float, float], cell: Cell
) -> WayOff | None:
    """Return the way along the fall line of a robot's cell, None for level ground or no such way.

    Unlike a lane it begins at the robot: what the map says of the ground behind it does not count.

    Args:
        grid: the ground.
        climb: the robot's ability.
        pose: x, y [m] and yaw [rad] in `map`.
        cell: in which that is.
    """
    rise = np.array((grid.slope_x[cell], grid.slope_y[cell]))
    if float(np.hypot(*rise)) < math.tan(math.radians(climb.least_slope_deg)):
        return None
    uphill = math.atan2(rise[1], rise[0])
    turned = abs(math.remainder(pose[2] - uphill, 2.0 * math.pi))
    down = turned > 0.5 * math.pi
    if min(turned, math.pi - turned) > _SKEW:
        return None
    found = first_end(grid, climb, cell, uphill, downwards=down)
    return (
        None if found is None else _way_off(np.array(grid.centre(found[0])), found[1], uphill, down)
    )


def _way_off(end: Array, slope: float, uphill: float, down: bool) -> WayOff:
    yaw = math.remainder(uphill + math.pi * down, 2.0 * math.pi)
    return WayOff(end, -slope if down else slope, yaw)


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
