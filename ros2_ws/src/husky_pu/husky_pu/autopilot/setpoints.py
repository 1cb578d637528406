"""Setpoints from a companion: what is accepted, from whom, and whether the stream is alive."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from enum import IntFlag

from husky_description.rotation import Quaternion, Vector

STREAM_PERIOD = 0.5
"""A stream is at least this fast [s]: 2 Hz, as PX4 demands of OFFBOARD."""
_NORM_TOLERANCE = 1e-2
"""Of a quaternion's length; ArduPilot's is 1e-3, PX4 has none. Four floats cost 1e-7."""
_THRUST_TOLERANCE = 1e-3
"""By which three numbers that are rounded may make more than the full thrust."""
_RATE_LIMIT = 35.0
"""Greatest rate that means something [rad/s]: the gyro's range, 2000 deg/s."""


class TypeMask(IntFlag):
    """Bits of SET_ATTITUDE_TARGET.type_mask."""

    IGNORE_ROLL_RATE = 1
    IGNORE_PITCH_RATE = 2
    IGNORE_YAW_RATE = 4
    THRUST_BODY_SET = 32
    IGNORE_THROTTLE = 64
    IGNORE_ATTITUDE = 128


@dataclass(frozen=True)
class AttitudeSetpoint:
    """What a companion wants; one of attitude, rates or moments.

    Attributes:
        stamp_ns: time of the message as its sender wrote it [ns].
        thrust: share of the full collective thrust, 0 to 1; None keeps the one before.
        attitude: quaternion (x, y, z, w), body FRD to NED; `yaw_rate` is fed forward.
        rates: angular velocity in the body [rad/s].
        moments: shares of what the mixer can give, -1 to 1, FRD; goes past the control loops.
        yaw_rate: beside an attitude [rad/s].
        direction: unit vector along which the thrust is wanted, FRD; None for the body's up; zero
            where it does not matter, since no thrust is wanted.
    """

    stamp_ns: int
    thrust: float | None
    attitude: Quaternion | None = None
    rates: Vector | None = None
    moments: Vector | None = None
    yaw_rate: float = 0.0
    direction: Vector | None = None


def attitude_setpoint(
    stamp_ns: int,
    type_mask: int,
    wxyz: Sequence[float],
    rates: Sequence[float],
    thrust: float,
    thrust_body: Sequence[float] = (0.0, 0.0, 0.0),
) -> AttitudeSetpoint:
    """Return the setpoint of a SET_ATTITUDE_TARGET.

    With an attitude the yaw rate is fed forward and the others are not used, as in PX4; without
    one the rates are followed, and one that is ignored is 0. With THRUST_BODY_SET the thrust is
    `thrust_body`, FRD; if all else is ignored then, it is a force without a moment.

    Raises:
        ValueError: it asks for nothing, or a number that is used is not finite or out of range.
    """
    mask = TypeMask(type_mask & 0xFF)
    vectored = bool(mask & TypeMask.THRUST_BODY_SET)
    direction: Vector | None = None
    share: float | None = None
    if vectored:
        if mask & TypeMask.IGNORE_THROTTLE:
            raise ValueError("thrust both set and ignored")
        share, direction = _thrust_body(thrust_body)
    elif not mask & TypeMask.IGNORE_THROTTLE:
        share = _within(thrust, 0.0, 1.0, "thrust")
    used = [
        0.0 if mask & bit else _within(rate, -_RATE_LIMIT, _RATE_LIMIT, "rate")
        for bit, rate in zip(list(TypeMask)[:3], rates, strict=True)
    ]
    if not mask & TypeMask.IGNORE_ATTITUDE:
        w, x, y, z = wxyz
        norm = math.sqrt(w * w + x * x + y * y + z * z)
        if not abs(norm - 1.0) <= _NORM_TOLERANCE:
            raise ValueError(f"quaternion of length {norm:.3g}")
        attitude = (x / norm, y / norm, z / norm, w / norm)
        return AttitudeSetpoint(
            stamp_ns, share, attitude=attitude, yaw_rate=used[2], direction=direction
        )
    if mask & 7 == 7:
        if not vectored:
            raise ValueError("neither attitude nor rates")
        return AttitudeSetpoint(stamp_ns, share, moments=(0.0, 0.0, 0.0), direction=direction)
    return AttitudeSetpoint(stamp_ns, share, rates=(used[0], used[1], used[2]), direction=direction)


