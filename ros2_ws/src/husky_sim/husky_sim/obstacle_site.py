"""Sites of worlds of obstacles: a fence, and free spots in it for a goal and for obstacles."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from husky_sim.obstacle_world import GoalPose, GroundPoint, Rectangle, Square, UprightBox

APART = 1.2
"""Least distance of an obstacle from start, goal, fence and every other obstacle [m]."""
WALL_THICKNESS = 0.15
"""Of walls and the fence [m]."""
_FENCE_HEIGHT = 0.6
"""Of a fence that a robot on legs does not climb [m]."""
_MOST_SPOTS = 150
"""Draws for a free spot before an obstacle is left out."""

Range = tuple[float, float]
"""Least and greatest value of a uniform distribution."""


@dataclass
class ObstacleSite:
    """A square in which a world is being drawn.

    Attributes:
        square: within the fence.
        rng: generator of everything about the world.
        taken: ground that keeps its distance from what is placed next.
    """

    square: Square
    rng: np.random.Generator
    taken: list[Rectangle] = field(init=False, default_factory=list)

    def draw_goal(self, x: Range, y: Range) -> GoalPose:
        """Draw a goal [m] of any heading; keep obstacles away from it and from the start."""
        yaw = self.between((-math.pi, math.pi))
        goal = GoalPose(self.between(x), self.between(y), yaw)
        ends = GroundPoint(0.0, 0.0), GroundPoint(goal.x, goal.y)
        self.taken += [Rectangle(*end, 0.0, 0.0, 0.0) for end in ends]
        return goal

    def place(
        self,
        size: tuple[float, float],
        yaw: float,
        spare: float = 0.0,
        last_x: float = math.inf,
        from_fence: float = APART,
    ) -> Rectangle | None:
        """Draw a free spot and take it; return None if none is found.

        Args:
            size: length and width of the obstacle [m].
            yaw: most that its heading differs from x [rad].
            spare: ground that it takes before and behind its length [m].
            last_x: furthest x of its centre [m].
            from_fence: its least distance from the fence [m].
        """
        square = self.square
        for _ in range(_MOST_SPOTS):
            claim = Rectangle(0.0, 0.0, self.between((-yaw, yaw)), size[0] + 2.0 * spare, size[1])
            reach_x, reach_y = (
                half + from_fence + WALL_THICKNESS / 2 for half in claim.half_extent
            )
            xs = square.first_x + reach_x, min(square.last_x - reach_x, last_x)
            ys = reach_y - square.side / 2, square.side / 2 - reach_y
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


def fence(yard: Rectangle, height: float = _FENCE_HEIGHT) -> list[UprightBox]:
    """Return the four walls of a height [m] around a yard of yaw 0; their middle is on its edge."""
    ahead, beside = yard.length / 2, yard.width / 2
    return [
        *(
            UprightBox(Rectangle(x, yard.y, 0.0, WALL_THICKNESS, yard.width), height)
            for x in (yard.x - ahead, yard.x + ahead)
        ),
        *(
            UprightBox(Rectangle(yard.x, y, 0.0, yard.length, WALL_THICKNESS), height)
            for y in (yard.y - beside, yard.y + beside)
        ),
    ]
