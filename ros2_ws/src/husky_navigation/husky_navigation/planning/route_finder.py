"""The cheapest route from where a robot is to its goal, made of the steps of a search."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from husky_description.arrays import Array
from husky_navigation.planning.air_layers import AirLayers
from husky_navigation.planning.planning_grid import (
    HEADINGS,
    Cell,
    PlanningGrid,
    cells_between,
    heading_of,
)
from husky_navigation.planning.route import (
    Leg,
    PlanePose,
    Refusal,
    Route,
    RouteError,
    course_over,
    walk_leg,
    way_over,
)
from husky_navigation.planning.route_search import (
    CLIMB,
    FLY,
    Climb,
    Node,
    NoRouteError,
    RouteGraph,
    Step,
)
from husky_navigation.planning.route_start import free_beside, way_ahead, way_along_lane

_SLOPE = 0.15
"""Rise over way of ground from which on a robot climbs when its route begins, even if it can walk
off it [-].
"""
_NEAR_GOAL = 0.5
"""Distance within which an obstacle takes a goal, half the diagonal of the footprint [m]."""
_BESIDE_GOAL = 8
"""Cells to each side of a goal near unseen ground among which a free one is looked for."""
_FACES = 0.3
"""Angle to the way of a flight from which on the robot turns before it, on its legs [rad]."""
_HOLES = 0.1
"""Share of unseen ground by which a straight flight may exceed the way that was found [-]."""
_FLIES_AHEAD = 0.3
"""Way from which on a flight ends in its direction; in the air a turn costs much [m]."""


def find_route(
    graph: RouteGraph, start: PlanePose, goal: PlanePose, altitude: float | None = None
) -> Route:
    """Return the cheapest route; its first point and its last are start and goal themselves.

    Where only ground that was not seen speaks against the goal, the route ends beside it.

    Args:
        graph: the moves of the robot.
        start: pose of the robot.
        goal: where it can walk.
        altitude: of the base in `map`, of a robot in the air [m]; None for one on the ground.

    Raises:
        RouteError: there is none; says why.
        ValueError: a pose is not finite, or the robot is in the air and has no mode to fly.
    """
    _check_finite(start, goal, altitude)
    lattice = graph.grid.lattice
    first = lattice.index_of(start.x, start.y)
    last = lattice.index_of(goal.x, goal.y)
    if first is None:
        raise RouteError(Refusal.START_OUTSIDE)
    if last is None:
        raise RouteError(Refusal.GOAL_OUTSIDE)
    begin, off = _begin(graph, start, first) if altitude is None else (None, None)
    end = (int(heading_of(goal.yaw)), *last)
    is_whole = bool(graph.grid.free[end])
    if not is_whole:
        end, goal = _beside_goal(graph.grid, goal, last)
    if off is not None:
        x, y = off.points[-1]
        try:
            after = find_route(graph, PlanePose(float(x), float(y), off.yaw), goal)
        except RouteError as error:
            raise RouteError(error.refusal, Route((off,))) from error
        return Route((off, *after.legs), is_whole)
    try:
        if altitude is None:
            assert begin is not None
            steps = graph.search(begin, end)
        else:
            steps = graph.search_from_air(first, altitude, end)
    except NoRouteError as error:
        raise RouteError(Refusal.NO_WAY) from error
    builder = _Builder(graph, start, goal, math.nan if altitude is None else altitude)
    return replace(builder.route(steps), is_whole=is_whole)


def _begin(graph: RouteGraph, start: PlanePose, cell: Cell) -> tuple[Node | None, Leg | None]:
    """Return the node from which a robot on the ground, in a cell, can walk, and the way off a
    slope before that; either may be None, but raises RouteError for neither.
    """
    grid = graph.grid
    begin = free_beside(grid, cell, start.yaw)
    fits = bool(grid.free[int(heading_of(start.yaw)), *cell])
    is_climbing = begin is None or grid.slope[cell] > _SLOPE or not fits
    off = _off_slope(graph, start, cell, stranded=begin is None) if is_climbing else None
    if off is None and begin is None:
        raise RouteError(Refusal.START_OCCUPIED)
    return begin, off


def _check_finite(start: PlanePose, goal: PlanePose, altitude: float | None) -> None:
    """Raise ValueError for what is not finite."""
    for name, pose in (("start", start), ("goal", goal)):
        if not all(math.isfinite(value) for value in pose):
            raise ValueError(f"{name} is {pose}, it must be finite")
    if altitude is not None and not math.isfinite(altitude):
        raise ValueError(f"altitude is {altitude}, it must be finite")


def _beside_goal(grid: PlanningGrid, goal: PlanePose, cell: Cell) -> tuple[Node, PlanePose]:
    """Return the free node and its pose beside a goal near which only unseen ground is none to walk
    on; raises RouteError if an obstacle was seen there.
    """
    taken = grid.is_taken(goal.x, goal.y, _NEAR_GOAL)
    beside = None if taken else free_beside(grid, cell, goal.yaw, _BESIDE_GOAL)
    if beside is None:
        raise RouteError(Refusal.GOAL_OCCUPIED)
    heading, i, j = beside
    yaw = math.remainder(heading * 2.0 * math.pi / HEADINGS, 2.0 * math.pi)
    return beside, PlanePose(*grid.centre((i, j)), yaw)


def _off_slope(graph: RouteGraph, start: PlanePose, cell: Cell, *, stranded: bool) -> Leg | None:
    """Return the way off the slope on which a robot stands, None for none.

    Args:
        graph: the moves of the robot.
        start: its pose.
        cell: of that.
        stranded: it cannot walk anywhere.
    """
    grid, lanes, climb = graph.grid, graph.lanes, graph.abilities.climb
    if lanes is None or climb is None:
        return None
    way = way_along_lane(grid, lanes, start)
    if way is None and stranded:
        way = way_ahead(grid, climb, start, cell)
    if way is None:
        return None
    points = np.array((start[:2], way.end))
    time, energy = (
        way_over(points) / math.cos(way.slope) * float(each[0])
        for each in graph.costs.per_metre(CLIMB, climb.speed, np.degrees([way.slope]))
    )
    return Leg(CLIMB, points, way.yaw, time, energy, downwards=way.slope < 0.0)


class _Builder:
    """Makes the legs of a route from the steps of a search."""

    def __init__(
        self, graph: RouteGraph, start: PlanePose, goal: PlanePose, altitude: float
    ) -> None:
        """Take the ends of the route, and the altitude of a robot in the air [m]."""
        self._graph, self._start, self._goal, self._altitude = graph, start, goal, altitude
        here = graph.grid.lattice.index_of(start.x, start.y)
        assert here is not None
        self._here = here
        self._turns = graph.grid.free_all_ways

    def route(self, steps: Sequence[Step]) -> Route:
        """Return the route: walks with their corners alone, climbs and flights from end to end."""
        legs, begin, yaw = list[Leg](), 0, self._start.yaw
        for index, step in enumerate(steps):
            if index < begin or (step.climb is None and step.layer is None):
                continue
            walked, end = steps[begin:index], index
            if step.climb is not None:
                leg = self._climb(walked[-1], step, step.climb)
                to = leg.yaw
            else:
                end = next(k for k in range(index, len(steps)) if steps[k].layer is None)
                leg = self._fly(steps[:end], index)
                to = course_over(leg.points[:2])
            if walked:
                legs += self._walk(walked, yaw, to, first=begin == 0) or self._turn(leg, yaw, to)
            legs.append(leg)
            begin, yaw = end, leg.yaw
        walk = self._walk(steps[begin:], yaw, self._goal.yaw, first=begin == 0, last=True)
        return Route((*legs, *walk))

    def _climb(self, start: Step, end: Step, climb: Climb) -> Leg:
        """Return the leg of a lane."""
        lanes, ability = self._graph.lanes, self._graph.abilities.climb
        assert lanes is not None and ability is not None
        lane, down, time, energy = climb
        points = np.array([self._graph.grid.centre(each.cell) for each in (start, end)])
        yaw = math.remainder(float(lanes.direction[lane]) + math.pi * down, 2.0 * math.pi)
        is_seen = bool(lanes.seen[lane, int(down)] >= lanes.least_seen(ability)[lane])
        return Leg(CLIMB, points, yaw, time, energy, is_seen, down)

    def _fly(self, steps: Sequence[Step], begin: int) -> Leg:
        """Return the leg of a flight.

        Args:
            steps: of the search, up to the last in the air.
            begin: the first in the air; 0 for a robot that is there already.
        """
        air, costs, layer = self._graph.air, self._graph.flight_costs, steps[-1].layer
        assert air is not None and costs is not None and layer is not None
        points = self._flight_points(air, layer, steps, begin)
        altitude = float(air.altitude[layer])
        up, down = ((layer, *air.place(step.cell)) for step in (steps[begin], steps[-1]))
        begins = [costs.to_arms, costs.take_off(air.height[up])]
        if begin == 0:
            begins = [costs.change(altitude - self._altitude)]
        parts = *begins, costs.way(way_over(points)), costs.land(air.height[down]), costs.to_legs
        time, energy = (float(sum(part)) for part in zip(*parts, strict=True))
        yaw = course_over(points[-2:]) if way_over(points) > _FLIES_AHEAD else self._start.yaw
        is_seen, ground = bool(air.landing[down[1:]]), float(air.ground[down[1:]])
        return Leg(FLY, points, yaw, time, energy, is_seen, altitude=altitude, ground=ground)

    def _flight_points(
        self, air: AirLayers, layer: int, steps: Sequence[Step], begin: int
    ) -> Array:
        """Return the corners of a flight with both of its ends [m] (n, 2); see `_fly`."""
        before, known = steps[begin - 1].cell if begin else self._here, self._graph.grid.known
        cells = [before, *(step.cell for step in steps[begin:])]
        if len(cells) > 2 and cells[1] == before:
            del cells[1]

        def is_open(at: int, to: int) -> bool:
            line = cells_between(cells[at], cells[to])
            found = float(np.mean([known[cell] for cell in cells[at : to + 1]]))
            return air.is_open(layer, line) and bool(known[line].mean() > found - _HOLES)

        points = np.array([self._graph.grid.centre(cell) for cell in _corners(cells, is_open)])
        if before == self._here:
            points[0] = self._start[:2]
        return points

    def _turn(self, flight: Leg, yaw: float, to: float) -> list[Leg]:
        """Return a turn on the spot before a flight, if it leads elsewhere than ahead."""
        if flight.mode != FLY or abs(math.remainder(to - yaw, 2.0 * math.pi)) < _FACES:
            return []
        costs, speed = self._graph.costs, self._graph.abilities.walk.speed
        return [walk_leg(flight.points[[0, 0]], yaw, to, costs, speed)]

    def _walk(
        self,
        steps: Sequence[Step],
        yaw: float,
        yaw_at_end: float,
        *,
        first: bool = False,
        last: bool = False,
    ) -> list[Leg]:
        """Return the leg of a walk; none for one that goes nowhere and does not end at the goal.

        Args:
            steps: of the search, one at least.
            yaw: heading before it [rad].
            yaw_at_end: heading at its end [rad].
            first: it begins where the robot stands.
            last: it ends at the goal.
        """
        cells = [step.cell for step in steps]
        corners = _corners(cells, lambda at, to: self._walks_straight(cells[at], cells[to]))
        points = [self._graph.grid.centre(cell) for cell in corners]
        if first:
            points[: int(self._here == cells[0])] = [self._start[:2]]
        if last:
            if len(points) > 1:
                points.pop()
            points.append(self._goal[:2])
        if len(points) == 1:
            return []
        costs, speed = self._graph.costs, self._graph.abilities.walk.speed
        return [walk_leg(np.array(points), yaw, yaw_at_end, costs, speed)]

    def _walks_straight(self, start: Cell, end: Cell) -> bool:
        """Return whether the robot can turn everywhere between two cells, all seen or all not."""
        line = cells_between(start, end)
        known = self._graph.grid.known[line]
        alike = known.all() or not known.any()
        return bool(alike and self._turns[line].all())


def _corners(cells: Sequence[Cell], is_open: Callable[[int, int], bool]) -> list[Cell]:
    """Return the cells between which the robot goes straight.

    Where its way is open it goes straight for as long as it can, else on the way that was found.

    Args:
        cells: of the way that was found.
        is_open: whether it may go straight from one of them to another, by their indices.
    """
    kept, at = [cells[0]], 0
    while at < len(cells) - 1:
        to = at + 1
        while to < len(cells) - 1 and is_open(at, to + 1):
            to += 1
        if to == at + 1:  # straight on as far as the way that was found is straight
            step = np.subtract(cells[to], cells[at])
            while to < len(cells) - 1 and (np.subtract(cells[to + 1], cells[to]) == step).all():
                to += 1
        at = to
        kept.append(cells[at])
    return kept
