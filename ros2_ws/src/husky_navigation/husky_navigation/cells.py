"""Cells of the map: what is known of each, and the lattice of odom on which they lie."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array

Indices = NDArray[np.int64]
"""Of cells [i, j] of an array (n, n), as n i + j."""


class Cells(NamedTuple):
    """State of the cells of a square map, arrays (n, n).

    Index [i, j] counts along +x and +y of odom from the map's lowest corner. A cell that was never
    seen has height and top NaN.

    Attributes:
        height: of the ground in odom [m].
        variance: of that height [m^2].
        support: points that agree with it.
        expected: points that ground there would have given to the images that had it in view.
        offset_x, offset_y: mean of these points' places, from the cell's centre [m].
        other_height, other_variance, other_support: the same of the height that contradicts it.
        contradictions: images in a row that agree on that other height.
        looked_through: images that have looked through the cell, less those that agreed with it.
        top: highest surface that was seen in the cell in odom, of a wall its upper edge [m].
        looked_over: images that have looked through the cell at the height of its top, since that
            was seen.
        age: time since an image has measured its height or top, or a foothold the height at first
            [s].
    """

    height: Array
    variance: Array
    support: Array
    expected: Array
    offset_x: Array
    offset_y: Array
    other_height: Array
    other_variance: Array
    other_support: Array
    contradictions: Array
    looked_through: Array
    top: Array
    looked_over: Array
    age: Array


class Lattice(NamedTuple):
    """Place of the map: cell [i, j] begins at ((x + i) resolution, (y + j) resolution) in odom.

    Attributes:
        resolution: edge of a cell [m].
        cells: along an edge of the map.
        x, y: cells between odom's origin and the lowest corner.
    """

    resolution: float
    cells: int
    x: int
    y: int

    @property
    def center(self) -> tuple[float, float]:
        """The map's centre in odom [m]."""
        half = self.cells // 2
        return (self.x + half) * self.resolution, (self.y + half) * self.resolution

    def around(self, x: float, y: float) -> Lattice:
        """Return the lattice of the same cells whose centre is next to a place in odom [m]."""
        half = self.cells // 2
        corner = round(x / self.resolution) - half, round(y / self.resolution) - half
        return Lattice(self.resolution, self.cells, *corner)

    def index_of(self, x: float, y: float) -> tuple[int, int] | None:
        """Return the cell of a place in odom [m], None for one beyond the map."""
        i = int(np.floor(x / self.resolution)) - self.x
        j = int(np.floor(y / self.resolution)) - self.y
        return (i, j) if 0 <= i < self.cells and 0 <= j < self.cells else None

    def cell_centers(self) -> tuple[Array, Array]:
        """Return the coordinates in odom of the cells' centres along x and y [m], (n,) each."""
        steps = np.arange(self.cells, dtype=np.float64) + 0.5
        return (self.x + steps) * self.resolution, (self.y + steps) * self.resolution


def unseen_cells(count: int) -> Cells:
    """Return `count` by `count` cells of which nothing is known."""
    cells = Cells(*np.zeros((len(Cells._fields), count, count)))
    cells.height[:] = cells.top[:] = np.nan
    return cells


def forget(cells: Cells, which: NDArray[np.bool_]) -> None:
    """Make cells (n, n) ones that were never seen."""
    for values in cells:
        values[which] = 0
    cells.height[which] = cells.top[which] = np.nan


def age(cells: Cells, time: float, variance: float, lift: float) -> None:
    """Let all cells grow older [s], less sure by a variance [m^2], and move up by a height [m]."""
    cells.age[:] += time
    for height in (cells.height, cells.other_height, cells.top):
        height += lift
    for less_sure in (cells.variance, cells.other_variance):
        less_sure += variance


def shift(cells: Cells, east: int, north: int) -> None:
    """Let the map move by whole cells along +x and +y: cells keep their places in odom.

    Cells that come into the map are unseen.
    """
    count = cells.height.shape[0]
    (old_x, new_x), (old_y, new_y) = (_overlap(step, count) for step in (east, north))
    came = np.ones(cells.height.shape, dtype=np.bool_)
    came[new_x, new_y] = False
    for values in cells:
        values[new_x, new_y] = values[old_x, old_y]
    forget(cells, came)


def _overlap(step: int, count: int) -> tuple[slice, slice]:
    """Return the indices that stay in a map along one axis, before and after a step."""
    step = max(-count, min(count, step))
    return slice(max(0, step), count + min(0, step)), slice(max(0, -step), count - max(0, step))
