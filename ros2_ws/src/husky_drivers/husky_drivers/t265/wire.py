"""The simulated T265's wire: pose frames as bytes.

The real camera sits on USB behind librealsense, whose wire is not ours to imitate: the boundary is
the pose frame. Its simulated stand-in sends the same content over a serial line. All numbers are
little-endian but the CRC:

    A5 65 | length u16 = 96 | number u32 | time f64 ms | 19 f32 | tracker u32 | mapper u32 | CRC16

The 84 bytes from the 19 floats on are librealsense's `struct rs2_pose`: translation (3), velocity
(3), acceleration (3), rotation x, y, z, w, angular velocity (3), angular acceleration (3), both
confidences. The CRC is the VN-200's, over everything behind the two sync bytes, big-endian: over
these and itself it is 0. The host says `START` once it has opened the line.
"""

from __future__ import annotations

import struct

from husky_drivers.camera_link import WireCounters
from husky_drivers.t265.frames import PoseFrame
from husky_drivers.vn200.protocol import crc16

BAUD = 921600
"""Rate of the line: 200 frames of 102 bytes are 204 kbit/s."""
START = b"T265+"
"""The host wants frames."""

_SYNC = b"\xa5\x65"
_PAYLOAD = struct.Struct("<Id19f2I")
_HEADER = _SYNC + struct.pack("<H", _PAYLOAD.size)
FRAME_SIZE = len(_HEADER) + _PAYLOAD.size + 2
"""Bytes of a frame."""


def encode(frame: PoseFrame) -> bytes:
    """Return a frame as bytes.

    Raises:
        struct.error, OverflowError: a number does not fit.
    """
    body = _HEADER + _PAYLOAD.pack(
        frame.number & 0xFFFFFFFF,
        frame.time_ms,
        *frame.translation,
        *frame.velocity,
        *frame.acceleration,
        *frame.rotation,
        *frame.angular_velocity,
        *frame.angular_acceleration,
        frame.tracker_confidence,
        frame.mapper_confidence,
    )
    return body + crc16(body[2:]).to_bytes(2, "big")


def _decode(buffer: bytes, start: int) -> PoseFrame:
    number, time_ms, *v, tracker, mapper = _PAYLOAD.unpack_from(buffer, start + len(_HEADER))
    return PoseFrame(
        number,
        time_ms,
        (v[0], v[1], v[2]),
        (v[3], v[4], v[5]),
        (v[6], v[7], v[8]),
        (v[9], v[10], v[11], v[12]),
        (v[13], v[14], v[15]),
        (v[16], v[17], v[18]),
        tracker,
        mapper,
    )


class FrameParser:
    """Incremental parser: bytes in as they come, frames out as they complete.

    Nothing that arrives raises. After damage the search goes on one byte behind the false start, so
    a broken frame costs only itself; a false start ends no later than the whole frame behind it.
    """

    def __init__(self) -> None:
        """Start with nothing pending."""
        self.counters = WireCounters()
        self._pending = b""

    @property
    def pending(self) -> int:
        """Bytes that wait for the rest of their frame."""
        return len(self._pending)

    def feed(self, data: bytes) -> list[PoseFrame]:
        """Take the next bytes; return the frames that they complete, in order."""
        counters = self.counters
        counters.bytes += len(data)
        buffer = self._pending + data
        frames: list[PoseFrame] = []
        position, end = 0, len(buffer)
        while True:
            start = buffer.find(_HEADER, position)
            if start < 0:
                start = max(position, _header_prefix(buffer))
            counters.garbage_bytes += start - position
            position = start
            if end - start < FRAME_SIZE:
                break
            if crc16(buffer[start + 2 : start + FRAME_SIZE]):
                counters.crc_errors += 1
                counters.garbage_bytes += 1
                position += 1
            else:
                counters.frames += 1
                frames.append(_decode(buffer, start))
                position += FRAME_SIZE
        self._pending = buffer[position:]
        return frames

    def reset(self) -> None:
        """Give up on what is pending: the line was interrupted."""
        self.counters.garbage_bytes += len(self._pending)
        self._pending = b""


def _header_prefix(buffer: bytes) -> int:
    """Return where the buffer's end may be the beginning of a header, its length if nowhere."""
    for size in range(len(_HEADER) - 1, 0, -1):
        if buffer.endswith(_HEADER[:size]):
            return len(buffer) - size
    return len(buffer)
