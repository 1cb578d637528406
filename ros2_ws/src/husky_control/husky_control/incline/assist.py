"""Walking with the fans' help: what the propulsion unit is asked for, and what it is taken to give.

The fans carry a share of the weight along the body's z axis and damp roll and pitch with moments
(T40; thrust alone worsens roll, moments mend it). The legs are relieved of what the fans give now,
not of what they are asked for: a fan follows with a lag.
"""

from __future__ import annotations

import math

import numpy as np

from husky_control.parameters import Parameters
from husky_description.arrays import Array
from husky_description.gravity import GRAVITY
from husky_description.robot import Robot

FAN_LAG = 0.16
"""Of thrust after a command: the rotor's 0.08 s, and as much for the way over MAVLink [s]."""

RELEASE = 0.8
"""In modes without help the share falls at least so fast [1/s]: to nothing within 1 s."""


NEWS_LAG = 0.2
"""Of the unit's state: a share that was set so long before the news of arming counts [s]."""


class ThrustAssist:
    """Force and moment that are asked of the fans, and the lift they are taken to give.

    Arming asks for nothing: a share that was set before has to be set again.

    Attributes:
        force: asked for, along base z [N].
        moment: asked for, in base [N m] (3,).
        lift: taken to act along base z now [N].
    """

    def __init__(self, robot: Robot, parameters: Parameters) -> None:
        """Nothing asked, nothing given."""
        self.force = self.lift = 0.0
        self.moment = np.zeros(3)
        self._weight = float(robot.mass) * GRAVITY
        self._parameters = parameters
        self._withheld_at = -1
        self._stands, self._stands_for = -1, 0.0

    def reset(self) -> None:
        """As made: the fans are off."""
        self.force = self.lift = 0.0
        self.moment.fill(0.0)

    def ask(self, force: float, moment: Array) -> None:
        """Ask for a force [N] and a moment (3,) [N m] in this tick, in a mode that reckons them."""
        self.force = force
        self.moment[:] = moment

    def withhold(self) -> None:
        """Give no more help until the share is set anew: something has gone wrong with it."""
        self._withheld_at = self._parameters.set_at("assist.share")

    def _stand_by(self, dt: float) -> None:
        """The unit is disarmed: the share that stands now is not asked for when it is armed."""
        self.force = 0.0
        set_at = self._parameters.set_at("assist.share")
        if set_at != self._stands:
            self._stands, self._stands_for = set_at, 0.0
        self._stands_for += dt
        if self._stands_for > NEWS_LAG:
            self._withheld_at = set_at

    def tick(
        self,
        wanted: bool,
        available: bool,
        rotation: Array,
        angular_velocity: Array,
        dt: float,
        *,
        disarmed: bool = False,
    ) -> None:
        """Ask for this tick's force and moment.

        Args:
            wanted: the legs carry the robot in a mode in which fans may help.
            available: the unit is armed, listens and has no fail-safe.
            rotation: (3, 3), base to world.
            angular_velocity: (3,) rad/s in base.
            dt: s.
            disarmed: the unit says that it is not armed.
        """
        if disarmed:
            self._stand_by(dt)
        p = self._parameters
        wanted = wanted and p.set_at("assist.share") != self._withheld_at
        target = p["assist.share"] * self._weight if wanted and available else 0.0
        step = p["assist.slew"] * self._weight * dt
        fall = step if wanted else max(step, RELEASE * self._weight * dt)
        self.force += min(step, max(-fall, target - self.force))
        given = self.force if available else 0.0
        self.lift += (given - self.lift) * min(1.0, dt / FAN_LAG)
        if target <= 0.0:
            self.moment.fill(0.0)
            return
        # Tilt as a rotation vector in base: z_base x z_world, seen from the base.
        roll_error, pitch_error = rotation[2, 1], -rotation[2, 0]
        limit = p["assist.moment_limit"]
        stiffness, damping = p["assist.attitude_stiffness"], p["assist.attitude_damping"]
        self.moment[0] = _within(-stiffness * roll_error - damping * angular_velocity[0], limit)
        self.moment[1] = _within(-stiffness * pitch_error - damping * angular_velocity[1], limit)

    def lift_in_world(self, rotation: Array) -> float:
        """Return the upward part of the lift, N."""
        return self.lift * float(rotation[2, 2])


def _within(value: float, limit: float) -> float:
    return math.copysign(min(abs(value), limit), value)
