"""The law of the bus servos with their motors, gears and encoders, once a physics step.

Per step and joint:
- Encoder on the horn: count = round(center + q resolution / 2 pi). Speeds of count and of goal are
  those of second-order observers that follow them (critically damped).
- Position controller: u = (P e + D T (g' - c')) / 885 of the supply, e = goal - count, T the
  servo's own period, cut to the goal PWM. Velocity and profile modes are not modelled.
- Told: the observed speed, and the current through a low-pass as late as that, so that both are of
  the same moment.
- Current: (u U - k w) / R at the rotor's speed w, cut to the goal current and the current limit;
  R, k, torque per ampere and friction from stall and no-load figures, so that both ends of the
  torque-speed line are the data sheet's.
- Friction: Coulomb's, as the no-load current says, linear below a creeping speed.
- Backlash: the rotor is on one flank or the other of a gap, or between them, where it moves by
  itself and carries nothing; it lands without bouncing.
- Winding: one thermal capacity, heated by R i^2.
- Protection: temperature, overload (current at its limit for a time), supply out of range; what
  the shutdown mask holds takes torque off. A bus watchdog that bites holds the servo where it is.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from husky_description.arrays import Array

MOTOR = np.dtype(
    [
        # from the control table
        ("torque_on", "i4"),
        ("follows", "i4"),  # the mode is one of those that follow a goal position
        ("goal", "f8"),  # counts
        ("p", "f8"),  # share of the supply per count
        ("d", "f8"),  # share of the supply s per count
        ("goal_pwm", "f8"),  # greatest share of the supply
        ("goal_current", "f8"),  # A
        ("current_limit", "f8"),  # A
        ("temperature_limit", "f8"),  # deg C
        ("voltage_low", "f8"),  # V
        ("voltage_high", "f8"),  # V
        ("shutdown", "i4"),  # bits of hardware errors that take torque off
        ("watchdog", "f8"),  # s, 0 for none
        # to the control table
        ("error", "i4"),  # hardware error bits
        ("bitten", "i4"),  # by the watchdog
        ("count", "i8"),
        ("current", "f8"),  # of the motor, A
        ("told_current", "f8"),  # the same through a low-pass
        ("temperature", "f8"),  # of the winding, deg C
        ("voltage", "f8"),  # of the supply, V
        # inside
        ("started", "i4"),
        ("seen", "f8"),  # observer of the count
        ("seen_rate", "f8"),  # counts/s; it is also what is told
        ("aimed", "f8"),  # observer of the goal
        ("aimed_rate", "f8"),
        ("gap", "f8"),  # rotor ahead of the horn, rad, from -half to half of the backlash
        ("rotor", "f8"),  # its speed at the horn, rad/s
        ("loaded", "f8"),  # time at the current limit, s
        ("silence", "f8"),  # since the last packet, s
    ],
    align=True,
)
"""One servo; joint side, SI, except where said."""

CONSTANTS = np.dtype(
    [
        ("step", "f8"),  # s
        ("counts_per_radian", "f8"),
        ("center", "f8"),  # counts
        ("torque_per_ampere", "f8"),
        ("friction", "f8"),  # N m
        ("creep", "f8"),  # rad/s, below which friction is linear
        ("resistance", "f8"),
        ("volts_per_speed", "f8"),
        ("half_gap", "f8"),  # rad
        ("armature", "f8"),  # kg m^2
        ("law_rate", "f8"),  # of the observers, 1/s
        ("told_gain", "f8"),  # of the low-pass of the told current, per step
        ("heating", "f8"),  # K/W
        ("cooling", "f8"),  # share of the difference lost in a step
        ("ambient", "f8"),  # deg C
        ("overload_time", "f8"),  # s
    ],
    align=True,
)
"""What all servos share."""

VOLTAGE_ERROR, HEAT_ERROR, OVERLOAD_ERROR = 0x01, 0x04, 0x20
_AT_LIMIT = 0.98
"""Share of the current limit at which a motor counts as at its limit."""


@njit(cache=True)
def current_of(volts: float, speed: float, c: Any) -> float:
    """Return the current that a voltage [V] drives at a speed [rad/s] of the rotor [A]."""
    current: float = (volts - c.volts_per_speed * speed) / c.resistance
    return current


@njit(cache=True)
def _observe(seen: float, rate: float, value: float, c: Any) -> tuple[float, float]:
    """Follow a value; return what is seen of it and its rate (critically damped)."""
    error = value - seen
    return (
        seen + (rate + 2.0 * c.law_rate * error) * c.step,
        rate + c.law_rate**2 * error * c.step,
    )


@njit(cache=True)
def _current(s: Any, c: Any) -> float:
    """Return the motor's current under the position controller [A]."""
    if not s.torque_on or not s.follows:
        return 0.0
    share: float = s.p * (s.goal - s.count) + s.d * (s.aimed_rate - s.seen_rate)
    share = min(max(share, -s.goal_pwm), s.goal_pwm)
    limit = min(s.goal_current, s.current_limit)
    current: float = min(max(current_of(share * s.voltage, s.rotor, c), -limit), limit)
    return current


