"""Lanes straight up the slopes of a grid, from where a robot may walk to where it may again."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_navigation.planning.abilities import ClimbAbility
from husky_navigation.planning.planning_grid import Mask, PlanningGrid, heading_of

_REACH = 6.0
"""Longest way of a lane to each side of the cell from which it is found [m]."""
_BEND_OVER = 0.3
"""Way over which the bend of a lane is measured [m]."""
_LEAST_RISE = 0.1
"""Of a lane from its foot to its top [m]."""

Indices = NDArray[np.int64]


class Lanes(NamedTuple):
    """Lanes, one in each row.

    Attributes:
        foot, top: cells [i, j] where they begin and end (n, 2).
        direction: of the way up, from +x [rad] (n,).
        slope: inclination at each step of the grid's resolution [rad] (n, k), 0 off the lane.
        length: horizontal [m] (n,).
        unseen: way that was not seen [m] (n,).
    """

    foot: Indices
    top: Indices
    direction: Array
    slope: Array
    length: Array
    unseen: Array


def lanes_of(grid: PlanningGrid, climb: ClimbAbility) -> Lanes:
    """Return the lanes on which a robot may climb: each follows the fall line of one of its cells.

    Args:
        grid: the ground.
        climb: the robot's ability.
    """
    least = math.tan(math.radians(climb.least_slope_deg))
    seeds = np.argwhere(grid.known & grid.steep & (grid.slope > least) & ~grid.rough)
    seeds = seeds[(seeds % 2 == 0).all(axis=1)]  # a robot is wider than two cells
    uphill = np.stack([part[tuple(seeds.T)] for part in (grid.slope_x, grid.slope_y)], axis=1)
    uphill /= np.linalg.norm(uphill, axis=1, keepdims=True)
    resolution = grid.lattice.resolution
    middle = int(_REACH / resolution)
    steps = np.arange(-middle, middle + 1)
    places = seeds[:, None, :] + steps[None, :, None] * uphill[:, None, :]
    ground = _Ground(grid, places, uphill)
    good, ends = ground.good(climb), ground.ends()
    foot = middle - _first(ends[:, middle::-1], good[:, middle::-1])
    top = middle + _first(ends[:, middle:], good[:, middle:])
    index = steps + middle
    on_lane = (index >= foot[:, None]) & (index < top[:, None])
    slope = np.where(on_lane, np.clip(ground.inclination, 0.0, None), 0.0)
    rise = resolution * np.tan(slope).sum(axis=1)
    found = (foot >= 0) & (top <= 2 * middle) & (rise > _LEAST_RISE)
    cells, row = np.rint(places).astype(np.int64), np.arange(len(seeds))
    lanes = Lanes(
        cells[row, np.clip(foot, 0, 2 * middle)],
        cells[row, np.clip(top, 0, 2 * middle)],
        np.arctan2(uphill[:, 1], uphill[:, 0]),
        slope,
        resolution * (top - foot).astype(np.float64),
        resolution * (on_lane & ~ground.known).sum(axis=1),
    )
    return _distinct(Lanes._make(each[found] for each in lanes), grid.lattice.cells)


class _Ground:
    """The ground along candidates for lanes, arrays (n, k).

    Attributes:
        known: something was seen there.
        inclination: along the lane [rad].
    """

    def __init__(self, grid: PlanningGrid, places: Array, uphill: Array) -> None:
        """Look at places (n, k, 2), in cells, of lanes with a direction (n, 2)."""
        self._grid, self._places, self._uphill = grid, places, uphill
        self._at = self._cells(places)
        within = (places > -0.5) & (places < grid.lattice.cells - 0.5)
        self._filled: Mask = grid.filled[self._at] & within[..., 0] & within[..., 1]
        self.known: Mask = grid.known[self._at] & self._filled
        along, _ = self._slopes(self._at)
        self.inclination: Array = np.arctan(along)

    def _cells(self, places: Array) -> tuple[Indices, Indices]:
        """Return the cells at places, those at the border for places beyond it."""
        cells = np.clip(np.rint(places).astype(np.int64), 0, self._grid.lattice.cells - 1)
        return cells[..., 0], cells[..., 1]

    def _slopes(self, at: tuple[Indices, Indices]) -> tuple[Array, Array]:
        """Return the rise along and across the lanes at cells [-]."""
        slope_x, slope_y = self._grid.slope_x[at], self._grid.slope_y[at]
        x, y = self._uphill[:, None, 0], self._uphill[:, None, 1]
        return slope_x * x + slope_y * y, slope_y * x - slope_x * y

    def good(self, climb: ClimbAbility) -> Mask:
        """Return where the robot can climb: known at both sides, even across, bent gently."""
        level = math.tan(math.radians(climb.least_slope_deg))
        resolution = self._grid.lattice.resolution
        over = round(_BEND_OVER / resolution)
        good = self._filled & (self.inclination > -level)
        bend = np.abs(self.inclination[:, over:] - self.inclination[:, :-over]) / _BEND_OVER
        good[:, over:] &= bend <= 1.0 / climb.least_radius
        reach = math.ceil(climb.half_width / resolution)
        sideways = np.stack((-self._uphill[:, 1], self._uphill[:, 0]), axis=1)[:, None, :]
        for side in range(-reach, reach + 1):
            at = self._cells(self._places + side * sideways)
            along, across = self._slopes(at)
            good &= self._grid.filled[at] & ~self._grid.rough[at]
            good &= np.abs(across) <= math.tan(climb.most_skew) * np.maximum(np.abs(along), level)
            good &= self._grid.known[at] | ~self.known  # what is seen is seen to both sides
        return good

    def ends(self) -> Mask:
        """Return where the robot may stand and walk, in the direction of the lane."""
        heading = heading_of(np.arctan2(self._uphill[:, 1], self._uphill[:, 0]))
        free: Mask = self._grid.free[(heading[:, None], *self._at)] & self._filled
        return free


def _first(ends: Mask, good: Mask) -> Indices:
    """Return for each row the index of the first end to which good samples lead, or a large one."""
    found = ends & np.logical_and.accumulate(good | ends, axis=1)
    first: Indices = np.where(found.any(axis=1), found.argmax(axis=1), 10 * ends.shape[1])
    return first


def _distinct(lanes: Lanes, cells: int) -> Lanes:
    """Return one lane of those between the same two cells."""
    ends = np.concatenate((lanes.foot, lanes.top), axis=1)
    keys = np.ravel_multi_index(ends.T, (cells,) * 4) if len(ends) else np.zeros(0, np.int64)
    _, first = np.unique(keys, return_index=True)
    return Lanes._make(each[first] for each in lanes)
