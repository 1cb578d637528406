"""A depth image with its camera's pose, and what it says of each cell."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.vectors import Vector
from husky_navigation.cells import Indices, Lattice

DepthImage = NDArray[np.uint16]
"""Depth along the optical axis [mm], 0 where there is none: (rows, columns), row 0 at the top."""


LEAST_DROP = 0.15
"""Of a surface under the camera, for the noise of depth: on a higher one it has no bound [m]."""


class PinholeCamera(NamedTuple):
    """Focal lengths and principal point [pixels]; pixel (0, 0) has its centre at u = v = 0."""

    fx: float
    fy: float
    cx: float
    cy: float


class CameraPose(NamedTuple):
    """A camera in odom.

    Attributes:
        pinhole: of the camera.
        rotation: (3, 3), optical axes (x right, y down, z ahead) to odom.
        position: in odom [m] (3,).
    """

    pinhole: PinholeCamera
    rotation: Array
    position: Array


@dataclass(frozen=True, eq=False)
class DepthView:
    """A depth image, and the camera that took it.

    Attributes:
        depth: the image.
        camera: its pinhole.
        rotation: (3, 3), optical axes (x right, y down, z ahead) to odom.
        position: of the camera in odom [m] (3,).
        time: of the image [s].

    Arrays that are read-only or not contiguous are copied: kernels would be compiled anew for them.
    """

    depth: DepthImage
    camera: PinholeCamera
    rotation: Array
    position: Array
    time: float

    @property
    def pose(self) -> CameraPose:
        """The camera, as kernels take it."""
        return CameraPose(self.camera, self.rotation, self.position)

    @cached_property
    def inverse_depth(self) -> Array:
        """One over the depth [1/m] (rows, columns), 0 where there is none."""
        inverse = np.zeros(self.depth.shape)
        np.divide(1000.0, self.depth, out=inverse, where=self.depth > 0)
        return inverse

    def __post_init__(self) -> None:
        """Check the view.

        Raises:
            ValueError: a shape or type is wrong, a number not finite, or the matrix no rotation.
        """
        if self.depth.ndim != 2 or self.depth.dtype != np.uint16:
            raise ValueError(
                f"depth is {self.depth.dtype} {self.depth.shape}, it must be uint16 (rows, columns)"
            )
        for name, shape in (("rotation", (3, 3)), ("position", (3,)), ("camera", (4,))):
            value = np.asarray(getattr(self, name), dtype=np.float64)
            if value.shape != shape or not np.isfinite(value).all():
                raise ValueError(f"{name} is {value.tolist()}, it must be {shape} finite numbers")
        if not math.isfinite(self.time):
            raise ValueError(f"time is {self.time}, it must be finite")
        if self.camera.fx <= 0.0 or self.camera.fy <= 0.0:
            raise ValueError(f"camera has focal lengths {self.camera[:2]}, they must be positive")
        for name in ("rotation", "position"):
            own = np.require(getattr(self, name), np.float64, ["C", "W"])
            object.__setattr__(self, name, own)
        object.__setattr__(self, "depth", np.require(self.depth, requirements=["C", "W"]))
        object.__setattr__(self, "camera", PinholeCamera(*map(float, self.camera)))
        turned = self.rotation @ self.rotation.T
        if np.abs(turned - np.eye(3)).max() > 1e-3 or np.linalg.det(self.rotation) < 0.0:
            raise ValueError(f"rotation is {self.rotation.tolist()}, which is no rotation")


class DepthNoise(NamedTuple):
    """Errors of the camera and its pose: those of the same names in `MapParameters`."""

    least_depth: float
    most_depth: float
    axial_floor: float
    axial_growth: float
    axial_depth: float
    lateral: float
    headroom: float
    edge_gate: float
    edge_share: float
    wall_deviation: float


class SeenCells(NamedTuple):
    """Heights that one image shows in the cells, arrays (n, n), 0 in cells that it does not see.

    Attributes:
        height: sums of the points' heights over the camera, then the ground's height in odom [m].
        variance: sums of the points' variances, then that of the height [m^2], what the whole
            image has in common apart.
        square: sums of squared heights over the camera [m^2].
        lowest, highest: of the points, over the camera; then `highest` is the upper edge of what
            the cell holds in odom, NaN for no edge [m].
        offset_x, offset_y: sums of the points' places from the cell's centre, then their mean, 0
            for an edge [m].
        points: in each cell.
        edge: 1 in a cell that holds an edge of the ground.
        touched: the cells that were seen, in order (n n,).
    """

    height: Array
    variance: Array
    square: Array
    lowest: Array
    highest: Array
    offset_x: Array
    offset_y: Array
    points: Array
    edge: Array
    touched: Indices


class PixelCounts(NamedTuple):
    """Counts of the pixels of an image by their fate.

    Attributes:
        used: points in cells.
        without_depth: pixels that have none, or one out of range.
        flying: pixels between two surfaces.
        of_robot: pixels that see the robot.
        outside: points beyond the map, or too high above the camera.
    """

    used: int
    without_depth: int
    flying: int
    of_robot: int
    outside: int


_USED, _WITHOUT_DEPTH, _FLYING, _OF_ROBOT, _OUTSIDE = range(5)
"""Fates of a pixel, in the order of `PixelCounts`."""


def no_seen_cells(count: int) -> SeenCells:
    """Return room for what an image says of `count` by `count` cells."""
    numbers = np.zeros((len(SeenCells._fields) - 1, count, count))
    return SeenCells._make((*numbers, np.zeros(count * count, dtype=np.int64)))


@njit(inline="always")
def _is_flying(inverse: Array, row: int, column: int, tolerance: float, share: float) -> bool:
    """Return whether too few neighbours of a pixel see the surface that it sees.

    Args:
        inverse: inverse depth [1/m], in which planes are straight and the noise of ground is even;
            0 where there is none.
        row: of the pixel.
        column: of the pixel.
        tolerance: difference of neighbours on one surface [1/m].
        share: of the neighbours that there must be.
    """
    rows, columns = inverse.shape
    own, known, near = inverse[row, column], 0, 0
    for r in range(max(0, row - 1), min(rows, row + 2)):
        for c in range(max(0, column - 1), min(columns, column + 2)):
            if inverse[r, c] > 0.0:
                known += 1
                near += abs(inverse[r, c] - own) < tolerance
    # Without the pixel itself.
    return near - 1 < share * (known - 1) or known == 1


@njit(inline="always")
def _is_in_capsule(capsules: Array, x: float, y: float, z: float) -> bool:
    """Return whether a point lies in one of the capsules (k, 7): two ends [m], radius [m]."""
    for k in range(len(capsules)):
        ax, ay, az = capsules[k, 0], capsules[k, 1], capsules[k, 2]
        bx, by, bz = capsules[k, 3] - ax, capsules[k, 4] - ay, capsules[k, 5] - az
        px, py, pz = x - ax, y - ay, z - az
        along = (px * bx + py * by + pz * bz) / max(bx * bx + by * by + bz * bz, 1e-12)
        along = min(1.0, max(0.0, along))
        px, py, pz = px - along * bx, py - along * by, pz - along * bz
        if px * px + py * py + pz * pz < capsules[k, 6] * capsules[k, 6]:
            return True
    return False


@njit(inline="always")
def _box_around(capsules: Array) -> tuple[Array, Array]:
    """Return the lowest and the highest corner (3,) [m] of a box that holds capsules (k, 7)."""
    lowest, highest = np.full(3, np.inf), np.full(3, -np.inf)
    for k in range(len(capsules)):
        for axis in range(3):
            for end in (capsules[k, axis], capsules[k, 3 + axis]):
                lowest[axis] = min(lowest[axis], end - capsules[k, 6])
                highest[axis] = max(highest[axis], end + capsules[k, 6])
    return lowest, highest


@njit(inline="always")
def _is_in_box(lowest: Array, highest: Array, x: float, y: float, z: float) -> bool:
    """Return whether a point lies between two corners (3,) [m]."""
    within: bool = lowest[0] < x < highest[0] and lowest[1] < y < highest[1]
    return within and lowest[2] < z < highest[2]


@njit(inline="always")
def _axial_deviation(depth: float, noise: DepthNoise) -> float:
    """Return the deviation of a depth [m] along the optical axis [m]."""
    return noise.axial_floor + noise.axial_growth * (depth - noise.axial_depth) ** 2


@njit(inline="always")
def _surface_tolerance(depth: float, drop: float, camera: CameraPose, noise: DepthNoise) -> float:
    """Return by how much neighbours on level ground may differ in inverse depth [1/m].

    Args:
        depth: of the pixel [m].
        drop: of the ground under the camera [m].
        camera: the camera.
        noise: its errors.
    """
    drop = max(drop, LEAST_DROP)
    tilt = math.hypot(camera.rotation[2, 0], camera.rotation[2, 1])
    axial = _axial_deviation(depth, noise) / (depth * depth)
    deviation = math.hypot(noise.lateral * tilt / drop, axial)
    pitch = 1.0 / min(camera.pinhole.fx, camera.pinhole.fy)
    return noise.edge_gate * math.sqrt(2.0) * deviation + pitch * tilt / drop


@njit(inline="always")
def _add(seen: SeenCells, found: int, cell: tuple[int, int], point: Vector, variance: float) -> int:
    """Add a point to its cell; return how many cells were seen until now.

    Args:
        seen: cells.
        found: how many were seen before.
        cell: of the point.
        point: from the cell's centre along x and y, and height over the camera [m].
        variance: of that height [m^2].
    """
    i, j = cell
    x, y, z = point
    if seen.points[i, j] == 0.0:
        seen.touched[found] = seen.points.shape[0] * i + j
        seen.lowest[i, j] = seen.highest[i, j] = z
        found += 1
    seen.points[i, j] += 1.0
    seen.height[i, j] += z
    seen.square[i, j] += z * z
    seen.lowest[i, j] = min(seen.lowest[i, j], z)
    seen.highest[i, j] = max(seen.highest[i, j], z)
    seen.variance[i, j] += variance
    seen.offset_x[i, j] += x
    seen.offset_y[i, j] += y
    return found


@njit(inline="always")
def _reduce(
    seen: SeenCells, found: int, lattice: Lattice, position: Array, wall_deviation: float
) -> None:
    """Turn the sums of the cells that were seen into heights and variances.

    Where heights differ by more than their noise, the cell holds an edge: its points are spread
    from the lower to the upper ground, sqrt(3) deviations to either side of their mean. The cell's
    centre lies on the upper ground if the points stand before it, else on the lower one.
    """
    for k in range(found):
        i, j = divmod(seen.touched[k], lattice.cells)
        n = seen.points[i, j]
        mean, noise = seen.height[i, j] / n, seen.variance[i, j] / n
        spread = max(0.0, seen.square[i, j] / n - mean * mean)
        excess = spread - noise
        significant = n >= 4 and excess > 3.0 * math.sqrt(2.0 / n) * noise
        seen.edge[i, j] = significant and excess > wall_deviation * wall_deviation
        edge_top = math.nan
        if seen.edge[i, j]:
            x = (lattice.x + i + 0.5) * lattice.resolution - position[0]
            y = (lattice.y + j + 0.5) * lattice.resolution - position[1]
            before = seen.offset_x[i, j] * x + seen.offset_y[i, j] * y < 0.0
            reach = math.sqrt(3.0 * excess)
            # The lowest of n points lies about so far below the ground, by noise alone.
            stray = math.sqrt(noise) * (0.7 + 0.4 * math.log(n))
            upper = min(mean + reach, seen.highest[i, j] - stray)
            lower = max(mean - reach, seen.lowest[i, j] + stray)
            mean, edge_top = upper if before else lower, position[2] + upper
            seen.offset_x[i, j] = seen.offset_y[i, j] = 0.0
        seen.offset_x[i, j] /= n
        seen.offset_y[i, j] /= n
        seen.height[i, j] = position[2] + mean
        seen.highest[i, j] = edge_top
        seen.variance[i, j] = max(noise, spread) / n


@njit(cache=True)
def gather(
    depth: DepthImage,
    inverse: Array,
    camera: CameraPose,
    noise: DepthNoise,
    lattice: Lattice,
    capsules: Array,
    seen: SeenCells,
) -> tuple[int, Indices]:
    """Write what a depth image says of the cells.

    The height of a point has the variance of its ray's direction, which moves it over the ground,
    and of its depth: (lateral d)^2 (R20^2 + R21^2) + axial^2 (drop / d)^2.

    Args:
        depth: the image.
        inverse: its inverse depth [1/m], 0 where there is none.
        camera: the camera.
        noise: its errors.
        lattice: of the map.
        capsules: (k, 7), what the robot fills: ends of a line in odom, radius [m].
        seen: written; holds zeros.

    Returns:
        How many cells were seen, and what became of the pixels, as `PixelCounts`.
    """
    fates = np.zeros(5, dtype=np.int64)
    size, r, position = lattice.resolution, camera.rotation, camera.position
    lateral = noise.lateral**2 * (r[2, 0] ** 2 + r[2, 1] ** 2)
    found = 0
    lowest, highest = _box_around(capsules)  # few points are near the legs
    for row in range(depth.shape[0]):
        v = (row - camera.pinhole.cy) / camera.pinhole.fy
        for column in range(depth.shape[1]):
            d = 0.001 * depth[row, column]
            if d < noise.least_depth or d > noise.most_depth:
                fates[_WITHOUT_DEPTH] += 1
                continue
            u = (column - camera.pinhole.cx) / camera.pinhole.fx
            x = position[0] + d * (r[0, 0] * u + r[0, 1] * v + r[0, 2])
            y = position[1] + d * (r[1, 0] * u + r[1, 1] * v + r[1, 2])
            z = d * (r[2, 0] * u + r[2, 1] * v + r[2, 2])
            i, j = math.floor(x / size) - lattice.x, math.floor(y / size) - lattice.y
            if not (0 <= i < lattice.cells and 0 <= j < lattice.cells) or z > noise.headroom:
                fates[_OUTSIDE] += 1
                continue
            tolerance = _surface_tolerance(d, -z, camera, noise)
            if _is_flying(inverse, row, column, tolerance, noise.edge_share):
                fates[_FLYING] += 1
                continue
            up = position[2] + z
            if _is_in_box(lowest, highest, x, y, up) and _is_in_capsule(capsules, x, y, up):
                fates[_OF_ROBOT] += 1
                continue
            fates[_USED] += 1
            variance = lateral * d * d + (_axial_deviation(d, noise) * z / d) ** 2
            x -= (lattice.x + i + 0.5) * size
            y -= (lattice.y + j + 0.5) * size
            found = _add(seen, found, (i, j), (x, y, z), variance)
    _reduce(seen, found, lattice, position, noise.wall_deviation)
    return found, fates
