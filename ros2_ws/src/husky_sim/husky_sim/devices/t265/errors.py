"""What a tracking camera gets wrong: drift with the distance travelled, and noise, from a seed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from husky_description.rotation import Vector

_BLOCK = 200
"""Rows drawn at once: one second's worth."""
_WIDTH = 18
_SCALE, _HEADING, _SLOPE = 0.4, 0.4, 0.2
"""Shares of the three errors in the greatest drift; their sum is 1."""


def normals(seed: int) -> Iterator[list[float]]:
    """Yield rows of 18 standard normal numbers without end; equal seeds give equal rows."""
    generator = np.random.default_rng([seed, 265])
    while True:
        yield from generator.standard_normal((_BLOCK, _WIDTH)).tolist()


class Drift:
    """Wrong scale, wrong heading and a slope, which make displacements come out wrong.

    Each is a first-order Gauss-Markov process over the distance travelled, of an rms of half its
    bound and cut off there. The bounds add up to the greatest drift: the position cannot be further
    off than that part of the distance, whatever the seed. A camera at rest does not drift.

    Attributes:
        scale: displacements come out this much too long [-].
        heading: and turned by this about the vertical [rad].
        slope: and rise by this part of their horizontal length [-].
    """

    def __init__(self, greatest: float, length: float, normals: Sequence[float]):
        """Start with errors of the stationary distribution.

        Args:
            greatest: drift over distance [-].
            length: distance over which errors decay [m].
            normals: three standard normal numbers.
        """
        self._length = length
        self._bounds = tuple(share * greatest for share in (_SCALE, _HEADING, _SLOPE))
        self.scale, self.heading, self.slope = (
            _cut(0.5 * bound * normal, bound)
            for bound, normal in zip(self._bounds, normals, strict=True)
        )
        self._turn()

    def advance(self, distance: float, a: float, b: float, c: float) -> None:
        """Move on by a distance [m], with three standard normal numbers."""
        keep = math.exp(-distance / self._length)
        drive = 0.5 * math.sqrt(1.0 - keep * keep)
        scale, heading, slope = self._bounds
        self.scale = _cut(keep * self.scale + drive * scale * a, scale)
        self.heading = _cut(keep * self.heading + drive * heading * b, heading)
        self.slope = _cut(keep * self.slope + drive * slope * c, slope)
        self._turn()

    def _turn(self) -> None:
        stretch = 1.0 + self.scale
        self._cos, self._sin = stretch * math.cos(self.heading), stretch * math.sin(self.heading)
        self._stretch = stretch

    def apply(self, vector: Vector) -> Vector:
        """Return what a displacement or a velocity, z up, is taken for."""
        x, y, z = vector
        return (
            self._cos * x - self._sin * y,
            self._sin * x + self._cos * y,
            self._stretch * z + self.slope * math.sqrt(x * x + y * y),
        )


def _cut(value: float, bound: float) -> float:
    return max(-bound, min(bound, value))
