"""Judgements of the ground where a robot is, and where it goes next."""

from __future__ import annotations

import math

import numpy as np

from husky_navigation.following.leg_follower import PATH_STEP, LegFollower
from husky_navigation.planning.air_layers import STRIDE, AirLayers
from husky_navigation.planning.planning_grid import (
    Cell,
    Indices,
    Mask,
    PlanningGrid,
    cells_between,
    heading_of,
)
from husky_navigation.planning.route import Leg, PlanePose, Route, course_over, way_over
from husky_navigation.planning.route_search import CLIMB, FLY, Place

SIGHT = 0.7, 1.0
"""Ground ahead of the base that must have been seen, from and to [m]; nearer the camera of a robot
that turns sees none.
"""
_CLIMB_SEEN, _CLIMB_EVEN = 0.4, 0.9
"""Ground ahead of the base that must be seen, and not be rough, on a climb: a crest hides what is
behind it [m].
"""
_SAME_PLACE = 1.0
"""Distance between two places from which the same slope is seen [m]."""
_LOWER = 0.05
"""How much lower than was planned a robot may pass over what was seen: the map has noise [m].

With the 0.08 m below its altitude at which a flight sets out, `robot_wish.NEAR_TOP`, these are
0.13 m of the 0.16 m that are below the perch: `FlyAbility.clearance` 0.45 m less `perched` 0.29 m.
"""
_LEAVING = 0.5
"""Way within which a robot leaves an obstacle that it is too near to [m]."""

_SIDEWAYS = 0.3
"""Way up to which a flight to a landing keeps its heading; on longer ones it turns ahead [m]."""


def needs_a_look(route: Route, place: Place) -> bool:
    """Return whether a route climbs a slope of which too little is seen from a place [m]."""
    for leg in route.legs:
        away = math.hypot(leg.points[0, 0] - place[0], leg.points[0, 1] - place[1])
        if leg.mode == CLIMB and not leg.is_seen and away < _SAME_PLACE:
            return True
    return False


def is_blocked(grid: PlanningGrid, follower: LegFollower) -> bool:
    """Return whether something stands on what is left of a leg.

    A robot that stands too near an obstacle may leave it, on ground on which it can step. Cells
    beside the way count as free too: it leads over them where it cuts their corners.
    """
    x, y, yaw = follower.ahead().T
    lattice, heading = grid.lattice, heading_of(yaw)
    i, j = (np.floor(each / lattice.resolution).astype(int) for each in (x, y))
    i, j = i - lattice.x, j - lattice.y
    is_free, is_rough = np.zeros(len(x), np.bool_), np.zeros(len(x), np.bool_)
    inside = (i >= 0) & (i < lattice.cells) & (j >= 0) & (j < lattice.cells)
    is_rough[inside] = grid.rough[i[inside], j[inside]]
    for beside_i, beside_j in np.ndindex(3, 3):
        k, m = i + beside_i - 1, j + beside_j - 1
        inside = (k >= 0) & (k < lattice.cells) & (m >= 0) & (m < lattice.cells)
        is_free[inside] |= grid.free[heading[inside], k[inside], m[inside]]
    return bool(is_rough.any()) or _is_closed_after_leaving(is_free)


def _is_closed_after_leaving(is_free: Mask) -> bool:
    """Return whether places each `PATH_STEP` (n,) are not free, but for the first ones."""
    was_free = np.logical_or.accumulate(is_free)
    was_free[round(_LEAVING / PATH_STEP) :] = True
    return bool((was_free & ~is_free).any())


def place_ahead(pose: PlanePose, way: float) -> Place:
    """Return the place ahead of a pose [m]."""
    return pose.x + way * math.cos(pose.yaw), pose.y + way * math.sin(pose.yaw)


def is_seen(grid: PlanningGrid, pose: PlanePose, left: float) -> bool:
    """Return whether the ground ahead of a pose has been seen, of the way that is left [m]."""
    for way in np.arange(SIGHT[0], min(SIGHT[1], left), grid.lattice.resolution):
        cell = grid.lattice.index_of(*place_ahead(pose, way))
        if cell is None or not grid.known[cell]:
            return False
    return True


def can_climb_on(grid: PlanningGrid, leg: Leg, pose: PlanePose) -> bool:
    """Return whether, up to the end of a climb, the next 0.4 m were seen and 0.9 m are even."""
    end = leg.points[-1]
    left = math.hypot(end[0] - pose.x, end[1] - pose.y)
    for way in np.arange(0.0, min(left, _CLIMB_EVEN), grid.lattice.resolution):
        cell = grid.lattice.index_of(*(np.array(pose[:2]) + way / left * (end - pose[:2])))
        if cell is None or grid.rough[cell]:
            return False
        if way < _CLIMB_SEEN and not grid.known[cell]:
            return False
    return True


