"""Finds VectorNav packets and lines in a stream of bytes that may contain anything."""

from __future__ import annotations

import re
from binascii import crc_hqx
from dataclasses import dataclass
from typing import NamedTuple

from husky_drivers.vn200.binary import OutputLayout
from husky_drivers.vn200.protocol import MAX_LINE, SYNC, AsciiMessage, ProtocolError, decode_ascii


class BinaryPacket(NamedTuple):
    """A binary packet whose CRC is right: its payload's numbers, flat."""

    values: tuple[float, ...]


Message = BinaryPacket | AsciiMessage


@dataclass
class StreamCounters:
    """What a parser has seen; each byte is in a packet, in a line, garbage, or still pending.

    Attributes:
        bytes: bytes fed.
        packet_bytes: bytes of binary packets with a right CRC.
        lines: ASCII frames with a right checksum.
        line_bytes: bytes of these.
        crc_errors: binary packets with a wrong CRC.
        checksum_errors: ASCII lines with a wrong checksum or form.
        truncated: packets and lines cut short by the beginning of the next one.
        garbage_bytes: bytes that belong to no packet and no line.
    """

    bytes: int = 0
    packet_bytes: int = 0
    lines: int = 0
    line_bytes: int = 0
    crc_errors: int = 0
    checksum_errors: int = 0
    truncated: int = 0
    garbage_bytes: int = 0


_START = re.compile(b"[$\xfa]")
_LINE = re.compile(rb"\$VN[ -#%%-~]{0,%d}\r?\n" % (MAX_LINE - 5))
_LINE_PREFIX = re.compile(rb"\$(?:V(?:N[ -#%%-~]{0,%d}\r?)?)?\Z" % (MAX_LINE - 5))


class StreamParser:
    """Incremental parser: bytes in as they come, messages out as they complete.

    Nothing that arrives raises. After damage the search goes on one byte behind the false start, so
    no whole packet is lost to the rest of a broken one. Packets of one layout count, and one is
    found with its last byte, whatever came before: a false start ends no later, being as long as a
    packet. Cost is linear in the bytes.
    """

    def __init__(self, layout: OutputLayout):
        """Start with nothing pending; packets of this layout alone count."""
        self.layout = layout
        self.counters = StreamCounters()
        self._pending = b""

    @property
    def pending(self) -> int:
        """Bytes that wait for the rest of their message."""
        return len(self._pending)

    def feed(self, data: bytes) -> list[Message]:
        """Take the next bytes; return the messages that they complete, in order."""
        layout = self.layout
        if (
            not self._pending
            and len(data) == layout.size
            and data.startswith(layout.header)
            and not crc_hqx(data[1:], 0)
        ):  # The common case: one read, one packet.
            counters = self.counters
            counters.bytes += layout.size
            counters.packet_bytes += layout.size
            return [BinaryPacket(layout.unpack_from(data))]
        self.counters.bytes += len(data)
        return self._scan(self._pending + data if self._pending else data)

    def reset(self) -> None:
        """Give up on what is pending: the line was interrupted."""
        self.counters.garbage_bytes += len(self._pending)
        self._pending = b""

    def _scan(self, buffer: bytes) -> list[Message]:
        messages: list[Message] = []
        position = 0
        end = len(buffer)
        while position < end:
            match = _START.search(buffer, position)
            start = match.start() if match is not None else end
            self.counters.garbage_bytes += start - position
            position = start
            if match is None:
                break
            take = self._take_packet if buffer[start] == SYNC else self._take_line
            used = take(buffer, start, messages)
            if used == 0:
                break
            if used < 0:
                self.counters.garbage_bytes -= used
            position += abs(used)
        self._pending = buffer[position:]
        return messages

    def _take_packet(self, buffer: bytes, start: int, messages: list[Message]) -> int:
        """Return the bytes used at a sync byte; 0 to wait for more, below 0 for garbage."""
        layout, header = self.layout, self.layout.header
        if not buffer.startswith(header, start):
            return 0 if header.startswith(buffer[start : start + len(header)]) else -1
        stop = start + layout.size
        if len(buffer) < stop:
            return 0
        if crc_hqx(buffer[start + 1 : stop], 0):
            if buffer.find(header, start + 1, stop) >= 0:
                self.counters.truncated += 1
            else:
                self.counters.crc_errors += 1
            return -1
        self.counters.packet_bytes += layout.size
        messages.append(BinaryPacket(layout.unpack_from(buffer, start)))
        return layout.size

    def _take_line(self, buffer: bytes, start: int, messages: list[Message]) -> int:
        """Return the bytes used at a dollar sign: as `_take_packet`."""
        match = _LINE.match(buffer, start)
        if match is None:
            if _LINE_PREFIX.match(buffer, start):
                return 0
            if buffer.startswith(b"$VN", start):
                self.counters.truncated += 1
            return -1
        length = match.end() - start
        try:
            messages.append(decode_ascii(match.group()))
        except ProtocolError:
            self.counters.checksum_errors += 1
            return -length
        self.counters.lines += 1
        self.counters.line_bytes += length
        return length
