"""From thrust commands to setpoints: what is refused, how fast thrust may rise, what is said."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum

from husky_description.rotation import Quaternion, Vector, swap_body
from husky_pu.companion.client import MavlinkClient
from husky_pu.mavlink.axes import mavlink_attitude

SILENCE_NS = 500_000_000
"""After so long without a command thrust begins at zero again [ns]."""
_NOMINAL_NS = 10_000_000
"""Between two commands [ns]; what the first one's thrust may rise by."""
_LONGEST_NS = 100_000_000
"""A gap between commands lets thrust rise by no more than this [ns]."""
_IGNORE_RATES = 7
_THRUST_BODY_SET = 32
_IGNORE_ATTITUDE = 128
_UNIT_TOLERANCE = 1e-3
"""Of a quaternion's length, as ArduPilot demands."""
_SIDE_FORCE = 0.01
"""Force across base z that still counts as none [N]."""
_NO_MOMENT = 1e-3
"""Moment that counts as none beside a force in any direction [N m]."""
_ROUNDING = 1e-6
"""Relative; a command may exceed a limit by this, and is then held to it."""


_ZERO: Vector = (0.0, 0.0, 0.0)
_LEVEL: Quaternion = (1.0, 0.0, 0.0, 0.0)


class Kind(IntEnum):
    """Kinds of husky_msgs/PropulsionCommand."""

    NONE = 0
    ATTITUDE = 1
    WRENCH = 2


