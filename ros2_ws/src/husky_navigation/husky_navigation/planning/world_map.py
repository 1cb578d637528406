"""All ground that was seen, in `map`: what the rolling elevation map leaves behind stays here."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage

from husky_description.arrays import Array
from husky_navigation.cells import Lattice
from husky_navigation.frame_filter import LevelTransform
from husky_navigation.surface import fit_plane

_HALF = 2
"""Cells to each side of one in the plane fitted through it."""
_FILLED = 0.75
"""Distance from a seen cell up to which unseen ones are filled [m]: gaps of twice that."""
_SWEEPS, _OVER = 60, 1.7
"""Sweeps over the cells that are filled, and over-relaxation of each."""
_JUMP = 0.1
"""Shift of a map's middle since the last map, a second before, beyond which its frame has jumped
[m]; assumed. Odometry drifts by less."""


class MapHeights(NamedTuple):
    """Heights of a rolling elevation map, arrays (m, m), NaN where unseen.

    Attributes:
        elevation: of the ground, in the map's own frame [m].
        top: highest surface in each cell [m].
        age: time since each cell was measured [s].
        lattice: of the cells, in its own frame.
    """

    elevation: Array
    top: Array
    age: Array
    lattice: Lattice


class Shape(NamedTuple):
    """Shape of the ground in each cell, arrays (n, n); NaN where too little was seen.

    Attributes:
        slope_x, slope_y: rise along x and y of `map` [-].
        roughness: deviation of the cells around from their plane, rms [m].
    """

    slope_x: Array
    slope_y: Array
    roughness: Array


class WorldMap:
    """Height of the ground in `map`.

    Attributes:
        lattice: of its cells.
        elevation: height [m] (n, n), [i, j] along +x and +y; NaN where nothing was seen.
        top: highest surface [m] (n, n), NaN likewise.
    """

    def __init__(self, resolution: float = 0.05, cells: int = 400) -> None:
        """Nothing is known around the origin of `map`.

        Raises:
            ValueError: the number of cells along an edge is no multiple of 4.
        """
        if cells <= 0 or cells % 4:
            raise ValueError(f"cells is {cells}, it must be a positive multiple of 4")
        self.lattice = Lattice(resolution, cells, -(cells // 2), -(cells // 2))
        self.elevation, self.top = np.full((2, cells, cells), np.nan)
        self._frame: LevelTransform | None = None

    def clear(self) -> None:
        """Forget everything."""
        self.elevation.fill(np.nan)
        self.top.fill(np.nan)
        self._frame = None

    @property
    def highest(self) -> Array:
        """Highest surface that was seen in each cell [m] (n, n), NaN where nothing was."""
        highest: Array = np.fmax(self.elevation, self.top)
        return highest

    def merge(self, heights: MapHeights, frame: LevelTransform, oldest: float = math.inf) -> None:
        """Take over what an elevation map shows; its cells replace those that were known before.

        Older cells stay where they were put when they were measured: the map's own frame has
        drifted since. They are taken over as well where it has jumped to where it should be, and
        from the first map.

        Args:
            heights: the map.
            frame: its own frame in `map`.
            oldest: age up to which cells are taken over [s], infinite for all.

        Raises:
            ValueError: the frame is not finite.
        """
        if not all(math.isfinite(value) for value in frame):
            raise ValueError(f"the map's frame is {frame}, it must be finite")
        if self._frame is None or _shift(self._frame, frame, heights.lattice) > _JUMP:
            oldest = math.inf
        self._frame = frame
        lattice = heights.lattice
        xs, ys = lattice.cell_centers()
        cosine, sine = math.cos(frame.yaw), math.sin(frame.yaw)
        corners_x, corners_y = np.array([xs[0], xs[0], xs[-1], xs[-1]]), np.tile(ys[[0, -1]], 2)
        own = self.lattice
        around_x = frame.x + cosine * corners_x - sine * corners_y
        around_y = frame.y + sine * corners_x + cosine * corners_y
        rows, columns = (
            slice(
                max(0, math.floor(float(around.min()) / own.resolution) - first),
                max(0, min(own.cells, math.ceil(float(around.max()) / own.resolution) - first)),
            )
            for around, first in ((around_x, own.x), (around_y, own.y))
        )
        x, y = (axis[part] for axis, part in zip(own.cell_centers(), (rows, columns), strict=True))
        dx, dy = x[:, None] - frame.x, y[None, :] - frame.y
        i = np.floor((cosine * dx + sine * dy) / lattice.resolution).astype(np.int64) - lattice.x
        j = np.floor((cosine * dy - sine * dx) / lattice.resolution).astype(np.int64) - lattice.y
        inside = (i >= 0) & (i < lattice.cells) & (j >= 0) & (j < lattice.cells)
        taken = np.isfinite(heights.elevation) & ~(heights.age > oldest)
        inside[inside] = taken[i[inside], j[inside]]
        places = i[inside], j[inside]
        self.elevation[rows, columns][inside] = heights.elevation[places] + frame.z
        self.top[rows, columns][inside] = heights.top[places] + frame.z

    def filled(self) -> Array:
        """Return the heights with those of unseen cells near seen ones [m] (n, n), NaN elsewhere.

        Between two parts that were seen they lead from one to the other, as a stretched skin does:
        an edge behind which something lower was seen is steep, not level. Where nothing was seen
        behind, the nearest height goes on level.
        """
        seen = ~np.isnan(self.elevation)
        if not seen.any():
            return self.elevation.copy()
        away, nearest = ndimage.distance_transform_edt(~seen, return_indices=True)
        near = away * self.lattice.resolution <= _FILLED
        heights: Array = np.where(near, self.elevation[tuple(nearest)], np.nan)
        rows, columns = np.nonzero(near & ~seen)
        within = _between(seen, rows, columns, round(2.0 * _FILLED / self.lattice.resolution))
        _relax(heights, rows[within], columns[within])
        return heights


def _shift(before: LevelTransform, now: LevelTransform, lattice: Lattice) -> float:
    """Return how far a map's middle moves from one of its frames to another [m]."""
    middle = (*lattice.center, 0.0)
    return math.dist(before.apply(middle), now.apply(middle))


