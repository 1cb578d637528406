"""The servo law of the twelve drives with their motors, gears and encoders, at 10 kHz.

Runs in the plant between physics steps, where a real drive closes its loops: targets come at the
control tick, the law runs every drive cycle on what the encoder shows. Per cycle and joint: encoder
(turn error, quantisation), speed estimate, interpolated targets, law, current limits, torque.

- Encoder on the motor shaft: count = floor((a + A sin(a + phase)) N / 2 pi), a the motor's angle.
- Speed: difference of counts over a cycle through a first-order low-pass.
- Position law: kp (p* - p) + kd (v* - v) + torque*; velocity law: kd (v* - v) + torque*. Targets
  run linearly from the last ones to the new ones in the interpolation period, then hold.
- Current: i = torque / (kt ratio efficiency), limited by the drive and by the supply: a motor of
  speed constant K, phase resistance R, on a bus U, takes at most U / (sqrt(3) R) (1 - w / (K U))
  (sinusoidal drive, no inductance). The gear's loss is this constant efficiency in both directions.
- Limits of the drive's own, whatever a command says: the peak current, the joints' greatest speed,
  the greatest gains, positions that its 32 bits of counts can say. A command within them is
  followed as it is; one that holds what is not a number, or an unknown kind, is refused whole.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from husky_description.arrays import Array

OFF, POSITION, VELOCITY, TORQUE = 0, 1, 2, 3
"""Kinds of a servo command (husky_msgs/ServoCommand)."""

SERVO = np.dtype(
    [
        # command
        ("kind", "i4"),
        ("kp", "f8"),
        ("kd", "f8"),
        ("torque_limit", "f8"),
        ("start_position", "f8"),
        ("start_velocity", "f8"),
        ("start_torque", "f8"),
        ("end_position", "f8"),
        ("end_velocity", "f8"),
        ("end_torque", "f8"),
        ("age", "i8"),  # drive cycles since the command
        # encoder
        ("error_amplitude", "f8"),  # rad at the motor
        ("error_phase", "f8"),  # rad
        ("count", "i8"),
        ("velocity", "f8"),  # filtered, counts/s
        ("started", "i4"),
        # motor
        ("current", "f8"),  # mean of the last physics step, A
    ],
    align=True,
)
"""State of one joint's servo; joint side, SI, except where said."""

CONSTANTS = np.dtype(
    [
        ("cycles_per_step", "i8"),
        ("cycle", "f8"),  # s
        ("interpolation_cycles", "i8"),
        ("watchdog_cycles", "i8"),
        ("ratio", "f8"),
        ("counts_per_motor_radian", "f8"),
        ("radians_per_count", "f8"),  # at the joint
        ("filter_gain", "f8"),  # of the speed estimate, per cycle
        ("torque_per_ampere", "f8"),
        ("stall_current_per_volt", "f8"),  # 1/ohm
        ("speed_constant", "f8"),  # rad/s/V
        ("bus_voltage", "f8"),
        # the drive's own limits, joint side
        ("peak_torque", "f8"),  # of its peak current, N m
        ("greatest_position", "f8"),  # rad
        ("greatest_velocity", "f8"),  # rad/s
        ("greatest_kp", "f8"),
        ("greatest_kd", "f8"),
    ],
    align=True,
)
"""What all joints share."""


@njit(cache=True)
def supply_limits(motor_velocity: float, bus_voltage: float, c: Any) -> tuple[float, float]:
    """Least and greatest motor current that the supply can drive at a speed [A].

    Args:
        motor_velocity: rad/s.
        bus_voltage: V.
        c: record of `CONSTANTS`.
    """
    stall = bus_voltage * c.stall_current_per_volt
    back = motor_velocity / c.speed_constant * c.stall_current_per_volt
    return -stall - back, stall - back


@njit(cache=True)
def encoder_count(motor_angle: float, amplitude: float, phase: float, per_radian: float) -> int:
    """Count that the encoder shows; see the module's formula."""
    return int(np.floor((motor_angle + amplitude * np.sin(motor_angle + phase)) * per_radian))


@njit(cache=True)
def _torque(s: Any, c: Any, motor_velocity: float) -> float:
    """Joint torque in this drive cycle [N m]; the state's age is that of the cycle."""
    if s.kind == OFF or s.age >= c.watchdog_cycles:
        return 0.0
    part = min(1.0, (s.age + 1) / c.interpolation_cycles)
    torque = s.start_torque + part * (s.end_torque - s.start_torque)
    if s.kind != TORQUE:
        velocity = s.start_velocity + part * (s.end_velocity - s.start_velocity)
        torque += s.kd * (velocity - s.velocity * c.radians_per_count)
        if s.kind == POSITION:
            position = s.start_position + part * (s.end_position - s.start_position)
            torque += s.kp * (position - (s.count + 0.5) * c.radians_per_count)
    if not np.isfinite(torque):
        return 0.0
    torque = min(max(torque, -s.torque_limit), s.torque_limit)
    least, greatest = supply_limits(motor_velocity, c.bus_voltage, c)
    current: float = min(max(torque / c.torque_per_ampere, least), greatest)
    return current * float(c.torque_per_ampere)