def can_walk(grid: PlanningGrid, pose: PlanePose) -> bool:
    """Return whether a robot can walk where it is: on a crest its hind feet are on a slope."""
    cell = grid.lattice.index_of(pose.x, pose.y)
    return cell is not None and bool(grid.free[int(heading_of(pose.yaw)), *cell])


def has_room_behind(grid: PlanningGrid, pose: PlanePose, way: float) -> bool:
    """Return whether a robot may step back by a way [m]: the ground there is known, and it fits."""
    cell = grid.lattice.index_of(*place_ahead(pose, -way))
    heading = int(heading_of(pose.yaw))
    return cell is not None and bool(grid.known[cell] and grid.free[heading, *cell])


# In the air ---------------------------------------------------------------------------------------
def air_is_blocked(
    grid: PlanningGrid, air: AirLayers, follower: LegFollower, altitude: float
) -> bool:
    """Return whether something too high was seen on what is left of a flight at an altitude [m].

    A robot that is too near something high may leave it. Cells beside the way count as free too, as
    in `is_blocked`: the planner looks at the cells between the centres of others.
    """
    cells = (grid.lattice.index_of(x, y) for x, y, _ in follower.ahead())
    free = [
        cell is None or float(air.lowest[_around(cell)].min()) <= altitude + _LOWER
        for cell in cells
    ]
    return _is_closed_after_leaving(np.array(free, np.bool_))


def _around(cell: Cell) -> tuple[slice, slice]:
    """Return the cell and those beside it, 3 x 3."""
    i, j = cell
    return slice(max(0, i - 1), i + 2), slice(max(0, j - 1), j + 2)


def may_land(grid: PlanningGrid, air: AirLayers, pose: PlanePose) -> bool:
    """Return whether a robot may land at one of the 3 x 3 places around it, on ground seen."""
    return _is_any_near(grid, air, air.landing, pose)


def may_hope_to_land(grid: PlanningGrid, air: AirLayers, pose: PlanePose) -> bool:
    """Return whether only ground that was not seen speaks against a landing."""
    return _is_any_near(grid, air, air.hoped, pose)


def _is_any_near(grid: PlanningGrid, air: AirLayers, places: Mask, pose: PlanePose) -> bool:
    """Return whether one of the 3 x 3 places in the air around a pose is marked."""
    cell = grid.lattice.index_of(pose.x, pose.y)
    if cell is None:
        return False
    return bool(places[_around(air.place(cell))].any())


def ground_below(grid: PlanningGrid, air: AirLayers, leg: Leg) -> float:
    """Return the height in `map` of the ground at the end of a flight, as it is known now [m]."""
    cell = grid.lattice.index_of(*leg.points[-1].tolist())
    return leg.ground if cell is None else float(air.ground[air.place(cell)])


def nearest_landing(
    grid: PlanningGrid, air: AirLayers, pose: PlanePose, altitude: float, *, may_rise: bool
) -> Leg | None:
    """Return the straight way to the nearest place to land, None where there is none.

    Places that are reached at the altitude of now come first. Without any place to land the
    nearest ground on which the robot fits is taken.

    Args:
        grid: the ground.
        air: over it.
        pose: of the robot.
        altitude: at which it flies [m].
        may_rise: the way may be higher where something on it is too high, up to the highest layer.
    """
    here = grid.lattice.index_of(pose.x, pose.y)
    if here is None:
        return None
    highest = float(air.altitude.max(initial=altitude)) if may_rise else altitude
    for places in (STRIDE * np.argwhere(air.landing), np.argwhere(air.take_off)):
        found = _nearest_of(places, grid, air, here, (altitude, highest))
        if found is not None:
            end, top = found
            points, ground = np.array((pose[:2], grid.centre(end))), air.ground[air.place(end)]
            yaw = course_over(points) if way_over(points) > _SIDEWAYS else pose.yaw
            return Leg(FLY, points, yaw, 0.0, 0.0, altitude=top, ground=float(ground))
    return None


def _nearest_of(
    places: Indices,
    grid: PlanningGrid,
    air: AirLayers,
    here: Cell,
    altitudes: tuple[float, float],
) -> tuple[Cell, float] | None:
    """Return the nearest cell that is reached, and the altitude of the way there [m].

    A robot that is too near something high may leave it first.

    Args:
        places: cells (n, 2).
        grid: the ground.
        air: over the ground.
        here: cell from which the way leads.
        altitudes: that is tried first, and the highest [m].
    """
    altitude, highest = altitudes
    higher = None
    for i, j in places[np.argsort(np.hypot(*(places - here).T))].tolist():
        lowest = air.lowest[cells_between(here, (i, j))]
        way = math.dist(here, (i, j)) * grid.lattice.resolution
        leaving = round(len(lowest) * _LEAVING / max(way, _LEAVING))
        too_low = lowest > altitude + _LOWER
        if not too_low[np.argmin(too_low[:leaving]) :].any():
            return (i, j), altitude
        if higher is None and lowest.max() <= highest:
            higher = (i, j), float(lowest.max())
    return higher