def shape_of(elevation: Array, resolution: float) -> Shape:
    """Return slopes and roughness of heights (n, n) [m] in cells of a size [m]."""
    shape = Shape(*(np.full(elevation.shape, np.nan) for _ in range(3)))
    _measure(elevation, resolution, shape)
    return shape


@njit(cache=True)
def _between(
    seen: NDArray[np.bool_], rows: NDArray[np.int64], columns: NDArray[np.int64], gap: int
) -> NDArray[np.bool_]:
    """Return which cells are in a gap between seen ones, so many cells wide at most."""
    between = np.zeros(len(rows), np.bool_)
    for k in range(len(rows)):
        for di, dj in ((1, 0), (0, 1), (1, 1), (1, -1)):
            left = gap if di * dj == 0 else round(gap / math.sqrt(2.0))
            for sign in (-1, 1):
                i, j = rows[k], columns[k]
                while left >= 0:
                    i, j, left = i + sign * di, j + sign * dj, left - 1
                    if not (0 <= i < seen.shape[0] and 0 <= j < seen.shape[1]):
                        left = -1
                    elif seen[i, j]:
                        break
            between[k] |= left >= 0
    return between


@njit(cache=True)
def _relax(heights: Array, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> None:
    """Let the heights (n, n) of some cells settle at the mean of their known neighbours."""
    last_row, last_column = heights.shape[0] - 1, heights.shape[1] - 1
    for _ in range(_SWEEPS):
        for k in range(len(rows)):
            i, j = rows[k], columns[k]
            total, count = 0.0, 0
            for di, dj in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                r, c = min(max(i + di, 0), last_row), min(max(j + dj, 0), last_column)
                if not math.isnan(heights[r, c]):
                    total += heights[r, c]
                    count += 1
            heights[i, j] += _OVER * (total / count - heights[i, j])


@njit(cache=True)
def _measure(elevation: Array, resolution: float, shape: Shape) -> None:
    """Write the shape of an elevation (n, n) [m] where it is known."""
    rows, columns = elevation.shape
    for i in range(rows):
        for j in range(columns):
            if math.isnan(elevation[i, j]):
                continue
            seen, dx, dy, spread = fit_plane(elevation, i, j, _HALF)
            if not seen:
                continue
            dx /= resolution
            dy /= resolution
            shape.slope_x[i, j], shape.slope_y[i, j] = dx, dy
            shape.roughness[i, j] = spread / math.sqrt(1.0 + dx * dx + dy * dy)
