"""The ground as the planner sees it: where a robot may stand in each heading, and its slopes."""

from __future__ import annotations

import math
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from husky_description.arrays import Array
from husky_navigation.cells import Lattice
from husky_navigation.planning.abilities import Abilities
from husky_navigation.planning.world_map import WorldMap, shape_of

Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]
Cell = tuple[int, int]
"""Index [i, j]."""

HEADINGS = 8
"""Directions in which a robot stands and walks, in steps of 45 deg from +x."""
COARSENING = 2
"""Cells of the world map along an edge of a planning cell."""
_WALL = 0.2
"""Height over the mean ground from which on a surface in the same cell is a wall [m]; `elevation`
may be its foot alone. The steepest slope rises by 0.05 m to a cell's edge, the rest is for errors.
"""
_WIDE = 2
"""Planning cells to each side across which the rise of the ground is measured: so noise of the map
is no slope."""


class PlanningGrid(NamedTuple):
    """Ground in planning cells, arrays (n, n).

    Attributes:
        lattice: of the cells, in `map`.
        known: something was seen there.
        filled: seen, or near what was seen.
        height: of the ground, 0 where it is not filled [m].
        top: highest surface that was seen there, NaN where nothing was [m].
        slope_x, slope_y: rise along x and y [-], 0 where nothing is known.
        rough: ground on which no foot is put: a step, an edge, a wall.
        steep: ground that rises too much for a walk.
        free: the robot fits there in each heading, walking (HEADINGS, n, n).
        distance: to the nearest cell on which it does not walk [m].
    """

    lattice: Lattice
    known: Mask
    filled: Mask
    height: Array
    top: Array
    slope_x: Array
    slope_y: Array
    rough: Mask
    steep: Mask
    free: Mask
    distance: Array

    @property
    def slope(self) -> Array:
        """Steepest rise over way [-]."""
        return np.hypot(self.slope_x, self.slope_y)

    @property
    def free_all_ways(self) -> Mask:
        """Mark of the cells in which the robot can turn, walking (n, n)."""
        turns: Mask = np.logical_and.reduce(self.free, axis=0)
        return turns

    def is_taken(self, x: float, y: float, within: float) -> bool:
        """Return whether something that was seen, within a distance of a place [m], is no ground to
        walk on; a slope that leads to what was not seen may be none.
        """
        seen_around = ndimage.binary_erosion(self.known, np.ones((2 * _WIDE + 3,) * 2))
        i, j = np.nonzero((self.rough & self.known) | (self.steep & seen_around))
        xs, ys = self.lattice.cell_centers()
        return bool((np.hypot(xs[i] - x, ys[j] - y) < within).any())

    def centre(self, cell: tuple[int, int]) -> tuple[float, float]:
        """Return the centre of a cell [i, j] in `map` [m]."""
        first, resolution = (self.lattice.x, self.lattice.y), self.lattice.resolution
        x, y = ((f + index + 0.5) * resolution for f, index in zip(first, cell, strict=True))
        return x, y


def heading_of(yaw: Array | float) -> NDArray[np.int64]:
    """Return the number of the heading next to an angle from +x [rad], 0 to HEADINGS - 1."""
    return np.rint(np.asarray(yaw) / (2.0 * math.pi / HEADINGS)).astype(np.int64) % HEADINGS


def cells_between(start: Cell, end: Cell) -> tuple[Indices, Indices]:
    """Return the cells along a straight line."""
    count = 2 * max(abs(b - a) for a, b in zip(start, end, strict=True)) + 1
    i, j = np.rint(np.linspace(start, end, count)).astype(np.int64).T
    return i, j


