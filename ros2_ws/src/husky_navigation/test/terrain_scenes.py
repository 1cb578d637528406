"""Grounds in closed form: the height at a place, and where rays meet it first.

Rays are arrays (3, n) whose last row is 1 in the camera's axes, so that the distance along them is
the depth. Single precision is 1 um here, and three times as fast.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float32]

_FAR = np.float32(np.inf)


@dataclass(frozen=True)
class Facet:
    """Ground z = level + gradient (x - start) for start <= x < end."""

    start: float
    end: float
    level: float
    gradient: float = 0.0

    def height(self, x, y):
        inside = (x >= self.start) & (x < self.end)
        return np.where(inside, self.level + self.gradient * (x - self.start), -np.inf)

    def meet(self, origin, rays: Values) -> Values:
        above = origin[2] - self.level - self.gradient * (origin[0] - self.start)
        nearing = np.float32(self.gradient) * rays[0] - rays[2]
        t = np.float32(above) / np.maximum(nearing, np.float32(1e-9))
        x = np.float32(origin[0]) + t * rays[0]
        return np.where((t > 0.0) & (x >= self.start) & (x < self.end), t, _FAR)


@dataclass(frozen=True)
class Box:
    """A solid box along the axes, from its lower to its upper corner."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]

    def height(self, x, y):
        inside = (x >= self.lower[0]) & (x < self.upper[0])
        inside &= (y >= self.lower[1]) & (y < self.upper[1])
        return np.where(inside, self.upper[2], -np.inf)

    def meet(self, origin, rays: Values) -> Values:
        enter = np.zeros(rays.shape[1], dtype=np.float32)
        leave = np.full(rays.shape[1], _FAR)
        for axis in range(3):
            along = np.where(np.abs(rays[axis]) < 1e-9, np.float32(1e-9), rays[axis])
            first = np.float32(self.lower[axis] - origin[axis]) / along
            second = np.float32(self.upper[axis] - origin[axis]) / along
            enter = np.maximum(enter, np.minimum(first, second))
            leave = np.minimum(leave, np.maximum(first, second))
        return np.where((enter > 0.0) & (enter <= leave), enter, _FAR)


@dataclass(frozen=True)
class Relief:
    """Smooth ground z = function(x, y) within [low, high], met by marching, then by the secant."""

    function: Callable[[Values, Values], Values]
    low: float
    high: float

    def height(self, x, y):
        return self.function(x, y)

    def meet(self, origin, rays: Values, steps: int = 10, secants: int = 3) -> Values:
        origin = np.float32(origin)
        down = np.maximum(-rays[2], np.float32(1e-3))
        start, length = (origin[2] - self.high) / down, (self.high - self.low) / down
        over, above = start, self._clearance(origin, rays, start)
        under, below = start + length, np.full_like(start, -1.0)
        found = np.zeros(rays.shape[1], dtype=bool)
        for k in range(1, steps + 1):
            t = start + length * np.float32(k / steps)
            clearance = self._clearance(origin, rays, t)
            hit = ~found & (clearance <= 0.0)
            under, below = np.where(hit, t, under), np.where(hit, clearance, below)
            found |= hit
            over, above = np.where(found, over, t), np.where(found, above, clearance)
        for _ in range(secants):
            t = over + (under - over) * above / (above - below)
            clearance = self._clearance(origin, rays, t)
            hit = clearance <= 0.0
            under, below = np.where(hit, t, under), np.where(hit, clearance, below)
            over, above = np.where(hit, over, t), np.where(hit, above, clearance)
        return t

    def _clearance(self, origin, rays: Values, t: Values) -> Values:
        x, y = origin[0] + t * rays[0], origin[1] + t * rays[1]
        return origin[2] + t * rays[2] - self.function(x, y)


@dataclass(frozen=True)
class Scene:
    """Solids that stand on and in each other; the ground is the highest of them."""

    parts: tuple[Facet | Box | Relief, ...]

    def height(self, x, y):
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        return np.max([part.height(x, y) for part in self.parts], axis=0)

    def meet(self, origin, rays: Values) -> Values:
        nearest = self.parts[0].meet(origin, rays)
        for part in self.parts[1:]:
            nearest = np.minimum(nearest, part.meet(origin, rays))
        return nearest


FLOOR = Facet(-100.0, 100.0, 0.0)
_SLOPE = 0.268
"""Of the slope: 15 deg."""


def _waves(x, y):
    return 0.022 * np.sin(5.1 * x + 0.3) * np.cos(4.3 * y) + 0.016 * np.sin(9.7 * y - 11.9 * x)


_WAVES = Relief(_waves, -0.038, 0.038)


def _staircase(rise: float, run: float, count: int, start: float) -> tuple[Box, ...]:
    return tuple(
        Box((start + k * run, -1.47, 0.0), (start + (k + 1) * run, 1.47, (k + 1) * rise))
        for k in range(count)
    )


def _boxes(seed: int, count: int) -> tuple[Box, ...]:
    """Return boxes beside the robot's way, which is the x axis."""
    draw = np.random.default_rng(seed)
    boxes: list[Box] = []
    while len(boxes) < count:
        x, y = draw.uniform(1.0, 5.5), draw.uniform(-1.8, 1.8)
        half_x, half_y = draw.uniform(0.1, 0.3, 2)
        top = draw.uniform(0.06, 0.35)
        if abs(y) - half_y > 0.35:
            boxes.append(Box((x - half_x, y - half_y, -0.1), (x + half_x, y + half_y, top)))
    return tuple(boxes)


GAP = (2.315, 2.685)
"""Beginning and end of the gap along x [m]."""

SCENES = {
    "flat": Scene((FLOOR,)),
    "slope": Scene(
        (
            Facet(-100.0, 1.5, 0.0),
            Facet(1.5, 5.5, 0.0, _SLOPE),
            Facet(5.5, 100.0, 4.0 * _SLOPE),
        )
    ),
    "rough": Scene((_WAVES,)),
    "steps": Scene((FLOOR, *_staircase(0.08, 0.37, 6, 1.617))),
    "boxes": Scene((FLOOR, *_boxes(3, 12))),
    "mixed": Scene((_WAVES, *_boxes(5, 7), *_staircase(0.07, 0.43, 3, 3.1))),
    "gap": Scene(
        (
            Facet(-100.0, 100.0, -0.6),
            Box((-100.0, -100.0, -0.7), (GAP[0], 100.0, 0.0)),
            Box((GAP[1], -100.0, -0.7), (100.0, 100.0, 0.0)),
        )
    ),
}
