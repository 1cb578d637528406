"""A planner that keeps what was seen of the ground, and plans on it."""

from __future__ import annotations

import math
import threading
from typing import NamedTuple

from husky_description.arrays import Array
from husky_navigation.frame_filter import LevelTransform
from husky_navigation.planning.abilities import ABILITIES
from husky_navigation.planning.air_layers import AirLayers, air_layers_of
from husky_navigation.planning.planning_grid import PlanningGrid, grid_of
from husky_navigation.planning.route import Leg, PlanePose, Refusal, Route, RouteError, walk_leg
from husky_navigation.planning.route_finder import find_route
from husky_navigation.planning.route_search import MODES, PRICES, Prices, RouteGraph
from husky_navigation.planning.travel_costs import TravelCosts
from husky_navigation.planning.world_map import MapHeights, WorldMap


class Limits(NamedTuple):
    """Limits of a route.

    Attributes:
        modes: ways of moving that it may have, of `MODES`.
        energy: that it may cost [J].
        closed: places that were looked at, and not seen, as of `RouteGraph` [m].
    """

    modes: tuple[str, ...] = MODES
    energy: float = math.inf
    closed: tuple[tuple[float, float], ...] = ()


NO_LIMITS = Limits()
"""All ways of moving, any energy."""
_ENERGY_ALONE = Prices(time=0.0, unseen=1.0, near=0.0)
"""Prices at which the cheapest route is the one of least energy."""


class RoutePlanner:
    """Finds routes of one robot; several threads may use it.

    Grid and moves are made anew when they are asked for after the map has changed.

    Attributes:
        world: the map of all ground that was seen.
    """

    def __init__(self, robot: str) -> None:
        """Know nothing of the ground.

        Args:
            robot: whose abilities and measured costs count, `carbon` or `beta`.

        Raises:
            ValueError: no such robot.
        """
        if robot not in ABILITIES:
            raise ValueError(f"robot is {robot!r}, it must be one of {', '.join(ABILITIES)}")
        self.world = WorldMap()
        self._abilities, self._costs = ABILITIES[robot], TravelCosts.load(robot)
        self._lock = threading.RLock()
        self._grid: PlanningGrid | None = None
        self._air: AirLayers | None = None
        self._moves: dict[tuple[Limits, Prices], RouteGraph] = {}

    def merge(self, heights: MapHeights, frame: LevelTransform, oldest: float = math.inf) -> None:
        """Take over what an elevation map shows, as `WorldMap.merge` does."""
        with self._lock:
            self.world.merge(heights, frame, oldest)
            self._forget()

    def clear(self) -> None:
        """Forget the ground."""
        with self._lock:
            self.world.clear()
            self._forget()

    def grid(self) -> PlanningGrid:
        """Return the ground as the planner sees it."""
        with self._lock:
            if self._grid is None:
                self._grid = grid_of(self.world, self._abilities)
            return self._grid

    def air(self) -> AirLayers | None:
        """Return the air over the ground, None for a robot that does not fly."""
        with self._lock:
            if self._air is None and self._abilities.fly is not None:
                self._air = air_layers_of(self.grid(), self._abilities.fly)
            return self._air

    def plan(
        self,
        start: PlanePose,
        goal: PlanePose,
        limits: Limits = NO_LIMITS,
        altitude: float | None = None,
    ) -> Route:
        """Return the cheapest route; if the energy does not last for that, the one of least energy.

        Args:
            start: pose of the robot.
            goal: where it can walk.
            limits: of the route.
            altitude: as of `find_route`.

        Raises:
            RouteError: there is none; says why.
            ValueError: as of `find_route`, or there is no such mode.
        """
        route = find_route(self._moves_at(limits, PRICES), start, goal, altitude)
        if route.energy > limits.energy:
            thrifty = self._moves_at(limits, _ENERGY_ALONE)
            route = find_route(thrifty, start, goal, altitude)
        if route.energy > limits.energy:
            raise RouteError(Refusal.BATTERY)
        return route

    def walk(self, points: Array, yaw: float, yaw_at_end: float) -> Leg:
        """Return a walk over points, as `walk_leg` does."""
        return walk_leg(points, yaw, yaw_at_end, self._costs, self._abilities.walk.speed)

    def _moves_at(self, limits: Limits, prices: Prices) -> RouteGraph:
        """Return all moves within limits other than that of energy, at some prices."""
        key = limits._replace(energy=math.inf), prices
        with self._lock:
            moves = self._moves.get(key)
            if moves is None:
                ground, modes, closed = self.grid(), limits.modes, limits.closed
                moves = RouteGraph(
                    ground, self._abilities, self._costs, prices, modes, closed, self.air()
                )
                self._moves[key] = moves
            return moves

    def _forget(self) -> None:
        """Forget what was made of the map."""
        self._grid = self._air = None
        self._moves.clear()
