"""The simulated ground to look at: told once, latched, in the frame of the world."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from geometry_msgs.msg import Point
from rclpy.node import Node
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from husky_description.arrays import Array
from husky_description.plain_mujoco import mujoco
from husky_runtime import graph
from husky_runtime.nodes import qos
from husky_sim.scene import GROUND_COLOURS
from husky_sim.terrain import FLOOR

_REACH = 100
"""How far a plane is drawn from its middle to each side [m]."""
_SQUARES = 20
"""How far it has squares of 1 m in its second colour [m]."""
_DARKER = 0.9
"""Share of its colour that is left to a square."""
_THICKNESS = 0.02
"""Of a plane as it is drawn, and of the squares [m]."""
_LIFT = 0.002
"""Of the squares above their plane, or both would be seen [m]."""


class GroundMarkers:
    """Tells the ground of a model; who comes later is told too."""

    def __init__(self, node: Node, model: mujoco.MjModel):
        """Tell it."""
        self._publisher = node.create_publisher(MarkerArray, graph.TERRAIN, qos.LATCHED)
        self._publisher.publish(MarkerArray(markers=ground_markers(model)))


def ground_markers(model: mujoco.MjModel) -> list[Marker]:
    """Return the planes and boxes of a model's ground as boxes in the world."""
    markers = list(_markers(model))
    for number, marker in enumerate(markers):
        marker.id = number
    return markers


def _markers(model: mujoco.MjModel) -> Iterator[Marker]:
    for index in range(model.ngeom):
        geom = model.geom(index)
        if not geom.name.startswith(FLOOR):
            continue
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, geom.quat)
        up = rotation[2::3]
        first, second = GROUND_COLOURS[model.mat(int(geom.matid[0])).name]
        if geom.type[0] == mujoco.mjtGeom.mjGEOM_PLANE:
            middle = geom.pos - up * _THICKNESS / 2
            size = (2.0 * _REACH, 2.0 * _REACH, _THICKNESS)
            yield _marker(Marker.CUBE, middle, geom.quat, size, first)
            middle, size = middle + up * _LIFT, (1.0, 1.0, _THICKNESS)
            darker = [_DARKER * part for part in second]  # as viewers have more light
            squares = _marker(Marker.CUBE_LIST, middle, geom.quat, size, darker)
            squares.points = [Point(x=x, y=y) for x, y in _squares()]
            yield squares
        else:
            yield _marker(Marker.CUBE, geom.pos, geom.quat, 2.0 * geom.size, first)


def _marker(
    kind: int, place: Array, turn: Array, size: Sequence[float] | Array, colour: Sequence[float]
) -> Marker:
    """Return a marker in the world.

    Args:
        kind: a constant of Marker.
        place: of its middle [m] (3,).
        turn: quaternion (w, x, y, z).
        size: of its edges [m] (3,).
        colour: red, green, blue.
    """
    marker = Marker(type=kind, ns="ground", action=Marker.ADD)
    marker.header.frame_id = graph.FRAME_WORLD
    position, q, scale = marker.pose.position, marker.pose.orientation, marker.scale
    position.x, position.y, position.z = map(float, place)
    q.w, q.x, q.y, q.z = map(float, turn)
    scale.x, scale.y, scale.z = map(float, size)
    red, green, blue = colour
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=1.0)
    return marker


def _squares() -> Iterator[tuple[float, float]]:
    """Yield the middles of every other square."""
    for x in range(-_SQUARES, _SQUARES):
        for y in range(-_SQUARES, _SQUARES):
            if (x + y) % 2:
                yield x + 0.5, y + 0.5
