"""Search for the cheapest way over a grid: on the ground in a graph of (heading, cell).

A robot walks ahead to the next cell, turns by 45 deg, takes a lane up or down a slope, or flies. An
edge costs its energy, and its time at a price; ground that was not seen costs more.

Of a flight there are three kinds of nodes. On the ground legs have become arms, or are about to
become legs again; in the air (layer, place) the robot goes to any neighbour of the same layer.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from husky_description.arrays import Array
from husky_navigation.planning.abilities import Abilities, ClimbAbility
from husky_navigation.planning.air_layers import STRIDE, AirLayers, FlightCosts, air_layers_of
from husky_navigation.planning.climb_lanes import Lanes, lanes_of
from husky_navigation.planning.planning_grid import (
    HEADINGS,
    Cell,
    Indices,
    Mask,
    PlanningGrid,
    heading_of,
)
from husky_navigation.planning.travel_costs import ONCE, RADIAN, TravelCosts

WALK, CLIMB, FLY = "walk", "climb", "fly"
MODES = (WALK, CLIMB, FLY)
"""Ways of moving."""
_STEPS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
"""Cells ahead of each heading."""
_CLOSED_WITHIN = 1.0
"""Distance from a closed place within which it closes ground, slopes and landings [m]."""

Node = tuple[int, int, int]
"""Heading and cell [i, j] on the ground; layer and place [i, j] in the air."""
Place = tuple[float, float]
"""x, y in `map` [m]."""
_Slices = tuple[slice, ...]


class Prices(NamedTuple):
    """Prices of what counts beside energy.

    Attributes:
        time: of a second [W].
        unseen: factor on ground that was not seen [-].
        near: factor, less 1, next to an obstacle, falling to none at `near_within` [-].
        near_within: distance from an obstacle [m].
    """

    time: float = 50.0
    unseen: float = 1.6
    near: float = 1.0
    near_within: float = 0.5


PRICES = Prices()
"""Those that a robot goes by."""


class _Edges(NamedTuple):
    """Edges of the graph, arrays (m,).

    Attributes:
        start, end: numbers of nodes.
        price: energy, and what time, doubt and nearness are taken to cost [J].
    """

    start: Indices
    end: Indices
    price: Array


class _Climbs(NamedTuple):
    """Lanes that are taken in one direction, arrays (m,).

    Attributes:
        edges: of the graph.
        lane: number of each.
        downwards: all are taken downwards.
        time: [s].
        energy: [J].
    """

    edges: _Edges
    lane: Indices
    downwards: bool
    time: Array
    energy: Array


class NoRouteError(Exception):
    """No way leads to the goal."""


class Climb(NamedTuple):
    """A lane that is taken.

    Attributes:
        lane: its number.
        downwards: whether it is taken downwards.
        time: [s].
        energy: [J].
    """

    lane: int
    downwards: bool
    time: float
    energy: float


@dataclass(frozen=True)
class Step:
    """A cell of a route, and how the robot gets there.

    Attributes:
        cell: [i, j].
        climb: that leads here, None of a walk or a flight.
        layer: of the air in which the robot is, None on the ground.
    """

    cell: Cell
    climb: Climb | None = None
    layer: int | None = None


class RouteGraph:
    """All moves that a robot can make on a grid.

    Attributes:
        grid: the ground.
        abilities: of the robot.
        costs: of its ways of moving.
        lanes: up and down its slopes; None for a robot that does not climb.
        air: over it; None for a robot that does not fly.
        flight_costs: None for a robot that does not fly.
    """

    def __init__(
        self,
        grid: PlanningGrid,
        abilities: Abilities,
        costs: TravelCosts,
        prices: Prices = PRICES,
        modes: Sequence[str] = MODES,
        closed: Sequence[Place] = (),
        air: AirLayers | None = None,
    ) -> None:
        """Price every edge.

        Args:
            grid: the ground.
            abilities: of the robot.
            costs: that were measured of it.
            prices: of what counts beside energy.
            modes: of `MODES`, those that may be used; walking always may.
            closed: places from which ground was looked for in vain [m]: around them no unseen
                ground is walked on, no slope begun that was not seen whole, no landing hoped for.
            air: over the grid, where it was made before.

        Raises:
            ValueError: no such mode.
            LookupError: the costs of a mode are not known, or not up to the steepest slope.
        """
        unknown = sorted(set(modes) - set(MODES))
        if unknown:
            raise ValueError(f"no mode {unknown[0]!r}, there are {', '.join(MODES)}")
        self.grid, self.abilities, self.costs, self._prices = grid, abilities, costs, prices
        n = grid.lattice.cells
        self._number = np.arange(HEADINGS * n * n).reshape(HEADINGS, n, n)
        self._size = self._number.size
        parts = [*self._walks(abilities, closed), *self._turns()]
        self.lanes: Lanes | None = None
        self._climbs: tuple[_Climbs, ...] = ()
        if abilities.climb is not None and CLIMB in modes:
            self.lanes = lanes_of(grid, abilities.climb)
            self._climbs = tuple(self._climbs_on(self.lanes, abilities.climb, closed))
            parts += [climbs.edges for climbs in self._climbs]
        self.air: AirLayers | None = None
        self.flight_costs: FlightCosts | None = None
        if abilities.fly is not None and FLY in modes:
            self.flight_costs = FlightCosts(costs, abilities.fly)
            self.air = air or air_layers_of(grid, abilities.fly)
            parts += self._flights(self.air, self.flight_costs, closed)
        edges = _Edges._make(np.concatenate(part) for part in zip(*parts, strict=True))
        order = np.argsort(edges.start, kind="stable")
        rows = np.searchsorted(edges.start[order], np.arange(self._size + 1))
        matrix = edges.price[order], edges.end[order], rows
        self._graph = csr_matrix(matrix, (self._size, self._size))

    # Edges on the ground --------------------------------------------------------------------------
    def _walks(self, abilities: Abilities, closed: Sequence[Place]) -> Iterator[_Edges]:
        """Yield the edges from each cell to the one ahead, for each heading."""
        grid, prices, speed = self.grid, self._prices, abilities.walk.speed
        time, energy = (float(v[0]) for v in self.costs.per_metre(WALK, speed, np.zeros(1)))
        near = np.clip(1.0 - grid.distance / prices.near_within, 0.0, 1.0)
        factor = (1.0 + prices.near * near) * np.where(grid.known, 1.0, prices.unseen)
        n, resolution = grid.lattice.cells, grid.lattice.resolution
        unseen = np.argwhere(~grid.known)
        may = np.ones((n, n), np.bool_)
        may[tuple(unseen[self._are_near(unseen, closed)].T)] = False
        for heading, step in enumerate(_STEPS):
            here, there = _neighbours(n, step)
            ok = grid.free[heading][here] & grid.free[heading][there] & may[here] & may[there]
            mean = 0.5 * (factor[here] + factor[there])[ok]
            price = resolution * math.hypot(*step) * (energy + prices.time * time) * mean
            number = self._number[heading]
            yield _Edges(number[here][ok], number[there][ok], price)

    def _turns(self) -> Iterator[_Edges]:
        """Yield the edges between neighbouring headings in each cell."""
        turn, angle = self.costs.of(WALK, RADIAN), 2.0 * math.pi / HEADINGS
        price = angle * (turn.energy + self._prices.time * turn.time)
        for heading in range(HEADINGS):
            for other in ((heading + 1) % HEADINGS, (heading - 1) % HEADINGS):
                ok: Mask = self.grid.free[heading] & self.grid.free[other]
                start, end = self._number[heading][ok], self._number[other][ok]
                yield _Edges(start, end, np.full(len(start), price))

    def _climbs_on(
        self, lanes: Lanes, climb: ClimbAbility, closed: Sequence[Place]
    ) -> Iterator[_Climbs]:
        """Yield all lanes upwards, then downwards, but for closed ones."""
        speed, steepest = climb.speed, np.array((-1.0, 1.0)) * climb.most_slope_deg
        if not np.isfinite(self.costs.per_metre(CLIMB, speed, steepest)).all():
            raise LookupError(f"no costs of a climb up to {climb.most_slope_deg:g} deg")
        resolution, sloping = self.grid.lattice.resolution, lanes.slope > 0.0
        step = np.where(sloping, resolution / np.cos(lanes.slope), 0.0)
        level = np.clip(lanes.length - resolution * sloping.sum(axis=1), 0.0, None)
        once = [self.costs.of(name, ONCE) for name in ("to_climb", "from_climb")]
        doubt = 1.0 + (self._prices.unseen - 1.0) * lanes.unseen / lanes.length
        for down in (False, True):
            slope = np.degrees(-lanes.slope if down else lanes.slope)
            per_metre = self.costs.per_metre(CLIMB, speed, slope.ravel())
            on_level = self.costs.per_metre(CLIMB, speed, np.zeros(1))
            time, energy = (
                (step * each.reshape(step.shape)).sum(axis=1) + level * flat
                for each, flat in zip(per_metre, on_level, strict=True)
            )
            time = time + sum(each.time for each in once)
            energy = energy + sum(each.energy for each in once)
            heading = heading_of(lanes.direction + math.pi * down)
            feet, tops = (self._number[heading, *cells.T] for cells in (lanes.foot, lanes.top))
            ends = (tops, feet) if down else (feet, tops)
            is_open = lanes.seen[:, int(down)] >= lanes.length
            is_open |= ~self._are_near(lanes.top if down else lanes.foot, closed)
            price = self._price(time, energy) * doubt
            edges = _Edges._make(each[is_open] for each in (*ends, price))
            lane = np.flatnonzero(is_open)
            yield _Climbs(edges, lane, down, time[is_open], energy[is_open])

    # Edges of flights -----------------------------------------------------------------------------
    def _flights(
        self, air: AirLayers, costs: FlightCosts, closed: Sequence[Place]
    ) -> Iterator[_Edges]:
        """Yield all edges from the ground into the air, there, and to the ground again."""
        self._in_air = self._new_nodes(air.free.shape)
        yield from self._take_offs(air, costs)
        yield from self._ways(air, costs)
        yield from self._landings(air, costs, closed)

    def _take_offs(self, air: AirLayers, costs: FlightCosts) -> Iterator[_Edges]:
        """Yield the edges on which legs become arms, from any heading, and those up to a layer."""
        arms = self._new_nodes(air.known.shape)
        cells = np.argwhere(air.take_off)
        places = tuple((cells // STRIDE).T)
        start = self._number[:, *cells.T].ravel()
        price = np.full(len(start), self._price(*costs.to_arms))
        yield _Edges(start, np.tile(arms[places], HEADINGS), price)
        has_arms = np.zeros_like(air.known)
        has_arms[places] = True
        up = np.nonzero(air.reach & has_arms)
        yield _Edges(arms[up[1:]], self._in_air[up], self._price(*costs.take_off(air.height[up])))

    def _ways(self, air: AirLayers, costs: FlightCosts) -> Iterator[_Edges]:
        """Yield the edges between neighbours in each layer."""
        factor = np.where(air.known, 1.0, self._prices.unseen)
        metre, resolution = self._price(*costs.way(1.0)), STRIDE * self.grid.lattice.resolution
        for step in _STEPS:
            here, there = _neighbours(len(factor), step)
            ok = air.free[:, *here] & air.free[:, *there]
            mean = np.broadcast_to(0.5 * (factor[here] + factor[there]), ok.shape)[ok]
            price = resolution * math.hypot(*step) * metre * mean
            yield _Edges(self._in_air[:, *here][ok], self._in_air[:, *there][ok], price)

    def _landings(
        self, air: AirLayers, costs: FlightCosts, closed: Sequence[Place]
    ) -> Iterator[_Edges]:
        """Yield the edges down from each layer, and those on which arms become legs again."""
        landed = self._new_nodes(air.known.shape)
        hoped = np.argwhere(air.hoped)
        hoped = hoped[~self._are_near(STRIDE * hoped, closed)]
        doubt = np.where(air.landing, 1.0, np.nan)
        doubt[tuple(hoped.T)] = self._prices.unseen
        down = np.nonzero(air.reach & np.isfinite(doubt))
        price = self._price(*costs.land(air.height[down])) * doubt[down[1:]]
        yield _Edges(self._in_air[down], landed[down[1:]], price)
        i, j = np.nonzero(np.isfinite(doubt))
        end = self._number[:, STRIDE * i, STRIDE * j].ravel()
        price = np.full(len(end), self._price(*costs.to_legs))
        yield _Edges(np.tile(landed[i, j], HEADINGS), end, price)

    def _new_nodes(self, shape: tuple[int, ...]) -> Indices:
        """Return the numbers of more nodes."""
        first = self._size
        self._size += math.prod(shape)
        return np.arange(first, self._size).reshape(shape)

    def _price(self, time: Array, energy: Array) -> Array:
        """Return the price of times [s] and energies [J]."""
        return energy + self._prices.time * time

    def _are_near(self, cells: Indices, places: Sequence[Place]) -> Mask:
        """Return which cells (n, 2) are near one of some places [m]."""
        x, y = self.grid.lattice.cell_centers()
        near = np.zeros(len(cells), np.bool_)
        for place_x, place_y in places:
            away = np.hypot(x[cells[:, 0]] - place_x, y[cells[:, 1]] - place_y)
            near |= away < _CLOSED_WITHIN
        return near

    # Search ---------------------------------------------------------------------------------------
    def search(self, start: Node, goal: Node) -> list[Step]:
        """Return the cheapest way between two nodes, both included.

        Raises:
            NoRouteError: there is none.
        """
        nodes = _cheapest(self._graph, int(self._number[start]), int(self._number[goal]))
        return list(self._steps(nodes))

    def search_from_air(self, cell: Cell, altitude: float, goal: Node) -> list[Step]:
        """Return the cheapest way to a node of a robot in the air, both ends included.

        The robot first rises or sinks to a layer.

        Args:
            cell: over which it is.
            altitude: of its base in `map` [m].
            goal: on the ground.

        Raises:
            NoRouteError: there is none.
            ValueError: the robot does not fly.
        """
        if self.air is None or self.flight_costs is None:
            raise ValueError(f"the robot is in the air, and {FLY!r} is none of its modes")
        places = self.air.places_near(cell)
        changes = (self.flight_costs.change(z - altitude) for z in self.air.altitude[places[0]])
        price = [float(self._price(*change)) for change in changes]
        graph = csr_matrix(
            (
                np.append(self._graph.data, price),
                np.append(self._graph.indices, self._in_air[places]),
                np.append(self._graph.indptr, len(self._graph.data) + len(price)),
            ),
            (self._size + 1, self._size + 1),
        )
        nodes = _cheapest(graph, self._size, int(self._number[goal]))
        return list(self._steps(nodes[1:]))

    def _steps(self, nodes: Sequence[int]) -> Iterator[Step]:
        """Yield the steps of a way over nodes, but for those between legs and arms."""
        climbs = self._climbs_among(nodes)
        for before, node in pairwise((-1, *nodes)):
            if node < self._number.size:
                _, i, j = np.unravel_index(node, self._number.shape)
                yield Step((int(i), int(j)), climbs.get((before, node)))
            elif node < self._number.size + self._in_air.size:
                layer, i, j = np.unravel_index(node - self._number.size, self._in_air.shape)
                yield Step((STRIDE * int(i), STRIDE * int(j)), layer=int(layer))

    def _climbs_among(self, nodes: Sequence[int]) -> dict[tuple[int, int], Climb]:
        """Return the lanes that begin at some nodes, by both of their ends."""
        found = {}
        for climbs in self._climbs:
            start, end, _ = climbs.edges
            for k in np.flatnonzero(np.isin(start, nodes)):
                own = int(climbs.lane[k]), climbs.downwards, climbs.time[k], climbs.energy[k]
                found[int(start[k]), int(end[k])] = Climb(*own)
        return found


def _cheapest(graph: csr_matrix, start: int, goal: int) -> list[int]:
    """Return the numbers of the nodes on the cheapest way, both ends included.

    Raises:
        NoRouteError: there is none.
    """
    _, before = dijkstra(graph, indices=start, return_predecessors=True)
    if goal != start and before[goal] < 0:
        raise NoRouteError
    nodes = [goal]
    while nodes[-1] != start:
        nodes.append(int(before[nodes[-1]]))
    return nodes[::-1]


def _neighbours(cells: int, step: tuple[int, int]) -> tuple[_Slices, _Slices]:
    """Return the cells that have a neighbour one step further, and these neighbours."""
    here, there = (
        tuple(slice(max(0, sign * d), cells + min(0, sign * d)) for d in step) for sign in (-1, 1)
    )
    return here, there
