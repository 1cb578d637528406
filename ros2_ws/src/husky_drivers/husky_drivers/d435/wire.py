"""The simulated D435's wire: depth frames as bytes.

The real camera sits on USB behind librealsense, whose wire is not ours to imitate: the boundary is
the depth frame. Its simulated stand-in sends the same content over a stream socket of the machine.
All numbers are little-endian:

    A5 D4 | size u32 | ~size u32 | number u32 | time f64 ms | width u16 | height u16
          | fx fy cx cy f32 | depth unit f32 m | width x height u16 | CRC32

`size` counts the bytes between its complement and the CRC, which is zlib's over these. The host
says `START` once it has opened the line, and `taken` with the number of each frame that it has
passed on; a camera in lockstep waits for that.
"""

from __future__ import annotations

import re
import struct
import zlib

import numpy as np

from husky_drivers.camera_link import WireCounters
from husky_drivers.d435.frames import DepthFrame, Intrinsics

START = b"D435+"
"""The host wants frames."""
_TAKEN = b"D435!"
_TAKEN_MESSAGE = re.compile(re.escape(_TAKEN) + b"(.{4})", re.DOTALL)
TAKEN_SIZE = len(_TAKEN) + 4
"""Bytes of `taken`."""

_SYNC = b"\xa5\xd4"
_NUMBER = struct.Struct("<I")
_CRC = struct.Struct("<I")
_HEAD = struct.Struct("<Id2H5f")
_SIZES = struct.Struct("<2I")
_ALL_BITS = 0xFFFFFFFF
_PREFIX = len(_SYNC) + _SIZES.size
_MOST_PIXELS = 1280 * 720
"""The camera's largest depth image; a longer size is a false start."""


def taken(number: int) -> bytes:
    """Return the host's message that it has passed a frame on."""
    return _TAKEN + _NUMBER.pack(number & _ALL_BITS)


def taken_numbers(heard: bytes) -> list[int]:
    """Return the numbers of the frames that were taken, from what the host has said."""
    return [_NUMBER.unpack(match)[0] for match in _TAKEN_MESSAGE.findall(heard)]


def encode(frame: DepthFrame) -> bytes:
    """Return a frame as bytes."""
    i = frame.intrinsics
    head = _HEAD.pack(
        frame.number & _ALL_BITS,
        frame.time_ms,
        i.width,
        i.height,
        i.fx,
        i.fy,
        i.cx,
        i.cy,
        frame.depth_unit,
    )
    body = head + np.ascontiguousarray(frame.depth, "<u2").tobytes()
    sizes = _SIZES.pack(len(body), len(body) ^ _ALL_BITS)
    return _SYNC + sizes + body + _CRC.pack(zlib.crc32(body))


def _decode(body: bytes) -> DepthFrame | None:
    """Return the frame of a body whose CRC is right, None if it contradicts itself."""
    number, time_ms, width, height, fx, fy, cx, cy, unit = _HEAD.unpack_from(body)
    if len(body) - _HEAD.size != 2 * width * height or width * height == 0:
        return None
    pixels = np.frombuffer(body, "<u2", offset=_HEAD.size)
    intrinsics = Intrinsics(width, height, fx, fy, cx, cy)
    return DepthFrame(number, time_ms, intrinsics, unit, pixels.reshape(height, width))


class FrameParser:
    """Incremental parser: bytes in as they come, frames out as they complete.

    Nothing that arrives raises. After damage the search goes on one byte behind the false start, so
    a broken frame costs only itself; one that is cut short ends with the frame behind it.
    """

    def __init__(self) -> None:
        """Start with nothing pending."""
        self.counters = WireCounters()
        self._pending = bytearray()

    @property
    def pending(self) -> int:
        """Bytes that wait for the rest of their frame."""
        return len(self._pending)

    def feed(self, data: bytes) -> list[DepthFrame]:
        """Take the next bytes; return the frames that they complete, in order."""
        self.counters.bytes += len(data)
        buffer = self._pending
        buffer += data
        frames: list[DepthFrame] = []
        while self._find_start():
            size, complement = _SIZES.unpack_from(buffer, len(_SYNC))
            known = size ^ complement == _ALL_BITS
            if not known or not _HEAD.size < size <= _HEAD.size + 2 * _MOST_PIXELS:
                self._drop(1)
                continue
            end = _PREFIX + size
            if len(buffer) < end + _CRC.size:
                break
            body = bytes(buffer[_PREFIX:end])
            frame = None
            if zlib.crc32(body) == _CRC.unpack_from(buffer, end)[0]:
                frame = _decode(body)
            if frame is None:
                self.counters.crc_errors += 1
                self._drop(1)
                continue
            del buffer[: end + _CRC.size]
            self.counters.frames += 1
            frames.append(frame)
        return frames

    def _find_start(self) -> bool:
        """Drop what is before the next header; return whether its size has come, too."""
        buffer = self._pending
        start = buffer.find(_SYNC)
        if start < 0:
            start = len(buffer) - (1 if buffer.endswith(_SYNC[:1]) else 0)
        self._drop(start)
        return len(buffer) >= _PREFIX

    def _drop(self, count: int) -> None:
        self.counters.garbage_bytes += count
        del self._pending[:count]

    def reset(self) -> None:
        """Give up on what is pending: the line was interrupted."""
        self._drop(len(self._pending))