def grid_of(world: WorldMap, abilities: Abilities) -> PlanningGrid:
    """Return the ground of a map for a robot."""
    heights, walk, fine = world.filled(), abilities.walk, world.lattice
    shape = shape_of(heights, fine.resolution)
    lattice = Lattice(
        fine.resolution * COARSENING,
        fine.cells // COARSENING,
        fine.x // COARSENING,
        fine.y // COARSENING,
    )
    filled: Mask = np.logical_and.reduce(_blocks(~np.isnan(heights)), axis=-1)
    height, top = _mean(heights), _top(world.highest)
    slope_x, slope_y = (_mean(part) for part in (shape.slope_x, shape.slope_y))
    steepness = _blocks(np.nan_to_num(np.hypot(shape.slope_x, shape.slope_y))).max(axis=-1)
    rough = (_mean(shape.roughness) > walk.most_roughness) | (steepness > abilities.most_slope)
    rough |= top > height + _WALL
    wide = _rise(height, filled, lattice.resolution)  # beside a wall as well
    steep = np.minimum(wide, np.hypot(slope_x, slope_y)) > walk.most_slope
    near_steep = _distance_to(steep, lattice.resolution) <= walk.clearance
    free = np.empty((HEADINGS, *rough.shape), np.bool_)
    for heading in range(HEADINGS // 2):
        angle = heading * 2.0 * math.pi / HEADINGS
        footprint = _rectangle(abilities.length, abilities.width, angle, lattice.resolution)
        taken = ndimage.binary_dilation(rough, footprint, border_value=True)
        free[heading] = ~(taken | near_steep)
        free[heading + HEADINGS // 2] = free[heading]
    return PlanningGrid(
        lattice,
        ~np.isnan(top),
        filled,
        height,
        top,
        slope_x,
        slope_y,
        rough,
        steep,
        free,
        _distance_to(rough | steep, lattice.resolution),
    )


def _distance_to(cells: Mask, resolution: float) -> Array:
    """Return the distance of each cell from the nearest of those [m], inf where there is none."""
    if not cells.any():
        return np.full(cells.shape, np.inf)
    distance: Array = ndimage.distance_transform_edt(~cells) * resolution
    return distance


def _blocks(fine: NDArray[Any]) -> NDArray[Any]:
    """Return the fine cells of each planning cell, (n, n, k)."""
    n = fine.shape[0] // COARSENING
    blocks = fine.reshape(n, COARSENING, n, COARSENING).swapaxes(1, 2)
    return blocks.reshape(n, n, -1)


def _mean(fine: Array) -> Array:
    """Return the mean of each planning cell's fine cells, 0 where one of them is NaN."""
    mean: Array = np.nan_to_num(_blocks(fine).mean(axis=-1))
    return mean


def _top(fine: Array) -> Array:
    """Return the highest of each planning cell's fine cells, NaN where all of them are."""
    rows = reduce(np.fmax, (fine[k::COARSENING] for k in range(COARSENING)))
    highest: Array = reduce(np.fmax, (rows[:, k::COARSENING] for k in range(COARSENING)))
    return highest


def _rise(height: Array, filled: Mask, resolution: float) -> Array:
    """Return the steepest rise over way across `_WIDE` cells to each side, 0 where unknown [-]."""
    smooth = ndimage.uniform_filter(height, 3)
    difference = [-1.0, *(0.0,) * (2 * _WIDE - 1), 1.0]
    along = (ndimage.correlate1d(smooth, difference, axis) for axis in (0, 1))
    inside = ndimage.binary_erosion(filled, np.ones((2 * _WIDE + 3,) * 2))
    return np.where(inside, np.hypot(*along) / (2 * _WIDE * resolution), 0.0)


def _rectangle(length: float, width: float, angle: float, resolution: float) -> Mask:
    """Return the cells that a rectangle about the middle one covers, (k, k) with k odd."""
    reach = math.ceil(0.5 * math.hypot(length, width) / resolution)
    steps = np.arange(-reach, reach + 1) * resolution
    x, y = steps[:, None], steps[None, :]
    cosine, sine = math.cos(angle), math.sin(angle)
    along, across = np.abs(cosine * x + sine * y), np.abs(cosine * y - sine * x)
    covered: Mask = (along <= 0.5 * length) & (across <= 0.5 * width)
    return covered
