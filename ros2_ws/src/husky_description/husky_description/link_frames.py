"""Where the links of a URDF are, joint by joint, as robot_state_publisher has it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np

from husky_description.arrays import Array
from husky_description.rotation import (
    Quaternion,
    conjugate,
    from_roll_pitch_yaw,
    multiply,
    rotate,
)

Edge = tuple[str, str]
"""A frame and its child."""

_TURNING = ("revolute", "continuous")


class LinkFrames:
    """The transforms of a URDF's joints: those that never change, and those that turn.

    A transform is the pose of the child in its parent: position x, y, z [m], quaternion
    (x, y, z, w).

    Attributes:
        fixed_edges: parent and child link of each fixed joint.
        fixed: their transforms (n, 7).
        moving_edges: parent and child link of each turning joint, in the URDF's order.
        joint_names: of the turning joints, in the same order.
    """

    def __init__(self, urdf: str):
        """Read the joints.

        Raises:
            ValueError: a joint is neither fixed nor turns by itself.
        """
        joints = ElementTree.fromstring(urdf).findall("joint")
        fixed, turning = [], []
        for joint in joints:
            kind = joint.get("type", "")
            if kind == "fixed":
                fixed.append(joint)
            elif kind in _TURNING and joint.find("mimic") is None:
                turning.append(joint)
            else:
                raise ValueError(
                    f"joint {joint.get('name')} is {kind} or a mimic, "
                    f"it must be fixed, {' or '.join(_TURNING)}"
                )
        self.fixed_edges = [_edge(joint) for joint in fixed]
        self.fixed = np.array([_origin(joint) for joint in fixed]).reshape(-1, 7)
        self.moving_edges = [_edge(joint) for joint in turning]
        self.joint_names = tuple(str(joint.get("name")) for joint in turning)
        # A turn by the angle a about the unit axis u after the fixed q is q (u sin a/2, cos a/2):
        # linear in sine and cosine.
        self._transforms = np.array([_origin(joint) for joint in turning]).reshape(-1, 7)
        self._cosine = self._transforms[:, 3:].copy()
        self._sine = np.array(
            [
                multiply(_quaternion(q), (*_axis(joint), 0.0))
                for q, joint in zip(self._cosine, turning, strict=True)
            ]
        ).reshape(-1, 4)

    def moving(self, position: Array) -> Array:
        """Return the transforms of the turning joints (n, 7); the array is reused.

        Args:
            position: their angles, in the order of `joint_names` [rad] (n,).
        """
        half = 0.5 * position[:, None]
        self._transforms[:, 3:] = np.cos(half) * self._cosine + np.sin(half) * self._sine
        return self._transforms


def inverse(transform: Sequence[float]) -> tuple[float, ...]:
    """Return the transform the other way: the parent's pose in the child, as 7 numbers."""
    px, py, pz, *rotation = (float(value) for value in transform)
    x, y, z, w = rotation
    back = conjugate((x, y, z, w))
    return (*rotate(back, (-px, -py, -pz)), *back)


def transform_of(position: Sequence[float], rpy: Sequence[float]) -> tuple[float, ...]:
    """Return a transform of a position [m] and fixed-axis roll, pitch, yaw [rad], as in URDF."""
    roll, pitch, yaw = map(float, rpy)
    return (*map(float, position), *from_roll_pitch_yaw(roll, pitch, yaw))


def _edge(joint: ElementTree.Element) -> Edge:
    parent, child = joint.find("parent"), joint.find("child")
    assert parent is not None and child is not None
    return str(parent.get("link")), str(child.get("link"))


def _numbers(element: ElementTree.Element | None, name: str, default: str) -> list[float]:
    text = default if element is None else element.get(name, default)
    return [float(value) for value in text.split()]


def _origin(joint: ElementTree.Element) -> tuple[float, ...]:
    origin = joint.find("origin")
    return transform_of(_numbers(origin, "xyz", "0 0 0"), _numbers(origin, "rpy", "0 0 0"))


def _axis(joint: ElementTree.Element) -> tuple[float, float, float]:
    x, y, z = _numbers(joint.find("axis"), "xyz", "1 0 0")
    length = math.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


def _quaternion(values: Array) -> Quaternion:
    x, y, z, w = values.tolist()
    return x, y, z, w
