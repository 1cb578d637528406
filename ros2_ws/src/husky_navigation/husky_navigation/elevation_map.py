"""A map of the ground's height around the robot, from depth images and footholds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_navigation.cells import Indices, Lattice, age, shift, unseen_cells
from husky_navigation.depth_view import (
    DepthNoise,
    DepthView,
    PixelCounts,
    gather,
    no_seen_cells,
)
from husky_navigation.drift import HeightDrift, height_over_map
from husky_navigation.fusion import HeightMeasurements, fuse, level_cells, raise_tops
from husky_navigation.map_parameters import MapParameters
from husky_navigation.visibility import VisibilityRules, look_through

_NO_CAPSULES = np.zeros((0, 7))


@dataclass(frozen=True)
class ImageReport:
    """Effect of an image on the map.

    Attributes:
        pixels: by their fate.
        cells: that it has seen.
        contradicted: cells whose height it contradicts.
        replaced: cells that have taken another height for that.
        believed: whether the pose was believed; if not, only other heights were noted.
        removed: cells that have been looked through, and are unseen again.
        compared: cells by which it was corrected.
        correction: height that was taken off it [m].
        lift: by which the map was raised to follow odometry's drift [m].
    """

    pixels: PixelCounts
    cells: int
    contradicted: int
    replaced: int
    believed: bool
    removed: int
    compared: int
    correction: float
    lift: float


class ElevationMap:
    """The ground's height in odom on a square grid whose centre follows the robot.

    Cells are fixed in odom. Each has a height and its variance, by a Kalman filter; one that was
    never seen has neither (NaN). Arrays are indexed [i, j] along +x and +y from the lowest corner.

    Attributes:
        parameters: of the map.
        lattice: where the cells lie.
    """

    def __init__(self, parameters: MapParameters | None = None) -> None:
        """Start with nothing seen, around odom's origin."""
        self.parameters = p = parameters or MapParameters()
        self.lattice = Lattice(p.resolution, p.cells, -p.cells // 2, -p.cells // 2)
        self._noise = _of(DepthNoise, p)
        self._visibility = _of(VisibilityRules, p)
        self._seen = no_seen_cells(p.cells)
        self.clear()

    def clear(self) -> None:
        """Forget everything that was seen."""
        self._cells = unseen_cells(self.parameters.cells)
        self._drift = HeightDrift(self.parameters.drift_variance)
        self._time = -math.inf
        self._growth = 0.0
        self._place: Array | None = None

    @property
    def elevation(self) -> Array:
        """Height of the ground in odom [m] (n, n), NaN where it was not seen."""
        return np.where(self._known(), self._cells.height, np.nan)

    @property
    def variance(self) -> Array:
        """Variance of `elevation` [m^2] (n, n), NaN where the ground was not seen."""
        return np.where(self._known(), self._cells.variance, np.nan)

    @property
    def top(self) -> Array:
        """Highest surface that was seen in each cell in odom [m] (n, n), NaN where none was.

        It differs from `elevation` in cells that hold the face of a wall: the ground at such a
        cell's middle is the wall's foot, or its top.
        """
        return np.where(self._known(), np.fmax(self._cells.height, self._cells.top), np.nan)

    @property
    def age(self) -> Array:
        """Time from the last image that measured each cell to the last image [s] (n, n).

        From the foothold, if it was the first to show the cell; NaN where the ground was not seen.
        """
        return np.where(self._known(), self._cells.age, np.nan)

    def _known(self) -> NDArray[np.bool_]:
        """Return which cells enough points have shown, on all sides of the centre (n, n)."""
        cells, p = self._cells, self.parameters
        offset = np.hypot(cells.offset_x, cells.offset_y)
        least = np.maximum(p.least_support, p.least_share * cells.expected)
        known: NDArray[np.bool_] = cells.support >= least
        known &= offset <= p.most_offset * p.resolution
        return known

    def move_to(self, position: Array) -> None:
        """Centre the map on the robot, by whole cells; what leaves it is forgotten.

        Args:
            position: of the base in odom [m] (2,) or (3,).

        Raises:
            ValueError: it is not finite.
        """
        x, y = float(position[0]), float(position[1])
        if not (math.isfinite(x) and math.isfinite(y)):
            raise ValueError(f"position is {x}, {y}, it must be finite")
        lattice = self.lattice.around(x, y)
        east, north = lattice.x - self.lattice.x, lattice.y - self.lattice.y
        if east or north:
            shift(self._cells, east, north)
            self.lattice = lattice
        place = np.array([x, y])
        if self._place is None:
            self._place = place
        distance = min(float(np.hypot(*(place - self._place))), self.parameters.length)
        if distance >= _SWAY:
            self._drift.walk(distance)
            self._growth += self.parameters.travel_variance * distance
            self._place = place

    def integrate(self, view: DepthView, capsules: Array = _NO_CAPSULES) -> ImageReport:
        """Take in a depth image.

        The image is corrected by the height in which it differs from the map where both have seen
        the ground. Part of the height is drift of odometry, which the map follows.

        Args:
            view: the image, and its camera.
            capsules: (k, 7), what the robot fills (`LegCapsules.in_odom`).

        Raises:
            ValueError: the capsules' shape is wrong.
        """
        if capsules.ndim != 2 or capsules.shape[1] != 7:
            raise ValueError(f"capsules have shape {capsules.shape}, it must be (k, 7)")
        elapsed = max(0.0, view.time - self._time) if math.isfinite(self._time) else 0.0
        self._growth += self.parameters.time_variance * min(elapsed, _LONGEST)
        self._time = max(self._time, view.time)
        found, fates = gather(
            view.depth,
            view.inverse_depth,
            view.pose,
            self._noise,
            self.lattice,
            np.require(capsules, np.float64, ["C", "W"]),
            self._seen,
        )
        places, pixels = self._seen.touched[:found], PixelCounts(*fates.tolist())
        compared, correction, lift = self._correct(places, elapsed)
        measured = self._measured(places, view.position, correction)
        outcome = fuse(self._cells, places, measured, self.parameters)
        removed = 0
        raise_tops(self._cells, places, self._seen.highest.reshape(-1)[places] - correction)
        if outcome.believed:
            removed = look_through(self._cells, self._seen, self.lattice, view, self._visibility)
        for values in self._seen[:-1]:
            values.reshape(-1)[places] = 0.0
        return ImageReport(pixels, found, *outcome, removed, compared, correction, lift)

    def observe_foothold(self, position: Array, deviation: float | None = None) -> bool:
        """Take in the ground's height under a foot that stands.

        It fills the cell, and shows odometry's drift where the cell was seen before.

        Args:
            position: where the foot touches the ground, in odom [m] (3,).
            deviation: of its height [m], None for that of the parameters.

        Returns:
            True if the foothold is on the map.

        Raises:
            ValueError: a number is not finite, or the deviation is not positive.
        """
        x, y, z = (float(value) for value in position)
        if not math.isfinite(x + y + z):
            raise ValueError(f"position is {x}, {y}, {z}, it must be finite")
        index = self.lattice.index_of(x, y)
        if index is None:
            return False
        i, j = index
        deviation = self.parameters.foothold_deviation if deviation is None else deviation
        if not 0.0 < deviation < math.inf:
            raise ValueError(f"deviation is {deviation}, it must be positive and finite")
        variance = deviation**2
        if self._is_even(i, j):
            differs = z - float(self._cells.height[i, j])
            # A foot on something that the map has wrong tells nothing of drift.
            total = self._cells.variance[i, j] + variance + self._drift.variance
            if differs**2 < self.parameters.gate**2 * total:
                lift = self._drift.correct(differs, float(self._cells.variance[i, j]) + variance)
                age(self._cells, 0.0, 0.0, lift)
        self._put(np.array([i * self.lattice.cells + j]), np.array([z]), variance)
        return True

    def seed_ground(self, footholds: Array, margin: float = 0.15, deviation: float = 0.02) -> int:
        """Fill unseen cells under a standing robot with the plane through its footholds.

        The camera never sees the ground on which the robot starts.

        Args:
            footholds: where feet touch the ground, in odom [m] (k, 3), k >= 3.
            margin: around the polygon of the footholds [m].
            deviation: of the ground from the plane [m].

        Returns:
            How many cells were filled.

        Raises:
            ValueError: a number is not finite, or the footholds are fewer than 3 or in a line.
        """
        feet = np.asarray(footholds, dtype=np.float64)
        if feet.ndim != 2 or feet.shape[1] != 3 or len(feet) < 3 or not np.isfinite(feet).all():
            raise ValueError(f"footholds are {feet.tolist()}, they must be (k, 3), k >= 3, finite")
        center = feet.mean(axis=0)
        plane, _, rank, _ = np.linalg.lstsq(feet[:, :2] - center[:2], feet[:, 2] - center[2])
        if rank < 2:
            raise ValueError(f"footholds are {feet.tolist()}, they must not lie in a line")
        x, y = np.meshgrid(*self.lattice.cell_centers(), indexing="ij")
        inside = _is_around_polygon(x - center[0], y - center[1], feet[:, :2] - center[:2], margin)
        unseen = inside & np.isnan(self._cells.height)
        z = center[2] + plane[0] * (x - center[0]) + plane[1] * (y - center[1])
        self._put(np.flatnonzero(unseen), z[unseen], deviation**2)
        return int(np.count_nonzero(unseen))

    def _correct(self, places: Indices, elapsed: float) -> tuple[int, float, float]:
        """Return cells compared, the image's correction and the lift of the map [m].

        Args:
            places: of the cells that the image sees.
            elapsed: time since the last image [s].
        """
        compared, height = height_over_map(self._cells, self._seen, places, self.parameters)
        lift = 0.0
        if height is not None:
            lift = self._drift.correct(height, self.parameters.image_deviation**2)
        age(self._cells, elapsed, self._growth, lift)
        self._growth = 0.0
        return compared, 0.0 if height is None else height - lift, lift

    def _measured(self, places: Indices, position: Array, correction: float) -> HeightMeasurements:
        """Return what the last image has measured in cells.

        Args:
            places: of the cells.
            position: of the camera in odom [m] (3,).
            correction: height by which the image is too high [m].
        """
        p, seen = self.parameters, self._seen
        i, j = np.divmod(places, p.cells)
        x = (self.lattice.x + i + 0.5) * p.resolution - position[0]
        y = (self.lattice.y + j + 0.5) * p.resolution - position[1]
        pose = p.height_deviation**2 + p.attitude_deviation**2 * (x * x + y * y)
        return HeightMeasurements(
            seen.height.reshape(-1)[places] - correction,
            seen.variance.reshape(-1)[places] + pose,
            p.least_variance + p.lasting_share * pose,
            seen.points.reshape(-1)[places],
            seen.offset_x.reshape(-1)[places],
            seen.offset_y.reshape(-1)[places],
        )

    def _put(self, places: Indices, height: Array, variance: float) -> None:
        """Fuse heights [m] (k,) that fill cells into the map.

        Cells that an image has shown keep their age: a single one with odometry's drift since then
        would stand out of the ground around it.
        """
        support = float(self.parameters.least_support)
        age, seen = self._cells.age.reshape(-1), ~np.isnan(self._cells.height.reshape(-1)[places])
        shown, before = places[seen], age[places[seen]]
        fuse(self._cells, places, level_cells(height, variance, support), self.parameters)
        age[shown] = before

    def _is_even(self, i: int, j: int) -> bool:
        """Return whether a cell and its neighbours were well seen, and are about level."""
        if not (0 < i < self.lattice.cells - 1 and 0 < j < self.lattice.cells - 1):
            return False
        around = slice(i - 1, i + 2), slice(j - 1, j + 2)
        known = self._cells.support[around] >= self.parameters.least_support
        height = self._cells.height[around]
        return bool(known.all()) and float(np.ptp(height)) < _LEVEL


_SWAY = 0.05
"""Distance within which a robot sways or odometry is noisy: it counts as no way [m]."""
_LONGEST = 60.0
"""Time between images for which cells grow less sure, at most [s]."""
_LEVEL = 0.03
"""Most difference of height between a foothold's neighbours by which drift is judged [m]."""


def _is_around_polygon(x: Array, y: Array, corners: Array, margin: float) -> NDArray[np.bool_]:
    """Return which places lie in a convex polygon around the origin, or within a margin of it."""
    order = np.argsort(np.arctan2(corners[:, 1], corners[:, 0]))
    inside = np.ones(x.shape, dtype=np.bool_)
    for start, end in zip(corners[order], corners[np.roll(order, -1)], strict=True):
        along = (end - start) / max(float(np.hypot(*(end - start))), 1e-9)
        inside &= along[1] * (x - start[0]) - along[0] * (y - start[1]) <= margin
    return inside


def _of(rules: Any, parameters: MapParameters) -> Any:
    """Return a record of the kernels: the parameters that have the names of its fields."""
    return rules(*(getattr(parameters, name) for name in rules._fields))
