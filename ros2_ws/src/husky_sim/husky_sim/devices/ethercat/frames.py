"""EtherCAT frames on their way through a line of slave controllers (ETG.1000.4).

A frame is an Ethernet header, a header of two bytes and datagrams. Every slave works on a datagram
while it passes: it reads or writes its memory, counts the working counter up and, where slaves are
addressed by their place, the address.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from enum import IntEnum
from typing import NamedTuple, Protocol

from husky_drivers.ethercat.interface import ETHERTYPE

_ETHERTYPE_BYTES = struct.pack(">H", ETHERTYPE)
HEADER = 16
"""Bytes before the first datagram."""
DATAGRAM_HEADER = 10
RETURNED = 0x02
"""Bit of the source address of a frame that slaves have processed."""
_LENGTH, _MORE = 0x07FF, 0x8000
_HEAD = struct.Struct("<BxHHH")
_WORD = struct.Struct("<H")


class Command(IntEnum):
    """Commands of datagrams."""

    NOP = 0
    APRD = 1
    APWR = 2
    APRW = 3
    FPRD = 4
    FPWR = 5
    FPRW = 6
    BRD = 7
    BWR = 8
    BRW = 9
    LRD = 10
    LWR = 11
    LRW = 12
    ARMW = 13
    FRMW = 14


_NOP, _LRD, _LRW, _ARMW, _FRMW = 0, 10, 12, 13, 14


class Datagram(NamedTuple):
    """Where a datagram stands in its frame.

    Attributes:
        command: one of `Command`, or unknown.
        address: logical address; or its low word the slave, its high word the memory.
        header: offset of its header.
        data, end: offsets of its data; the working counter follows.
    """

    command: int
    address: int
    header: int
    data: int
    end: int


class Controller(Protocol):
    """Memory of a slave as datagrams see it."""

    def answers_to(self, station: int) -> bool:
        """Return whether a station address is the slave's."""

    def read(self, address: int, length: int) -> bytes | None:
        """Return bytes of the memory, None when they cannot be read now."""

    def write(self, address: int, data: bytes) -> bool:
        """Write bytes into the memory; return whether they can be written now."""


Follow = Callable[[int, int, memoryview], tuple[int, int]]
"""Command, address of a slave and data of a datagram that hands a system time to all slaves behind
the one that it reads, to the address as it leaves and what all slaves count."""
SYSTEM_TIME = 0x0910
"""Register of the system time."""

Logical = Callable[[int, int, memoryview], int]
"""Command, logical address and data of a datagram, changed in place, to what all slaves count."""


def is_ethercat(frame: bytes | bytearray) -> bool:
    """Return whether a frame carries EtherCAT datagrams."""
    return (
        len(frame) >= HEADER and frame[12:14] == _ETHERTYPE_BYTES and frame[HEADER - 1] >> 4 == 0x1
    )


def datagrams(frame: bytes | bytearray) -> Iterator[Datagram]:
    """Iterate over the datagrams of an EtherCAT frame, up to the first that does not fit in it."""
    limit = HEADER + (_WORD.unpack_from(frame, HEADER - 2)[0] & _LENGTH)
    if limit > len(frame):
        return
    header, more = HEADER, True
    while more and header + DATAGRAM_HEADER <= limit:
        command, slave, memory, length = _HEAD.unpack_from(frame, header)
        data = header + DATAGRAM_HEADER
        end = data + (length & _LENGTH)
        if end + 2 > limit:
            return
        yield Datagram(command, slave | memory << 16, header, data, end)
        header, more = end + 2, bool(length & _MORE)


def pass_frame(
    frame: bytearray, line: Sequence[Controller], logical: Logical, follow: Follow
) -> bool:
    """Pass a frame through a line of slaves and mark it as one that comes back.

    Args:
        frame: from the Ethernet header on, changed in place. What follows a datagram that does not
            fit stays as it is.
        line: the slaves in the order in which the frame reaches them.
        logical: processes a datagram with a logical address.
        follow: processes one that hands on a system time.

    Returns:
        False for a frame that is not EtherCAT, which is left alone.
    """
    if not is_ethercat(frame):
        return False
    with memoryview(frame) as view:
        for datagram in datagrams(frame):
            command, address, header, data, end = datagram
            if _LRD <= command <= _LRW:
                count = logical(command, address, view[data:end])
            elif command == _NOP or command > _FRMW:
                continue
            elif command >= _ARMW and address >> 16 == SYSTEM_TIME and end - data >= 4:
                slave, count = follow(command, address & 0xFFFF, view[data:end])
                _WORD.pack_into(frame, header + 2, slave)
            else:
                slave, count = _physical(command, address, view[data:end], line)
                _WORD.pack_into(frame, header + 2, slave)
            if count:
                count += _WORD.unpack_from(frame, end)[0]
                _WORD.pack_into(frame, end, count & 0xFFFF)
    frame[6] |= RETURNED
    return True


def _physical(
    command: int, address: int, data: memoryview, line: Sequence[Controller]
) -> tuple[int, int]:
    """Pass a datagram that addresses slaves; return their address as it leaves, and the count."""
    slave, memory = address & 0xFFFF, address >> 16
    multiple = command in (_ARMW, _FRMW)
    group, access = (0, 1) if command == _ARMW else divmod(command - 1, 3)
    if command == _FRMW:
        group, access = 1, 1
    elif not multiple:
        access += 1  # bit 0 reads, bit 1 writes
    count = 0
    for controller in line:
        if group == 1:
            addressed = controller.answers_to(slave)
        else:
            addressed = group == 2 or slave == 0
            slave = slave + 1 & 0xFFFF
        if addressed:
            count += _access(controller, access, memory, data, merge=group == 2)
        elif multiple:
            count += controller.write(memory, bytes(data))
    return slave, count


def _access(
    controller: Controller, access: int, memory: int, data: memoryview, *, merge: bool
) -> int:
    """Read (bit 0 of `access`) and write (bit 1) the memory of a slave; return what it counts."""
    count = 0
    written = bytes(data) if access & 2 else b""
    if access & 1:
        found = controller.read(memory, len(data))
        if found is not None:
            data[:] = bytes(a | b for a, b in zip(data, found, strict=True)) if merge else found
            count += 1
    if access & 2 and controller.write(memory, written):
        count += 1 if access == 2 else 2
    return count
