"""A world of obstacles: ridges to climb, ditches, walls and crates between a start and a goal.

A world is a square in a fence, with level ground at height 0. The robot starts at the origin and
faces +x. Positions, headings and heights are in world.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from husky_description.arrays import Array
from husky_sim.ramp import Place, Ramp

DITCH_DEPTH = 0.6
"""Depth of every ditch [m]."""
RIDGE_TURN = math.radians(5.0)
"""Most that one facet of a ridge's arcs turns [rad]; at a radius of 1.5 m it is 1.5 mm off the arc.
"""


Coordinates = Array | float
"""Coordinates of several points or of one [m]."""


class GroundPoint(NamedTuple):
    """A point on the ground, in world [m]."""

    x: float
    y: float


class GoalPose(NamedTuple):
    """A position [m] and a heading [rad] on the ground, in world."""

    x: float
    y: float
    yaw: float


@dataclass(frozen=True)
class Square:
    """Square within a fence; along y it reaches half a side to the left and to the right of start.

    Attributes:
        side: its edge [m].
        behind: distance from the start to the edge behind it [m].
    """

    side: float
    behind: float

    @property
    def first_x(self) -> float:
        """Its end behind the start [m]."""
        return -self.behind

    @property
    def last_x(self) -> float:
        """Its end ahead of the start [m]."""
        return self.side - self.behind

    @property
    def ground(self) -> Rectangle:
        """Its ground."""
        middle = (self.first_x + self.last_x) / 2
        return Rectangle(middle, 0.0, 0.0, self.side, self.side)


@dataclass(frozen=True)
class Rectangle:
    """Ground that an obstacle takes.

    Attributes:
        x: of its centre in world [m].
        y: of its centre in world [m].
        yaw: direction of its length in world [rad].
        length: edge along its heading [m].
        width: edge across its heading [m].
    """

    x: float
    y: float
    yaw: float
    length: float
    width: float

    @property
    def half_extent(self) -> GroundPoint:
        """Its half extent along x and y of world [m]."""
        return _half_extent(self.length, self.width, self.yaw)

    def at(self, along: float, across: float) -> GroundPoint:
        """Return the point at a distance along and across its heading from its centre [m]."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return GroundPoint(self.x + c * along - s * across, self.y + s * along + c * across)

    def along(self, x: Coordinates, y: Coordinates) -> Coordinates:
        """Return how far points lie from its centre along its heading [m]."""
        return math.cos(self.yaw) * (x - self.x) + math.sin(self.yaw) * (y - self.y)

    def across(self, x: Coordinates, y: Coordinates) -> Coordinates:
        """Return how far points lie from its centre to the left of its heading [m]."""
        return math.cos(self.yaw) * (y - self.y) - math.sin(self.yaw) * (x - self.x)

    def distance_to(self, x: Coordinates, y: Coordinates) -> Array:
        """Return how far points lie outside it [m], 0 inside."""
        outside_along = np.maximum(np.abs(self.along(x, y)) - self.length / 2, 0.0)
        outside_across = np.maximum(np.abs(self.across(x, y)) - self.width / 2, 0.0)
        distance: Array = np.hypot(outside_along, outside_across)
        return distance

    def gap_to(self, other: Rectangle) -> float:
        """Return the widest gap between two rectangles along an edge of either [m].

        They are at least that far apart; it is negative if they overlap.
        """
        return max(self._gap_along_edges(other), other._gap_along_edges(self))

    def _gap_along_edges(self, other: Rectangle) -> float:
        """Return the wider one of the gaps along its length and along its width [m]."""
        x, y = other.x - self.x, other.y - self.y
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        half_x, half_y = _half_extent(other.length, other.width, other.yaw - self.yaw)
        return max(
            abs(c * x + s * y) - self.length / 2 - half_x,
            abs(c * y - s * x) - self.width / 2 - half_y,
        )

    def lengthened(self, by: float) -> Rectangle:
        """Return a rectangle that reaches further at both ends of its length [m]."""
        return replace(self, length=self.length + 2.0 * by)


