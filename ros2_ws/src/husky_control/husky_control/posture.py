"""Standing up and sitting down: smooth joint trajectories between postures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from husky_control.kinematics import JOINTS

Array = NDArray[np.float64]


class PostureMove:
    """Minimum-jerk motion through postures, each reached at rest."""

    def __init__(self) -> None:
        """No motion, at zero."""
        self.joint_position = np.zeros(JOINTS)
        self.joint_velocity = np.zeros(JOINTS)
        self._postures: list[Array] = [np.zeros(JOINTS)]
        self._durations: list[float] = []
        self._elapsed = 0.0

    def start(self, postures: list[Array], durations: list[float]) -> None:
        """Begin at rest in the first posture and go through the others.

        Args:
            postures: n + 1 joint positions (12,) rad.
            durations: n times in s.
        """
        if len(postures) != len(durations) + 1:
            raise ValueError(f"{len(postures)} postures need {len(postures) - 1} durations")
        self._postures = [np.array(posture) for posture in postures]
        self._durations = list(durations)
        self._elapsed = 0.0
        self.joint_position[:] = postures[0]
        self.joint_velocity.fill(0.0)

    @property
    def done(self) -> bool:
        """Whether the last posture is reached."""
        return not self._durations

    @property
    def last_leg_of_the_way(self) -> bool:
        """Whether the motion is on its way to the last posture, or there."""
        return len(self._durations) <= 1

    @property
    def progress(self) -> float:
        """Progress towards the next posture, 0 to 1."""
        return min(1.0, self._elapsed / self._durations[0]) if self._durations else 1.0

    def tick(self, dt: float) -> None:
        """Advance joint_position (rad) and joint_velocity (rad/s) by dt s."""
        if not self._durations:
            self.joint_velocity.fill(0.0)
            return
        self._elapsed += dt
        duration = self._durations[0]
        s = min(1.0, self._elapsed / duration)
        blend = s * s * s * (10.0 + s * (6.0 * s - 15.0))
        slope = 30.0 * s * s * (1.0 - s) * (1.0 - s) / duration
        start, end = self._postures[0], self._postures[1]
        np.subtract(end, start, out=self.joint_velocity)
        np.multiply(self.joint_velocity, blend, out=self.joint_position)
        self.joint_position += start
        self.joint_velocity *= slope
        if s >= 1.0:
            self._postures.pop(0)
            self._durations.pop(0)
            self._elapsed = 0.0
