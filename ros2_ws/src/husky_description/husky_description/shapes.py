"""Primitive shapes of a look: boxes, cylinders, spheres and rings, placed in a link's frame."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from husky_description.arrays import Array
from husky_description.rotation import from_roll_pitch_yaw, rotate

Vector = Sequence[float] | Array

ORIGIN = (0.0, 0.0, 0.0)
ALONG_X = (0.0, math.pi / 2, 0.0)
ALONG_Y = (math.pi / 2, 0.0, 0.0)
ALONG_Z = ORIGIN


@dataclass(frozen=True)
class Shape:
    """One primitive.

    Attributes:
        kind: `box`, `cylinder`, `sphere` or `ring`; the last three about their z.
        size: Edges x, y, z of a box; radius, length of a cylinder; radius of a sphere;
            inner radius, outer radius, length of a ring [m].
        position: Centre in the link's frame [m] (3,).
        rpy: Fixed-axis roll, pitch, yaw in the link's frame, as in URDF [rad] (3,).
        material: Name of a material of the look.
    """

    kind: str
    size: tuple[float, ...]
    position: tuple[float, ...]
    rpy: tuple[float, ...]
    material: str


def box(material: str, position: Vector, size: Vector, rpy: Vector = ORIGIN) -> Shape:
    """Box with edges `size` [m] (3,)."""
    return Shape("box", _floats(size), _floats(position), _floats(rpy), material)


def disc(
    material: str, position: Vector, radius: float, length: float, rpy: Vector = ALONG_Y
) -> Shape:
    """Cylinder about y, or about the z of `rpy`; `radius` and `length` [m]."""
    return Shape("cylinder", _floats((radius, length)), _floats(position), _floats(rpy), material)


def ball(material: str, position: Vector, radius: float) -> Shape:
    """Sphere of `radius` [m]."""
    return Shape("sphere", _floats((radius,)), _floats(position), ORIGIN, material)


def ring(material: str, position: Vector, inner: float, outer: float, length: float) -> Shape:
    """Tube wall about z between the radii `inner` and `outer` [m]."""
    return Shape("ring", _floats((inner, outer, length)), _floats(position), ORIGIN, material)


def tube(material: str, start: Vector, end: Vector, radius: float) -> Shape:
    """Cylinder between two points [m] (3,)."""
    line = np.asarray(end, dtype=float) - np.asarray(start, dtype=float)
    middle = (np.asarray(end, dtype=float) + np.asarray(start, dtype=float)) / 2
    pitch = math.atan2(math.hypot(line[0], line[1]), line[2])
    rpy = (0.0, pitch, math.atan2(line[1], line[0]))
    return disc(material, middle, radius, float(np.linalg.norm(line)), rpy)


def moved(shapes: Iterable[Shape], offset: Vector) -> list[Shape]:
    """The same shapes, displaced by `offset` [m] (3,)."""
    return [replace(s, position=_floats(np.add(s.position, offset))) for s in shapes]


def without_rings(shapes: Iterable[Shape], sectors: int = 16) -> list[Shape]:
    """The same shapes, each ring made of `sectors` boxes, for formats that know no ring."""
    result = []
    for shape in shapes:
        if shape.kind != "ring":
            result.append(shape)
            continue
        inner, outer, length = shape.size
        middle = (inner + outer) / 2
        edge = 2 * outer * math.tan(math.pi / sectors)
        for angle in 2 * math.pi * np.arange(sectors) / sectors:
            center = np.add(shape.position, [middle * math.cos(angle), middle * math.sin(angle), 0])
            result.append(
                box(shape.material, center, (outer - inner, edge, length), (0, 0, float(angle)))
            )
    return result


def rotation_of(rpy: Vector) -> Array:
    """Rotation matrix (3, 3) of fixed-axis roll, pitch, yaw [rad] (3,)."""
    roll, pitch, yaw = _floats(rpy)
    turn = from_roll_pitch_yaw(roll, pitch, yaw)
    return np.column_stack([rotate(turn, axis) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1))])


def _floats(values: Vector) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
