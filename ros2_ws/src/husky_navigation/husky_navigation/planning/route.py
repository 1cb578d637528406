"""A route: legs on which the robot walks or climbs, from where it stands to its goal."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from husky_description.arrays import Array
from husky_navigation.planning.climb_lanes import Indices
from husky_navigation.planning.planning_grid import HEADINGS, Mask, PlanningGrid, heading_of
from husky_navigation.planning.route_search import (
    CLIMB,
    WALK,
    Node,
    NoRouteError,
    RouteGraph,
    Step,
)
from husky_navigation.planning.travel_costs import RADIAN

_BESIDE = 4
"""Cells to each side among which one is looked for that is free, of a robot near an obstacle."""


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


class RouteError(Exception):
    """There is no route.

    Attributes:
        refusal: why.
    """

    def __init__(self, refusal: Refusal) -> None:
        """Say why."""
        super().__init__(refusal.value)
        self.refusal = refusal


@dataclass(frozen=True)
class Leg:
    """A part of a route on which the robot moves in one way.

    Attributes:
        mode: `walk` or `climb`.
        points: of the base in `map`, from where the leg begins to where it ends [m] (n, 2).
        yaw: heading at its end [rad]; on a climb all along.
        time: that it is to take [s].
        energy: that it is to cost [J].
    """

    mode: str
    points: Array
    yaw: float
    time: float
    energy: float

    @property
    def length(self) -> float:
        """Horizontal way [m]."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())


@dataclass(frozen=True)
class Route:
    """Legs one after the other."""

    legs: tuple[Leg, ...]

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
    begin, end = _free_beside(grid, start, first), (int(heading_of(goal.yaw)), *last)
    if begin is None:
        raise RouteError(Refusal.START_OCCUPIED)
    if not grid.free[end]:
        raise RouteError(Refusal.GOAL_OCCUPIED)
    try:
        steps = graph.search(begin, end)
    except NoRouteError as error:
        raise RouteError(Refusal.NO_WAY) from error
    return _Builder(graph, start, goal).route(steps)


def _free_beside(grid: PlanningGrid, pose: PlanePose, cell: tuple[int, int]) -> Node | None:
    """Return the free node next to a pose, of its heading if one is near, None where none is."""
    own = int(heading_of(pose.yaw))
    n = grid.lattice.cells
    i, j = (range(max(0, k - _BESIDE), min(n, k + _BESIDE + 1)) for k in cell)
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
        return Leg(CLIMB, points, yaw, end.time, end.energy)

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
        return [self._leg(np.array(points), yaw, yaw_at_end)]

    def _leg(self, points: Array, yaw: float, yaw_at_end: float) -> Leg:
        """Return a leg of a walk over points, with the cost of its way and of its turns."""
        costs, speed = self._graph.costs, self._graph.abilities.walk.speed
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


def _line(start: tuple[int, int], end: tuple[int, int]) -> tuple[Indices, Indices]:
    """Return the cells along a straight line."""
    count = 2 * max(abs(b - a) for a, b in zip(start, end, strict=True)) + 1
    i, j = np.rint(np.linspace(start, end, count)).astype(np.int64).T
    return i, j
