"""Motion of the reference body beyond its velocity: sway of the crawl, hop of the pronk."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

SHORTEST_SWAY = 0.5  # s, bounds the acceleration when the goal moves late


Point = tuple[float, float]


def sway_interval(
    point: Point, sideways: Point, corners: list[Any], margin: float
) -> tuple[float, float]:
    """Least and greatest move sideways that keeps a margin inside of a triangle.

    Args:
        point: m.
        sideways: unit vector.
        corners: three points in m, in either order.
        margin: m.

    Returns:
        m; the least exceeds the greatest when no point at the side keeps the margin.
    """
    (ax, ay), (bx, by), (cx, cy) = ((float(p[0]), float(p[1])) for p in corners)
    if (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) < 0.0:
        bx, by, cx, cy = cx, cy, bx, by
    low, high = -math.inf, math.inf
    for px, py, qx, qy in ((ax, ay, bx, by), (bx, by, cx, cy), (cx, cy, ax, ay)):
        length = math.hypot(qx - px, qy - py)
        nx, ny = -(qy - py) / length, (qx - px) / length  # inward
        inside = nx * (point[0] - px) + ny * (point[1] - py) - margin
        gain = nx * sideways[0] + ny * sideways[1]
        if gain > 1e-6:
            low = max(low, -inside / gain)
        elif gain < -1e-6:
            high = min(high, -inside / gain)
    return low, high


class Sway:
    """A displacement that goes to its goal in a given time: quintic, from the present motion."""

    def __init__(self) -> None:
        """No displacement."""
        self.offset = np.zeros(2)
        self.velocity = np.zeros(2)
        self.acceleration = np.zeros(2)
        self._remaining = 0.0

    def reset(self) -> None:
        """Back to no displacement, at rest."""
        self.offset.fill(0.0)
        self.velocity.fill(0.0)
        self.acceleration.fill(0.0)
        self._remaining = 0.0

    def begin(self, duration: float) -> None:
        """Reach the goal in duration (s) from now."""
        self._remaining = duration

    def move_towards(self, goal_x: float, goal_y: float, most: float, dt: float) -> None:
        """Move towards a goal (m) no further than most (m), by dt (s)."""
        length = math.hypot(goal_x, goal_y)
        scale = most / length if length > most else 1.0
        # The goal drifts with the feet; the shortest remaining time bounds the acceleration.
        t = max(self._remaining, SHORTEST_SWAY)
        self._remaining = max(0.0, self._remaining - dt)
        error = np.array((goal_x * scale, goal_y * scale)) - self.offset
        # Third derivative, now, of the quintic that comes to rest at the goal in t.
        jerk = 60.0 * error / t**3 - 36.0 * self.velocity / t**2 - 9.0 * self.acceleration / t
        self.acceleration += jerk * dt
        self.velocity += self.acceleration * dt
        self.offset += self.velocity * dt


class Hop:
    """Height of the body through a stance that ends with an upward speed.

    A cubic from the height and speed at touchdown to the nominal height and the hop speed at
    liftoff; for a periodic hop its acceleration is constant, 2 v / T_stance.
    """

    def __init__(self) -> None:
        """At the nominal height."""
        self._start_height = 0.0
        self._start_speed = 0.0
        self.end_speed = 0.0  # m/s, with which this stance ends; 0 to stay on the ground
        self.height = 0.0  # m over the nominal height
        self.speed = 0.0  # m/s
        self.acceleration = 0.0  # m/s^2

    def touchdown(self, height: float, speed: float, end_speed: float) -> None:
        """Begin a stance at a height over the nominal (m) with a vertical speed (m/s)."""
        self._start_height, self._start_speed, self.end_speed = height, speed, end_speed

    def follow(self, progress: float, stance_time: float) -> None:
        """Height, speed and acceleration at a progress of the stance, 0 to 1."""
        s, t = min(1.0, max(0.0, progress)), stance_time
        h0, v0, v1 = self._start_height, self._start_speed * t, self.end_speed * t
        # Hermite cubic with end height 0.
        a, b = 2.0 * h0 + v0 + v1, -3.0 * h0 - 2.0 * v0 - v1
        self.height = ((a * s + b) * s + v0) * s + h0
        self.speed = ((3.0 * a * s + 2.0 * b) * s + v0) / t
        self.acceleration = (6.0 * a * s + 2.0 * b) / (t * t)
