"""How a wished velocity is taken up by a body whose acceleration lags behind what is asked for."""

from __future__ import annotations

import numpy as np

from husky_description.arrays import Array

RAMP = 0.6
"""Greatest change of the velocity that is wished [m/s^2]."""
LAG = 0.3
"""Of attitude and thrust: the time by which the acceleration follows [s]."""
_CREEP = 1e-3
"""Difference of speed that is not waited for [m/s]."""


class WishedMotion:
    """Velocity of a place that a body can stay at, and the push that takes it along.

    The wish is ramped. A body that is pushed by the ramp's slope, and follows it with its lag,
    moves at the ramped velocity behind that lag: so does the place, and no error grows between
    the two.

    Attributes:
        velocity: of the place in the heading frame [m/s] (2,).
        push: acceleration that the body is to be asked for [m/s^2] (2,).
    """

    def __init__(self) -> None:
        """At rest."""
        self.velocity, self.push, self._ramped = np.zeros((3, 2))

    def reset(self) -> None:
        """At rest, at once."""
        for motion in (self.velocity, self.push, self._ramped):
            motion.fill(0.0)

    @property
    def moves(self) -> bool:
        """Whether the place is not at rest."""
        return bool(self.velocity.any())

    def advance(self, wish: tuple[float, float], dt: float) -> Array:
        """Go on towards a wished velocity for dt s; return the place's velocity."""
        most = RAMP * dt
        for axis, wished in enumerate(wish):
            step = min(most, max(-most, wished - float(self._ramped[axis])))
            self.push[axis] = step / dt
            self._ramped[axis] += step
            behind = float(self._ramped[axis] - self.velocity[axis])
            self.velocity[axis] += behind * (dt / LAG if abs(behind) > _CREEP else 1.0)
        return self.velocity
