"""The place on the ground that is under the mouse: rays against triangles."""

from __future__ import annotations

import numpy as np

from husky_bringup.console.frame_tree import Pose
from husky_description.arrays import Array
from husky_description.link_frames import inverse
from husky_description.rotation import rotate


def moved_ray(ray: Array, pose: Pose) -> Array:
    """Return a ray, origin [m] and direction (2, 3), of a frame in that one where it has a pose."""
    turn = pose[3], pose[4], pose[5], pose[6]
    origin, direction = (rotate(turn, (each[0], each[1], each[2])) for each in ray.tolist())
    return np.array((np.add(origin, pose[:3]), direction))


def first_hit(ray: Array, triangles: Array, frame: Pose) -> float:
    """Return how far a ray goes to the first of some triangles, in lengths of its direction.

    By Moeller and Trumbore, Fast, minimum storage ray-triangle intersection (1997).

    Args:
        ray: origin and direction (2, 3).
        triangles: corners (n, 3, 3) in another frame.
        frame: pose of that frame in the ray's.

    Returns:
        The way, infinite where it hits none.
    """
    origin, direction = moved_ray(ray, inverse(frame))
    corner = triangles[:, 0]
    first, second = triangles[:, 1] - corner, triangles[:, 2] - corner
    normal, start = np.cross(direction, second), origin - corner
    across = np.cross(start, first)
    with np.errstate(divide="ignore", invalid="ignore"):  # of triangles along the ray
        share = 1.0 / np.einsum("ij,ij->i", first, normal)
        u, v = share * np.einsum("ij,ij->i", start, normal), share * (across @ direction)
        way = share * np.einsum("ij,ij->i", second, across)
        hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (way > 0.0)
    return float(way[hit].min(initial=np.inf))
