"""How well the estimated motion is known: covariances of pose and twist, as Odometry has them.

The filter (`estimator`) tells how well the legs and the accelerometer know position and velocity.
Two things it does not know are added here. The heading of the IMU is off by a little that changes
slowly, so what is walked is walked in a slightly wrong direction: position across the velocity v is
a random walk, of density 2 T (sigma v)^2 for an error of rms sigma and correlation time T. And feet
roll, bend and slip, alike in each step, and most of all in the first second of standing up, when
they slide into place under a body that still lies. Measured in simulation, over five gaits on the
flat: 0.1 to 1 % of the way, and 37 mm in a rise.
"""

from __future__ import annotations

import math

import numpy as np

from husky_description.arrays import Array

HEADING_TIME = 10.0
"""Correlation time of the heading's error [s], as long as such a filter trusts its gyroscope."""
WAY_DRIFT = 0.01
"""Error along the way, that grows with its root [m/sqrt(m)]."""
RISE_DRIFT = 0.02
"""The same of a body that stands up or sits down, each way, with the root of time [m/sqrt(s)]."""
LOOSE = 1.0
"""Variance of what the filter does not follow [m^2], [m^2/s^2]: of a robot that falls or hangs."""
_LEAST = 1e-9
"""Least variance of anything [m^2], [rad^2], ...: the matrix has an inverse."""


class OdometryCovariance:
    """Covariances of the estimated motion of the base, row by row (6, 6).

    Attributes:
        pose: of position [m] in the odometry frame, then rotation about its axes [rad].
        twist: of linear [m/s], then angular velocity [rad/s], both in base.
    """

    def __init__(self) -> None:
        """Nothing has been walked."""
        self.pose = np.zeros((6, 6))
        self.twist = np.zeros((6, 6))
        self._walked = np.zeros((2, 2))

    def restart(self) -> None:
        """The estimate begins again at the origin."""
        self._walked.fill(0.0)

    def walk(
        self, velocity: Array, heading_variance: float, dt: float, *, rising: bool = False
    ) -> None:
        """Add what the filter does not know of a piece of the way.

        Args:
            velocity: of the base in the odometry frame [m/s] (3,).
            heading_variance: [rad^2].
            dt: how long [s].
            rising: whether the body rises, or sinks, over its feet.
        """
        along = velocity[:2]
        across = np.array((-along[1], along[0]))
        speed = math.hypot(along[0], along[1])
        self._walked += (2.0 * HEADING_TIME * heading_variance * dt) * np.outer(across, across)
        if speed > 0.0:
            self._walked += (WAY_DRIFT**2 * dt / speed) * np.outer(along, along)
        if rising:
            self._walked += RISE_DRIFT**2 * dt * np.eye(2)

    def update(
        self,
        rotation: Array,
        horizontal: Array,
        vertical: Array,
        attitude_variance: Array,
        rate_variance: Array,
        *,
        place_counts: bool,
        velocity_counts: bool,
    ) -> None:
        """Write `pose` and `twist`.

        Args:
            rotation: base to odometry frame (3, 3).
            horizontal: the filter's covariance of x and of y: position, velocity, feet (n, n).
            vertical: the same of z.
            attitude_variance: about the axes of the odometry frame [rad^2] (3,).
            rate_variance: of the angular velocity on each axis of base [rad^2/s^2] (3,).
            place_counts: False while the position says nothing: the robot hangs.
            velocity_counts: False while the velocity says nothing: the filter does not run.
        """
        pose, twist = self.pose, self.twist
        pose.fill(0.0)
        twist.fill(0.0)
        position = velocity = LOOSE * np.eye(3)
        if place_counts:
            position = np.diag((horizontal[0, 0], horizontal[0, 0], vertical[0, 0]))
            position[:2, :2] += self._walked
        if velocity_counts:
            velocity = np.diag((horizontal[1, 1], horizontal[1, 1], vertical[1, 1]))
        pose[:3, :3] = position
        pose[3:, 3:] = np.diag(attitude_variance)
        in_base = rotation.T @ velocity @ rotation
        twist[:3, :3] = 0.5 * (in_base + in_base.T)
        twist[3:, 3:] = np.diag(rate_variance)
        for matrix in (pose, twist):
            diagonal = np.einsum("ii->i", matrix)
            np.maximum(diagonal, _LEAST, out=diagonal)
