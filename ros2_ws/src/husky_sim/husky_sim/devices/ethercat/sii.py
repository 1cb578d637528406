"""EEPROM of a slave, the slave information interface (ETG.2010): who it is, how it is reached.

Identity, mailboxes and sync managers are those of a slave dump of a Gold Twitter; of its mailbox
protocols only CoE is there.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from husky_drivers.ethercat.bus import Identity

MAILBOX_OUT, MAILBOX_IN, MAILBOX_LENGTH = 0x1800, 0x1900, 140
"""Start addresses of the mailboxes to and from the drive, and the length of each."""
OUTPUTS, INPUTS = 0x1100, 0x1180
"""Start addresses of the process data."""
_COE = 0x0004
_COE_DETAILS = 0x0F
"""SDO, SDO information, PDO assignment and configuration; no complete access."""
_FACTORY_LENGTH = 10
"""Bytes of the process data after power on, each way."""
_STRINGS, _GENERAL, _FMMU, _SYNC_MANAGERS, _END = 10, 30, 40, 41, 0xFFFF
_PDI_CONTROL = 0x0005  # serial interface (assumed)


def checksum(data: bytes) -> int:
    """Return the checksum of the first 14 bytes (x^8 + x^2 + x + 1, from 0xFF)."""
    value = 0xFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = (value << 1 ^ (0x07 if value & 0x80 else 0)) & 0xFF
    return value


def eeprom_image(identity: Identity, serial: int) -> bytearray:
    """Return the EEPROM of a drive, 2 KiB.

    Args:
        identity: vendor, product, revision.
        serial: serial number.
    """
    head = struct.pack("<HHHHHHH", _PDI_CONTROL, 0, 0, 0, 0, 0, 0)
    head += struct.pack("<H", checksum(head))
    head += struct.pack("<IIII8x", identity.vendor, identity.product, identity.revision, serial)
    mailboxes = struct.pack("<HHHH", MAILBOX_OUT, MAILBOX_LENGTH, MAILBOX_IN, MAILBOX_LENGTH)
    head += mailboxes * 2 + struct.pack("<H", _COE)  # of bootstrap, and the usual ones
    head = head.ljust(0x7C, b"\0") + struct.pack("<HH", 2 * 8 - 1, 1)  # KiBit - 1, version
    general = struct.pack("<BBBBxB", 0, 0, 1, 1, _COE_DETAILS)
    managers = (
        (MAILBOX_OUT, MAILBOX_LENGTH, 0x26, 1),
        (MAILBOX_IN, MAILBOX_LENGTH, 0x22, 2),
        (OUTPUTS, _FACTORY_LENGTH, 0x64, 3),
        (INPUTS, _FACTORY_LENGTH, 0x20, 4),
    )
    image = head
    image += _category(_STRINGS, _texts(["Gold Twitter"]))
    image += _category(_GENERAL, general.ljust(32, b"\0"))
    image += _category(_FMMU, bytes((1, 2, 3, 0)))  # outputs, inputs, mailbox, unused
    image += _category(
        _SYNC_MANAGERS,
        b"".join(
            struct.pack("<HHBBBB", start, length, control, 0, 1, kind)
            for start, length, control, kind in managers
        ),
    )
    return bytearray((image + struct.pack("<H", _END)).ljust(2048, b"\xff"))


def _texts(texts: Sequence[str]) -> bytes:
    return bytes((len(texts),)) + b"".join(bytes((len(t),)) + t.encode("ascii") for t in texts)


def _category(kind: int, data: bytes) -> bytes:
    data += bytes(len(data) % 2)
    return struct.pack("<HH", kind, len(data) // 2) + data
