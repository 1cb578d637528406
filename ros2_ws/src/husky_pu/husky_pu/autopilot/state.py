"""Small things that the parts of the flight controller hand to each other."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

from husky_description.rotation import Quaternion, Vector
from husky_pu.autopilot.descent import InertialSpeed

ZERO: Vector = (0.0, 0.0, 0.0)
"""No rotation, no moment."""


class Severity(IntEnum):
    """Of a status text (MAV_SEVERITY)."""

    EMERGENCY = 0
    ALERT = 1
    CRITICAL = 2
    WARNING = 4
    INFO = 6


@dataclass
class Motion:
    """What is known of the unit's motion in this tick.

    Attributes:
        attitude: quaternion (x, y, z, w), body FRD to NED.
        rates: [rad/s] FRD.
        aligned: whether they are valid at all.
        sensors_ok: gyro and accelerometer say something that can be true.
        sensors_lost: they have not for HKY_GYR_LOSS.
        compass_ok: the magnetometer does.
        still_for: how long the unit has not turned fast [s].
        tilt: from the vertical [rad].
        speed: of the unit; at rest where MPC_LAND_SPEED is 0.
    """

    attitude: Quaternion = (0.0, 0.0, 0.0, 1.0)
    rates: Vector = ZERO
    aligned: bool = False
    sensors_ok: bool = False
    sensors_lost: bool = False
    compass_ok: bool = False
    still_for: float = 0.0
    tilt: float = 0.0
    speed: InertialSpeed = field(default_factory=InertialSpeed)
