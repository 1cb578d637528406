"""A route: legs on which the robot walks or climbs, from where it stands to its goal."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from husky_description.arrays import Array
from husky_navigation.planning.climb_lanes import Indices, way_ahead
from husky_navigation.planning.planning_grid import HEADINGS, Mask, PlanningGrid, heading_of
from husky_navigation.planning.route_search import (
    CLIMB,
    WALK,
    Node,
    NoRouteError,
    RouteGraph,
    Step,
)
from husky_navigation.planning.travel_costs import RADIAN, TravelCosts

_SLOPE = 0.15
"""Rise over way of ground from which on a robot climbs when its route begins, even if it can walk
off it [-].
"""
_OFF_LANE, _SKEW = 0.4, 0.35
"""Distance from a lane [m] plus angle to it [rad] at which a robot still stands on it, and most of
that angle.
"""
_NEAR_GOAL = 0.5
"""Distance within which an obstacle takes a goal, half the diagonal of the footprint [m]."""
_BESIDE, _BESIDE_GOAL = 4, 8
"""Cells to each side among which one is looked for that is free, of a robot near an obstacle, and
of a goal near ground that was not seen.
"""


class PlanePose(NamedTuple):
    """Where a robot stands in `map`: place [m] and heading [rad]."""

    x: float
    y: float
    yaw: float


class Refusal(enum.Enum):
    """Reasons for which there is no route."""

    START_OUTSIDE = "the robot is off the map"
    GOAL_OUTSIDE = "the goal is off the map"
    START_OCCUPIED = "the robot stands where it cannot walk"
    GOAL_OCCUPIED = "the goal is on or too near an obstacle, or on a slope"
    NO_WAY = "no way leads to the goal on ground that the robot can take"
    BATTERY = "the battery does not last for the way to the goal"
    OFF_PATH = "the robot is more than 0.5 m from the path"
    PATH_BLOCKED = "the path leads over ground that the robot cannot take"


class RouteError(Exception):
    """There is no route.

    Attributes:
        refusal: why.
        off_slope: the way to level ground of a robot that stands on a slope, from where it may see
            more; None for one that does not.
    """

    def __init__(self, refusal: Refusal, off_slope: Route | None = None) -> None:
        """Say why."""
        super().__init__(refusal.value)
        self.refusal, self.off_slope = refusal, off_slope


@dataclass(frozen=True)
class Leg:
    """A part of a route on which the robot moves in one way.

    Attributes:
        mode: `walk` or `climb`.
        points: of the base in `map`, from where the leg begins to where it ends [m] (n, 2).
        yaw: heading at its end [rad]; on a climb all along, also backwards.
        time: that it is to take [s].
        energy: that it is to cost [J].
        is_seen: so much of a climb that it may begin; else the robot has to look at it before.
        downwards: on a climb.
    """

    mode: str
    points: Array
    yaw: float
    time: float
    energy: float
    is_seen: bool = True
    downwards: bool = False

    @property
    def length(self) -> float:
        """Horizontal way [m]."""
        return _way(self.points)


@dataclass(frozen=True)
class Route:
    """Legs one after the other.

    Attributes:
        legs: in order.
        is_whole: the last one ends at the goal, not beside it.
    """

    legs: tuple[Leg, ...]
    is_whole: bool = True

    @property
    def time(self) -> float:
        """Time that it is to take [s]."""
        return sum(leg.time for leg in self.legs)

    @property
    def energy(self) -> float:
        """Energy that it is to cost [J]."""
        return sum(leg.energy for leg in self.legs)

    @property
    def length(self) -> float:
        """Horizontal way [m]."""
        return sum(leg.length for leg in self.legs)

    @property
    def modes(self) -> tuple[str, ...]:
        """Ways of moving, in order."""
        return tuple(leg.mode for leg in self.legs)


def find_route(graph: RouteGraph, start: PlanePose, goal: PlanePose) -> Route:
    """Return the cheapest route; its first point and its last are start and goal themselves.

    Where only ground that was not seen speaks against the goal, the route ends beside it.

    Raises:
        RouteError: there is none; says why.
        ValueError: a pose is not finite.
    """
    for name, pose in (("start", start), ("goal", goal)):
        if not all(math.isfinite(value) for value in pose):
            raise ValueError(f"{name} is {pose}, it must be finite")
    grid = graph.grid
    first = grid.lattice.index_of(start.x, start.y)
    last = grid.lattice.index_of(goal.x, goal.y)
    if first is None:
        raise RouteError(Refusal.START_OUTSIDE)
    if last is None:
        raise RouteError(Refusal.GOAL_OUTSIDE)
    begin, end = _free_beside(grid, start, first, _BESIDE), (int(heading_of(goal.yaw)), *last)
    fits = bool(grid.free[int(heading_of(start.yaw)), *first])
    is_climbing = begin is None or grid.slope[first] > _SLOPE or not fits
    off = _off_slope(graph, start) if is_climbing else None
    if off is None and begin is None:
        off = _ahead_on_slope(graph, start, first)
    if off is None and begin is None:
        raise RouteError(Refusal.START_OCCUPIED)
    is_whole = bool(grid.free[end])
    if not is_whole:
        end, goal = _beside_goal(grid, goal, last)
    if off is not None:
        x, y = off.points[-1]
        try:
            after = find_route(graph, PlanePose(float(x), float(y), off.yaw), goal)
        except RouteError as error:
            raise RouteError(error.refusal, Route((off,))) from error
        return Route((off, *after.legs), is_whole)
    assert begin is not None
    try:
        steps = graph.search(begin, end)
    except NoRouteError as error:
        raise RouteError(Refusal.NO_WAY) from error
    return replace(_Builder(graph, start, goal).route(steps), is_whole=is_whole)


def _off_slope(graph: RouteGraph, start: PlanePose) -> Leg | None:
    """Return the way along a lane, nose ahead, of a robot that stands on it; None for no lane."""
    lanes = graph.lanes
    if lanes is None:
        return None
    x, y = graph.grid.lattice.cell_centers()
    ends = [np.stack((x[each[:, 0]], y[each[:, 1]]), axis=1) for each in (lanes.foot, lanes.top)]
    cosine, sine = np.cos(lanes.direction), np.sin(lanes.direction)
    dx, dy = (np.array(start[:2]) - ends[0]).T
    along, across = cosine * dx + sine * dy, cosine * dy - sine * dx
    turned = np.abs((start.yaw - lanes.direction + math.pi) % (2.0 * math.pi) - math.pi)
    downwards = turned > 0.5 * math.pi
    skew = np.minimum(turned, math.pi - turned)
    on_lane = (along > 0.0) & (along < lanes.length)
    score = np.where(on_lane & (skew < _SKEW), np.abs(across) + skew, np.inf)
    if score.size == 0 or score.min() > _OFF_LANE:
        return None
    k = int(np.argmin(score))
    down = bool(downwards[k])
    yaw = math.remainder(float(lanes.direction[k]) + math.pi * down, 2.0 * math.pi)
    left = float(along[k] if down else lanes.length[k] - along[k])
    slope = lanes.slope[k][lanes.slope[k] > 0.0].mean()
    speed = graph.abilities.climb.speed if graph.abilities.climb else 0.0
    time, energy = (
        left / math.cos(slope) * float(each[0])
        for each in graph.costs.per_metre(CLIMB, speed, np.degrees([-slope if down else slope]))
    )
    points = np.array((start[:2], ends[0 if down else 1][k]))
    return Leg(CLIMB, points, yaw, time, energy, downwards=down)


def _ahead_on_slope(graph: RouteGraph, start: PlanePose, cell: tuple[int, int]) -> Leg | None:
    """Return the way ahead of a robot on a slope on which no lane leads past it any more: what was
    seen anew of the ground behind it does not strand it.
    """
    grid, climb = graph.grid, graph.abilities.climb
    if graph.lanes is None or climb is None or grid.slope[cell] < graph.abilities.walk.most_slope:
        return None
    uphill = math.atan2(grid.slope_y[cell], grid.slope_x[cell])
    turned = abs(math.remainder(start.yaw - uphill, 2.0 * math.pi))
    if min(turned, math.pi - turned) > _SKEW:
        return None
    way = way_ahead(grid, climb, cell, start.yaw)
    if way is None:
        return None
    points = np.array((start[:2], grid.centre(way.end)))
    length, down = _way(points) / math.cos(way.slope), turned > 0.5 * math.pi
    yaw = math.remainder(uphill + math.pi * down, 2.0 * math.pi)
    time, energy = (
        length * float(each[0])
        for each in graph.costs.per_metre(CLIMB, climb.speed, np.degrees([way.slope]))
    )
    return Leg(CLIMB, points, yaw, time, energy, downwards=down)


def walk_leg(points: Array, yaw: float, yaw_at_end: float, costs: TravelCosts, speed: float) -> Leg:
    """Return a leg of a walk, with the cost of its way and of its turns.

    Args:
        points: of the base in `map` [m] (n, 2).
        yaw: heading before it [rad].
        yaw_at_end: heading at its end [rad].
        costs: of the robot.
        speed: at which it walks [m/s].
    """
    steps = np.diff(points, axis=0)
    ways = np.linalg.norm(steps, axis=1)
    ahead = np.arctan2(steps[:, 1], steps[:, 0])[ways > 0.0]
    turns = np.diff(np.concatenate(([yaw], ahead, [yaw_at_end])))
    turned = float(np.abs((turns + math.pi) % (2.0 * math.pi) - math.pi).sum())
    per_metre = (float(each[0]) for each in costs.per_metre(WALK, speed, np.zeros(1)))
    turn, way = costs.of(WALK, RADIAN), float(ways.sum())
    time, energy = (
        way * metre + turned * radian
        for metre, radian in zip(per_metre, (turn.time, turn.energy), strict=True)
    )
    return Leg(WALK, points, yaw_at_end, time, energy)


def _beside_goal(
    grid: PlanningGrid, goal: PlanePose, cell: tuple[int, int]
) -> tuple[Node, PlanePose]:
    """Return the free node and its pose beside a goal near which only unseen ground is none to walk
    on; raises RouteError if an obstacle was seen there.
    """
    taken = grid.is_taken(goal.x, goal.y, _NEAR_GOAL)
    beside = None if taken else _free_beside(grid, goal, cell, _BESIDE_GOAL)
    if beside is None:
        raise RouteError(Refusal.GOAL_OCCUPIED)
    heading, i, j = beside
    yaw = math.remainder(heading * 2.0 * math.pi / HEADINGS, 2.0 * math.pi)
    return beside, PlanePose(*grid.centre((i, j)), yaw)


def _free_beside(
    grid: PlanningGrid, pose: PlanePose, cell: tuple[int, int], reach: int
) -> Node | None:
    """Return the free node next to a pose, of its heading if one is near, None where none is.

    Args:
        grid: the ground.
        pose: somewhere.
        cell: of that.
        reach: cells to each side among which a free one is looked for.
    """
    own = int(heading_of(pose.yaw))
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
    line = _line(cell, found)
    if grid.rough[line].any():
        return None
    return int(best[0]), *found


class _Builder:
    """Makes the legs of a route from the steps of a search."""

    def __init__(self, graph: RouteGraph, start: PlanePose, goal: PlanePose) -> None:
        """Take the ends of the route."""
        self._graph, self._start, self._goal = graph, start, goal
        # Cells on which the robot can turn.
        self._all_ways: Mask = np.logical_and.reduce(graph.grid.free, axis=0)

    def route(self, steps: Sequence[Step]) -> Route:
        """Return the route: walks with their corners alone, climbs from end to end."""
        legs, begin, yaw = list[Leg](), 0, self._start.yaw
        for index, step in enumerate(steps):
            if step.lane is None:
                continue
            climb = self._climb(steps[index - 1], step, step.lane)
            legs += self._walk(steps[begin:index], yaw, climb.yaw, first=begin == 0)
            legs.append(climb)
            begin, yaw = index, climb.yaw
        walk = self._walk(steps[begin:], yaw, self._goal.yaw, first=begin == 0, last=True)
        return Route((*legs, *walk))

    def _climb(self, start: Step, end: Step, lane: int) -> Leg:
        """Return the leg of a lane."""
        assert self._graph.lanes is not None
        points = np.array([self._graph.grid.centre(each.cell) for each in (start, end)])
        uphill = float(self._graph.lanes.direction[lane])
        yaw = math.remainder(uphill + math.pi * end.downwards, 2.0 * math.pi)
        lanes, climb = self._graph.lanes, self._graph.abilities.climb
        assert climb is not None
        is_seen = bool(lanes.seen[lane, int(end.downwards)] >= lanes.least_seen(climb)[lane])
        return Leg(CLIMB, points, yaw, end.time, end.energy, is_seen, end.downwards)

    def _walk(
        self,
        steps: Sequence[Step],
        yaw: float,
        yaw_at_end: float,
        *,
        first: bool = False,
        last: bool = False,
    ) -> list[Leg]:
        """Return the leg of a walk; none for one between two climbs that goes nowhere.

        Args:
            steps: of the search, one at least.
            yaw: heading before it [rad].
            yaw_at_end: heading at its end [rad].
            first: it begins where the robot stands.
            last: it ends at the goal.
        """
        cells = [step.cell for step in steps]
        points = [self._graph.grid.centre(cell) for cell in self._corners(cells)]
        if first:
            here = self._graph.grid.lattice.index_of(self._start.x, self._start.y)
            points[: int(here == cells[0])] = [self._start[:2]]
        if last:
            if len(points) > 1:
                points.pop()
            points.append(self._goal[:2])
        if len(points) == 1:
            return []
        costs, speed = self._graph.costs, self._graph.abilities.walk.speed
        return [walk_leg(np.array(points), yaw, yaw_at_end, costs, speed)]

    def _corners(self, cells: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
        """Return the cells between which the robot walks straight.

        Where it has room to turn on the whole way it goes straight for as long as it can, else on
        the way that was found.
        """
        kept, at = [cells[0]], 0
        while at < len(cells) - 1:
            to = at + 1
            while to < len(cells) - 1 and self._is_open(cells[at], cells[to + 1]):
                to += 1
            if to == at + 1:  # straight on as far as the way that was found is straight
                step = np.subtract(cells[to], cells[at])
                while to < len(cells) - 1 and (np.subtract(cells[to + 1], cells[to]) == step).all():
                    to += 1
            at = to
            kept.append(cells[at])
        return kept

    def _is_open(self, start: tuple[int, int], end: tuple[int, int]) -> bool:
        """Return whether the robot can turn everywhere between two cells, all seen or all not."""
        line = _line(start, end)
        known = self._graph.grid.known[line]
        alike = known.all() or not known.any()
        return bool(alike and self._all_ways[line].all())


def _way(points: Array) -> float:
    """Return the way over points [m]."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _line(start: tuple[int, int], end: tuple[int, int]) -> tuple[Indices, Indices]:
    """Return the cells along a straight line."""
    count = 2 * max(abs(b - a) for a, b in zip(start, end, strict=True)) + 1
    i, j = np.rint(np.linspace(start, end, count)).astype(np.int64).T
    return i, j