@njit(cache=True)
def _through_gap(s: Any, c: Any, motor: float, joint_speed: float) -> float:
    """Return the torque that reaches the horn [N m]; moves the rotor on within the backlash."""
    if c.half_gap == 0.0:
        s.rotor = joint_speed
        return motor
    touching = (s.gap >= c.half_gap and motor > 0.0) or (s.gap <= -c.half_gap and motor < 0.0)
    if touching:
        s.rotor = joint_speed
        return motor
    s.rotor += motor / c.armature * c.step
    s.gap += (s.rotor - joint_speed) * c.step
    if abs(s.gap) >= c.half_gap:
        s.gap = c.half_gap if s.gap > 0.0 else -c.half_gap
        s.rotor = joint_speed
    return 0.0


@njit(cache=True)
def _protect(s: Any, c: Any) -> None:
    """Heat the winding, and let go or stop where the servo protects itself."""
    heat = c.resistance * s.current**2 * c.heating
    s.temperature += (c.ambient + heat - s.temperature) * c.cooling
    if s.temperature >= s.temperature_limit:
        s.error |= HEAT_ERROR
    strained = s.torque_on and abs(s.current) >= _AT_LIMIT * s.current_limit
    s.loaded = s.loaded + c.step if strained else max(0.0, s.loaded - c.step)
    if s.loaded >= c.overload_time:
        s.error |= OVERLOAD_ERROR
    if s.voltage < s.voltage_low or s.voltage > s.voltage_high:
        s.error |= VOLTAGE_ERROR
    if s.error & s.shutdown:
        s.torque_on = 0
    s.silence += c.step
    if s.torque_on and s.watchdog > 0.0 and s.silence > s.watchdog and not s.bitten:
        s.bitten = 1
        s.goal = s.count


@njit(cache=True)
def step_motors(
    motors: Any, constants: Any, joint_position: Array, joint_velocity: Array, torque: Array
) -> None:
    """Run one physics step's law of all servos.

    Args:
        motors: (n,) records of `MOTOR`.
        constants: (1,) record of `CONSTANTS`.
        joint_position: (n,) at the start of the step [rad].
        joint_velocity: (n,) at the start of the step [rad/s].
        torque: (n,) overwritten with the joint torques [N m].
    """
    c = constants[0]
    for index in range(len(motors)):
        s = motors[index]
        s.count = int(np.floor(c.center + joint_position[index] * c.counts_per_radian + 0.5))
        if not s.started:
            s.started = 1
            s.seen, s.seen_rate = float(s.count), 0.0
            s.aimed, s.aimed_rate = s.goal, 0.0
            s.rotor = joint_velocity[index]
        if not s.torque_on:
            s.aimed, s.aimed_rate = s.goal, 0.0
        s.seen, s.seen_rate = _observe(s.seen, s.seen_rate, float(s.count), c)
        s.aimed, s.aimed_rate = _observe(s.aimed, s.aimed_rate, s.goal, c)
        s.current = _current(s, c)
        s.told_current += (s.current - s.told_current) * c.told_gain
        motor = c.torque_per_ampere * s.current
        motor -= c.friction * min(max(s.rotor / c.creep, -1.0), 1.0)
        torque[index] = _through_gap(s, c, motor, joint_velocity[index])
        _protect(s, c)
