"""Which joints a master has, what they may be commanded, and why a command is refused."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from husky_description.arrays import Array
from husky_description.robot import Robot
from husky_drivers.cia402 import OperationMode

POSITION_MARGIN = 0.05
"""How far a position command may lie beyond the joints' range [rad]: a joint at its stop must be
held where it is, and the encoder errs a little."""
CYCLIC_MODES = (
    OperationMode.CYCLIC_SYNCHRONOUS_POSITION,
    OperationMode.CYCLIC_SYNCHRONOUS_VELOCITY,
    OperationMode.CYCLIC_SYNCHRONOUS_TORQUE,
)
"""Modes that a command may ask for."""


@dataclass(frozen=True, eq=False, kw_only=True)
class JointSettings:
    """Numbers of the joints that every master has; angles and torques on the joint side.

    Attributes:
        joint_names: in their order along the wire.
        position_lower, position_upper: range of a position command [rad] (n,).
        velocity_limit: range of a velocity command [rad/s] (n,).
        torque_limit: range of an effort command [N m] (n,).
        command_timeout_ticks: ticks without a command until all joints stop.
        enable_window: distance of a position command from the joint that still allows to enable
            [rad].
        handover_velocity: speed at which targets close on the command when position control begins
            [rad/s].
    """

    joint_names: tuple[str, ...]
    position_lower: Array
    position_upper: Array
    velocity_limit: Array
    torque_limit: Array
    command_timeout_ticks: int = 5
    enable_window: float = 0.2
    handover_velocity: float = 1.0

    def __post_init__(self) -> None:
        """Check the scalars; raises ValueError naming the setting and its range."""
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, (int, float)) and not (math.isfinite(value) and value > 0):
                raise ValueError(f"{field.name} is {value!r}, it must be finite and above 0")


def ranges_of(robot: Robot) -> dict[str, Any]:
    """Return the names and ranges of a robot's joints, as `JointSettings` wants them."""
    return {
        "joint_names": tuple(robot.joint_names),
        "position_lower": robot.joint_lower - POSITION_MARGIN,
        "position_upper": robot.joint_upper + POSITION_MARGIN,
        "velocity_limit": robot.joint_velocity_limit,
        "torque_limit": robot.joint_torque_limit,
    }


def why_refused(
    settings: JointSettings, mode: int, position: Any, velocity: Any, effort: Any
) -> str:
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
        wrong = _outside(np.asarray(values), lower, upper, s.joint_names, quantity)
        if wrong:
            return wrong
    return "out of range"


def _outside(
    values: Array, lower: Array, upper: Array, names: tuple[str, ...], quantity: str
) -> str:
    """Say which of some numbers is out of its range, and which is allowed; "" when none is."""
    for value, low, high, name in zip(values, lower, upper, names, strict=True):
        if not math.isfinite(value):
            return f"{name}: {quantity} is not finite"
        if not low <= value <= high:
            return f"{name}: {quantity} {value:.4g} is outside [{low:.4g}, {high:.4g}]"
    return ""
