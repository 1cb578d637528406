"""Random worlds of 8 m, as the lab draws them: wide boxes to walk around or to fly over."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from husky_sim.obstacle_site import APART, WALL_THICKNESS, ObstacleSite, fence
from husky_sim.obstacle_world import GoalPose, ObstacleWorld, Rectangle, Square, UprightBox
from husky_sim.reachability import goal_is_reachable

LAB_SQUARE = Square(side=8.0, behind=1.0)
"""Square of these worlds."""
FLIGHT_HEIGHT = 1.2
"""Height of a box that a robot in flight passes over [m]; a higher one may stand in its way."""
NARROW = 0.3
"""Gaps between closing boxes, and from them to the fence, are less [m]: no robot walks there."""

_FENCE_HEIGHT = 2.5
"""Of the fence [m]: no robot flies over it."""
_CLOSED_SHARE = 0.5
"""Share of the worlds that boxes close."""
_FEWEST, _MOST = 3, 4
"""Number of boxes in a world."""
_MOST_WORLDS = 100
"""Draws for a world with a way to its goal."""
_GOAL_X, _GOAL_Y = (5.0, 5.7), (-2.7, 2.7)
"""Ranges of the goal's position [m]."""
_WIDTH, _DEPTH, _HEIGHT = (2.0, 3.0), (0.4, 0.8), (0.25, 1.75)
"""Of a box [m]; the lab states no depth."""


def lab_world(rng: np.random.Generator) -> ObstacleWorld:
    """Draw worlds until one has a way from its start to its goal.

    In about half of all worlds boxes side by side leave no way on level ground: a robot flies over
    one of them, of at most `FLIGHT_HEIGHT`. In the others scattered boxes leave a way on level
    ground. The same state of the generator gives the same world.

    Raises:
        RuntimeError: no world has a way after `_MOST_WORLDS` draws.
    """
    closed = bool(rng.random() < _CLOSED_SHARE)
    count = int(rng.integers(_FEWEST, _MOST + 1))
    flight_height = FLIGHT_HEIGHT if closed else 0.0
    for _ in range(_MOST_WORLDS):
        world = _draw_world(ObstacleSite(LAB_SQUARE, rng), closed, count)
        if world is not None and goal_is_reachable(world, flight_height=flight_height):
            return world
    raise RuntimeError(f"none of {_MOST_WORLDS} worlds of the lab has a way to its goal")


def _draw_world(site: ObstacleSite, closed: bool, count: int) -> ObstacleWorld | None:
    """Draw goal and boxes; return None if the boxes find no room."""
    goal = site.draw_goal(_GOAL_X, _GOAL_Y)
    grounds = (_closing_grounds if closed else _scattered_grounds)(site, count, goal)
    if grounds is None:
        return None
    boxes = [UprightBox(ground, site.between(_HEIGHT)) for ground in grounds]
    walls = fence(site.square.ground, _FENCE_HEIGHT)
    return ObstacleWorld((), (*walls, *boxes), (), goal, closed, site.square)


def _scattered_grounds(site: ObstacleSite, count: int, goal: GoalPose) -> list[Rectangle] | None:
    """Return grounds of boxes of any heading before a goal; None if one finds no free spot."""
    spots = [
        site.place(
            (site.between(_DEPTH), site.between(_WIDTH)), math.pi, last_x=goal.x, from_fence=0.0
        )
        for _ in range(count)
    ]
    grounds = [spot for spot in spots if spot]
    return grounds if len(grounds) == count else None


def _closing_grounds(site: ObstacleSite, count: int, goal: GoalPose) -> list[Rectangle] | None:
    """Return grounds of boxes side by side from fence to fence, between the start and a goal.

    The boxes stand in one line, with equal gaps. If they are too wide together for that, they stand
    in two lines in turn, one close behind the other, and overlap as seen from the start.

    Returns:
        The grounds from right to left; None where the gaps are too wide, boxes of one line meet, or
        the lines are too near to start or goal.
    """
    widths = [site.between(_WIDTH) for _ in range(count)]
    to_fence, between_lines = site.between((0.0, NARROW)), site.between((0.0, NARROW))
    ahead = float(site.rng.choice((-1.0, 1.0)))
    edge = (site.square.side - WALL_THICKNESS) / 2
    gap = (2.0 * (edge - to_fence) - sum(widths)) / (count - 1)
    if gap >= NARROW or min(widths) + 2.0 * gap < 0.0:
        return None
    grounds, right = [], to_fence - edge
    for width in widths:
        depth = site.between(_DEPTH)
        x = 0.0 if gap >= 0.0 else ahead * (between_lines + depth) / 2
        grounds.append(Rectangle(x, right + width / 2, 0.0, depth, width))
        right += width + gap
        ahead = -ahead
    first = APART - min(ground.x - ground.length / 2 for ground in grounds)
    last = goal.x - APART - max(ground.x + ground.length / 2 for ground in grounds)
    if first > last:
        return None
    shift = site.between((first, last))
    return [replace(ground, x=ground.x + shift) for ground in grounds]
