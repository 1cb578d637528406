"""One speed controller: pulses in, throttle out.

A pulse is its width [us]; anything outside 800 to 2200 us, 0 above all, is no pulse.

- Unarmed after power-on. Pulses below `pulse_start` for `arming_time` without a gap arm it.
- Armed: throttle = (pulse - pulse_low) / (pulse_high - pulse_low), 0 below `pulse_start`, through
  a first-order lag; while a pulse is missing the last one holds.
- No pulse for longer than `pulse_timeout`: unarmed, bridge open, the rotor coasts.
- Low voltage, soft: a limit of the throttle integrates gain * (bus voltage - cut-off), within 0
  and 1. Under load it settles where the voltage stands at the cut-off; on a pack that is empty
  even without load it goes to zero.
- Motor current within +-`current_limit` (solved with the bus, see `battery.bus_voltage`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from husky_description.gimbal import GREATEST_PULSE, LEAST_PULSE
from husky_description.robot import Robot

ESC = np.dtype(
    [
        ("armed", "i4"),
        ("failed", "i4"),  # the bridge stays open
        ("low_time", "f8"),  # of pulses below pulse_start, in a row [s]
        ("silence", "f8"),  # since the last pulse [s]
        ("throttle", "f8"),  # after the lag [-]
        ("target", "f8"),  # of the last pulse [-]
        ("limit", "f8"),  # of the low-voltage cut-off [-]
    ],
    align=True,
)
"""State of one speed controller."""

ESC_CONSTANTS = np.dtype(
    [
        ("pulse_low", "f8"),  # us
        ("pulse_span", "f8"),  # us
        ("pulse_start", "f8"),  # us
        ("arming_time", "f8"),  # s
        ("pulse_timeout", "f8"),  # s
        ("lag", "f8"),  # s
        ("cutoff_voltage", "f8"),  # V of the pack
        ("cutoff_gain", "f8"),  # 1/(V s)
    ],
    align=True,
)
"""What all speed controllers share."""

OPEN = -1.0
"""Throttle that `step_esc` returns for an open bridge."""


def esc_constants(robot: Robot) -> Any:
    """(1,) record of `ESC_CONSTANTS` of a robot."""
    constants = np.zeros(1, ESC_CONSTANTS)
    esc, c = robot.esc, constants[0]
    c["pulse_low"] = esc.pulse_low
    c["pulse_span"] = esc.pulse_high - esc.pulse_low
    c["pulse_start"] = esc.pulse_start
    c["arming_time"] = esc.arming_time
    c["pulse_timeout"] = esc.pulse_timeout
    c["lag"] = esc.throttle_lag
    c["cutoff_voltage"] = esc.cutoff_cell_voltage * robot.battery.cells
    c["cutoff_gain"] = esc.cutoff_gain
    return constants


@njit(cache=True)
def step_esc(s: Any, pulse: float, bus_voltage: float, dt: float, c: Any) -> float:
    """Advance one speed controller.

    Args:
        s: record of `ESC`, changed.
        pulse: width at its input [us].
        bus_voltage: [V].
        dt: [s].
        c: record of `ESC_CONSTANTS`.

    Returns:
        Throttle, 0 to 1, or `OPEN`.
    """
    if LEAST_PULSE <= pulse <= GREATEST_PULSE:
        s.silence = 0.0
        low = pulse < c.pulse_start
        s.low_time = s.low_time + dt if low else 0.0
        if not s.armed and low and s.low_time >= c.arming_time - 1e-9:
            s.armed = 1
        s.target = 0.0 if low else min((pulse - c.pulse_low) / c.pulse_span, 1.0)
    else:
        s.silence += dt
        s.low_time = 0.0
        if s.silence > c.pulse_timeout + 1e-9:
            s.armed = 0
    s.limit = min(max(s.limit + c.cutoff_gain * (bus_voltage - c.cutoff_voltage) * dt, 0.0), 1.0)
    if not s.armed or s.failed:
        s.throttle = 0.0
        return OPEN
    share = 1.0 - math.exp(-dt / c.lag) if c.lag > 0.0 else 1.0
    s.throttle += share * (s.target - s.throttle)
    return float(min(s.throttle, s.limit))
