"""Lanes straight up the slopes of a grid, from where a robot may walk to where it may again.

A slope is seen from one end, and often not up to the other: then a lane ends where nothing was seen
any more, which is hoped to be level.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from husky_description.arrays import Array
from husky_navigation.planning.abilities import ClimbAbility
from husky_navigation.planning.planning_grid import Cell, Indices, Mask, PlanningGrid, heading_of

_REACH = 6.0
"""Longest way of a lane to each side of the cell from which it is found [m]."""
_BEND_OVER = 0.3
"""Way over which the bend of a lane is measured [m]."""
_LEAST_RISE, _LEAST_RISE_SEEN = 0.1, 0.04
"""Of a lane from its foot to its top, and of what was seen of one that is hoped for [m]."""
_NEAR_UNSEEN = 0.15
"""Distance from unseen ground within which the bend of a lane is not judged [m]."""


class Lanes(NamedTuple):
    """Lanes, one in each row.

    Attributes:
        foot, top: cells [i, j] where they begin and end (n, 2).
        direction: of the way up, from +x [rad] (n,).
        slope: inclination at each step of the grid's resolution [rad] (n, k), 0 off the lane.
        length: horizontal [m] (n,).
        unseen: way that was not seen [m] (n,).
        seen: way from the foot and from the top that was seen, or lies between seen ground (n, 2).
    """

    foot: Indices
    top: Indices
    direction: Array
    slope: Array
    length: Array
    unseen: Array
    seen: Array

    def least_seen(self, climb: ClimbAbility) -> Array:
        """Return the way of each that has to be seen before it is begun [m] (n,)."""
        return np.minimum(self.length, climb.seen_first)


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
    ground = _Ground(grid, places, uphill, climb)
    up, down = slice(middle, None), slice(middle, None, -1)
    tops, feet = (_first(ground.ends[:, way], ground.good[:, way]) for way in (up, down))
    lanes = [ground.lanes(middle - feet, middle + tops)]
    hoped_tops, hoped_feet = (
        _first(ground.hoped_ends[:, way], ground.likely[:, way]) for way in (up, down)
    )
    beyond = 2 * middle + 1
    for foot, top, from_foot in ((feet, hoped_tops, True), (hoped_feet, tops, False)):
        foot = np.where(np.maximum(feet, tops) < beyond, beyond, foot)  # all was seen
        lanes.append(ground.lanes(middle - foot, middle + top, seen_from_foot=from_foot))
    joined = Lanes._make(np.concatenate(parts) for parts in zip(*lanes, strict=True))
    return _distinct(joined, grid.lattice.cells)


def first_end(
    grid: PlanningGrid, climb: ClimbAbility, cell: Cell, direction: float, *, downwards: bool
) -> tuple[Cell, float] | None:
    """Return the cell where the robot may walk again on its way straight up or down from a cell,
    and the mean inclination up to there [rad]; None where it finds none.

    Args:
        grid: the ground.
        climb: the robot's ability.
        cell: on a slope.
        direction: of the way up, from +x [rad].
        downwards: it goes down.
    """
    uphill = np.array([[math.cos(direction), math.sin(direction)]])
    course = -uphill[0] if downwards else uphill[0]
    steps = np.arange(int(_REACH / grid.lattice.resolution))
    ground = _Ground(grid, cell + steps[None, :, None] * course, uphill, climb)
    for ends, good in ((ground.ends, ground.good), (ground.hoped_ends, ground.likely)):
        (found,) = _first(ends, good)
        if 0 < found < len(steps):
            i, j = np.rint(cell + found * course).astype(int).tolist()
            return (i, j), float(ground.inclination[0, :found].mean())
    return None


class _Ground:
    """The ground along candidates for lanes, arrays (n, k).

    Attributes:
        known: something was seen there.
        inclination: along the lane [rad].
        good: the robot can climb there.
        likely: it can, or nothing speaks against it.
        ends: the robot may stand and walk there, in the direction of the lane.
        hoped_ends: it may, or nothing was seen there.
    """

    def __init__(
        self, grid: PlanningGrid, places: Array, uphill: Array, climb: ClimbAbility
    ) -> None:
        """Look at places (n, k, 2), in cells, of lanes with a direction (n, 2)."""
        self._grid, self._places, self._uphill = grid, places, uphill
        self._at = self._cells(places)
        within = ((places > -0.5) & (places < grid.lattice.cells - 0.5)).all(axis=-1)
        filled = grid.filled[self._at] & within
        self.known: Mask = grid.known[self._at] & filled
        along, _ = self._slopes(self._at)
        self.inclination: Array = np.arctan(along)
        even, seen_beside = self._even(climb)
        bends = self._bends(climb)
        near = _NEAR_UNSEEN / grid.lattice.resolution
        unseen = ndimage.binary_dilation(~self.known, np.ones((1, 2 * round(near) + 1)))
        self.good: Mask = filled & even & seen_beside & ~bends
        self.likely: Mask = within & (~self.known | (even & (~bends | unseen)))
        heading = heading_of(np.arctan2(uphill[:, 1], uphill[:, 0]))
        free = grid.free[(heading[:, None], *self._at)] & within
        self.ends: Mask = free & filled
        self.hoped_ends: Mask = free & (filled | ~self.known)

    def lanes(self, foot: Indices, top: Indices, *, seen_from_foot: bool | None = None) -> Lanes:
        """Return the lanes between samples (n,); none where one is out of range, or nothing rises.

        Args:
            foot: where they begin.
            top: where they end.
            seen_from_foot: they were seen from there, or else from the top; None: whole.
        """
        resolution, last = self._grid.lattice.resolution, self.known.shape[1] - 1
        index, length = np.arange(last + 1), top - foot
        on_lane = (index >= foot[:, None]) & (index < top[:, None])
        slope = np.where(on_lane, np.clip(self.inclination, 0.0, None), 0.0)
        counts, least, seen = on_lane, _LEAST_RISE, np.stack((length, length), axis=1)
        if seen_from_foot is not None:
            counts, least = on_lane & self.known, _LEAST_RISE_SEEN
            unseen = on_lane & ~self.known
            first = np.where(unseen.any(axis=1), unseen.argmax(axis=1), top)
            final = last - np.where(unseen.any(axis=1), unseen[:, ::-1].argmax(axis=1), last - foot)
            nothing = np.zeros_like(length)
            both = (first - foot, nothing) if seen_from_foot else (nothing, top - final)
            seen = np.stack(both, axis=1)
        rise = resolution * np.where(counts, np.tan(slope), 0.0).sum(axis=1)
        found = (foot >= 0) & (top <= last) & (rise > least)
        cells, row = np.rint(self._places).astype(np.int64), np.arange(len(foot))
        lanes = Lanes(
            cells[row, np.clip(foot, 0, last)],
            cells[row, np.clip(top, 0, last)],
            np.arctan2(self._uphill[:, 1], self._uphill[:, 0]),
            slope,
            resolution * length.astype(np.float64),
            resolution * (on_lane & ~self.known).sum(axis=1),
            resolution * seen.astype(np.float64),
        )
        return Lanes._make(each[found] for each in lanes)

    def _cells(self, places: Array) -> tuple[Indices, Indices]:
        """Return the cells at places, those at the border for places beyond it."""
        cells = np.clip(np.rint(places).astype(np.int64), 0, self._grid.lattice.cells - 1)
        return cells[..., 0], cells[..., 1]

    def _slopes(self, at: tuple[Indices, Indices]) -> tuple[Array, Array]:
        """Return the rise along and across the lanes at cells [-]."""
        slope_x, slope_y = self._grid.slope_x[at], self._grid.slope_y[at]
        x, y = self._uphill[:, None, 0], self._uphill[:, None, 1]
        return slope_x * x + slope_y * y, slope_y * x - slope_x * y

    def _bends(self, climb: ClimbAbility) -> Mask:
        """Return where the ground bends more than the robot can take."""
        over = round(_BEND_OVER / self._grid.lattice.resolution)
        bend = np.abs(self.inclination[:, over:] - self.inclination[:, :-over]) / _BEND_OVER
        bends: Mask = np.pad(bend > 1.0 / climb.least_radius, ((0, 0), (over, 0)))
        return bends

    def _even(self, climb: ClimbAbility) -> tuple[Mask, Mask]:
        """Return where the ground does not fall and is even, and where it was seen to both sides.

        Where nothing was seen the latter holds too.
        """
        level = math.tan(math.radians(climb.least_slope_deg))
        even, seen = self.inclination > -level, np.ones_like(self.known)
        reach = math.ceil(climb.half_width / self._grid.lattice.resolution)
        sideways = np.stack((-self._uphill[:, 1], self._uphill[:, 0]), axis=1)[:, None, :]
        for side in range(-reach, reach + 1):
            at = self._cells(self._places + side * sideways)
            along, across = self._slopes(at)
            even &= ~self._grid.rough[at]
            seen &= self._grid.filled[at] & (self._grid.known[at] | ~self.known)
            allowed = np.maximum(math.tan(climb.most_skew) * np.abs(along), climb.most_bank)
            even &= np.abs(across) <= allowed
        return even, seen


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
