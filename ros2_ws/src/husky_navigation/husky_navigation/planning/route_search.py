"""Search for the cheapest way over a grid, in a graph of (heading, cell).

A robot walks ahead to the next cell, turns by 45 deg, or takes a lane up or down a slope. An edge
costs its energy, and its time at a price; ground that was not seen costs more.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from husky_description.arrays import Array
from husky_navigation.planning.abilities import Abilities, ClimbAbility
from husky_navigation.planning.climb_lanes import Lanes, lanes_of
from husky_navigation.planning.planning_grid import HEADINGS, Mask, PlanningGrid, heading_of
from husky_navigation.planning.travel_costs import ONCE, RADIAN, TravelCosts

WALK, CLIMB = "walk", "climb"
MODES = (WALK, CLIMB)
"""Ways of moving."""
_STEPS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
"""Cells ahead of each heading."""
_NO_LANE = -1
_CLOSED_WITHIN = 1.0
"""Distance from a closed place within which it closes ground and slopes [m]."""

Node = tuple[int, int, int]
"""Heading and cell [i, j]."""


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


class Cost(NamedTuple):
    """Cost of edges, arrays (m,).

    Attributes:
        time: [s].
        energy: [J].
        price: energy, and what time, doubt and nearness are taken to cost [J].
    """

    time: Array
    energy: Array
    price: Array


class _Edges(NamedTuple):
    """Edges of the graph, arrays (m,).

    Attributes:
        start, end: numbers of nodes.
        time, energy, price: as in `Cost`.
        lane: 2 k of lane k upwards, 2 k + 1 downwards, `_NO_LANE` of a walk.
    """

    start: NDArray[np.int64]
    end: NDArray[np.int64]
    time: Array
    energy: Array
    price: Array
    lane: NDArray[np.int64]


class NoRouteError(Exception):
    """No way leads to the goal."""


@dataclass(frozen=True)
class Step:
    """A cell of a route, and the move that leads there.

    Attributes:
        cell: [i, j].
        lane: that leads here, None of a walk.
        downwards: that lane is taken downwards.
        time: of the move [s].
        energy: of the move [J].
    """

    cell: tuple[int, int]
    lane: int | None
    downwards: bool
    time: float
    energy: float


class RouteGraph:
    """All moves that a robot can make on a grid.

    Attributes:
        grid: the ground.
        abilities: of the robot.
        costs: of its ways of moving.
        lanes: up and down its slopes.
    """

    def __init__(
        self,
        grid: PlanningGrid,
        abilities: Abilities,
        costs: TravelCosts,
        prices: Prices = PRICES,
        modes: Sequence[str] = MODES,
        closed: Sequence[tuple[float, float]] = (),
    ) -> None:
        """Price every edge.

        Args:
            grid: the ground.
            abilities: of the robot.
            costs: that were measured of it.
            prices: of what counts beside energy.
            modes: of `MODES`, those that may be used; walking always may.
            closed: places that were looked at, and not seen: ground around them that was not seen,
                and slopes that begin there and were not seen whole, are not gone on [m].

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
        parts = [*self._walks(abilities, closed), *self._turns()]
        self.lanes: Lanes | None = None
        if abilities.climb is not None and CLIMB in modes:
            self.lanes = lanes_of(grid, abilities.climb)
            parts += self._climbs(self.lanes, abilities.climb, closed)
        edges = _Edges._make(np.concatenate(part) for part in zip(*parts, strict=True))
        order = np.argsort(edges.start, kind="stable")
        self._edges = _Edges._make(each[order] for each in edges)
        size = self._number.size
        self._rows = np.searchsorted(self._edges.start, np.arange(size + 1))
        matrix = self._edges.price, self._edges.end, self._rows
        self._graph = csr_matrix(matrix, (size, size))

    # Edges ----------------------------------------------------------------------------------------
    def _walks(
        self, abilities: Abilities, closed: Sequence[tuple[float, float]]
    ) -> Iterator[_Edges]:
        """Yield the edges from each cell to the one ahead, for each heading."""
        grid, prices, speed = self.grid, self._prices, abilities.walk.speed
        time, energy = (float(v[0]) for v in self.costs.per_metre(WALK, speed, np.zeros(1)))
        near = np.clip(1.0 - grid.distance / prices.near_within, 0.0, 1.0)
        factor = (1.0 + prices.near * near) * np.where(grid.known, 1.0, prices.unseen)
        n, resolution = grid.lattice.cells, grid.lattice.resolution
        unseen = np.argwhere(~grid.known)
        may = np.ones((n, n), np.bool_)
        may[tuple(unseen[self._are_near(unseen, closed)].T)] = False
        for heading, (di, dj) in enumerate(_STEPS):
            here, there = (_shifted(n, -di), _shifted(n, -dj)), (_shifted(n, di), _shifted(n, dj))
            ok = grid.free[heading][here] & grid.free[heading][there] & may[here] & may[there]
            way = resolution * math.hypot(di, dj)
            mean = 0.5 * (factor[here] + factor[there])[ok]
            price = way * (energy + prices.time * time) * mean
            cost = Cost(np.full_like(price, way * time), np.full_like(price, way * energy), price)
            number = self._number[heading]
            yield _edges(number[here][ok], number[there][ok], cost)

    def _turns(self) -> Iterator[_Edges]:
        """Yield the edges between neighbouring headings in each cell."""
        turn, angle = self.costs.of(WALK, RADIAN), 2.0 * math.pi / HEADINGS
        time, energy = angle * turn.time, angle * turn.energy
        for heading in range(HEADINGS):
            for other in ((heading + 1) % HEADINGS, (heading - 1) % HEADINGS):
                ok: Mask = self.grid.free[heading] & self.grid.free[other]
                each = np.ones(int(ok.sum()))
                cost = Cost(time * each, energy * each, (energy + self._prices.time * time) * each)
                yield _edges(self._number[heading][ok], self._number[other][ok], cost)

    def _climbs(
        self, lanes: Lanes, climb: ClimbAbility, closed: Sequence[tuple[float, float]]
    ) -> Iterator[_Edges]:
        """Yield all lanes upwards, then downwards, but for closed ones."""
        speed, steepest = climb.speed, np.array((-1.0, 1.0)) * climb.most_slope_deg
        if not np.isfinite(self.costs.per_metre(CLIMB, speed, steepest)).all():
            raise LookupError(f"no costs of a climb up to {climb.most_slope_deg:g} deg")
        resolution, sloping = self.grid.lattice.resolution, lanes.slope > 0.0
        step = np.where(sloping, resolution / np.cos(lanes.slope), 0.0)
        level = np.clip(lanes.length - resolution * sloping.sum(axis=1), 0.0, None)
        once = [self.costs.of(name, ONCE) for name in ("to_climb", "from_climb")]
        doubt = 1.0 + (self._prices.unseen - 1.0) * lanes.unseen / lanes.length
        for downwards in (False, True):
            slope = np.degrees(-lanes.slope if downwards else lanes.slope)
            per_metre = self.costs.per_metre(CLIMB, speed, slope.ravel())
            on_level = self.costs.per_metre(CLIMB, speed, np.zeros(1))
            time, energy = (
                (step * each.reshape(step.shape)).sum(axis=1) + level * flat
                for each, flat in zip(per_metre, on_level, strict=True)
            )
            time = time + sum(each.time for each in once)
            energy = energy + sum(each.energy for each in once)
            cost = Cost(time, energy, (energy + self._prices.time * time) * doubt)
            heading = heading_of(lanes.direction + math.pi * downwards)
            feet, tops = (self._number[heading, *cells.T] for cells in (lanes.foot, lanes.top))
            ends = (tops, feet) if downwards else (feet, tops)
            lane = 2 * np.arange(len(level)) + downwards
            is_open = lanes.seen[:, int(downwards)] >= lanes.length
            is_open |= ~self._are_near(lanes.top if downwards else lanes.foot, closed)
            yield _Edges._make(each[is_open] for each in (*ends, *cost, lane))

    def _are_near(self, cells: NDArray[np.int64], places: Sequence[tuple[float, float]]) -> Mask:
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
        first, last = int(self._number[start]), int(self._number[goal])
        _, before = dijkstra(self._graph, indices=first, return_predecessors=True)
        if last != first and before[last] < 0:
            raise NoRouteError
        nodes = [last]
        while nodes[-1] != first:
            nodes.append(int(before[nodes[-1]]))
        return list(self._steps(nodes[::-1]))

    def _steps(self, nodes: Sequence[int]) -> Iterator[Step]:
        """Yield the steps of a way over nodes."""
        yield Step(self._cell(nodes[0]), None, False, 0.0, 0.0)
        for before, node in pairwise(nodes):
            edge = self._cheapest(before, node)
            time, energy = float(self._edges.time[edge]), float(self._edges.energy[edge])
            lane = int(self._edges.lane[edge])
            taken, downwards = (None, False) if lane == _NO_LANE else (lane // 2, lane % 2 == 1)
            yield Step(self._cell(node), taken, downwards, time, energy)

    def _cell(self, node: int) -> tuple[int, int]:
        """Return the cell [i, j] of a node."""
        _, i, j = np.unravel_index(node, self._number.shape)
        return int(i), int(j)

    def _cheapest(self, start: int, end: int) -> int:
        """Return the cheapest edge from one node to another."""
        edges = np.arange(self._rows[start], self._rows[start + 1])
        edges = edges[self._edges.end[edges] == end]
        return int(edges[np.argmin(self._edges.price[edges])])


def _edges(start: NDArray[np.int64], end: NDArray[np.int64], cost: Cost) -> _Edges:
    """Return edges that are no lanes."""
    return _Edges(start, end, *cost, np.full(len(start), _NO_LANE))


def _shifted(cells: int, step: int) -> slice:
    """Return the cells along an axis that have another one `step` before them."""
    return slice(max(0, step), cells + min(0, step))
