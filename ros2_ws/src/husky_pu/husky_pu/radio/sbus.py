"""SBUS: the wire between a radio receiver and a flight controller, frames of 25 bytes.

A frame is 0x0F, 22 bytes with 16 channels of 11 bits, least significant bit first, a byte of flags
and 0x00. There is no checksum: a frame is known by its first and last byte and by the pause before
it. The line runs at 100000 baud, 8 data bits, even parity, 2 stop bits, with inverted levels (idle
is low): a UART needs an inverter or the setting for it, while a pseudo-terminal carries bytes and
has neither levels nor parity. 25 bytes of 12 bits take 3 ms; frames follow each other every 7 or
14 ms, so between two of them the line rests for at least 4 ms. Who has times of bytes may use that
pause to resynchronise; this parser has none and goes by the bytes alone.

Numbers: 192 to 1792 stand for 1000 to 2000 us (some stacks use 172 to 1811).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

BAUD = 100_000
"""Of the line, 8E2, inverted [baud]."""
FRAME_SIZE = 25
CHANNELS = 16
HEADER = 0x0F
FOOTER = 0x00
LOW, HIGH = 1000, 2000
"""Ends of a channel's travel [us]."""
_NEXT = bytes((HEADER,))
_RAW_LOW, _RAW_HIGH = 192, 1792
_RAW_MAX = 2047
_MASK = 0x7FF


class SbusChannel(IntEnum):
    """What the channels carry, from 0: the usual order of an aircraft (AETR) and its switches.

    Roll, pitch and yaw rest at 1500 us; above it: right side down, nose down (the stick forward),
    clockwise seen from above. Switches are off below 1300 us and on above 1700 us.
    """

    ROLL = 0
    PITCH = 1
    THROTTLE = 2
    YAW = 3
    MODE = 4
    """Low STABILIZED, high OFFBOARD."""
    ARM = 5
    KILL = 6


@dataclass(frozen=True)
class Frame:
    """One frame.

    Attributes:
        channels: 16 numbers as on the wire, 0 to 2047; see `pulses`.
        channel_17: first digital channel.
        channel_18: second digital channel.
        frame_lost: the receiver has missed a frame of the transmitter.
        failsafe: the receiver has lost the transmitter.
    """

    channels: tuple[int, ...]
    channel_17: bool = False
    channel_18: bool = False
    frame_lost: bool = False
    failsafe: bool = False

    @property
    def pulses(self) -> tuple[float, ...]:
        """The channels as pulse widths [us], 880 to 2159."""
        return tuple(to_pulse(raw) for raw in self.channels)


def to_raw(pulse: float) -> int:
    """Return the number on the wire for a pulse width [us], held within 11 bits."""
    raw = round(_RAW_LOW + (pulse - LOW) * (_RAW_HIGH - _RAW_LOW) / (HIGH - LOW))
    return min(max(raw, 0), _RAW_MAX)


def to_pulse(raw: int) -> float:
    """Return the pulse width of a number on the wire [us]."""
    return LOW + (raw - _RAW_LOW) * (HIGH - LOW) / (_RAW_HIGH - _RAW_LOW)


def frame_of_pulses(
    pulses: Sequence[float], *, frame_lost: bool = False, failsafe: bool = False
) -> Frame:
    """Return a frame of up to 16 pulse widths [us]; channels that are not given are centred.

    Raises:
        ValueError: more than 16.
    """
    if len(pulses) > CHANNELS:
        raise ValueError(f"{len(pulses)} channels, SBUS has {CHANNELS}")
    centre = (LOW + HIGH) / 2
    padded = (*pulses, *[centre] * (CHANNELS - len(pulses)))
    return Frame(tuple(map(to_raw, padded)), frame_lost=frame_lost, failsafe=failsafe)


def encode(frame: Frame) -> bytes:
    """Return the 25 bytes of a frame; raises ValueError if its channels are not 16 of 11 bits."""
    if len(frame.channels) != CHANNELS:
        raise ValueError(f"{len(frame.channels)} channels, SBUS has {CHANNELS}")
    bits = 0
    for index, raw in enumerate(frame.channels):
        if not 0 <= raw <= _RAW_MAX:
            raise ValueError(f"channel {index} is {raw}, it must be 0 to {_RAW_MAX}")
        bits |= raw << 11 * index
    flags = frame.channel_17 | frame.channel_18 << 1 | frame.frame_lost << 2 | frame.failsafe << 3
    return bytes((HEADER,)) + bits.to_bytes(22, "little") + bytes((flags, FOOTER))


def decode(data: bytes | bytearray) -> Frame:
    """Return the frame in 25 bytes; the four spare bits of the flags are ignored.

    Raises:
        ValueError: not 25 bytes, or not those of a frame.
    """
    if len(data) != FRAME_SIZE or data[0] != HEADER or data[-1] != FOOTER:
        raise ValueError(f"no SBUS frame: {bytes(data[:FRAME_SIZE]).hex(' ')}")
    bits = int.from_bytes(data[1:23], "little")
    channels = tuple(bits >> 11 * index & _MASK for index in range(CHANNELS))
    flags = data[23]
    return Frame(channels, bool(flags & 1), bool(flags & 2), bool(flags & 4), bool(flags & 8))


class SbusParser:
    """Finds frames in a stream of any bytes.

    A header is believed when the end byte stands where it belongs, and another header behind it if
    anything has come yet; if not, the search goes on one byte later. So a frame that was cut short
    and the head of the one behind it make none together. After garbage the first whole frame that
    does not begin inside a false one is found; a false one, which nothing but a checksum could
    expose, costs at most the two frames it overlaps.

    Attributes:
        frames: how many were found.
        garbage_bytes: bytes that belonged to none.
    """

    def __init__(self) -> None:
        """Begin with an empty line."""
        self.frames = 0
        self.garbage_bytes = 0
        self._buffer = bytearray()

    @property
    def pending(self) -> int:
        """Bytes that may yet become a frame."""
        return len(self._buffer)

    def feed(self, data: bytes) -> list[Frame]:
        """Take bytes; return the frames that have become complete, oldest first."""
        buffer = self._buffer
        buffer += data
        found = []
        start = 0
        while True:
            header = buffer.find(HEADER, start)
            if header < 0:
                header = len(buffer)
            self.garbage_bytes += header - start
            start = header
            if len(buffer) - start < FRAME_SIZE:
                break
            end = start + FRAME_SIZE
            if buffer[end - 1] == FOOTER and buffer[end : end + 1] in (b"", _NEXT):
                found.append(decode(buffer[start:end]))
                start = end
            else:
                self.garbage_bytes += 1
                start += 1
        del buffer[:start]
        self.frames += len(found)
        return found