def _half_extent(length: float, width: float, yaw: float) -> GroundPoint:
    """Return how far a rectangle at the origin reaches along x and y [m]."""
    c, s = abs(math.cos(yaw)), abs(math.sin(yaw))
    return GroundPoint((c * length + s * width) / 2, (s * length + c * width) / 2)


@dataclass(frozen=True)
class Ridge:
    """A slope up, level ground and the same slope down, with arcs between them and upright sides.

    Attributes:
        ground: that it takes; the robot climbs it along its length, from either end.
        flank: profile of both slopes, from the foot to the end of the crest.
    """

    ground: Rectangle
    flank: Ramp

    @property
    def slope(self) -> float:
        """Inclination of both slopes [rad]."""
        return self.flank.slope

    @property
    def run(self) -> float:
        """Distance from the foot to the end of the crest, seen from above [m]."""
        return self.flank.at(self.flank.slope_end + self.flank.arc).x

    @property
    def height(self) -> float:
        """Height of its top [m]."""
        return self.flank.at(self.flank.slope_end + self.flank.arc).z

    @property
    def outline(self) -> list[Place]:
        """Corners of one flank: distance from the foot, seen from above, and height [m]."""
        facets = self.flank.facets(RIDGE_TURN)
        return [facets[0][0], *(end for _, end in facets)]

    def ends(self, distance: float) -> tuple[GroundPoint, GroundPoint]:
        """Return the points on its centre line at a distance before its two feet [m]."""
        reach = self.ground.length / 2 + distance
        return self.ground.at(-reach, 0.0), self.ground.at(reach, 0.0)

    def height_at(self, x: Coordinates, y: Coordinates) -> Array:
        """Return the heights of its surface at points [m], 0 beside it."""
        runs, heights = zip(*self.outline, strict=True)
        from_foot = self.ground.length / 2 - np.abs(self.ground.along(x, y))
        beside = np.abs(self.ground.across(x, y)) > self.ground.width / 2
        surface: Array = np.where(beside, 0.0, np.interp(from_foot, runs, heights))
        return surface


@dataclass(frozen=True)
class UprightBox:
    """A crate, a wall or a side of the fence: a box with a level top on the ground.

    Attributes:
        ground: that it takes.
        height: [m].
    """

    ground: Rectangle
    height: float


@dataclass(frozen=True)
class ObstacleWorld:
    """Obstacles, and the goal of a robot that starts at the origin.

    Attributes:
        ridges: the first crosses the barrier, if there is one.
        boxes: crates, walls and the fence.
        ditches: their openings, of yaw 0; they have upright sides.
        goal: of the robot.
        barrier: True if walls or boxes from fence to fence leave no way to the goal on level
            ground.
        square: within the fence.
    """

    ridges: tuple[Ridge, ...]
    boxes: tuple[UprightBox, ...]
    ditches: tuple[Rectangle, ...]
    goal: GoalPose
    barrier: bool
    square: Square

    @property
    def grounds(self) -> list[Rectangle]:
        """Ground that is not level: that of all ridges, boxes and ditches."""
        ridges, boxes = ([each.ground for each in kind] for kind in (self.ridges, self.boxes))
        return [*ridges, *boxes, *self.ditches]

    def height_at(self, x: Coordinates, y: Coordinates) -> Array:
        """Return the heights of the surface at points within the fence [m]."""
        surface: Array = np.zeros(np.broadcast(x, y).shape)
        for ditch in self.ditches:
            surface = np.where(ditch.distance_to(x, y) == 0.0, -DITCH_DEPTH, surface)
        for box in self.boxes:
            surface = np.where(box.ground.distance_to(x, y) == 0.0, box.height, surface)
        for ridge in self.ridges:
            height = ridge.height_at(x, y)
            surface = np.where(height > 0.0, height, surface)
        return surface
