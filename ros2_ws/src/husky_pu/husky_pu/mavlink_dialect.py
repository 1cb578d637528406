"""What MAVLink's common messages have and the dialect of pymavlink 2.4.50 has not.

`install` puts these into the dialect's table, once, so that every codec of the process knows them:

* SET_ATTITUDE_TARGET with its extension `thrust_body`: thrust in body axes FRD, -1 to 1 each.
  Extensions are no part of the checksum's seed; where they are cut off they are zero.
* ESC_INFO (290), ESC_STATUS (291): what four speed controllers tell. The seeds of their checksums
  follow from their fields as the guide to serialisation says; a test computes them.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

ESC_INFO, ESC_STATUS = 290, 291
"""Message ids."""
ESC_FAILURE_GENERIC = 64
"""Bit of ESC_INFO.failure_flags."""


class SetAttitudeTarget(mavlink.MAVLink_set_attitude_target_message):
    """SET_ATTITUDE_TARGET (82) with `thrust_body`."""

    _base = mavlink.MAVLink_set_attitude_target_message
    fieldnames = [*_base.fieldnames, "thrust_body"]  # noqa: RUF012 - as in the dialect
    ordered_fieldnames = [*_base.ordered_fieldnames, "thrust_body"]  # noqa: RUF012
    fieldtypes = [*_base.fieldtypes, "float"]  # noqa: RUF012
    native_format = bytearray(b"<IfffffBBBf")
    orders = [*_base.orders, 9]  # noqa: RUF012
    lengths = [*_base.lengths, 3]  # noqa: RUF012
    array_lengths = [*_base.array_lengths, 3]  # noqa: RUF012
    unpacker = struct.Struct("<I4fffffBBB3f")

    def __init__(self, *fields: Any, thrust_body: Sequence[float] = (0.0, 0.0, 0.0)):
        """Take the nine fields of the dialect; `thrust_body` last of all, or by name."""
        super().__init__(*fields[:9])
        self._fieldnames = self.fieldnames
        self.thrust_body = list(fields[9] if len(fields) > 9 else thrust_body)

    def pack(self, mav: mavlink.MAVLink, force_mavlink1: bool = False) -> bytes:
        """Return the frame; MAVLink 1 has no extensions."""
        values = (
            self.time_boot_ms,
            *self.q,
            self.body_roll_rate,
            self.body_pitch_rate,
            self.body_yaw_rate,
            self.thrust,
            self.target_system,
            self.target_component,
            self.type_mask,
        )
        if force_mavlink1:
            short = self._base.unpacker.pack(*values)
            return bytes(self._pack(mav, self.crc_extra, short, force_mavlink1=True))
        payload = self.unpacker.pack(*values, *self.thrust_body)
        return bytes(self._pack(mav, self.crc_extra, payload))


class _EscMessage(mavlink.MAVLink_message):
    """A message without extensions; subclasses name its fields in the order of the guide."""

    id = 0
    msgname = ""
    crc_extra = 0
    fieldnames: Sequence[str] = ()
    ordered_fieldnames: Sequence[str] = ()
    fieldtypes: Sequence[str] = ()
    lengths: Sequence[int] = ()
    array_lengths: Sequence[int] = ()
    unpacker = struct.Struct("")
    instance_field = None
    instance_offset = -1

    def __init__(self, *fields: Any):
        """Take the fields in the order of `fieldnames`."""
        super().__init__(self.id, self.msgname)
        self._fieldnames = list(self.fieldnames)
        self._instance_field, self._instance_offset = self.instance_field, self.instance_offset
        for name, value in zip(self.fieldnames, fields, strict=True):
            setattr(self, name, value)

    def pack(self, mav: mavlink.MAVLink, force_mavlink1: bool = False) -> bytes:
        """Return the frame."""
        values: list[Any] = []
        for name in self.ordered_fieldnames:
            value = getattr(self, name)
            values += value if isinstance(value, list) else [value]
        return bytes(self._pack(mav, self.crc_extra, self.unpacker.pack(*values)))


def _orders(names: Sequence[str], ordered: Sequence[str]) -> list[int]:
    """Return where each field stands on the wire."""
    return [ordered.index(name) for name in names]


class EscInfo(_EscMessage):
    """ESC_INFO: which of four speed controllers are there, and what they suffer from."""

    id = ESC_INFO
    msgname = "ESC_INFO"
    crc_extra = 251
    fieldnames = (
        "index",
        "time_usec",
        "counter",
        "count",
        "connection_type",
        "info",
        "failure_flags",
        "error_count",
        "temperature",
    )
    ordered_fieldnames = (
        "time_usec",
        "error_count",
        "counter",
        "failure_flags",
        "temperature",
        "index",
        "count",
        "connection_type",
        "info",
    )
    fieldtypes = (
        "uint8_t",
        "uint64_t",
        "uint16_t",
        "uint8_t",
        "uint8_t",
        "uint8_t",
        "uint16_t",
        "uint32_t",
        "int16_t",
    )
    orders = _orders(fieldnames, ordered_fieldnames)
    lengths = (1, 4, 1, 4, 4, 1, 1, 1, 1)
    array_lengths = (0, 4, 0, 4, 4, 0, 0, 0, 0)
    unpacker = struct.Struct("<Q4IH4H4hBBBB")


class EscStatus(_EscMessage):
    """ESC_STATUS: speed [rpm], voltage [V] and current [A] of four speed controllers."""

    id = ESC_STATUS
    msgname = "ESC_STATUS"
    crc_extra = 10
    fieldnames = ("index", "time_usec", "rpm", "voltage", "current")
    ordered_fieldnames = ("time_usec", "rpm", "voltage", "current", "index")
    fieldtypes = ("uint8_t", "uint64_t", "int32_t", "float", "float")
    orders = _orders(fieldnames, ordered_fieldnames)
    lengths = (1, 4, 4, 4, 1)
    array_lengths = (0, 4, 4, 4, 0)
    unpacker = struct.Struct("<Q4i4f4fB")


def install() -> None:
    """Put the messages into pymavlink's table, unless a newer pymavlink has them."""
    table = mavlink.mavlink_map
    if "thrust_body" not in table[SetAttitudeTarget.id].fieldnames:
        table[SetAttitudeTarget.id] = SetAttitudeTarget
    for message in (EscInfo, EscStatus):
        table.setdefault(message.id, message)
