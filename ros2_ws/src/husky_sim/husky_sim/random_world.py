"""Random worlds of obstacles, each with a way to its goal."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from husky_sim.obstacle_world import (
    FIRST_X,
    LAST_X,
    SIDE,
    GoalPose,
    GroundPoint,
    ObstacleWorld,
    Rectangle,
    Ridge,
    UprightBox,
)
from husky_sim.ramp import Ramp
from husky_sim.reachability import goal_is_reachable

APART = 1.2
"""Least distance of an obstacle from start, goal, fence and every other obstacle [m]."""
APPROACH = 2.0
"""Level ground before both feet of a ridge, over its whole width; the robot turns in it [m]."""

_BARRIER_SHARE = 0.5
"""Share of the worlds that have a barrier."""
_MOST_WORLDS = 100
"""Draws for a world with a way to its goal."""
_MOST_SPOTS = 150
"""Draws for a free spot before an obstacle is left out."""
_GOAL_X, _GOAL_Y = (7.5, 9.2), (-4.0, 4.0)
"""Ranges of the goal's position [m]."""
_FENCE_HEIGHT, _WALL_THICKNESS = 0.6, 0.15
"""[m]"""
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

Range = tuple[float, float]
"""Least and greatest value of a uniform distribution."""


def random_world(rng: np.random.Generator) -> ObstacleWorld:
    """Draw worlds until one has a way from its start to its goal.

    In about half of all worlds a barrier leaves only the way over a ridge; in the others a way on
    level ground exists. The same state of the generator gives the same world.

    Raises:
        RuntimeError: no world has a way after `_MOST_WORLDS` draws.
    """
    barrier = bool(rng.random() < _BARRIER_SHARE)
    for _ in range(_MOST_WORLDS):
        world = _Site(rng, barrier).world()
        if world is not None and goal_is_reachable(world, climbing=barrier):
            return world
    raise RuntimeError(f"none of {_MOST_WORLDS} worlds of obstacles has a way to its goal")


@dataclass
class _Site:
    """A world that is being drawn.

    Attributes:
        rng: generator of everything about it.
        barrier: True if a barrier crosses the world.
        goal: of the robot.
        taken: ground that keeps its distance from what is placed next.
    """

    rng: np.random.Generator
    barrier: bool
    goal: GoalPose = field(init=False)
    taken: list[Rectangle] = field(init=False)

    def __post_init__(self) -> None:
        """Draw the goal; keep obstacles away from it and from the start."""
        yaw = self.between((-math.pi, math.pi))
        self.goal = GoalPose(self.between(_GOAL_X), self.between(_GOAL_Y), yaw)
        ends = GroundPoint(0.0, 0.0), GroundPoint(self.goal.x, self.goal.y)
        self.taken = [Rectangle(*end, 0.0, 0.0, 0.0) for end in ends]

    def world(self) -> ObstacleWorld | None:
        """Draw all obstacles; return None if no ridge, no ditch or not the barrier finds room."""
        rng = self.rng
        ridges: list[Ridge | None] = []
        boxes: list[UprightBox | None] = [*fence()]
        if self.barrier:
            crossing = self.ridge(yaw=0.0, last_x=self.goal.x - APART)
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
            self.goal,
            self.barrier,
        )

    def ridge(self, yaw: float, last_x: float = LAST_X) -> Ridge | None:
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
            near, far = ground.y + side * ground.width / 2, side * SIDE / 2
            middle, width = (near + far) / 2, abs(far - near)
            wall = Rectangle(ground.x, middle, 0.0, _WALL_THICKNESS, width)
            self.taken.append(wall)
            walls.append(UprightBox(wall, self.between(_WALL_HEIGHT)))
        return walls

    def ditch(self) -> Rectangle | None:
        """Draw a ditch along x or along y."""
        length, width = self.between(_DITCH_LENGTH), self.between(_DITCH_WIDTH)
        return self.place((length, width) if self.rng.random() < 0.5 else (width, length), 0.0)

    def wall(self) -> UprightBox | None:
        """Draw a wall of any heading."""
        ground = self.place((self.between(_WALL_LENGTH), _WALL_THICKNESS), math.pi)
        return UprightBox(ground, self.between(_WALL_HEIGHT)) if ground else None

    def crate(self) -> UprightBox | None:
        """Draw a crate of any heading."""
        ground = self.place((self.between(_CRATE_EDGE), self.between(_CRATE_EDGE)), math.pi)
        return UprightBox(ground, self.between(_CRATE_HEIGHT)) if ground else None

    def place(
        self,
        size: tuple[float, float],
        yaw: float,
        spare: float = 0.0,
        last_x: float = LAST_X,
    ) -> Rectangle | None:
        """Draw a free spot and take it; return None if none is found.

        Args:
            size: length and width of the obstacle [m].
            yaw: most that its heading differs from x [rad].
            spare: ground that it takes before and behind its length [m].
            last_x: furthest x of its centre [m].
        """
        for _ in range(_MOST_SPOTS):
            claim = Rectangle(0.0, 0.0, self.between((-yaw, yaw)), size[0] + 2.0 * spare, size[1])
            reach_x, reach_y = (half + APART + _WALL_THICKNESS / 2 for half in claim.half_extent)
            xs = FIRST_X + reach_x, min(LAST_X - reach_x, last_x)
            ys = reach_y - SIDE / 2, SIDE / 2 - reach_y
            if xs[0] > xs[1] or ys[0] > ys[1]:
                continue
            claim = replace(claim, x=self.between(xs), y=self.between(ys))
            if all(claim.gap_to(other) >= APART for other in self.taken):
                self.taken.append(claim)
                return claim.lengthened(-spare)
        return None

    def between(self, limits: Range) -> float:
        """Draw a number from a uniform distribution."""
        return float(self.rng.uniform(*limits))


def fence() -> list[UprightBox]:
    """Return the four walls around the world; their middle is on its edge."""
    middle, edge = (FIRST_X + LAST_X) / 2, SIDE / 2
    return [
        *(
            UprightBox(Rectangle(x, 0.0, 0.0, _WALL_THICKNESS, SIDE), _FENCE_HEIGHT)
            for x in (FIRST_X, LAST_X)
        ),
        *(
            UprightBox(Rectangle(middle, y, 0.0, SIDE, _WALL_THICKNESS), _FENCE_HEIGHT)
            for y in (-edge, edge)
        ),
    ]