@njit(cache=True)
def step_servos(
    servos: Any, constants: Any, joint_position: Array, joint_velocity: Array, out: Array
) -> None:
    """Run the drive cycles of one physics step; the joints move on at their velocity meanwhile.

    Args:
        servos: records of `SERVO`.
        constants: (1,) record of `CONSTANTS`.
        joint_position: at the start of the step [rad].
        joint_velocity: at the start of the step [rad/s].
        out: mean torque over the step [N m], written.
    """
    c = constants[0]
    for i in range(len(servos)):
        s = servos[i]
        motor_velocity = joint_velocity[i] * c.ratio
        angle = joint_position[i] * c.ratio
        total = 0.0
        for _ in range(c.cycles_per_step):
            count = encoder_count(
                angle, s.error_amplitude, s.error_phase, c.counts_per_motor_radian
            )
            if s.started:
                s.velocity += c.filter_gain * ((count - s.count) / c.cycle - s.velocity)
            else:
                s.velocity = motor_velocity * c.counts_per_motor_radian
                s.started = 1
            s.count = count
            total += _torque(s, c, motor_velocity)
            s.age += 1
            angle += motor_velocity * c.cycle
        out[i] = total / c.cycles_per_step
        s.current = out[i] / c.torque_per_ampere


@njit(cache=True)
def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


@njit(cache=True)
def is_command(
    kind: Any, position: Any, velocity: Any, torque: Any, kp: Any, kd: Any, torque_limit: Any
) -> bool:
    """Whether every kind is known and every number finite (husky_msgs/ServoCommand)."""
    for i in range(len(kind)):
        if not OFF <= kind[i] <= TORQUE:
            return False
        targets = np.isfinite(position[i]) and np.isfinite(velocity[i]) and np.isfinite(torque[i])
        gains = np.isfinite(kp[i]) and np.isfinite(kd[i]) and np.isfinite(torque_limit[i])
        if not (targets and gains):
            return False
    return True


@njit(cache=True)
def take_command(
    servos: Any,
    constants: Any,
    kind: Any,
    position: Any,
    velocity: Any,
    torque: Any,
    kp: Any,
    kd: Any,
    torque_limit: Any,
) -> bool:
    """Start from where the last targets stand now toward new ones (husky_msgs/ServoCommand).

    A power stage that changes its kind starts at its new targets. Every number is held within the
    drive's own limits; a command that is none changes nothing.

    Returns:
        Whether it was one: see `is_command`.
    """
    if not is_command(kind, position, velocity, torque, kp, kd, torque_limit):
        return False
    c = constants[0]
    for i in range(len(servos)):
        s = servos[i]
        end_position = _within(position[i], c.greatest_position)
        end_velocity = _within(velocity[i], c.greatest_velocity)
        end_torque = _within(torque[i], c.peak_torque)
        if kind[i] == s.kind:
            part = min(1.0, s.age / c.interpolation_cycles)
            s.start_position += part * (s.end_position - s.start_position)
            s.start_velocity += part * (s.end_velocity - s.start_velocity)
            s.start_torque += part * (s.end_torque - s.start_torque)
        else:
            s.start_position = end_position
            s.start_velocity = end_velocity
            s.start_torque = end_torque
        s.kind = kind[i]
        s.end_position = end_position
        s.end_velocity = end_velocity
        s.end_torque = end_torque
        s.kp = min(max(kp[i], 0.0), c.greatest_kp)
        s.kd = min(max(kd[i], 0.0), c.greatest_kd)
        s.torque_limit = min(max(torque_limit[i], 0.0), c.peak_torque)
        s.age = 0
    return True


@njit(cache=True)
def read_state(
    servos: Any, constants: Any, joint_position: Array, count: Any, velocity: Any, current: Any
) -> None:
    """Write what the drives report at a tick; arguments as in `motor.Servos.update_state`."""
    c = constants[0]
    for i in range(len(servos)):
        s = servos[i]
        count[i] = encoder_count(
            joint_position[i] * c.ratio,
            s.error_amplitude,
            s.error_phase,
            c.counts_per_motor_radian,
        )
        velocity[i] = int(np.rint(s.velocity))
        current[i] = s.current
