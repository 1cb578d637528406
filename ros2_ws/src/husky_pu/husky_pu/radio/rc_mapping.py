"""The pilot's joystick as a radio's sticks and switches: `sensor_msgs/Joy` to SBUS frames."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from husky_pu.radio.sbus import HIGH, LOW, Frame, SbusChannel, frame_of_pulses

_CENTRE = (LOW + HIGH) / 2
_HALF = (HIGH - LOW) / 2


JOY_PLACES = {
    "throttle": "axis for thrust, down is none",
    "roll": "axis for roll, left is positive",
    "pitch": "axis for pitch, forward (nose down) is positive",
    "yaw": "axis for yaw, left is positive",
    "arm": "button of the arming switch",
    "kill": "button of the kill switch",
    "mode": "button of the mode switch: off STABILIZED, on OFFBOARD",
}
"""Attributes of `JoyLayout`: what is where in `sensor_msgs/Joy`."""


@dataclass(frozen=True)
class JoyLayout:
    """Places in `sensor_msgs/Joy`, see `JOY_PLACES`; -1 for nowhere."""

    throttle: int = 1
    roll: int = 3
    pitch: int = 4
    yaw: int = 0
    arm: int = 7
    kill: int = 6
    mode: int = 5


class RcMapping:
    """Keeps the newest sticks and switches, and tells when there are none.

    Attributes:
        refused: joystick messages that were not finite or lacked an axis.
        refusal: why the last of them was refused.
    """

    def __init__(
        self,
        layout: JoyLayout,
        *,
        dead_band: float = 0.02,
        silence: float = 0.5,
        momentary: bool = False,
        upper_half: bool = False,
    ):
        """Start without a joystick, that is in failsafe.

        Args:
            layout: what is where.
            dead_band: share of a centred stick's travel that counts as centre; the rest is
                stretched to the whole travel, linearly.
            silence: age at which the last message counts as lost [s].
            momentary: buttons spring back, so each press turns a switch over.
            upper_half: the throttle stick springs back to its centre, which is no thrust.
        """
        self.refused = 0
        self.refusal = ""
        self._layout = layout
        self._dead_band = dead_band
        self._silence = silence
        self._momentary = momentary
        self._upper_half = upper_half
        self._pulses = [_CENTRE] * len(SbusChannel)
        self._pulses[SbusChannel.THROTTLE] = LOW
        self._switches = {SbusChannel.ARM: False, SbusChannel.KILL: False, SbusChannel.MODE: False}
        self._held = dict(self._switches)
        self._heard = -math.inf

    def joy(self, axes: Sequence[float], buttons: Sequence[int], now: float) -> bool:
        """Take a joystick message whole, or refuse it whole; return whether it was taken.

        Args:
            axes: each -1 to 1.
            buttons: 0 or 1.
            now: the time [s], of the same clock as in `frame`.
        """
        layout = self._layout
        try:
            throttle, roll, pitch, yaw = (
                _axis(axes, getattr(layout, name), name)
                for name in ("throttle", "roll", "pitch", "yaw")
            )
            held = {
                channel: _button(buttons, getattr(layout, channel.name.lower()), channel.name)
                for channel in self._switches
            }
        except ValueError as error:
            self.refused += 1
            self.refusal = str(error)
            return False
        if layout.throttle < 0:
            throttle = -1.0
        share = max(0.0, self._centred(throttle)) if self._upper_half else (throttle + 1.0) / 2
        self._pulses[SbusChannel.THROTTLE] = LOW + share * (HIGH - LOW)
        self._pulses[SbusChannel.ROLL] = _CENTRE - _HALF * self._centred(roll)
        self._pulses[SbusChannel.PITCH] = _CENTRE + _HALF * self._centred(pitch)
        self._pulses[SbusChannel.YAW] = _CENTRE - _HALF * self._centred(yaw)
        for channel, pressed in held.items():
            if not self._momentary:
                self._switches[channel] = pressed
            elif pressed and not self._held[channel]:
                self._switches[channel] = not self._switches[channel]
        self._held = held
        self._heard = now
        return True

    def lost(self, now: float) -> bool:
        """Return whether the joystick has been silent for too long, or was never heard."""
        return not now - self._heard <= self._silence

    def restart(self, now: float) -> None:
        """Time has gone back to `now` [s]: what was heard before then counts from there on."""
        self._heard = min(self._heard, now)

    def frame(self, now: float) -> Frame:
        """Return the frame to send at a time [s]: the sticks, or the failsafe.

        In failsafe the sticks are centred, throttle is low and switches stay as they are.
        """
        lost = self.lost(now)
        pulses = [_CENTRE] * len(SbusChannel) if lost else list(self._pulses)
        if lost:
            pulses[SbusChannel.THROTTLE] = LOW
        for channel, on in self._switches.items():
            pulses[channel] = HIGH if on else LOW
        return frame_of_pulses(pulses, frame_lost=lost, failsafe=lost)

    def _centred(self, value: float) -> float:
        """Return a stick's deflection without its dead band, -1 to 1."""
        beyond = abs(value) - self._dead_band
        return math.copysign(beyond / (1.0 - self._dead_band), value) if beyond > 0.0 else 0.0


