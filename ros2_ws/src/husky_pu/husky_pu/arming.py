"""Pre-arm checks: why the unit may not be armed, in the words of its status text."""

from __future__ import annotations

import math
from dataclasses import dataclass

from husky_pu.autopilot_battery import BatteryLevel
from husky_pu.failsafes import FlightMode
from husky_pu.flight_parameters import FlightParameters


@dataclass(frozen=True)
class Readiness:
    """What the checks look at.

    Attributes:
        mode: of flight.
        sensors_ok: gyro and accelerometer say something that can be true.
        compass_ok: so does the magnetometer.
        aligned: there is an attitude.
        still_for: how long the unit has not turned faster than HKY_ARM_GYR [s].
        tilt: from the vertical [rad].
        battery_connected: the power module says something that can be true.
        battery: warning.
        kill: the kill switch is on.
        terminated: a termination has not been lifted.
        sticks_alive: sticks come.
        throttle: of the stick, 0 to 1.
        stream_alive: setpoints come at 2 Hz or faster.
        setpoint_thrust: that they ask for, 0 to 1.
    """

    mode: FlightMode
    sensors_ok: bool
    compass_ok: bool
    aligned: bool
    still_for: float
    tilt: float
    battery_connected: bool
    battery: BatteryLevel
    kill: bool
    terminated: bool
    sticks_alive: bool
    throttle: float
    stream_alive: bool
    setpoint_thrust: float


STILL_TIME = 0.5
"""How long the unit has to be still [s]."""


def never(readiness: Readiness) -> str:
    """Return why not even force arms, or ""; PX4's force would."""
    if readiness.terminated:
        return "flight termination active"
    if readiness.kill:
        return "kill switch engaged"
    return ""


def refusals(readiness: Readiness, parameters: FlightParameters) -> list[str]:
    """Return every reason against arming, the gravest first; none means go."""
    r, p = readiness, parameters
    offboard = r.mode is FlightMode.OFFBOARD
    checks = (
        (never(r) != "", never(r)),
        (not r.sensors_ok, "gyro or accelerometer missing"),
        (not r.compass_ok, "compass missing"),
        (not r.aligned, "attitude not ready"),
        (r.still_for < STILL_TIME, "unit is moving"),
        (r.tilt > math.radians(p["HKY_ARM_TILT"]), "tilted too far"),
        (not r.battery_connected, "battery not connected"),
        (r.battery >= BatteryLevel.LOW, "low battery"),
        (offboard and not r.stream_alive, "no offboard signal"),
        (offboard and r.setpoint_thrust > p["HKY_ARM_THR"], "thrust setpoint not low"),
        (
            not offboard and not r.sticks_alive and not p["COM_ARM_WO_RC"],
            "no manual control input",
        ),
        (not offboard and r.sticks_alive and r.throttle > p["HKY_ARM_THR"], "throttle not low"),
    )
    return [reason for fails, reason in checks if fails]
