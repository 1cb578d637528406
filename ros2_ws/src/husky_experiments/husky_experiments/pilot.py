"""A person with a radio: sees the propulsion unit from beside it and moves two sticks.

The hands are what a plain closed loop makes of the place and the speed that are seen, a few times a
second and no faster than a hand moves. `Sight` is the ground truth (`radio_flight`): a person sees
it. Nothing of the autopilot's own estimate is used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from husky_control.slew import slewed
from husky_description.arrays import Array
from husky_description.gravity import GRAVITY
from husky_pu.autopilot.flight_parameters import TABLE
from husky_pu.radio.rc_mapping import JoyLayout

FULL_TILT = math.radians(TABLE["MPC_MAN_TILT_MAX"].default)
"""Tilt that a full stick asks for [rad]."""
FULL_YAW_RATE = math.radians(TABLE["MPC_MAN_Y_MAX"].default)
"""Yaw rate that a full stick asks for [rad/s]."""
_LAYOUT = JoyLayout()
_HAND = 0.8
"""How fast a stick is moved, in half travels [1/s]."""
_THUMB = 0.2
"""How fast the throttle is moved, in full travels [1/s]."""
_STIFFNESS, _DAMPING = 0.8, 1.8
"""Acceleration that is wanted for a distance [1/s^2] and a speed [1/s] along the ground."""
_TRIMMING = 0.12
"""Growth of the acceleration that holds against an autopilot whose level is wrong [1/s^3]."""
_TRIM_TILT = math.radians(2.5)
"""Largest tilt of that trim [rad]."""
_CAUTION = math.radians(6.0)
"""Largest tilt that is used to stay at a place [rad]."""
_RISE, _BRAKE, _TRIM = 0.10, 0.09, 0.05
"""Throttle for a height [1/m], a speed of rising [s/m], and a height that stays [1/(m s)]."""
_TRIM_LIMIT = 0.05
_REACH = 0.4
"""A height that is further away looks no further [m]."""


@dataclass(frozen=True)
class Sight:
    """What the person sees."""

    position: Array  # of the unit in world [m] (3,)
    velocity: Array  # in world [m/s] (3,)
    yaw: float  # where its nose points, from world x [rad]


@dataclass(frozen=True)
class Wish:
    """What is wanted of the unit; None is left to the hand that keeps it at its place."""

    roll: float | None = None  # right side down [rad]
    pitch: float | None = None  # nose down [rad]
    yaw_rate: float = 0.0  # to the left [rad/s]
    throttle: float | None = None  # 0 to 1


class Pilot:
    """Two hands on the radio.

    Attributes:
        place: where the unit is wanted, in world [m] (3,).
        armed: the arming switch.
        throttle: stick, 0 to 1.
        roll, pitch, yaw: sticks, -1 to 1; left, forward, left.
    """

    def __init__(self, hover: float):
        """Let everything go.

        Args:
            hover: throttle that carries the unit, 0 to 1, as far as the person knows.
        """
        self.place = np.zeros(3)
        self.armed = False
        self.throttle = self.roll = self.pitch = self.yaw = 0.0
        self._hover = hover
        self._trim = 0.0
        self._lean_trim = np.zeros(2)  # acceleration in world [m/s^2]

    def move(self, sight: Sight, wish: Wish, dt: float) -> None:
        """Look, and move the sticks as is wished until the next look, dt [s] later."""
        if wish.roll is None and wish.pitch is None and self._flies:
            self._trim_lean(sight, dt)
        stay, trim = self._lean(sight), _tilts(self._lean_trim, sight.yaw)
        roll, pitch = (
            trimmed + (near if wanted is None else wanted)
            for trimmed, near, wanted in zip(trim, stay, (wish.roll, wish.pitch), strict=True)
        )
        throttle = self._lift(sight, dt) if wish.throttle is None else wish.throttle
        self.roll = _towards(self.roll, -roll / FULL_TILT, _HAND * dt)
        self.pitch = _towards(self.pitch, pitch / FULL_TILT, _HAND * dt)
        self.yaw = _towards(self.yaw, wish.yaw_rate / FULL_YAW_RATE, _HAND * dt)
        self.throttle = max(0.0, _towards(self.throttle, throttle, _THUMB * dt))

    @property
    def _flies(self) -> bool:
        """True if the throttle is near the one that carries the unit."""
        return self.throttle > 0.5 * self._hover

    def _lean(self, sight: Sight) -> tuple[float, float]:
        """Return roll and pitch [rad] that bring the unit to its place."""
        wanted = _STIFFNESS * (self.place - sight.position) - _DAMPING * sight.velocity
        roll, pitch = _tilts(wanted[:2], sight.yaw)
        limit = _CAUTION
        return max(-limit, min(limit, roll)), max(-limit, min(limit, pitch))

    def _trim_lean(self, sight: Sight, dt: float) -> None:
        """Trim the sticks against what carries the unit off while it is to stay where it is."""
        error = (self.place - sight.position)[:2]
        away = float(np.linalg.norm(error))
        trim = self._lean_trim + _TRIMMING * dt * error * min(1.0, _REACH / max(away, 1e-9))
        size, most = float(np.linalg.norm(trim)), GRAVITY * math.tan(_TRIM_TILT)
        self._lean_trim = trim * min(1.0, most / max(size, 1e-9))

    def _lift(self, sight: Sight, dt: float) -> float:
        """Return the throttle that brings the unit to its height."""
        error = max(-_REACH, min(_REACH, float(self.place[2] - sight.position[2])))
        if self._flies:
            self._trim += _TRIM * error * dt
            self._trim = max(-_TRIM_LIMIT, min(_TRIM_LIMIT, self._trim))
        return self._hover + self._trim + _RISE * error - _BRAKE * float(sight.velocity[2])

    def joy(self) -> tuple[list[float], list[int]]:
        """Return axes and buttons of `sensor_msgs/Joy`."""
        axes, buttons = [0.0] * 8, [0] * 8
        axes[_LAYOUT.throttle] = 2.0 * self.throttle - 1.0
        axes[_LAYOUT.roll], axes[_LAYOUT.pitch] = self.roll, self.pitch
        axes[_LAYOUT.yaw] = self.yaw
        buttons[_LAYOUT.arm] = int(self.armed)
        return axes, buttons


def _tilts(acceleration: Array, yaw: float) -> tuple[float, float]:
    """Return roll and pitch [rad] that give an acceleration in world [m/s^2] (2,) at a heading."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    forward = cos * acceleration[0] + sin * acceleration[1]
    left = cos * acceleration[1] - sin * acceleration[0]
    # Nose down (REP-103: positive) goes forward, right side down (positive) goes right.
    return math.atan2(-left, GRAVITY), math.atan2(forward, GRAVITY)


def _towards(value: float, goal: float, step: float) -> float:
    """Return a stick moved towards a goal within its travel, no further than a step."""
    return slewed(value, max(-1.0, min(1.0, goal)), step)
