"""Compiled casting of a pinhole's rays at MuJoCo's geoms; each ray finds what `mj_ray` finds.

`mj_multiRay` asks each ray about each geom, of which rough ground has 1300. Here the bounding
sphere of a geom tells the pixels that may see it, and the rays of these alone are asked.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.plain_mujoco import mujoco
from husky_description.vectors import Vector, difference, transposed_product, vector

_PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
_SPHERE = int(mujoco.mjtGeom.mjGEOM_SPHERE)
_CAPSULE = int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_CYLINDER = int(mujoco.mjtGeom.mjGEOM_CYLINDER)
_BOX = int(mujoco.mjtGeom.mjGEOM_BOX)
SHAPES = {
    _PLANE: "plane",
    _SPHERE: "sphere",
    _CAPSULE: "capsule",
    _CYLINDER: "cylinder",
    _BOX: "box",
}
"""Shapes that rays see, by MuJoCo's number of their type."""

_MISS = math.inf, -math.inf
"""Interval of a ray that does not meet a shape."""
_PARALLEL = 1e-15
"""Slope of a ray, or its square, below which the ray never meets a face or a cylinder's side."""

Interval = tuple[float, float]
"""Depths at which a ray enters a shape and leaves it; the first is greater for a miss."""


class Geoms(NamedTuple):
    """Geoms that rays see; position and axes are views of MuJoCo's own arrays.

    Attributes:
        seen: places of these geoms in the arrays of all (n,).
        kind: of all geoms, numbers of `SHAPES` (m,).
        size: of all, as MuJoCo has it for each shape [m] (m, 3).
        bound: radii of all geoms' bounding spheres, 0 for a plane [m] (m,).
        position: of all in world [m] (m, 3).
        axes: of all in world, row by row (m, 9).
    """

    seen: NDArray[np.intp]
    kind: NDArray[np.int32]
    size: Array
    bound: Array
    position: Array
    axes: Array


def geoms_of(model: mujoco.MjModel, data: mujoco.MjData, seen: NDArray[np.bool_]) -> Geoms:
    """Return the geoms of a world that are seen; `data` is the one that `cast` will look at.

    Args:
        model: of the world.
        data: of the world.
        seen: whether rays see a geom, of all geoms (m,).

    Raises:
        ValueError: a geom that is seen has a shape that rays cannot meet.
    """
    for index in np.flatnonzero(seen).tolist():
        if int(model.geom_type[index]) not in SHAPES:
            shape = mujoco.mjtGeom(model.geom_type[index]).name.removeprefix("mjGEOM_").lower()
            raise ValueError(
                f"geom {model.geom(index).name!r} has the shape {shape}, the depth camera sees "
                f"{', '.join(SHAPES.values())} only"
            )
    return Geoms(
        np.flatnonzero(seen),
        model.geom_type,
        model.geom_size,
        model.geom_rbound,
        data.geom_xpos,
        data.geom_xmat,
    )


@njit(cache=True, nogil=True)
def cast(
    geoms: Geoms, slopes: tuple[Array, Array], position: Array, axes: Array, depth: Array
) -> None:
    """Write the depth along the optical axis at which each ray meets a geom first, inf for none.

    Args:
        geoms: what there is.
        slopes: of the rays, from `Intrinsics.slopes` (width,), (height,).
        position: of the lens in world [m] (3,).
        axes: of the lens in world: x along the view, y to the left, z up (3, 3).
        depth: written [m] (height, width).
    """
    depth[:] = math.inf
    lens = vector(position)
    right, below = slopes
    for index in geoms.seen:
        frame = geoms.axes[index].reshape(3, 3)
        center = vector(geoms.position[index])
        kind, size = geoms.kind[index], vector(geoms.size[index])
        first_row, end_row, first, end = 0, len(below), 0, len(right)
        if kind != _PLANE:
            ahead, left, up = transposed_product(axes, difference(center, lens))
            bound = geoms.bound[index]
            first, end = _window(ahead, -left, bound, right)
            first_row, end_row = _window(ahead, -up, bound, below)
        # Everything else in the geom's own frame, per metre of depth.
        start = transposed_product(frame, difference(lens, center))
        view = transposed_product(frame, vector(axes[:, 0]))
        leftward = transposed_product(frame, vector(axes[:, 1]))
        upward = transposed_product(frame, vector(axes[:, 2]))
        for row in range(first_row, end_row):
            along = _less(view, below[row], upward)
            for column in range(first, end):
                ray = _less(along, right[column], leftward)
                enter, leave = _meet(kind, size, start, ray)
                if enter > leave or leave < 0.0:
                    continue
                # From within a shape the other side is seen, as by mj_ray.
                depth[row, column] = min(depth[row, column], enter if enter >= 0.0 else leave)


