"""Pre-arm checks: why the unit may not be armed, in the words of its status text."""

from __future__ import annotations

import math

from husky_pu.autopilot.battery import BatteryLevel
from husky_pu.autopilot.failsafes import FlightMode, FlightSituation
from husky_pu.autopilot.flight_parameters import FlightParameters

STILL_TIME = 0.5
"""How long the unit has to be still [s]."""


def never(situation: FlightSituation) -> str:
    """Return why not even force arms, or ""; PX4's force would."""
    if situation.terminated:
        return "flight termination active"
    if situation.kill:
        return "kill switch engaged"
    return ""


def refusals(situation: FlightSituation, parameters: FlightParameters) -> list[str]:
    """Return every reason against arming, the gravest first; none means go."""
    s, m, p = situation, situation.motion, parameters
    offboard = s.mode is FlightMode.OFFBOARD
    checks = (
        (never(s) != "", never(s)),
        (not m.sensors_ok, "gyro or accelerometer missing"),
        (not m.compass_ok, "compass missing"),
        (not m.aligned, "attitude not ready"),
        (m.still_for < STILL_TIME, "unit is moving"),
        (m.tilt > math.radians(p["HKY_ARM_TILT"]), "tilted too far"),
        (not s.battery_connected, "battery not connected"),
        (s.battery >= BatteryLevel.LOW, "low battery"),
        (offboard and not s.stream_alive, "no offboard signal"),
        (offboard and s.setpoint_thrust > p["HKY_ARM_THR"], "thrust setpoint not low"),
        (
            not offboard and not s.sticks_alive and not p["COM_ARM_WO_RC"],
            "no manual control input",
        ),
        (not offboard and s.sticks_alive and s.throttle > p["HKY_ARM_THR"], "throttle not low"),
    )
    return [reason for fails, reason in checks if fails]
