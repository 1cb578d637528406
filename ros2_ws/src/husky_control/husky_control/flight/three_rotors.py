"""What the arms do for a quadrotor that has lost a rotor: it stays one that can be steered (T21).

The rotor across from the lost one would have to rest, for nothing answers it any more; and the two
that are left turn the same way and spin the body. So both their arms sweep a little towards the
lost one: now the one across pushes as well, and can push more and less. And the hips tilt all
propellers, the front ones to one side and the hind ones to the other, by what stops the spin: some
5 degrees against the drag of two rotors that carry the weight.
"""

from __future__ import annotations

import numpy as np

from husky_control.slew import slewed
from husky_description.arrays import Array

SWEEP = 0.15
"""Of the two arms beside the lost rotor [rad]: the centre of lift moves by 12 mm."""
TILT_PER_RATE, TILT_PER_ANGLE = 0.08, 0.2
"""Angle of the hips per yaw rate [s], and per angle turned [-]."""
TILT_LIMIT = 0.16
"""Of the hips [rad]; the thrust along z loses 1 % by it."""
_TURNS = np.array((-1.0, -1.0, 1.0, 1.0))
"""Which way each leg's hip turns for a positive yaw moment."""


class ThreeRotors:
    """Angles of the arms beside the posture of flight; joints turn as fast as they can."""

    def __init__(self, joint_speed: float) -> None:
        """As in flight.

        Args:
            joint_speed: what every joint can do [rad/s].
        """
        self._speed = joint_speed
        self.reset()

    def reset(self) -> None:
        """All four rotors turn."""
        self._sweep = self._tilt = self._turned = 0.0

    def move_arms(self, lost: int, yaw_rate: float, position: Array, dt: float) -> None:
        """Go towards the angles that serve, and add them to what is commanded.

        Args:
            lost: place of the rotor's leg, front left, front right, hind left, hind right.
            yaw_rate: of the body [rad/s].
            position: of the joints (12,) [rad], changed.
            dt: since the last call [s].
        """
        forward = lost < 2
        self._sweep = slewed(self._sweep, -SWEEP if forward else SWEEP, self._speed * dt)
        turned = self._turned + TILT_PER_ANGLE * yaw_rate * dt
        self._turned = min(TILT_LIMIT, max(-TILT_LIMIT, turned))
        wanted = -TILT_PER_RATE * yaw_rate - self._turned
        wanted = min(TILT_LIMIT, max(-TILT_LIMIT, wanted))
        self._tilt = slewed(self._tilt, wanted, self._speed * dt)
        position[0::3] += self._tilt * _TURNS
        for beside in (lost ^ 1, lost ^ 2):
            position[3 * beside + 1] += self._sweep
