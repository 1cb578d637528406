"""The thrust's axis when the fans are vectored: two angles, what turns them, what they are told.

An ideal gimbal at the robot's centre of mass stands for the thesis's force in any direction (T25).
It turns the unit by the pitch p about base y, then by the roll r about the x axis so turned, so
that in base (x forward, y left, z up) the thrust points along

    R_y(p) R_x(r) z = (sin p cos r, -sin r, cos p cos r).

Each angle has a servo: limits, a rate, a first-order lag; pulses as the speed controllers' (PX4's
tilt servos), `pulse_low` to `pulse_high` from one limit to the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from husky_description.robot import Robot
from husky_description.rotation import Vector

LEAST_PULSE, GREATEST_PULSE = 800.0, 2200.0
"""Widths that count as pulses, of a servo and of a speed controller [us]."""

Angles = tuple[float, float]
"""Pitch and roll of the axis [rad]."""
Rotation = tuple[Vector, Vector, Vector]
"""Rows of a rotation matrix."""

NEUTRAL: Angles = (0.0, 0.0)
"""Along base z."""


@dataclass(frozen=True)
class Gimbal:
    """Geometry, limits and servos of the axis.

    Attributes:
        limits: of pitch and roll, both ways [rad].
        rate: of each servo [rad/s].
        lag: of each servo [s].
        pulse_low: at the lower limit [us].
        pulse_high: at the upper limit [us].
    """

    limits: Angles
    rate: float
    lag: float
    pulse_low: float
    pulse_high: float

    @classmethod
    def of(cls, robot: Robot) -> Gimbal | None:
        """Return the robot's, None when its fans are fixed."""
        if robot.legs_carry_propellers or robot.fans.mounting != "vectoring":
            return None
        section = robot.gimbal
        return cls(
            (section.pitch_limit, section.roll_limit),
            section.rate,
            section.lag,
            robot.esc.pulse_low,
            robot.esc.pulse_high,
        )

    def angles(self, direction: Sequence[float]) -> Angles:
        """Return the angles within the limits that point along a direction in base.

        Args:
            direction: (3,) of any length but zero; zero is `NEUTRAL`.
        """
        x, y, z = direction
        pitch = math.atan2(x, z) if x or z else 0.0
        roll = math.atan2(-y, math.hypot(x, z))
        limit_pitch, limit_roll = self.limits
        return _within(pitch, limit_pitch), _within(roll, limit_roll)

    def slewed(self, angles: Angles, target: Angles, dt: float) -> Angles:
        """Return the angles after `dt` [s] on their way to a target at the servos' rate."""
        step = self.rate * dt
        pitch, roll = (a + _within(t - a, step) for a, t in zip(angles, target, strict=True))
        return pitch, roll

    def followed(self, angles: Angles, target: Angles, dt: float) -> Angles:
        """Return where the servos are after `dt` [s]: the target through lag, rate and limits."""
        share = 1.0 - math.exp(-dt / self.lag) if self.lag > 0.0 else 1.0
        step = self.rate * dt
        pitch, roll = (
            _within(a + _within(share * (_within(t, limit) - a), step), limit)
            for a, t, limit in zip(angles, target, self.limits, strict=True)
        )
        return pitch, roll

    def pulses(self, angles: Angles) -> tuple[int, int]:
        """Return the pulses that mean the angles [us]."""
        middle, span = self._middle_and_span
        pitch, roll = (
            round(middle + span * _within(a, limit) / limit)
            for a, limit in zip(angles, self.limits, strict=True)
        )
        return pitch, roll

    def told(self, pulses: Sequence[float], before: Angles = NEUTRAL) -> Angles:
        """Return the angles that pulses mean; what is no pulse leaves a servo where it was told."""
        middle, span = self._middle_and_span
        pitch, roll = (
            _within(limit * (pulse - middle) / span, limit)
            if LEAST_PULSE <= pulse <= GREATEST_PULSE
            else a
            for pulse, a, limit in zip(pulses, before, self.limits, strict=True)
        )
        return pitch, roll

    @property
    def _middle_and_span(self) -> tuple[float, float]:
        return (self.pulse_low + self.pulse_high) / 2.0, (self.pulse_high - self.pulse_low) / 2.0


def axis(angles: Angles) -> Vector:
    """Return the unit vector in base along which the thrust points."""
    pitch, roll = angles
    return (
        math.sin(pitch) * math.cos(roll),
        -math.sin(roll),
        math.cos(pitch) * math.cos(roll),
    )


def rotation(angles: Angles) -> Rotation:
    """Return the rows of the matrix from the turned unit's axes to base's."""
    pitch, roll = angles
    sp, cp, sr, cr = math.sin(pitch), math.cos(pitch), math.sin(roll), math.cos(roll)
    return (cp, sp * sr, sp * cr), (0.0, cr, -sr), (-sp, cp * sr, cp * cr)


def into_unit(angles: Angles, vector: Sequence[float]) -> Vector:
    """Return a vector of base in the turned unit's axes."""
    (a, b, c), (d, e, f), (g, h, i) = rotation(angles)
    x, y, z = vector
    return a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z


def into_base(angles: Angles, vector: Sequence[float]) -> Vector:
    """Return a vector of the turned unit's axes in base's."""
    x, y, z = vector
    p, q, r = (a * x + b * y + c * z for a, b, c in rotation(angles))
    return p, q, r


def _within(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
