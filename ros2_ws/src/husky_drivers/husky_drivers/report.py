"""What the master says about its drives and commands, in words and as records."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from husky_drivers.axes import Settings, outside
from husky_drivers.bus import AlState, Bus
from husky_drivers.cia402 import Mode, State, error_name
from husky_drivers.commissioning import describe_code

CYCLIC_MODES = (
    Mode.CYCLIC_SYNCHRONOUS_POSITION,
    Mode.CYCLIC_SYNCHRONOUS_VELOCITY,
    Mode.CYCLIC_SYNCHRONOUS_TORQUE,
)
"""Modes that a command may ask for."""


@dataclass(frozen=True)
class AxisStatus:
    """One drive, as husky_msgs/DriveStatus wants it: A, V, rad."""

    joint: str
    statusword: int
    state: State
    error_code: int
    error: str
    mode_of_operation: int
    safe_torque_off: bool
    bus_voltage: float
    current: float
    following_error: float


def why_refused(settings: Settings, mode: int, position: Any, velocity: Any, effort: Any) -> str:
    """Why a command is refused; the first thing that is wrong with it."""
    if mode not in CYCLIC_MODES:
        return f"mode of operation {mode} is not one of {[int(m) for m in CYCLIC_MODES]}"
    s = settings
    rows = (
        ("position [rad]", position, s.position_lower, s.position_upper),
        ("velocity [rad/s]", velocity, -s.velocity_limit, s.velocity_limit),
        ("effort [N m]", effort, -s.torque_limit, s.torque_limit),
    )
    for quantity, values, lower, upper in rows:
        if len(values) != len(s.joint_names):
            return f"{len(values)} numbers of {quantity}, expected {len(s.joint_names)}"
        wrong = outside(np.asarray(values), lower, upper, s.joint_names, quantity)
        if wrong:
            return wrong
    return "out of range"


def describe(settings: Settings, which: Any, states: Any, errors: Any) -> str:
    """Name some drives with their states and errors.

    Args:
        settings: names.
        which: (n,) bool.
        states: (n,) values of `State`.
        errors: (n,) error codes.
    """
    return ", ".join(
        f"{settings.joint_names[i]}: {State(int(states[i])).title}"
        + (f" ({error_name(int(errors[i]))})" if errors[i] else "")
        for i in np.flatnonzero(which)
    )


def why_incomplete(bus: Bus, settings: Settings, working_counter: int) -> str:
    """Which drives miss from the exchanges."""
    away = []
    for axis, name in enumerate(settings.joint_names):
        status = bus.al_status(axis)
        if status == 0:
            away.append(f"{name} does not answer")
        elif status != AlState.OP:
            away.append(f"{name} left OP ({describe_code(bus.al_status_code(axis))})")
    counters = f"{working_counter} of {bus.expected_working_counter}"
    return f"bus incomplete, working counter {counters}: {', '.join(away) or 'frames lost'}"
