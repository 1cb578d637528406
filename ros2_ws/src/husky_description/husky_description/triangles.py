"""Primitive shapes as triangles, with their normals outward and their edges sharp."""

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.shapes import Shape, rotation_of

Faces = NDArray[np.int32]
Patch = tuple[Array, Faces]

SECTORS = 28
"""Sides of the prism that stands for a cylinder."""


def triangulate(shapes: Iterable[Shape]) -> Patch:
    """Vertices [m] (n, 3) in the link's frame and faces (m, 3), counter-clockwise from outside.

    Vertices are shared within a smooth surface only, so that normals averaged over the faces of
    a vertex keep the edges sharp.
    """
    patches: list[Patch] = []
    for shape in shapes:
        rotation = rotation_of(shape.rpy)
        patches += [(v @ rotation.T + shape.position, faces) for v, faces in _patches(shape)]
    vertices, faces = join(patches)
    return vertices, _with_area(vertices, faces)


def join(patches: Iterable[Patch]) -> Patch:
    """One set of vertices and faces from several."""
    vertices: list[Array] = [np.zeros((0, 3))]
    faces: list[Faces] = [np.zeros((0, 3), dtype=np.int32)]
    total = 0
    for patch_vertices, patch_faces in patches:
        vertices.append(patch_vertices)
        faces.append(patch_faces + np.int32(total))
        total += len(patch_vertices)
    return np.concatenate(vertices), np.concatenate(faces)


def _patches(shape: Shape) -> list[Patch]:
    if shape.kind == "box":
        return _box(np.array(shape.size) / 2)
    if shape.kind == "cylinder":
        radius, length = shape.size
        return [
            _wall(radius, length, outward=True),
            _cap(0.0, radius, length / 2, upward=True),
            _cap(0.0, radius, -length / 2, upward=False),
        ]
    if shape.kind == "ring":
        inner, outer, length = shape.size
        return [
            _wall(outer, length, outward=True),
            _wall(inner, length, outward=False),
            _cap(inner, outer, length / 2, upward=True),
            _cap(inner, outer, -length / 2, upward=False),
        ]
    if shape.kind == "sphere":
        return [_sphere(shape.size[0])]
    raise ValueError(f"unknown kind of shape: {shape.kind!r}")


def _box(half: Array) -> list[Patch]:
    patches = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for sign in (-1.0, 1.0):
            corners = np.zeros((4, 3))
            corners[:, axis] = sign * half[axis]
            corners[:, u] = half[u] * np.array([-1, 1, 1, -1])
            corners[:, v] = half[v] * np.array([-1, -1, 1, 1])
            patches.append((corners, _facing(np.array([[0, 1, 2], [0, 2, 3]]), sign > 0)))
    return patches


def _circle(radius: float, z: float) -> Array:
    angle = 2 * math.pi * np.arange(SECTORS) / SECTORS
    return np.column_stack(
        (radius * np.cos(angle), radius * np.sin(angle), np.full(SECTORS, float(z)))
    )


def _band(first: int, second: int) -> Faces:
    """Faces between two circles of vertices that begin at `first` and `second`."""
    i = np.arange(SECTORS)
    j = (i + 1) % SECTORS
    lower = np.column_stack((first + i, first + j, second + j))
    upper = np.column_stack((first + i, second + j, second + i))
    return np.concatenate((lower, upper)).astype(np.int32)


def _wall(radius: float, length: float, outward: bool) -> Patch:
    vertices = np.concatenate((_circle(radius, -length / 2), _circle(radius, length / 2)))
    return vertices, _facing(_band(0, SECTORS), outward)


def _cap(inner: float, outer: float, z: float, upward: bool) -> Patch:
    vertices = np.concatenate((_circle(outer, z), _circle(inner, z)))
    return vertices, _facing(_band(0, SECTORS), upward)


def _sphere(radius: float) -> Patch:
    rows = SECTORS // 2
    latitudes = np.pi * (np.arange(rows + 1) / rows - 0.5)
    circles = [_circle(radius * math.cos(t), radius * math.sin(t)) for t in latitudes]
    faces = [_band(row * SECTORS, (row + 1) * SECTORS) for row in range(rows)]
    return np.concatenate(circles), np.concatenate(faces)


def _with_area(vertices: Array, faces: Faces) -> Faces:
    """The faces without those that the poles of a sphere and the middle of a disc collapse."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    kept: Faces = faces[twice_area > 1e-12]
    return kept


def _facing(faces: NDArray[np.integer], outward: bool) -> Faces:
    ordered = faces if outward else faces[:, ::-1]
    return np.ascontiguousarray(ordered, dtype=np.int32)
