"""What the operator's velocity command becomes: ramped, and corrected by position and heading."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from husky_control.rotation import wrap_angle
from husky_description.arrays import Array

if TYPE_CHECKING:
    from husky_control.parameters import Parameters


class Pace(NamedTuple):
    """Limits of a gait to how fast the reference changes; the operator's limits hold besides."""

    catch_up: float = math.inf  # m/s, that the position error adds along each axis
    acceleration: float = math.inf  # m/s^2, of the ramp along each axis
    yaw_acceleration: float = math.inf  # rad/s^2


class VelocityReference:
    """Desired velocity in world and desired heading.

    Attributes:
        command: (3,) vx, vy in m/s and yaw rate in rad/s, as asked, in the heading frame.
        ramped: (3,) the same behind its acceleration limits.
        velocity: (2,) m/s in world: the ramped command and a share of the position error, which
            is the integral of the velocity error.
        position: (2,) m in world, where the body should be by its commands.
        yaw: rad, desired heading.
    """

    def __init__(self, parameters: Parameters) -> None:
        """At rest at the origin."""
        self.parameters = parameters
        self.command = np.zeros(3)
        self.ramped = np.zeros(3)
        self.velocity = np.zeros(2)
        self.position = np.zeros(2)
        self.yaw = 0.0

    def reset(self, position: Array, yaw: float) -> None:
        """At rest at a place (m) and a heading (rad)."""
        self.command.fill(0.0)
        self.ramped.fill(0.0)
        self.velocity.fill(0.0)
        self.position[:] = position[:2]
        self.yaw = yaw

    @property
    def at_rest(self) -> bool:
        """Whether the ramp has come to zero."""
        r = self.ramped
        return bool(abs(r[0]) < 0.02 and abs(r[1]) < 0.02 and abs(r[2]) < 0.05)

    def tick(
        self,
        yaw: float,
        position_x: float,
        position_y: float,
        pace: Pace,
        waits: bool,
        dt: float,
    ) -> None:
        """Advance by dt s.

        Args:
            yaw: rad, measured heading.
            position_x: m, estimated position along the world's x, without sway.
            position_y: m, along y.
            pace: of the gait.
            waits: the clock of the gait stands still, and with it the heading.
            dt: s.
        """
        p, ramped, most = self.parameters, self.ramped, pace.catch_up
        along = min(pace.acceleration, p["command.acceleration"])
        about = min(pace.yaw_acceleration, p["command.yaw_acceleration"])
        for i, most_change in enumerate((along, along, about)):
            limit = most_change * dt
            ramped[i] += min(limit, max(-limit, self.command[i] - ramped[i]))
        vx, vy, yaw_rate = float(ramped[0]), float(ramped[1]), float(ramped[2])
        c, s = math.cos(yaw), math.sin(yaw)
        leash, gain = p["walk.position_leash"], p["walk.position_gain"]
        for i, (speed, place) in enumerate(
            ((c * vx - s * vy, position_x), (s * vx + c * vy, position_y))
        ):
            error = min(leash, max(-leash, self.position[i] + speed * dt - place))
            self.position[i] = place + error
            self.velocity[i] = speed + min(most, max(-most, gain * error))
        leash = p["walk.yaw_leash"]
        turn = 0.0 if waits else yaw_rate * dt
        error = wrap_angle(self.yaw + turn - yaw)
        self.yaw = wrap_angle(yaw + min(leash, max(-leash, error)))