@dataclass(frozen=True)
class ThrustCommand:
    """husky_msgs/PropulsionCommand: stamp [ns], rotation FLU to ENU (x, y, z, w), [N], [N m]."""

    stamp_ns: int
    kind: int
    attitude: Sequence[float] = (0.0, 0.0, 0.0, 1.0)
    force: Sequence[float] = (0.0, 0.0, 0.0)
    moment: Sequence[float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Limits:
    """What the unit can do.

    Attributes:
        collective: thrust of all fans [N] that 1 stands for on the wire.
        moment: (3,) about base x, y, z [N m] that 1 stands for on the wire.
        thrust_rate: how fast the collective may rise [N/s].
        vectoring: the fans push in any direction at the centre of mass, not along base z alone.
    """

    collective: float
    moment: Sequence[float]
    thrust_rate: float
    vectoring: bool = False


@dataclass(frozen=True)
class ThrustSetpoint:
    """What goes on the wire.

    Attributes:
        kind: as commanded.
        as_wrench: it goes as SET_ACTUATOR_CONTROL_TARGET.
        thrust: share of the collective, 0 to 1.
        attitude: FRD to NED (w, x, y, z).
        moment: shares of the moments, -1 to 1, FRD.
        force: shares of the collective in each direction, FRD, which go as `thrust_body` of
            SET_ATTITUDE_TARGET; None for a thrust along base z.
    """

    kind: Kind
    as_wrench: bool
    thrust: float = 0.0
    attitude: Quaternion = (1.0, 0.0, 0.0, 0.0)
    moment: Vector = _ZERO
    force: Vector | None = None

    def without_thrust(self) -> ThrustSetpoint:
        """Return the one that asks for nothing, by the same message."""
        return ThrustSetpoint(
            Kind.NONE, self.as_wrench, force=None if self.force is None else _ZERO
        )

    def send(self, sender: MavlinkClient, boot_us: int) -> None:
        """Send it with a time of the autopilot's clock [us]."""
        boot_ms = boot_us // 1000
        if self.force is not None:
            mask = _THRUST_BODY_SET | _IGNORE_ATTITUDE | _IGNORE_RATES
            # Who does not know thrust_body may at most push as much along z.
            up = max(0.0, -self.force[2])
            sender.attitude_target(boot_ms, mask, _LEVEL, _ZERO, up, self.force)
        elif self.as_wrench:
            sender.actuator_target(boot_us, (*self.moment, self.thrust))
        elif self.kind is Kind.ATTITUDE:
            sender.attitude_target(boot_ms, _IGNORE_RATES, self.attitude, _ZERO, self.thrust)
        else:
            sender.attitude_target(boot_ms, _IGNORE_ATTITUDE, _LEVEL, _ZERO, 0.0)


@dataclass
class ThrustSetpoints:
    """Turns commands into setpoints, one for each that is good.

    Thrust falls at once and rises by at most `limits.thrust_rate`; it rises from zero after a
    silence, while disarmed, and after a restart of time. While it is held back, moments shrink
    in proportion.

    Attributes:
        limits: see `Limits`.
        enabled: whether thrust may be asked for: while armed, and not after a kill.
        accepted: commands that were good.
        refused: commands that were not.
        refusal: why the last of them was refused.
        projected: commands whose force across base z was left out: the fans are fixed.
        projection: what was left out of the last of them.
        newest: last setpoint, None before the first.
        stamp_ns: of its command [ns], -1 before the first.
    """

    limits: Limits
    enabled: bool = False
    accepted: int = 0
    refused: int = 0
    refusal: str = ""
    projected: int = 0
    projection: str = ""
    newest: ThrustSetpoint | None = None
    stamp_ns: int = -1
    _thrust: float = field(default=0.0, repr=False)

    def convert(self, command: ThrustCommand) -> ThrustSetpoint | None:
        """Take a command whole, or refuse it whole; return its setpoint, None for a refused one.

        A command with the stamp of the one before gets the same setpoint again.
        """
        if command.stamp_ns == self.stamp_ns and self.newest is not None:
            return self.newest
        try:
            kind = self._check(command)
        except ValueError as error:
            self.refused += 1
            self.refusal = str(error)
            return None
        self.newest = self._setpoint(kind, command)
        self.stamp_ns = command.stamp_ns
        self.accepted += 1
        return self.newest

    def silent(self, stamp_ns: int) -> bool:
        """Return whether no command has come for 0.5 s, at this stamp [ns]."""
        return self.newest is None or not 0 <= stamp_ns - self.stamp_ns <= SILENCE_NS

    def enable(self, enabled: bool) -> None:
        """Allow thrust, or ask for none from now on; it begins at zero when allowed again."""
        self.enabled = enabled
        if not enabled:
            self._thrust = 0.0

    def _check(self, command: ThrustCommand) -> Kind:
        """Return the kind; raises ValueError for what is not finite or out of range."""
        try:
            kind = Kind(command.kind)
        except ValueError:
            raise ValueError(f"kind {command.kind} is not known") from None
        if kind is Kind.NONE:
            return kind
        numbers = (*command.force, *command.moment, *command.attitude)
        if not all(map(math.isfinite, numbers)):
            raise ValueError("not finite")
        down = self.limits.vectoring and command.force[2] < -_SIDE_FORCE
        if kind is Kind.WRENCH and (down or _is_across(command.force)):
            self._check_across(command)
        else:
            self._check_collective(command.force[2])
        if kind is Kind.ATTITUDE:
            norm = math.hypot(*command.attitude)
            if not abs(norm - 1.0) <= _UNIT_TOLERANCE:
                raise ValueError(f"attitude of length {norm:g}, it must be 1")
            return kind
        for axis, value, limit in zip("xyz", command.moment, self.limits.moment, strict=True):
            if abs(value) > limit * (1.0 + _ROUNDING):
                raise ValueError(f"moment {axis} {value:g} N m, it must be within {limit:g} N m")
        return kind

    def _check_collective(self, thrust: float) -> None:
        most = self.limits.collective
        if not -_SIDE_FORCE <= thrust <= most * (1.0 + _ROUNDING):
            raise ValueError(f"collective thrust {thrust:g} N, it must be 0 to {most:g} N")

    def _check_across(self, command: ThrustCommand) -> None:
        length, most = math.hypot(*command.force), self.limits.collective
        if length > most * (1.0 + _ROUNDING):
            raise ValueError(f"force of {length:g} N, it must be 0 to {most:g} N")
        if self.limits.vectoring and max(map(abs, command.moment)) > _NO_MOMENT:
            raise ValueError("a moment beside a force that is not along z: there is no message")

    def _setpoint(self, kind: Kind, command: ThrustCommand) -> ThrustSetpoint:
        since = command.stamp_ns - self.stamp_ns
        if self.silent(command.stamp_ns):
            self._thrust, since = 0.0, _NOMINAL_NS
        if kind is Kind.NONE or not self.enabled:
            self._thrust = 0.0
            return self._nothing(kind, command)
        force = self._force(kind, command)
        wanted = min(math.hypot(*force), self.limits.collective)
        rise = self.limits.thrust_rate * 1e-9 * min(since, _LONGEST_NS)
        self._thrust = min(wanted, self._thrust + rise)
        thrust = self._thrust / self.limits.collective
        if kind is Kind.ATTITUDE:
            return ThrustSetpoint(kind, False, thrust, self._attitude(command))
        if self._is_vectored(command):
            scale = thrust / wanted if wanted > 0.0 else 0.0
            x, y, z = swap_body(force)
            return ThrustSetpoint(kind, False, thrust, force=(scale * x, scale * y, scale * z))
        share = self._thrust / wanted if wanted > 0.0 else 1.0
        x, y, z = (
            share * min(max(value / limit, -1.0), 1.0)
            for value, limit in zip(command.moment, self.limits.moment, strict=True)
        )
        return ThrustSetpoint(kind, True, thrust, moment=swap_body((x, y, z)))

    def _nothing(self, kind: Kind, command: ThrustCommand) -> ThrustSetpoint:
        """Return the setpoint without thrust, by the message that the command would go by."""
        if kind is Kind.NONE:
            none = ThrustSetpoint(kind, False)
            return self.newest.without_thrust() if self.newest is not None else none
        if kind is Kind.ATTITUDE:
            # An attitude is told before it is flown: the yaw of a standing robot is not zero.
            return ThrustSetpoint(kind, False, attitude=self._attitude(command))
        vectored = self._is_vectored(command)
        return ThrustSetpoint(kind, not vectored, force=_ZERO if vectored else None)

    def _force(self, kind: Kind, command: ThrustCommand) -> Vector:
        """Return the force that is asked of the fans, in base [N]; say what is left out."""
        x, y, z = command.force
        if kind is Kind.WRENCH and self._is_vectored(command):
            return (x, y, z)
        if kind is Kind.WRENCH and _is_across(command.force):
            self.projected += 1
            self.projection = f"({x:g}, {y:g}) N across the fans, they are fixed along z"
        return (0.0, 0.0, max(z, 0.0))

    def _is_vectored(self, command: ThrustCommand) -> bool:
        """Whether a wrench goes as a force in any direction: one with moments is along z."""
        return self.limits.vectoring and max(map(abs, command.moment)) <= _NO_MOMENT

    @staticmethod
    def _attitude(command: ThrustCommand) -> Quaternion:
        norm = math.hypot(*command.attitude)
        w, x, y, z = mavlink_attitude(command.attitude)
        return w / norm, x / norm, y / norm, z / norm


def _is_across(force: Sequence[float]) -> bool:
    return max(map(abs, force[:2])) > _SIDE_FORCE


class BootClock:
    """Maps this machine's time to that of an autopilot which counts from its start.

    A report arrives later than it was made, never earlier: the smallest difference of the last
    10 to 20 s is the nearest to the truth.
    """

    _BLOCK_NS = 10_000_000_000

    def __init__(self) -> None:
        """Nothing is known."""
        self._block_start: int | None = None
        self._smallest = self._smallest_before = 0

    def observe(self, boot_us: int, host_ns: int) -> None:
        """A report of a time of the autopilot [us] has arrived at a time of the host [ns]."""
        offset = host_ns - 1000 * boot_us
        start = self._block_start
        # A start of the autopilot moves the offset by far; so does a clock that is set.
        if start is None or abs(offset - self._smallest) > 1_000_000_000:
            self._block_start = host_ns
            self._smallest = self._smallest_before = offset
        elif host_ns - start > self._BLOCK_NS:
            self._block_start = host_ns
            self._smallest, self._smallest_before = offset, self._smallest
        else:
            self._smallest = min(self._smallest, offset)

    @property
    def known(self) -> bool:
        """Whether there has been a report."""
        return self._block_start is not None

    def boot_us(self, host_ns: int) -> int:
        """Return the autopilot's time [us] at a time of the host [ns], not below 0."""
        return max(0, (host_ns - self._offset) // 1000)

    def host_ns(self, boot_us: int) -> int:
        """Return the host's time [ns] at a time of the autopilot [us]."""
        return 1000 * boot_us + self._offset

    @property
    def _offset(self) -> int:
        return min(self._smallest, self._smallest_before)
