"""Routes along a path that somebody else has planned: walked, but for slopes and gaps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_navigation.planning.planning_grid import Mask, PlanningGrid, heading_of
from husky_navigation.planning.route import (
    Leg,
    PlanePose,
    Refusal,
    Route,
    RouteError,
    course_over,
    way_to_each,
)
from husky_navigation.planning.route_planner import Limits, RoutePlanner

_JOINS_WITHIN = 0.5
"""Greatest distance from the path at which a robot joins it [m]."""
_STRAYS = 0.5
"""Greatest distance from the path of a route that climbs or flies where the path is blocked [m]."""
_ROOM = 0.8
"""Way before and behind a slope or gap on which a route may leave the path [m]."""
_JUST_OFF = 2.0
"""Way that is planned of a robot in the air, so that it does not land just before a gap [m]."""
_LONGEST = 200.0
"""Longest path [m]."""
_STEP = 0.1
"""Between two points at which the path is looked at [m]."""


class GivenPath:
    """A path, and how far the robot has come along it."""

    def __init__(self, poses: Sequence[PlanePose], planner: RoutePlanner) -> None:
        """Begin at its first pose.

        Args:
            poses: in two places or more.
            planner: knows the ground.

        Raises:
            ValueError: there are fewer, or it is too long.
        """
        points = np.array([pose[:2] for pose in poses]).reshape(-1, 2)
        along = way_to_each(points)
        if along.size == 0 or along[-1] == 0.0:
            raise ValueError(f"the path has {min(1, along.size)} places, it must have 2 or more")
        if along[-1] > _LONGEST:
            raise ValueError(f"the path is {along[-1]:.0f} m long, it may be {_LONGEST:g} m long")
        new = np.concatenate(([True], np.diff(along) > 0.0))
        steps = np.linspace(0.0, along[-1], 1 + math.ceil(along[-1] / _STEP))
        self._points = np.column_stack(
            [np.interp(steps, along[new], points[new, axis]) for axis in (0, 1)]
        )
        self._planner, self._goal = planner, poses[-1]
        self._passed = 0

    @property
    def goal(self) -> PlanePose:
        """The last pose."""
        return self._goal

    def route(self, start: PlanePose, limits: Limits, altitude: float | None = None) -> Route:
        """Return the route from a pose to the path, and along what is left of it.

        Args:
            start: pose of the robot.
            limits: of the route.
            altitude: as of `find_route`.

        Raises:
            RouteError: the robot is too far from it, or it leads where no route can follow.
            ValueError: as of `find_route`.
        """
        self._passed = self._next(start)
        way = np.concatenate(([start[:2]], self._points[self._passed :]))
        legs, yaw = list[Leg](), start.yaw
        for begin, end, walkable in self._pieces(way, in_air=altitude is not None):
            piece = way[begin : end + 1]
            last = end == len(way) - 1
            to = self._goal.yaw if last else course_over(way[[end - 1, end]])
            if walkable:
                found = [self._planner.walk(piece, yaw, to)]
            else:
                poses = _pose(way[begin], yaw), _pose(way[end], to)
                found = self._cross(*poses, limits, altitude if begin == 0 else None)
                _check_near(found, piece)
            legs += found
            yaw = to
        route = Route(tuple(legs))
        if route.energy > limits.energy:
            raise RouteError(Refusal.BATTERY)
        return route

    def _next(self, start: PlanePose) -> int:
        """Return the first point left that is near a pose, and nearer than the one behind it."""
        left = self._points[self._passed :]
        away = np.hypot(left[:, 0] - start.x, left[:, 1] - start.y)
        here = np.flatnonzero((away <= _JOINS_WITHIN) & (away <= np.append(away[1:], math.inf)))
        if here.size == 0:
            raise RouteError(Refusal.OFF_PATH)
        return self._passed + int(here[0])

    def _cross(
        self, start: PlanePose, goal: PlanePose, limits: Limits, altitude: float | None
    ) -> list[Leg]:
        """Return the legs of a planned route between two places of the path."""
        try:
            route = self._planner.plan(start, goal, limits, altitude)
        except RouteError as error:
            raise RouteError(Refusal.PATH_BLOCKED) from error
        if not route.is_whole:
            raise RouteError(Refusal.PATH_BLOCKED)
        return list(route.legs)

    def _pieces(self, way: Array, *, in_air: bool) -> list[tuple[int, int, bool]]:
        """Return parts of a way by first and last point, and whether each can be walked.

        The first one of a robot in the air is planned.
        """
        blocked = _blocked(self._planner.grid(), way)
        along = way_to_each(way)
        near = np.abs(along[:, None] - along[None, blocked]).min(axis=1, initial=math.inf) < _ROOM
        # A step is planned where both of its ends are near a slope.
        planned = near[:-1] & near[1:]
        if in_air:
            planned |= along[:-1] < _JUST_OFF
        changes = np.flatnonzero(np.diff(planned)) + 1
        ends = [0, *changes.tolist(), len(planned)]
        return [(begin, end, not planned[begin]) for begin, end in pairwise(ends)]


def _blocked(grid: PlanningGrid, way: Array) -> Mask:
    """Return at which points of a way the robot does not fit, or cannot walk."""
    course = np.arctan2(*np.diff(way, axis=0)[:, ::-1].T)
    heading: NDArray[np.int64] = heading_of(np.concatenate((course[:1], course)))
    blocked = np.zeros(len(way), np.bool_)
    for number, ((x, y), way_ahead) in enumerate(zip(way, heading, strict=True)):
        cell = grid.lattice.index_of(x, y)
        blocked[number] = cell is None or not grid.free[way_ahead, *cell]
    blocked[0] = False  # the robot stands there
    return blocked


def _check_near(legs: Sequence[Leg], piece: Array) -> None:
    """Raise RouteError if legs stray from a piece of the path."""
    for x, y in np.concatenate([leg.points for leg in legs]):
        if np.hypot(piece[:, 0] - x, piece[:, 1] - y).min() > _STRAYS:
            raise RouteError(Refusal.PATH_BLOCKED)


def _pose(place: Array, yaw: float) -> PlanePose:
    return PlanePose(float(place[0]), float(place[1]), yaw)