def _axis(axes: Sequence[float], place: int, name: str) -> float:
    if place < 0:
        return 0.0
    if place >= len(axes):
        raise ValueError(f"no axis {place} for {name}, there are {len(axes)}")
    value = axes[place]
    if not math.isfinite(value):
        raise ValueError(f"axis {place} for {name} is {value}")
    return min(max(value, -1.0), 1.0)


def _button(buttons: Sequence[int], place: int, name: str) -> bool:
    if place < 0:
        return False
    if place >= len(buttons):
        raise ValueError(f"no button {place} for {name.lower()}, there are {len(buttons)}")
    return bool(buttons[place])


class JoyQueue:
    """Joystick messages that wait until the clock has passed their stamps.

    One that was sent at t and one of the clock that was told at t come in either order. With this a
    message counts from the first time after its stamp, in every run.
    """

    def __init__(self, horizon: float = 1.0):
        """Begin empty.

        Args:
            horizon: a stamp further from the clock than this is of another clock, or none, and its
                message counts at once [s].
        """
        self._horizon = horizon
        self._waiting: deque[tuple[float, Sequence[float], Sequence[int]]] = deque()

    def push(self, stamp: float, axes: Sequence[float], buttons: Sequence[int], now: float) -> None:
        """Take a message with its stamp, at a time of the clock [s]."""
        ours = abs(stamp - now) <= self._horizon
        self._waiting.append((stamp if ours else -math.inf, axes, buttons))

    def due(self, now: float) -> Iterator[tuple[Sequence[float], Sequence[int]]]:
        """Yield axes and buttons of the messages from before a time [s], as they have come."""
        while self._waiting and self._waiting[0][0] < now:
            yield self._waiting.popleft()[1:]

    def clear(self) -> None:
        """Forget what waits: time has gone back."""
        self._waiting.clear()


class FrameSchedule:
    """Multiples of a period that a clock has passed: frame n belongs to n periods."""

    def __init__(self, period_ns: int, ahead_ns: int = 0, most: int = 100):
        """Begin with the first time that is told.

        Args:
            period_ns: between frames [ns].
            ahead_ns: how long before its time a frame is due [ns].
            most: after a jump by more frames than this the schedule begins anew.
        """
        self._period = period_ns
        self._ahead = ahead_ns
        self._most = most
        self._next: int | None = None
        self._time = 0

    def due(self, time_ns: int) -> tuple[range, bool]:
        """Return the numbers of the frames that are due now, and whether time went back."""
        back = self._next is not None and time_ns < self._time
        newest = (time_ns + self._ahead) // self._period
        self._time = time_ns
        if self._next is None or back or newest - self._next >= self._most:
            self._next = max(1, -(-time_ns // self._period))
        frames = range(self._next, newest + 1)
        self._next = max(self._next, newest + 1)
        return frames, back