def _thrust_body(thrust_body: Sequence[float]) -> tuple[float, Vector]:
    """Return length and direction, (0, 0, 0) for none."""
    x, y, z = (_within(part, -1.0, 1.0, "thrust_body") for part in thrust_body)
    length = _within(math.hypot(x, y, z), 0.0, 1.0 + _THRUST_TOLERANCE, "length of thrust_body")
    if length == 0.0:
        return 0.0, (0.0, 0.0, 0.0)
    return min(length, 1.0), (x / length, y / length, z / length)


def actuator_setpoint(stamp_ns: int, group: int, controls: Sequence[float]) -> AttitudeSetpoint:
    """Return the setpoint of a SET_ACTUATOR_CONTROL_TARGET of group 0.

    Controls 0 to 2 are the moments about roll, pitch, yaw, 3 is the thrust; the rest is not used.

    Raises:
        ValueError: another group, a number that is not finite or out of range.
    """
    if group != 0:
        raise ValueError(f"group {group}")
    roll, pitch, yaw = (_within(control, -1.0, 1.0, "moment") for control in controls[:3])
    return AttitudeSetpoint(
        stamp_ns, _within(controls[3], 0.0, 1.0, "thrust"), moments=(roll, pitch, yaw)
    )


def _within(value: float, lower: float, upper: float, name: str) -> float:
    if not lower <= value <= upper:
        raise ValueError(f"{name} {value:g}")
    return value


class SetpointStream:
    """The stream of accepted setpoints; one source owns it as long as it speaks.

    Attributes:
        newest: last setpoint, None before the first.
        stamp_ns: its sender's time [ns], -1 before the first.
        accepted: how many were.
        refused: whole messages that were bad.
        contested: setpoints refused because another source owns the stream.
        thrust: the last thrust that was asked for.
        direction: of that thrust, see `AttitudeSetpoint`.
    """

    def __init__(self) -> None:
        """Start without a source."""
        self.newest: AttitudeSetpoint | None = None
        self.stamp_ns = -1
        self.accepted = self.refused = self.contested = 0
        self.thrust = 0.0
        self.direction: Vector | None = None
        self._source: Hashable = None
        self._times = [-math.inf, -math.inf]

    def accept(self, setpoint: AttitudeSetpoint, source: Hashable, now: float) -> bool:
        """Take a setpoint; return False when another source speaks.

        Args:
            setpoint: a good one.
            source: who sent it.
            now: time of arrival [s].
        """
        if source != self._source and self.age(now) <= STREAM_PERIOD:
            self.contested += 1
            return False
        self._source = source
        self.newest = setpoint
        self.stamp_ns = setpoint.stamp_ns
        if setpoint.thrust is not None:
            self.thrust, self.direction = setpoint.thrust, setpoint.direction
        self._times = [self._times[1], now]
        self.accepted += 1
        return True

    def age(self, now: float) -> float:
        """Return the time since the last one [s], inf before the first."""
        return now - self._times[1]

    def link(self, now: float) -> Hashable:
        """Return the link of the source that owns the stream, None when nobody does."""
        owned = isinstance(self._source, tuple) and self.age(now) <= STREAM_PERIOD
        return self._source[0] if owned else None  # type: ignore[index]

    def alive(self, now: float) -> bool:
        """Whether setpoints come at 2 Hz or faster: the last two and none overdue."""
        return self.age(now) <= STREAM_PERIOD and self._times[1] - self._times[0] <= STREAM_PERIOD
