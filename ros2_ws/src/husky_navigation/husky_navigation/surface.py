"""Slope, steps, roughness and traversability of the ground, from its height.

Definitions and limits are those of leggedrobotics' traversability_estimation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.vectors import solve_symmetric
from husky_navigation.map_parameters import MapParameters


@dataclass(frozen=True, eq=False)
class Surface:
    """Shape of the ground in each cell, arrays (n, n); NaN where too little was seen.

    Attributes:
        slope: angle of the plane through the cells around [rad].
        step: height of steps around [m].
        roughness: deviation of the cells around from their plane [m].
        traversability: from 0 to 1, easy: mean of what slope, step and roughness leave of 1 when
            each is divided by its limit and clipped.
    """

    slope: Array
    step: Array
    roughness: Array
    traversability: Array


class SurfaceRules(NamedTuple):
    """Those of the same names in `MapParameters`."""

    resolution: float
    plane_cells: int
    most_step: float
    critical_cells: int


@njit(inline="always")
def fit_plane(elevation: Array, i: int, j: int, half: int) -> tuple[int, float, float, float]:
    """Fit a plane to the cells around [i, j], up to `half` away along each axis.

    Returns:
        How many cells were seen, gradients along both axes [m/cell], and the root of the mean
        squared distance along z from the plane, over one cell less [m]; zeros for fewer than half
        of the cells, or cells in a line.
    """
    rows, columns = elevation.shape
    n = x = y = xx = xy = yy = 0
    z = xz = yz = zz = 0.0
    own = elevation[i, j]
    for r in range(max(0, i - half), min(rows, i + half + 1)):
        for c in range(max(0, j - half), min(columns, j + half + 1)):
            height = elevation[r, c] - own
            if math.isnan(height):
                continue
            dx, dy = r - i, c - j
            n += 1
            x += dx
            y += dy
            xx += dx * dx
            xy += dx * dy
            yy += dy * dy
            z += height
            xz += dx * height
            yz += dy * height
            zz += height * height
    if 2 * n < (2 * half + 1) ** 2:
        return 0, 0.0, 0.0, 0.0
    diagonal = float(n), float(xx), float(yy)
    beside = float(x), float(y), float(xy)
    level, slope_x, slope_y = solve_symmetric(diagonal, beside, (z, xz, yz))
    left = zz - level * z - slope_x * xz - slope_y * yz
    return n, slope_x, slope_y, math.sqrt(max(0.0, left) / (n - 1))


@njit(inline="always")
def _height_range(elevation: Array, i: int, j: int) -> float:
    """Return the difference of the heights around a cell, itself included [m]."""
    rows, columns = elevation.shape
    low = high = elevation[i, j]
    for r in range(max(0, i - 1), min(rows, i + 2)):
        for c in range(max(0, j - 1), min(columns, j + 2)):
            if not math.isnan(elevation[r, c]):
                low, high = min(low, elevation[r, c]), max(high, elevation[r, c])
    difference: float = high - low
    return difference


@njit(inline="always")
def _step_height(ranges: Array, i: int, j: int, most: float, critical_cells: int) -> float:
    """Return the height of the step around a cell [m]; one that few cells have counts less."""
    rows, columns = ranges.shape
    step, critical = 0.0, 0
    for r in range(max(0, i - 1), min(rows, i + 2)):
        for c in range(max(0, j - 1), min(columns, j + 2)):
            if not math.isnan(ranges[r, c]):
                step = max(step, ranges[r, c])
                critical += ranges[r, c] > most
    if step <= most:
        return step
    share: float = min(1.0, critical / critical_cells)
    return share * step


@njit(cache=True)
def measure_surface(
    elevation: Array,
    rules: SurfaceRules,
    ranges: Array,
    slope: Array,
    step: Array,
    roughness: Array,
) -> None:
    """Write slope [rad], step [m] and roughness [m] of an elevation [m], arrays (n, n).

    The other arrays hold NaN before; `ranges` is for work.
    """
    rows, columns = elevation.shape
    for i in range(rows):
        for j in range(columns):
            if not math.isnan(elevation[i, j]):
                ranges[i, j] = _height_range(elevation, i, j)
    for i in range(rows):
        for j in range(columns):
            if math.isnan(elevation[i, j]):
                continue
            seen, dx, dy, spread = fit_plane(elevation, i, j, rules.plane_cells)
            if not seen:
                continue
            gradient = math.hypot(dx, dy) / rules.resolution
            slope[i, j] = math.atan(gradient)
            roughness[i, j] = spread / math.sqrt(1.0 + gradient * gradient)
            step[i, j] = _step_height(ranges, i, j, rules.most_step, rules.critical_cells)


def surface_of(elevation: Array, parameters: MapParameters) -> Surface:
    """Return the shape of the ground that has an elevation [m] (n, n), NaN where unseen."""
    p = parameters
    rules = SurfaceRules(p.resolution, p.plane_cells, p.most_step, p.critical_cells)
    ranges, slope, step, roughness = (np.full(elevation.shape, np.nan) for _ in range(4))
    measure_surface(np.ascontiguousarray(elevation), rules, ranges, slope, step, roughness)
    left = (
        _left(slope, p.most_slope) + _left(step, p.most_step) + _left(roughness, p.most_roughness)
    )
    return Surface(slope, step, roughness, left / 3.0)


def _left(value: Array, most: float) -> Array:
    """Return what a value leaves of 1 when it is divided by its limit and clipped."""
    left: Array = 1.0 - np.clip(value / most, 0.0, 1.0)
    return left


def occupancy_of(surface: Surface, parameters: MapParameters) -> NDArray[np.int8]:
    """Return costs for a planner (n, n): 0 easy to 99, 100 beyond a limit, -1 unseen.

    The mean of three hides a limit that one of them exceeds; here it does not.
    """
    p = parameters
    known = ~np.isnan(surface.traversability)
    beyond = surface.slope >= p.most_slope
    beyond |= surface.step >= p.most_step
    beyond |= surface.roughness >= p.most_roughness
    cost = np.rint(99.0 * (1.0 - np.where(known, surface.traversability, 0.0)))
    return np.where(known, np.where(beyond, 100.0, cost), -1.0).astype(np.int8)
