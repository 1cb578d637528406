"""Stick input: from the receiver's SBUS frames or from RC_CHANNELS_OVERRIDE, as PX4 chooses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from husky_pu.autopilot.flight_parameters import FlightParameters

CHANNELS = 16
_LOW, _HIGH = 1300.0, 1700.0
"""Switches are off below, on above [us]; between the two they stay as they were."""
_DEAD_ZONE = 0.02
"""Share of a stick's travel about its centre."""


class Source(IntEnum):
    """Where sticks come from."""

    NONE = 0
    RADIO = 1
    MAVLINK = 2


@dataclass(frozen=True)
class Sticks:
    """Sticks and switches.

    Attributes:
        roll: -1 to 1, right positive.
        pitch: -1 to 1, stick forward (nose down) positive.
        yaw: -1 to 1, clockwise from above positive.
        throttle: 0 to 1.
        offboard: mode switch.
        arm: arm switch, None when there is none.
        kill: kill switch.
    """

    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    throttle: float = 0.0
    offboard: bool | None = None
    arm: bool | None = None
    kill: bool = False


class StickInput:
    """Chooses the source, maps channels, knows when the sticks are lost.

    Attributes:
        source: whose sticks count now.
        seen: whether sticks have ever come.
        sticks: the last ones.
        pulses: of the channels [us] (16,), empty before the first.
        failsafe: the receiver itself says that it has lost the transmitter.
        bad_frames: inputs refused because a number was not finite or absurd.
    """

    def __init__(self, parameters: FlightParameters):
        """Start without sticks."""
        self._parameters = parameters
        self.bad_frames = 0
        self.source = Source.NONE
        self.seen = False
        self.sticks = Sticks()
        self.pulses: tuple[float, ...] = ()
        self.failsafe = False
        self._heard = {Source.RADIO: -math.inf, Source.MAVLINK: -math.inf}
        self._override: list[float] = [0.0] * CHANNELS

    def radio(
        self, pulses: Sequence[float], now: float, *, failsafe: bool = False, lost: bool = False
    ) -> None:
        """Take a frame of the receiver.

        Args:
            pulses: widths of 16 channels [us].
            now: time [s].
            failsafe: the receiver has lost the transmitter.
            lost: the receiver has missed this frame; its channels are old.
        """
        if failsafe:
            self.failsafe = self.failsafe or self.source is Source.RADIO
            return
        if lost:
            return
        if len(pulses) < CHANNELS or not all(700.0 <= pulse <= 2300.0 for pulse in pulses):
            self.bad_frames += 1
            return
        self._take(Source.RADIO, tuple(pulses[:CHANNELS]), now)

    def override(self, fields: Sequence[int], now: float) -> None:
        """Take RC_CHANNELS_OVERRIDE, 18 fields [us].

        0 releases channels 1 to 8, 65534 channels 9 to 18; 65535 (and 0 from 9 on) leaves one as it
        is. Sticks count when the four main channels are given.
        """
        values = list(self._override)
        for index, field in enumerate(fields[:CHANNELS]):
            if field == 65535 or (index >= 8 and field == 0):
                continue
            released = field == 0 if index < 8 else field == 65534
            if not released and not 700 <= field <= 2300:
                self.bad_frames += 1
                return
            values[index] = 0.0 if released else float(field)
        self._override = values
        if any(values) and all(values[:4]):
            self._take(Source.MAVLINK, tuple(v or 1500.0 for v in values), now, given=values)

    def _take(
        self,
        source: Source,
        pulses: tuple[float, ...],
        now: float,
        given: Sequence[float] | None = None,
    ) -> None:
        mode = int(self._parameters["COM_RC_IN_MODE"])
        self._heard[source] = now
        if mode == 4 or (mode == 0 and source is not Source.RADIO):
            return
        if mode == 1 and source is not Source.MAVLINK:
            return
        if mode == 3 and self.source not in (Source.NONE, source):
            return
        if mode == 2 and self.source not in (Source.NONE, source) and not self.silent(now):
            return
        self.source, self.seen, self.failsafe, self.pulses = source, True, False, pulses
        self.sticks = self._map(pulses, given)

    def silent(self, now: float) -> bool:
        """Whether the source has said nothing for COM_RC_LOSS_T, or the receiver its fail-safe."""
        heard = self._heard.get(self.source, -math.inf)
        return self.failsafe or now - heard > self._parameters["COM_RC_LOSS_T"]

    def _map(self, pulses: Sequence[float], given: Sequence[float] | None) -> Sticks:
        p = self._parameters

        def channel(name: str) -> float | None:
            index = int(p[name]) - 1
            if index < 0 or (given is not None and not given[index]):
                return None
            return pulses[index]

        def switch(name: str, before: bool | None) -> bool | None:
            pulse = channel(name)
            if pulse is None:
                return None
            return True if pulse > _HIGH else False if pulse < _LOW else bool(before)

        throttle = channel("RC_MAP_THROTTLE")
        old = self.sticks
        return Sticks(
            roll=_centred(channel("RC_MAP_ROLL")),
            pitch=_centred(channel("RC_MAP_PITCH")),
            yaw=_centred(channel("RC_MAP_YAW")),
            throttle=0.0 if throttle is None else max(0.0, min(1.0, (throttle - 1000.0) / 1000.0)),
            offboard=switch("RC_MAP_OFFB_SW", old.offboard),
            arm=switch("RC_MAP_ARM_SW", old.arm),
            kill=bool(switch("RC_MAP_KILL_SW", old.kill)),
        )


def _centred(pulse: float | None) -> float:
    if pulse is None:
        return 0.0
    share = max(-1.0, min(1.0, (pulse - 1500.0) / 500.0))
    if abs(share) < _DEAD_ZONE:
        return 0.0
    return math.copysign((abs(share) - _DEAD_ZONE) / (1.0 - _DEAD_ZONE), share)
