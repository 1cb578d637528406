"""A landing by the flight controller alone: level, at its own vertical speed, until it is down.

Nobody tells a position any more. The vertical speed comes of accelerometer and barometer, the
thrust of what the weight takes (MPC_THR_HOVER) and of the speed's error. Horizontal speed is
braked, as PX4's mode Land does for the seconds in which EKF2 still has a velocity from its inertial
sensors (EKF2_NOAID_TOUT, 5 s): a companion that falls silent leaves its last tilt. With a rotor
lost the thrust ends at once on the ground: three cannot hold a body that stands on an edge.
"""

from __future__ import annotations

import math

from husky_description.gravity import GRAVITY
from husky_description.rotation import Quaternion, Vector, rotate

_AIR_WEIGHT = 1.225 * GRAVITY
"""By which pressure falls with height near the ground [Pa/m]."""
_BANDWIDTH = 1.0
"""Below it the barometer tells the vertical speed, above it the accelerometer [rad/s]."""
_LEAK = 0.3
"""Rate at which horizontal speed is forgotten, of which the accelerometer alone tells [1/s]."""
_SPEED_GAIN, _TRIM_GAIN, _TRIM_LIMIT = 3.0, 4.0, 2.5
"""Acceleration per error of the vertical speed [1/s], of its integral [1/s^2], the integral's
limit [m/s^2]: what a low battery and a lost rotor take away."""
_HURRY = 4.0
"""With a rotor lost integrals of the rates grow so much faster: lift stands beside the centre."""
_BRAKE_GAIN, _BRAKE_LIMIT = 2.0, 1.7
"""Acceleration against horizontal speed [1/s], its limit: 10 degrees of tilt [m/s^2]."""
_LEAST_UPRIGHT = 0.7
"""Cosine of the tilt beyond which a tilt is not made up for."""
_LEAST_SHARE = 0.5
"""Least thrust in the air, over that of the hover: without thrust there is no attitude either."""
_FIRST = 1.0
"""Time from the start on within which a body that does not sink counts as in the air [s]."""
_DOWN = 0.3
"""Time for which a body that is told to sink must not, to be down [s]."""
_BLOW_TIME, _BLOW = 0.03, 0.15
"""Speed lost within a time that only the ground takes away [s, m/s]."""


class InertialSpeed:
    """Velocity of the unit by complementary filters.

    Attributes:
        north, east: what has come of late, within some 3 s [m/s].
        climb: [m/s], up.
    """

    def __init__(self) -> None:
        """At rest, before the first pressure."""
        self.north = self.east = self.climb = 0.0
        self._height = math.nan  # above sea level [m], but for the weather

    def update(
        self, attitude: Quaternion, specific_force: Vector, pressure: float, dt: float
    ) -> None:
        """Take one sample.

        Args:
            attitude: body FRD to NED (x, y, z, w).
            specific_force: [m/s^2] FRD.
            pressure: [Pa]; one that is not finite counts as none.
            dt: since the last one [s].
        """
        north, east, down = rotate(attitude, specific_force)
        self.north += (north - _LEAK * self.north) * dt
        self.east += (east - _LEAK * self.east) * dt
        self.climb -= (down + GRAVITY) * dt
        self._height += self.climb * dt
        told = -pressure / _AIR_WEIGHT
        if not math.isfinite(told):
            return
        if not math.isfinite(self._height):
            self._height = told
        missing = told - self._height
        self._height += 2.0 * _BANDWIDTH * missing * dt
        self.climb += _BANDWIDTH**2 * missing * dt


class Descent:
    """One landing.

    Attributes:
        down: the ground has been felt: the thrust may end.
    """

    def __init__(self, speed: float, hover: float):
        """Begin in the air.

        Args:
            speed: at which it is to sink [m/s], positive.
            hover: share of full thrust that carries the weight.
        """
        self.down = False
        self._speed, self._hover = speed, hover
        self._trim = 0.0  # m/s^2
        self._lasted = self._still_for = 0.0
        self._late = math.nan  # vertical speed behind a low-pass [m/s]

    def thrust(self, climb: float, tilt: float, dt: float) -> float:
        """Return the share of full thrust that is wanted now.

        Args:
            climb: vertical speed [m/s], up.
            tilt: from the vertical [rad].
            dt: since the last call [s].
        """
        self.down = self.down or self._feels_ground(climb, dt)
        error = -self._speed - climb
        trim = self._trim + _TRIM_GAIN * error * dt
        self._trim = max(-_TRIM_LIMIT, min(_TRIM_LIMIT, trim))
        share = 1.0 + (_SPEED_GAIN * error + self._trim) / GRAVITY
        upright = max(_LEAST_UPRIGHT, math.cos(tilt))
        return self._hover * max(_LEAST_SHARE, share) / upright

    def _feels_ground(self, climb: float, dt: float) -> bool:
        """Whether a blow has taken the speed away, or the body sinks no further."""
        self._lasted += dt
        slow = climb > -0.5 * self._speed
        self._still_for = self._still_for + dt if slow and self._lasted > _FIRST else 0.0
        if not math.isfinite(self._late):
            self._late = climb
        self._late += (climb - self._late) * dt / _BLOW_TIME
        blow = self._late < -0.4 * self._speed and climb - self._late > _BLOW
        return blow or self._still_for > _DOWN


def braking(speed: InertialSpeed, heading: float) -> tuple[float, float]:
    """Return roll and pitch [rad] FRD that take horizontal speed away.

    Args:
        speed: of the unit.
        heading: of the body [rad].
    """
    north, east = -_BRAKE_GAIN * speed.north, -_BRAKE_GAIN * speed.east
    scale = min(1.0, _BRAKE_LIMIT / max(math.hypot(north, east), 1e-9))
    c, s = math.cos(heading), math.sin(heading)
    ahead, right = scale * (c * north + s * east), scale * (c * east - s * north)
    return math.atan2(right, GRAVITY), -math.atan2(ahead, GRAVITY)


def hurried(integral: Vector) -> Vector:
    """Return the gains of the rates' integrals for three rotors, from those for four."""
    p, q, r = integral
    return _HURRY * p, _HURRY * q, r
