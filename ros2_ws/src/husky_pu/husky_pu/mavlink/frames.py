"""MAVLink frames in a stream of any bytes: pymavlink's dialect decodes, this finds and vouches.

pymavlink's own stream parser drops the whole length that a header claims when its checksum fails,
so a truncated frame costs the good one behind it. Here the search goes on one byte after a header
that proved false. A forged signature is found before pymavlink sees it: its parser would note the
forger's time stamp and then refuse the true sender.
"""

from __future__ import annotations

import hashlib
import hmac
from dataclasses import dataclass
from typing import Any, TypeAlias

from pymavlink.dialects.v20 import common as mavlink

from husky_pu.mavlink import dialect as mavlink_dialect

mavlink_dialect.install()

Message: TypeAlias = Any
"""`mavlink.MAVLink_message`; its fields differ from type to type."""

KEY_SIZE = 32
"""Of a signing key [bytes]."""
_MARKERS = {0xFE: (6, 2), 0xFD: (10, 2)}
"""First byte of MAVLink 1 and 2: size of the header and of the checksum [bytes]."""
_SIGNED = 0x01
_SIGNATURE_SIZE = 13
_SIGNING_EPOCH = 1_420_070_400
"""2015-01-01, where signatures' time stamps begin [s since 1970]."""


@dataclass
class FrameCounters:
    """What became of the bytes.

    Attributes:
        frames: messages that were handed out.
        unknown: headers of messages that the dialect does not have; their bytes are garbage.
        damaged: headers behind which no frame with a good checksum came.
        refused: frames that were not signed with our key, or were signed again (replayed).
        garbage_bytes: bytes that belonged to no frame.
    """

    frames: int = 0
    unknown: int = 0
    damaged: int = 0
    refused: int = 0
    garbage_bytes: int = 0


def signing_time(unix_time: float) -> int:
    """Return the time stamp of a signature [10 us] for a time [s since 1970]."""
    return int((unix_time - _SIGNING_EPOCH) * 1e5)


def read_key(text: str) -> bytes:
    """Return the key of 64 hexadecimal digits; raises ValueError for something else."""
    try:
        key = bytes.fromhex(text.strip())
    except ValueError:
        key = b""
    if len(key) != KEY_SIZE:
        raise ValueError(f"a signing key has {2 * KEY_SIZE} hexadecimal digits")
    return key


class FrameReader:
    """Bytes in, messages out; `counters` say what became of them."""

    def __init__(self, codec: mavlink.MAVLink):
        """Begin with an empty buffer; if the codec has a secret key, all must be signed with it."""
        self.counters = FrameCounters()
        self._codec = codec
        self._buffer = bytearray()

    @property
    def pending(self) -> int:
        """Bytes that may yet become a frame."""
        return len(self._buffer)

    def reset(self) -> None:
        """The line is another one: what is half here will never be whole."""
        self.counters.garbage_bytes += len(self._buffer)
        self._buffer.clear()

    def give_up(self) -> list[Message]:
        """The line has fallen silent within a frame: its header was false; search behind it."""
        if not self._buffer:
            return []
        self.counters.damaged += 1
        self.counters.garbage_bytes += 1
        del self._buffer[0]
        return self.feed(b"")

    def feed(self, data: bytes) -> list[Message]:
        """Take bytes; return the messages that have become complete, oldest first."""
        buffer, counters = self._buffer, self.counters
        buffer += data
        messages: list[Message] = []
        start, end = 0, len(buffer)
        while start < end:
            sizes = _MARKERS.get(buffer[start])
            if sizes is None:
                start += 1
                counters.garbage_bytes += 1
                continue
            size = _frame_size(buffer, start, *sizes)
            if size == 0 or size > end - start:
                break
            message = self._decode(buffer[start : start + size])
            if message is None:
                start += 1
                counters.garbage_bytes += 1
                continue
            start += size
            if message is not True:
                counters.frames += 1
                messages.append(message)
        del buffer[:start]
        return messages

    def _decode(self, frame: bytearray) -> Message:
        """Return the message, True for a frame to pass over, None for no frame."""
        counters = self.counters
        is_v2 = frame[0] == 0xFD
        signed = is_v2 and bool(frame[2] & _SIGNED)
        number = int.from_bytes(frame[7:10], "little") if is_v2 else frame[5]
        if is_v2 and frame[2] & ~_SIGNED:
            counters.damaged += 1
            return None
        if number not in mavlink.mavlink_map:
            # Its checksum cannot be told, so neither its length be believed.
            counters.unknown += 1
            return None
        key = self._codec.signing.secret_key
        genuine = key is None or (signed and _is_signed(frame, key))
        try:
            # Checksums first: what is not signed by us is decoded without noting its time.
            message = (self._codec if genuine else _PLAIN).decode(frame)
        except mavlink.MAVError as error:
            if genuine and "signature" in str(error):
                counters.refused += 1
                return True
            counters.damaged += 1
            return None
        if not genuine:
            counters.refused += 1
            return True
        return message


_PLAIN = mavlink.MAVLink(None)
"""Decodes without a key."""


def _frame_size(buffer: bytearray, start: int, header: int, checksum: int) -> int:
    """Return the size that a header claims, 0 when too little of it is here."""
    if len(buffer) - start < 3:
        return 0
    size = header + buffer[start + 1] + checksum
    return size + _SIGNATURE_SIZE if header == 10 and buffer[start + 2] & _SIGNED else size


def _is_signed(frame: bytearray, key: bytes) -> bool:
    digest = hashlib.sha256(key + frame[:-6]).digest()[:6]
    return hmac.compare_digest(digest, bytes(frame[-6:]))
