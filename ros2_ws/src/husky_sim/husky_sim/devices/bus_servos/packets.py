"""Packets of DYNAMIXEL protocol 2.0 as a servo hears and makes them.

FF FF FD 00, id, length (2), instruction, parameters, CRC-16 (2). The CRC is over everything before
it, polynomial 0x8005, from 0, not reflected. FF FF FD within a packet is followed by a further FD,
counted by length and CRC, so that the header is nowhere else.
Source: ROBOTIS e-manual, emanual.robotis.com/docs/en/dxl/protocol2.
"""

from __future__ import annotations

from typing import NamedTuple

from fastcrc import crc16

from husky_drivers.dynamixel.control_table import Instruction

HEADER = b"\xff\xff\xfd"
_STUFFED = HEADER + b"\xfd"
_FRONT = 7
"""Bytes up to the length, which counts those behind it."""
_LEAST, _MOST = 3, 1024
"""Lengths that a packet may say: instruction and CRC at least."""


class InstructionPacket(NamedTuple):
    """What the master says.

    Attributes:
        servo: id of who is meant, `BROADCAST` for all.
        instruction: one of `Instruction`, or an unknown one.
        parameters: without stuffing.
        sound: whether the CRC is right; if not, the rest may be wrong too.
    """

    servo: int
    instruction: int
    parameters: bytes
    sound: bool


def checksum(data: bytes) -> int:
    """Return the CRC-16 of bytes."""
    return int(crc16.umts(data))


def make_packet(servo: int, instruction: int, parameters: bytes) -> bytes:
    """Return a packet with stuffing and CRC."""
    content = (bytes([instruction]) + parameters).replace(HEADER, _STUFFED)
    body = HEADER + bytes([0, servo]) + (len(content) + 2).to_bytes(2, "little") + content
    return body + checksum(body).to_bytes(2, "little")


def status_packet(servo: int, error: int, parameters: bytes = b"") -> bytes:
    """Return a servo's answer."""
    return make_packet(servo, Instruction.STATUS, bytes([error]) + parameters)


class PacketReader:
    """Finds instruction packets in what comes on the line, whatever else comes there.

    Attributes:
        garbage: bytes that belonged to no packet.
        damaged: packets with a wrong CRC.
    """

    def __init__(self) -> None:
        """Nothing has come."""
        self._buffer = bytearray()
        self.garbage = self.damaged = 0

    def feed(self, data: bytes) -> list[InstructionPacket]:
        """Take bytes; return the packets that are complete now."""
        self._buffer += data
        packets = []
        while (packet := self._next()) is not None:
            packets.append(packet)
        return packets

    def _next(self) -> InstructionPacket | None:
        buffer = self._buffer
        while True:
            self._skip_to_header()
            if len(buffer) < _FRONT:
                return None
            length = buffer[5] | buffer[6] << 8
            if buffer[3] == 0 and _LEAST <= length <= _MOST:
                break
            self._drop(len(HEADER))
        end = _FRONT + length
        if len(buffer) < end:
            # A header within is another packet's: this one has been cut short.
            begun = buffer.find(HEADER + b"\x00", len(HEADER))
            if begun < 0:
                return None
            self._drop(begun)
            return self._next()
        whole = bytes(buffer[:end])
        sound = checksum(whole[:-2]) == int.from_bytes(whole[-2:], "little")
        if not sound:
            self.damaged += 1
            del buffer[: len(HEADER)]  # its length may be what is damaged: look within
            return InstructionPacket(whole[4], whole[7], b"", False)
        del buffer[:end]
        content = whole[_FRONT:-2].replace(_STUFFED, HEADER)
        return InstructionPacket(whole[4], content[0], content[1:], True)

    def _skip_to_header(self) -> None:
        start = self._buffer.find(HEADER)
        if start < 0:
            keep = next((n for n in (2, 1) if self._buffer.endswith(HEADER[:n])), 0)
            start = len(self._buffer) - keep
        self._drop(start)

    def _drop(self, count: int) -> None:
        self.garbage += count
        del self._buffer[:count]
