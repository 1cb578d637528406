"""Yaw moment by tilted propellers: small motions of the hips' frontal joints (T21).

A hip that turns about its frontal axis tilts its propeller to the side. The front ones to one side
and the hind ones to the other, the thrusts' sideways parts turn the body and do not move it.
"""

from __future__ import annotations

import math

import numpy as np

from husky_description.arrays import Array
from husky_description.fan import FanModel
from husky_description.gravity import GRAVITY
from husky_description.parameters import frozen
from husky_description.robot import Robot
from husky_description.rotor_geometry import flight_posture, rotor_geometry

TILT_LIMIT = math.radians(8.0)
"""Greatest angle of a hip from the posture of flight [rad]; thrust along z loses 1 % by it."""
SPEED_SHARE = 1.0 / 3.0
"""Of what the joints can do at most, for a hip that goes there."""
_STEP = 1e-4
"""Of an angle, to differentiate by [rad]."""


def hover_wrench(robot: Robot, joint_position: Array) -> Array:
    """Return force [N] and moment about the centre of mass [N m] (6,) of rotors that hover.

    Each gives a quarter of the weight along its own axis; in base.

    Args:
        robot: one whose legs carry propellers.
        joint_position: [rad] (12,).
    """
    matrix = rotor_geometry(robot, joint_position).effectiveness(
        FanModel.of(robot).moment_per_thrust
    )
    wrench: Array = matrix @ np.full(4, robot.mass * GRAVITY / 4.0)
    return wrench


def tilt_per_moment(robot: Robot) -> Array:
    """Return the hips' frontal angles that give a yaw moment of 1 N m in hover [rad/(N m)] (4,).

    The smallest ones that, to first order, give neither force nor roll nor pitch.
    """
    posture = flight_posture(robot)
    columns = []
    for leg in range(4):
        step = np.zeros(12)
        step[3 * leg] = _STEP
        rise = hover_wrench(robot, posture + step) - hover_wrench(robot, posture - step)
        columns.append(rise / (2.0 * _STEP))
    return frozen(np.linalg.pinv(np.transpose(columns), rcond=1e-6)[:, 5])


class ThrustVectoring:
    """Angles of the hips beside the posture of flight, limited in size and speed.

    Attributes:
        greatest_speed: at which a hip turns [rad/s].
        angle: of the frontal hips [rad] (4,).
        speed: at which they change [rad/s] (4,).
    """

    def __init__(self, robot: Robot) -> None:
        """Propellers upright."""
        self._tilt_per_moment = tilt_per_moment(robot)
        self.greatest_speed = SPEED_SHARE * robot.joint_speed
        self.angle, self.speed = np.zeros(4), np.zeros(4)

    def reset(self) -> None:
        """Propellers upright, at once."""
        self.angle.fill(0.0)
        self.speed.fill(0.0)

    def advance(self, moment: float, dt: float) -> None:
        """Go towards the angles that give a yaw moment in base [N m], for dt s."""
        wanted = moment * self._tilt_per_moment
        # All shrink alike, so that they go on giving a moment alone.
        wanted *= min(1.0, TILT_LIMIT / max(float(np.abs(wanted).max()), 1e-9))
        step = wanted - self.angle
        step *= min(1.0, self.greatest_speed * dt / max(float(np.abs(step).max()), 1e-9))
        self.angle += step
        self.speed[:] = step / dt
