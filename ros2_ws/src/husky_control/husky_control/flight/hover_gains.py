"""Numbers of a flight by the T265 and the flight controller's attitude."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class HoverGains:
    """Numbers of the flight; forces are shares of the weight."""

    height: float = 0.3  # m, of the hold above the standing body
    climb_speed: float = 0.25  # m/s
    sink_speed: float = 0.15  # m/s
    blind_speed: float = 0.2  # m/s, of sinking in a blind landing
    take_off_rate: float = 0.8  # 1/s, rise of the force below 0.9
    last_rate: float = 0.3  # 1/s, the same above
    weigh_rate: float = 0.8  # 1/s, fall of the force on the ground
    fade_rate: float = 1.4  # 1/s, the same after a fault
    patience: float = 2.0  # s, to leave the ground at the greatest force
    position_gain: float = 0.7  # 1/s, velocity per position error
    velocity_gain: float = 1.4  # 1/s, acceleration per velocity error
    speed_limit: float = 0.3  # m/s
    tilt_limit: float = math.radians(6.0)  # rad
    trim_gain: float = 0.25  # 1/s^3, of the integral on position
    trim_limit: float = 0.35  # m/s^2
    height_gain: float = 1.2  # 1/s, rate of climb per height error
    climb_gain: float = 3.0  # 1/s, acceleration per error of the rate of climb
    lift_gain: float = 2.0  # 1/s^3, of the integral on height
    lift_limit: float = 1.5  # m/s^2
    blind_bleed: float = 0.01  # 1/s, how fast the force sinks in a blind landing
