"""Random worlds of 12 m: ridges, ditches, walls and crates, with a way to the goal."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from husky_sim.obstacle_site import APART, WALL_THICKNESS, ObstacleSite, fence
from husky_sim.obstacle_world import ObstacleWorld, Rectangle, Ridge, Square, UprightBox
from husky_sim.ramp import Ramp
from husky_sim.reachability import goal_is_reachable

SQUARE = Square(side=12.0, behind=1.5)
"""Square of these worlds."""
APPROACH = 2.0
"""Level ground before both feet of a ridge, over its whole width; the robot turns in it [m]."""

_BARRIER_SHARE = 0.5
"""Share of the worlds that have a barrier."""
_MOST_WORLDS = 100
"""Draws for a world with a way to its goal."""
_GOAL_X, _GOAL_Y = (7.5, 9.2), (-4.0, 4.0)
"""Ranges of the goal's position [m]."""
_SLOPE = math.radians(15.0), math.radians(45.0)
"""Inclination of ridges [rad]."""
_BLEND = 1.5
"""Radius of the arcs at the feet and crests of ridges [m]."""
_STRAIGHT, _TOP, _RIDGE_WIDTH = (0.1, 0.6), (1.0, 1.4), (2.0, 3.0)
"""Length of the straight part of a slope, length of the top, and width of a ridge [m]."""
_RIDGE_YAW = 0.3
"""Most that the heading of a ridge differs from x [rad]."""
_DITCH_LENGTH, _DITCH_WIDTH = (2.0, 5.0), (0.3, 0.8)
"""Of a ditch [m]."""
_WALL_LENGTH, _WALL_HEIGHT = (1.0, 4.0), (0.4, 1.0)
"""Of a wall [m]."""
_CRATE_EDGE, _CRATE_HEIGHT = (0.3, 0.8), (0.12, 0.6)
"""Of a crate [m]."""


def random_world(rng: np.random.Generator) -> ObstacleWorld:
    """Draw worlds until one has a way from its start to its goal.

    In about half of all worlds a barrier leaves only the way over a ridge; in the others a way on
    level ground exists. The same state of the generator gives the same world.

    Raises:
        RuntimeError: no world has a way after `_MOST_WORLDS` draws.
    """
    barrier = bool(rng.random() < _BARRIER_SHARE)
    for _ in range(_MOST_WORLDS):
        world = _Site(SQUARE, rng, barrier).world()
        if world is not None and goal_is_reachable(world, climbing=barrier):
            return world
    raise RuntimeError(f"none of {_MOST_WORLDS} worlds of obstacles has a way to its goal")


@dataclass
class _Site(ObstacleSite):
    """A world that is being drawn.

    Attributes:
        barrier: True if a barrier crosses the world.
    """

    barrier: bool

    def world(self) -> ObstacleWorld | None:
        """Draw the world; return None if no ridge, no ditch or not the barrier finds room."""
        rng, goal = self.rng, self.draw_goal(_GOAL_X, _GOAL_Y)
        ridges: list[Ridge | None] = []
        boxes: list[UprightBox | None] = [*fence(self.square.ground)]
        if self.barrier:
            crossing = self.ridge(yaw=0.0, last_x=goal.x - APART)
            if crossing is None:
                return None
            ridges.append(crossing)
            boxes += self.walls_beside(crossing)
        ridges += [self.ridge(_RIDGE_YAW) for _ in range(rng.integers(1, 3))]
        ditches = [self.ditch() for _ in range(rng.integers(1, 3))]
        boxes += [self.wall() for _ in range(rng.integers(2, 4))]
        boxes += [self.crate() for _ in range(rng.integers(3, 7))]
        if not any(ridges) or not any(ditches):
            return None
        return ObstacleWorld(
            tuple(ridge for ridge in ridges if ridge),
            tuple(box for box in boxes if box),
            tuple(ditch for ditch in ditches if ditch),
            goal,
            self.barrier,
            self.square,
        )

    def ridge(self, yaw: float, last_x: float = math.inf) -> Ridge | None:
        """Draw a ridge of a heading up to `yaw` from x [rad], its centre before `last_x` [m]."""
        flank = Ramp(self.between(_SLOPE), 0.0, _BLEND, self.between(_STRAIGHT), 0.0)
        length = 2.0 * flank.at(flank.slope_end + flank.arc).x + self.between(_TOP)
        size = length, self.between(_RIDGE_WIDTH)
        ground = self.place(size, yaw, spare=APPROACH - APART, last_x=last_x)
        return Ridge(ground, flank) if ground else None

    def walls_beside(self, ridge: Ridge) -> list[UprightBox]:
        """Draw walls from both sides of a ridge of yaw 0 to the fence, and take their ground."""
        ground, walls = ridge.ground, []
        for side in (-1.0, 1.0):
            near, far = ground.y + side * ground.width / 2, side * self.square.side / 2
            middle, width = (near + far) / 2, abs(far - near)
            wall = Rectangle(ground.x, middle, 0.0, WALL_THICKNESS, width)
            self.taken.append(wall)
            walls.append(UprightBox(wall, self.between(_WALL_HEIGHT)))
        return walls

    def ditch(self) -> Rectangle | None:
        """Draw a ditch along x or along y."""
        length, width = self.between(_DITCH_LENGTH), self.between(_DITCH_WIDTH)
        return self.place((length, width) if self.rng.random() < 0.5 else (width, length), 0.0)

    def wall(self) -> UprightBox | None:
        """Draw a wall of any heading."""
        ground = self.place((self.between(_WALL_LENGTH), WALL_THICKNESS), math.pi)
        return UprightBox(ground, self.between(_WALL_HEIGHT)) if ground else None

    def crate(self) -> UprightBox | None:
        """Draw a crate of any heading."""
        ground = self.place((self.between(_CRATE_EDGE), self.between(_CRATE_EDGE)), math.pi)
        return UprightBox(ground, self.between(_CRATE_HEIGHT)) if ground else None
