"""The force that the fans make, by what the flight controller tells."""

from __future__ import annotations

import math
from dataclasses import dataclass

from husky_description.gimbal import NEUTRAL, Angles, Gimbal, axis
from husky_description.robot import Robot
from husky_description.rotation import Vector
from husky_pu.autopilot.weighted_mixer import mixer_of
from husky_pu.companion.telemetry import Report


@dataclass(frozen=True)
class Force:
    """What the unit makes.

    Attributes:
        force: in base [N].
        tilt: pitch and roll of its axis, as the servos are told [rad].
        limit: greatest force without a moment that the fans left can make [N].
        thrust: of each fan, along the axis [N].
    """

    force: Vector
    tilt: Angles
    limit: float
    thrust: tuple[float, ...]


class ForceEstimate:
    """Reckons with the robot's own fans and gimbal."""

    def __init__(self, robot: Robot):
        """Take thrust curve and mounting of the robot."""
        self._mixer = mixer_of(robot)
        self._gimbal = Gimbal.of(robot)

    def of(self, report: Report) -> Force:
        """Return what the unit makes as of a report.

        By the rotors' speeds; where they are not known by the pulses, which rotors follow within
        about 0.1 s. A lost fan makes none.
        """
        voltage = report.battery.voltage if report.battery.voltage > 0.0 else None
        left = report.fan_ok
        made = self._thrusts(report, voltage)
        each = tuple(t if ok else 0.0 for t, ok in zip(made, left, strict=True))
        thrust = sum(each)
        tilt = self._gimbal.told(report.tilt) if self._gimbal is not None else NEUTRAL
        x, y, z = axis(tilt)
        return Force(
            (thrust * x, thrust * y, thrust * z),
            tilt,
            self._mixer.greatest_collective(voltage, left),
            each,
        )

    def _thrusts(self, report: Report, voltage: float | None) -> list[float]:
        if math.isnan(sum(report.fan_speed)):
            return [float(t) for t in self._mixer.steady_thrust(report.pwm, voltage)]
        return [self._mixer.fan.thrust_coefficient * w * w for w in report.fan_speed]
