"""Setpoints as MAVLink messages, and what lockstep holds until its time has come."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from husky_pu.autopilot.setpoints import AttitudeSetpoint, actuator_setpoint, attitude_setpoint
from husky_pu.autopilot.telemetry import Message

SETPOINT_PERIOD_NS = 10_000_000
"""Of the companion's stream in lockstep [ns]."""
_ATTITUDE, _ACTUATORS = "SET_ATTITUDE_TARGET", "SET_ACTUATOR_CONTROL_TARGET"
_CLOCK = "SYSTEM_TIME"
_STATE_CHANGING = frozenset(
    (
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
        mavlink.MAV_CMD_DO_SET_MODE,
        mavlink.MAV_CMD_DO_FLIGHTTERMINATION,
        mavlink.MAV_CMD_PREFLIGHT_STORAGE,
    )
)

Held = tuple[Hashable, Message]
"""The link that a message came by, and the message."""


def is_setpoint(message: Any) -> bool:
    """Whether a message is a setpoint."""
    return message.get_type() in (_ATTITUDE, _ACTUATORS)


def keeps_time(message: Any) -> bool:
    """Whether a message tells how far the companion has come: a setpoint, or that there is none."""
    return is_setpoint(message) or message.get_type() == _CLOCK


def stamp_of(message: Any) -> int:
    """Return the time that a message which keeps time carries [ns]."""
    if message.get_type() in (_ATTITUDE, _CLOCK):
        return int(message.time_boot_ms) * 1_000_000
    return int(message.time_usec) * 1000


def read_setpoint(message: Any) -> AttitudeSetpoint:
    """Return the setpoint in a message.

    Raises:
        ValueError: it is a bad one.
        OverflowError: the same.
    """
    m = message
    if m.get_type() == _ATTITUDE:
        rates = (m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate)
        return attitude_setpoint(stamp_of(m), m.type_mask, m.q, rates, m.thrust, m.thrust_body)
    return actuator_setpoint(stamp_of(m), m.group_mlx, m.controls)


def changes_state(message: Any) -> bool:
    """Whether a message arms, changes the mode, a parameter or the sticks."""
    kind = message.get_type()
    if kind in ("COMMAND_LONG", "COMMAND_INT"):
        return message.command in _STATE_CHANGING
    return kind in ("SET_MODE", "PARAM_SET", "PARAM_EXT_SET", "RC_CHANNELS_OVERRIDE")


class HeldMessages:
    """Messages in the order in which they came."""

    def __init__(self) -> None:
        """Hold nothing."""
        self._held: deque[Held] = deque()

    def __len__(self) -> int:
        return len(self._held)

    def push(self, link: Hashable, message: Message) -> None:
        """Hold a message."""
        self._held.append((link, message))

    def due(self, now_ns: int) -> list[Held]:
        """Return all up to the last that keeps time and is 10 ms old, at a multiple of 10 ms."""
        count = 0
        if now_ns % SETPOINT_PERIOD_NS == 0:
            for place, (_, message) in enumerate(self._held, 1):
                if keeps_time(message):
                    if stamp_of(message) > now_ns - SETPOINT_PERIOD_NS:
                        break
                    count = place
        return [self._held.popleft() for _ in range(count)]

    def commands(self) -> list[Held]:
        """Return all but those that keep time, which stay."""
        held, self._held = self._held, deque()
        self._held.extend(item for item in held if keeps_time(item[1]))
        return [item for item in held if not keeps_time(item[1])]

    def everything(self) -> list[Held]:
        """Return all."""
        held, self._held = self._held, deque()
        return list(held)
