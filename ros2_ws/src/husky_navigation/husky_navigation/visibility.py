"""Removal of cells that a camera looks through."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from husky_description.arrays import Array
from husky_navigation.cells import Cells, Lattice, forget
from husky_navigation.depth_view import LEAST_DROP, CameraPose, DepthView, SeenCells

_MANY = 50.0
"""Points that a cell is expected to have got, beyond which they are halved."""


class VisibilityRules(NamedTuple):
    """Those of the same names in `MapParameters`."""

    least_depth: float
    most_depth: float
    see_through_margin: float
    see_through_images: int
    see_through_most: float


@njit(inline="always")
def _shares(inverse: Array, row: int, column: int, near: float, far: float) -> tuple[float, float]:
    """Return the shares of the 9 pixels around one that see nearer and farther than two depths.

    They are shares of those that have a depth, and 0 where fewer than 5 have one. Where fewer than
    3 have one the camera is covered, and the cell counts as hidden. Rays are uncertain by 1.3
    pixels, which these 9 make up for.
    """
    known = before = beyond = 0
    for r in range(row - 1, row + 2):
        for c in range(column - 1, column + 2):
            known += inverse[r, c] > 0.0
            before += inverse[r, c] * near > 1.0
            beyond += 0.0 < inverse[r, c] * far < 1.0
    if known < 5:
        return (1.0 if known < 3 else 0.0), 0.0
    return before / known, beyond / known


class _Marks(NamedTuple):
    """Marks of an image on cells (n, n): 1 if it looks through, points that it expects."""

    through: Array
    expected: Array


@njit(cache=True)
def _mark(
    height: Array,
    variance: Array,
    lattice: Lattice,
    camera: CameraPose,
    inverse: Array,
    rules: VisibilityRules,
    marks: _Marks,
) -> int:
    """Mark the cells; return how many the image has in view."""
    rows, columns = inverse.shape
    pinhole, r, position = camera.pinhole, camera.rotation, camera.position
    pixels = lattice.resolution**2 * pinhole.fx * pinhole.fy
    in_view = 0
    for i in range(lattice.cells):
        x = (lattice.x + i + 0.5) * lattice.resolution - position[0]
        for j in range(lattice.cells):
            if math.isnan(height[i, j]):
                continue
            y = (lattice.y + j + 0.5) * lattice.resolution - position[1]
            z = height[i, j] - position[2]
            depth = r[0, 2] * x + r[1, 2] * y + r[2, 2] * z
            if depth < rules.least_depth:
                continue
            right = r[0, 0] * x + r[1, 0] * y + r[2, 0] * z
            down = r[0, 1] * x + r[1, 1] * y + r[2, 1] * z
            column = round(pinhole.cx + pinhole.fx * right / depth)
            row = round(pinhole.cy + pinhole.fy * down / depth)
            if not (0 < row < rows - 1 and 0 < column < columns - 1):
                continue
            in_view += 1
            margin = rules.see_through_margin + 3.0 * math.sqrt(variance[i, j])
            margin /= max(-z, LEAST_DROP)
            near, far = depth * (1.0 - min(0.5, margin)), depth * (1.0 + margin)
            before, beyond = _shares(inverse, row, column, near, far)
            marks.through[i, j] = beyond >= 0.7
            if before < 0.5 and depth < rules.most_depth:
                marks.expected[i, j] = pixels * max(0.0, -z) / depth**3
    return in_view


def look_through(
    cells: Cells, seen: SeenCells, lattice: Lattice, view: DepthView, rules: VisibilityRules
) -> int:
    """Remove cells through which more images have looked than have seen them, and tops likewise.

    Each cell is projected into the image. It is looked through where most pixels around it see
    ground that lies lower, by a margin and by three deviations of the cell's height. At a grazing
    angle ground that is farther is hardly lower, so that such views remove nothing. An image that
    looks through too large a share of the cells in view has a wrong pose, and removes nothing.

    Args:
        cells: the map.
        seen: what the image says of it.
        lattice: of the map.
        view: the image, and its camera.
        rules: of the removal.

    Returns:
        How many cells were removed.
    """
    marks = _Marks(*np.zeros((2, lattice.cells, lattice.cells)))
    inverse = view.inverse_depth
    in_view = _mark(cells.height, cells.variance, lattice, view.pose, inverse, rules, marks)
    _expect(cells, seen, marks.expected)
    if marks.through.sum() > rules.see_through_most * in_view:
        return 0
    cells.looked_through[:] += marks.through
    gone = cells.looked_through >= rules.see_through_images
    forget(cells, gone)
    over = _Marks(*np.zeros((2, lattice.cells, lattice.cells)))
    _mark(cells.top, cells.variance, lattice, view.pose, inverse, rules, over)
    cells.looked_over[:] += over.through
    cells.top[cells.looked_over >= rules.see_through_images] = np.nan
    return int(np.count_nonzero(gone))


def _expect(cells: Cells, seen: SeenCells, expected: Array) -> None:
    """Count the points that an image was expected to give to cells (n, n).

    It is measured by what it has given to all of them, so that drop-outs do not count. Counts are
    halved when they are large: old ones count less.
    """
    given = float(seen.points[expected > 0.0].sum())
    total = float(expected.sum())
    if total > 0.0:
        cells.expected[:] += min(1.0, given / total) * expected
    many = cells.expected > _MANY
    cells.expected[many] *= 0.5
    cells.support[many] *= 0.5