@njit(cache=True)
def _less(a: Vector, factor: float, b: Vector) -> Vector:
    """Return a - factor b."""
    return a[0] - factor * b[0], a[1] - factor * b[1], a[2] - factor * b[2]


@njit(cache=True)
def _window(ahead: float, aside: float, bound: float, slopes: Array) -> tuple[int, int]:
    """Return the first pixel of a row or column that may see a sphere, and one behind the last.

    Args:
        ahead: of the lens, where the sphere's centre is [m].
        aside: in the direction in which slopes rise [m].
        bound: radius of the sphere [m].
        slopes: of the pixels' rays, equally spaced.
    """
    count = len(slopes)
    if ahead + bound <= 0.0:
        return 0, 0
    distance = math.hypot(ahead, aside)
    if distance <= bound:
        return 0, count
    middle, half = math.atan2(aside, ahead), math.asin(bound / distance)
    low, high = middle - half, middle + half
    spacing = slopes[1] - slopes[0]
    first, end = 0, count
    if low > -0.5 * math.pi:
        if low >= 0.5 * math.pi:
            return 0, 0
        first = max(0, min(count, math.floor((math.tan(low) - slopes[0]) / spacing)))
    if high < 0.5 * math.pi:
        if high <= -0.5 * math.pi:
            return 0, 0
        end = max(0, min(count, math.ceil((math.tan(high) - slopes[0]) / spacing) + 1))
    return first, end


@njit(cache=True)
def _meet(kind: int, size: Vector, start: Vector, ray: Vector) -> Interval:
    """Return where a ray is inside a shape; all in the shape's frame, sizes as MuJoCo has them."""
    if kind == _BOX:
        x = _between(size[0], start[0], ray[0])
        y = _between(size[1], start[1], ray[1])
        z = _between(size[2], start[2], ray[2])
        return max(x[0], y[0], z[0]), min(x[1], y[1], z[1])
    if kind == _PLANE:
        return _meet_plane(size, start, ray)
    if kind == _SPHERE:
        return _meet_sphere(size[0], 0.0, start, ray)
    across, along = _meet_tube(size[0], start, ray), _between(size[1], start[2], ray[2])
    enter, leave = max(across[0], along[0]), min(across[1], along[1])
    if kind == _CYLINDER:
        return enter, leave
    # A capsule is a cylinder with a sphere at each end, without gaps in between.
    top = _meet_sphere(size[0], size[1], start, ray)
    bottom = _meet_sphere(size[0], -size[1], start, ray)
    if enter > leave:
        enter, leave = _MISS
    return min(enter, top[0], bottom[0]), max(leave, top[1], bottom[1])


@njit(cache=True)
def _between(half: float, start: float, slope: float) -> Interval:
    """Return where a ray is between two faces at minus and plus `half`."""
    if abs(slope) < _PARALLEL:
        return (-math.inf, math.inf) if abs(start) <= half else _MISS
    one, other = (-half - start) / slope, (half - start) / slope
    return min(one, other), max(one, other)


@njit(cache=True)
def _roots(a: float, half_b: float, c: float) -> Interval:
    """Return between which depths a t^2 + 2 half_b t + c is not positive."""
    if a < _PARALLEL:  # along the axis of a cylinder
        return (-math.inf, math.inf) if c <= 0.0 else _MISS
    discriminant = half_b * half_b - a * c
    if discriminant < 0.0:
        return _MISS
    root = math.sqrt(discriminant)
    return (-half_b - root) / a, (-half_b + root) / a


@njit(cache=True)
def _meet_tube(radius: float, start: Vector, ray: Vector) -> Interval:
    """Return where a ray is inside a cylinder along z without ends."""
    return _roots(
        ray[0] * ray[0] + ray[1] * ray[1],
        ray[0] * start[0] + ray[1] * start[1],
        start[0] * start[0] + start[1] * start[1] - radius * radius,
    )


@njit(cache=True)
def _meet_sphere(radius: float, height: float, start: Vector, ray: Vector) -> Interval:
    """Return where a ray is inside a sphere, whose centre is at a height on z."""
    z = start[2] - height
    return _roots(
        ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2],
        ray[0] * start[0] + ray[1] * start[1] + ray[2] * z,
        start[0] * start[0] + start[1] * start[1] + z * z - radius * radius,
    )


@njit(cache=True)
def _meet_plane(size: Vector, start: Vector, ray: Vector) -> Interval:
    """Return where a ray goes through a plane from its front, once; a size of 0 is endless."""
    if ray[2] > -_PARALLEL or start[2] < 0.0:
        return _MISS
    at = -start[2] / ray[2]
    if size[0] > 0.0 and abs(start[0] + at * ray[0]) > size[0]:
        return _MISS
    if size[1] > 0.0 and abs(start[1] + at * ray[1]) > size[1]:
        return _MISS
    return at, at
