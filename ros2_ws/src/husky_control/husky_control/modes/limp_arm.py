"""An arm whose hip gives way in flight: its mirror image gives way as far.

Thrust lifts an arm whose hip frontal servo is lost up to the joint's stop, 20 degrees, and pushes
the body aside and round by the sine of that. The arm across, tilted as far, takes both away: what
is left is a loss of lift and of levers at one end, which the attitude control trims.
"""

from __future__ import annotations

import numpy as np

from husky_description.arrays import Array

AWAY = 0.12
"""Angle from what was commanded at which a hip counts as limp [rad]; at full thrust a servo gives
way by 0.03."""
PATIENCE = 0.03
"""For so long [s]."""


class LimpArm:
    """Finds the first arm that does not follow, and lets the one across go with it."""

    def __init__(self) -> None:
        """All arms hold."""
        self.reset()

    def reset(self) -> None:
        """All arms hold again."""
        self._leg = -1
        self._away_for = 0.0

    def even_out(self, measured: Array, commanded: Array, dt: float) -> None:
        """Change the command of the arm across from a limp one.

        Args:
            measured: joint positions (12,) [rad].
            commanded: the same, changed.
            dt: since the last call [s].
        """
        if self._leg < 0:
            away = np.abs(measured[0::3] - commanded[0::3])
            self._away_for = self._away_for + dt if away.max() > AWAY else 0.0
            if self._away_for < PATIENCE:
                return
            self._leg = int(away.argmax())
        across = self._leg ^ 1  # legs are ordered front left, front right, hind left, hind right
        commanded[3 * across] = -measured[3 * self._leg]
