"""Heights at which a robot may fly over a grid, where it may take off and land, and what it costs.

A layer is one height of the base in `map`: over a step the robot flies as high as before it. Ground
that was not seen is taken for low in the air, and hoped to be level where it lands. But the camera
looks down, and sees no top that is higher than itself: an obstacle of which the face alone was seen
is taken for as high as the robot may fly over.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from husky_description.arrays import Array
from husky_navigation.planning.abilities import FlyAbility
from husky_navigation.planning.planning_grid import Cell, Indices, Mask, PlanningGrid
from husky_navigation.planning.travel_costs import ONCE, SECOND, TravelCosts

STRIDE = 2
"""Planning cells from one place in the air to the next."""
_HOLE = 3
"""Planning cells along an edge of the smallest patch that counts as not seen: the map has holes."""
_FACE, _LEAST_FACE = 2, 0.2
"""Planning cells to each side of a face among which the ground before it is, and its least height
[m].
"""
_BEHIND = 1.5
"""Planning cells behind a face within which unseen ground hides how far up it goes."""
_BESIDE = 2
"""Places to each side among which a free one is looked for, of a robot in the air."""


class AirLayers(NamedTuple):
    """Air over places [i, j], each over the planning cell [STRIDE i, STRIDE j].

    Attributes:
        altitude: of the base in `map`, of each layer [m] (k,).
        free: the robot may be there (k, m, m).
        height: its altitude less `ground` [m] (k, m, m).
        reach: from the ground below the robot may rise to there, and sink back (k, m, m).
        lowest: altitude from which on the base is clear of the ground around, over each planning
            cell; -inf where nothing was seen [m] (n, n).
        known: ground was seen below (m, m).
        ground: height of the nearest cell from which it may take off, itself included [m] (m, m).
        take_off: the robot may take off from each planning cell (n, n).
        landing: it may land, on level ground that was seen (m, m).
        hoped: it may if the ground that was not seen is level (m, m).
    """

    altitude: Array
    free: Mask
    height: Array
    reach: Mask
    lowest: Array
    known: Mask
    ground: Array
    take_off: Mask
    landing: Mask
    hoped: Mask

    def place(self, cell: Cell) -> Cell:
        """Return the place over a planning cell, or over the one before it."""
        i, j = cell
        return i // STRIDE, j // STRIDE

    def is_open(self, layer: int, cells: tuple[Indices, Indices]) -> bool:
        """Return whether the robot may fly over planning cells."""
        return bool((self.lowest[cells] <= self.altitude[layer]).all())

    def places_near(self, cell: Cell) -> tuple[Indices, Indices, Indices]:
        """Return the free place [k, i, j] next to a planning cell, in each layer in which it is
        free; none where none is near.

        A layer that is free only further away is left out: a robot that sank to it first, and went
        on then, might hit what is beside it.
        """
        i, j = self.place(cell)
        free = np.argwhere(self.free.any(axis=0))
        beside = free[(np.abs(free - (i, j)) <= _BESIDE).all(axis=1)]
        nearest = beside[np.argsort(np.hypot(*(beside - (i, j)).T))[:1]]
        layers, place = np.nonzero(self.free[:, *nearest.T])
        return layers, *nearest[place].T


def air_layers_of(grid: PlanningGrid, fly: FlyAbility) -> AirLayers:
    """Return the air over a grid, in layers from which a robot may reach some of its ground.

    Args:
        grid: the ground.
        fly: the robot's ability.
    """
    resolution, places = grid.lattice.resolution, np.s_[::STRIDE, ::STRIDE]
    reach = math.ceil(fly.radius / resolution)
    steps = np.arange(-reach, reach + 1) * resolution
    disc = np.hypot(steps[:, None], steps[None, :]) <= fly.radius
    turns = grid.free_all_ways
    take_off = grid.known & turns & (grid.distance >= fly.radius)
    may_land = (turns & (grid.distance >= fly.edge))[places]
    to_unseen = _distance_to_unseen(grid)
    seen = (to_unseen >= fly.edge)[places]
    altitude = _altitudes(grid.height[take_off], fly)
    top = np.where(grid.known, grid.top, -np.inf)
    if altitude.size:
        hidden = _is_face(grid) & (to_unseen < _BEHIND * resolution)
        top[hidden] = np.maximum(top[hidden], altitude[-1] - fly.clearance)
    lowest: Array = fly.clearance + ndimage.maximum_filter(top, footprint=disc, mode="nearest")
    ground = _nearest(grid.height, take_off)[places]
    free = lowest[places] <= altitude[:, None, None]
    height = altitude[:, None, None] - ground
    return AirLayers(
        altitude,
        free,
        height,
        free & (height >= fly.clearance) & (height <= fly.most_altitude),
        lowest,
        grid.known[places],
        ground,
        take_off,
        may_land & seen,
        may_land & ~seen,
    )


def _is_face(grid: PlanningGrid) -> Mask:
    """Return which cells are the face of an obstacle: higher than most of what was seen beside
    them. At an edge from which the ground falls, most of that is as high.
    """
    size, known, top = 2 * _FACE + 1, grid.known, grid.top[grid.known]
    lowest = ndimage.minimum_filter(np.where(known, grid.top, np.inf), size, mode="nearest")
    share = ndimage.uniform_filter(known.astype(np.float64), size, mode="nearest")
    total = ndimage.uniform_filter(np.where(known, grid.top, 0.0), size, mode="nearest")
    rise = top - lowest[known]
    face = np.zeros_like(known)
    face[known] = (rise > _LEAST_FACE) & (top - total[known] / share[known] > 0.5 * rise)
    return face


def _distance_to_unseen(grid: PlanningGrid) -> Array:
    """Return the distance of each planning cell from ground that was not seen [m]."""
    seen = ~ndimage.binary_opening(~np.pad(grid.known, _HOLE), np.ones((_HOLE, _HOLE)))
    distance: Array = ndimage.distance_transform_edt(seen) * grid.lattice.resolution
    return distance[_HOLE:-_HOLE, _HOLE:-_HOLE]


def _nearest(values: Array, cells: Mask) -> Array:
    """Return the value of the nearest of some cells, for each cell; NaN without any."""
    if not cells.any():
        return np.full(cells.shape, np.nan)
    at = ndimage.distance_transform_edt(~cells, return_distances=False, return_indices=True)
    nearest: Array = values[tuple(at)]
    return nearest


def _altitudes(ground: Array, fly: FlyAbility) -> Array:
    """Return the altitudes that may be flown at from and to heights of the ground [m]."""
    if not ground.size:
        return np.zeros(0)
    least = math.ceil((float(ground.min()) + fly.clearance) / fly.spacing)
    most = math.floor((float(ground.max()) + fly.most_altitude) / fly.spacing)
    return fly.spacing * np.arange(least, most + 1, dtype=np.float64)


class Spent(NamedTuple):
    """Time [s] and energy [J] of parts of flights, arrays of one shape, () of a single one."""

    time: Array
    energy: Array


_NOTHING = Spent(np.zeros(()), np.zeros(()))


class FlightCosts:
    """The cost of each part of a flight, by what was measured of one.

    Attributes:
        to_arms, to_legs: before it and behind it, on the ground.
    """

    def __init__(self, costs: TravelCosts, fly: FlyAbility) -> None:
        """Look the measured costs up.

        Raises:
            LookupError: one of them is not there.
        """
        self._fly = fly
        self.to_arms, self._take_off, self._land, self.to_legs = (
            _once(costs, mode) for mode in ("to_arms", "take_off", "land", "to_legs")
        )
        self._power = costs.of("hover", SECOND).energy
        self._metre = Spent._make(costs.per_metre("fly", fly.speed, np.zeros(())))

    def take_off(self, height: Array) -> Spent:
        """Return the cost up to heights of the base over the ground [m].

        The measured take-off has risen by `FlyAbility.risen` already.
        """
        return self._hovering(self._beyond(height) / self._fly.rise_speed, self._take_off)

    def change(self, by: float) -> Spent:
        """Return the cost to rise in the air, to sink for less than 0 [m]."""
        speed = self._fly.rise_speed if by > 0.0 else self._fly.sink_speed
        return self._hovering(np.array(abs(by) / speed))

    def way(self, length: float) -> Spent:
        """Return the cost of a way at one altitude [m]."""
        return Spent(length * self._metre.time, length * self._metre.energy)

    def land(self, height: Array) -> Spent:
        """Return the cost down from heights of the base over the ground [m]; see `take_off`."""
        return self._hovering(self._beyond(height) / self._fly.sink_speed, self._land)

    def _beyond(self, height: Array) -> Array:
        """Return how much heights of the base over the ground exceed the measured one [m]."""
        return height - self._fly.perched - self._fly.risen

    def _hovering(self, time: Array, more: Spent = _NOTHING) -> Spent:
        """Return `more`, and the cost of times in the air [s]; negative times take from it."""
        return Spent(more.time + time, more.energy + time * self._power)


def _once(costs: TravelCosts, mode: str) -> Spent:
    """Return the cost of a passage."""
    cost = costs.of(mode, ONCE)
    return Spent(np.array(cost.time), np.array(cost.energy))
