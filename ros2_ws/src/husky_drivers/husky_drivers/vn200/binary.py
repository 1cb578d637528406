"""Codec of the VectorNav VN-200's binary output packets and of the registers that select them.

Sources: VN-200 user manual UM004, VectorNav C++ library 1.2.0 (sizes of the fields), captured
packets (the CRC's polynomial: one page of the manual is wrong about it).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

from husky_drivers.vn200.protocol import (
    BITS_PER_BYTE,
    IMU_RATE,
    MAX_PACKET,
    SYNC,
    ErrorCode,
    ProtocolError,
    crc16,
    decimal,
    hexadecimal,
)

_COMMON = (
    "time_startup:Q time_gps:Q time_sync_in:Q yaw_pitch_roll:3f quaternion:4f angular_rate:3f "
    "position:3d velocity:3f accel:3f imu:6f mag_pres:5f delta_theta:7f ins_status:H "
    "sync_in_count:I time_gps_pps:Q"
)
_TIME = (
    "time_startup:Q time_gps:Q gps_tow:Q gps_week:H time_sync_in:Q time_gps_pps:Q time_utc:8s "
    "sync_in_count:I sync_out_count:I time_status:B"
)
_IMU = (
    "imu_status:H uncomp_mag:3f uncomp_accel:3f uncomp_gyro:3f temperature:f pressure:f "
    "delta_theta:4f delta_velocity:3f mag:3f accel:3f angular_rate:3f sens_sat:H raw:40s"
)
_GPS = (
    "utc:8s tow:Q week:H num_sats:B fix:B pos_lla:3d pos_ecef:3d vel_ned:3f vel_ecef:3f pos_u:3f "
    "vel_u:f time_u:f time_info:2s dop:7f"
)
_ATTITUDE = (
    "vpe_status:H yaw_pitch_roll:3f quaternion:4f dcm:9f mag_ned:3f accel_ned:3f "
    "linear_accel_body:3f linear_accel_ned:3f ypr_u:3f reserved_9:12s reserved_10:28s "
    "reserved_11:24s reserved_12:12s"
)
_INS = (
    "ins_status:H pos_lla:3d pos_ecef:3d vel_body:3f vel_ned:3f vel_ecef:3f mag_ecef:3f "
    "accel_ecef:3f linear_accel_ecef:3f pos_u:f vel_u:f reserved_11:68s reserved_12:64s"
)


def _fields(text: str) -> tuple[tuple[str, str], ...]:
    return tuple((name, code) for name, code in (item.split(":") for item in text.split()))


GROUPS: tuple[tuple[str, tuple[tuple[str, str], ...]], ...] = (
    ("common", _fields(_COMMON)),
    ("time", _fields(_TIME)),
    ("imu", _fields(_IMU)),
    ("gps", _fields(_GPS)),
    ("attitude", _fields(_ATTITUDE)),
    ("ins", _fields(_INS)),
    ("gps2", _fields(_GPS)),
)
"""Output groups in the order of their bits: name, and its fields (name, struct code) likewise.

Quaternions are (x, y, z, w), FRD body to NED; angles in degrees, rates in rad/s, accelerations in
m/s^2, times in ns, deltas of angle in degrees."""


class OutputLayout:
    """What a binary packet carries and where; equal when groups and masks are equal.

    Attributes:
        masks: field mask of each of the seven groups, 0 for a group that is absent.
        header: sync byte, groups and masks: how each packet of this layout begins.
        fields: name of each field in order of the payload, e.g. "common.quaternion".
        size: length of a packet with header and CRC [bytes].
        unpack_from: `unpack_from(packet, offset)` returns all payload numbers, flat.
    """

    __slots__ = ("_pack", "fields", "header", "masks", "size", "unpack_from")

    def __init__(self, masks: Sequence[int]):
        """Lay the packet out.

        Args:
            masks: field mask of each group from "common" on; groups left out are absent.

        Raises:
            ProtocolError: nothing selected, a bit without a field, or a packet that is too long.
        """
        self.masks = (*masks, *(0 for _ in GROUPS[len(masks) :]))
        names: list[str] = []
        code = ""
        for (group, fields), mask in zip(GROUPS, self.masks, strict=True):
            if mask < 0 or mask >> len(fields):
                raise ProtocolError(
                    ErrorCode.INVALID_PARAMETER, f"mask {mask:04X} of group {group}: no such field"
                )
            for bit, (name, field_code) in enumerate(fields):
                if mask >> bit & 1:
                    names.append(f"{group}.{name}")
                    code += field_code
        selected = [mask for mask in self.masks if mask]
        groups = sum(1 << bit for bit, mask in enumerate(self.masks) if mask)
        self.header = struct.pack(f"<BB{len(selected)}H", SYNC, groups, *selected)
        self.fields = tuple(names)
        self._pack = struct.Struct("<" + code).pack
        self.size = len(self.header) + struct.calcsize("<" + code) + 2
        self.unpack_from = struct.Struct(f"<{len(self.header)}x{code}2x").unpack_from
        if not names or self.size > MAX_PACKET:
            raise ProtocolError(
                ErrorCode.INVALID_PARAMETER, f"a packet of {len(names)} fields, {self.size} bytes"
            )

    def encode(self, *values: float | bytes) -> bytes:
        """Return the packet of the payload's values, given flat and in order."""
        packet = self.header + self._pack(*values)
        return packet + crc16(packet[1:]).to_bytes(2, "big")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, OutputLayout) and self.masks == other.masks

    def __hash__(self) -> int:
        return hash(self.masks)

    def __repr__(self) -> str:
        return f"OutputLayout({', '.join(self.fields)})"


@dataclass(frozen=True)
class BinaryOutput:
    """Content of a binary output register (75, 76, 77).

    Attributes:
        async_mode: ports to send on: 0 none, 1, 2, or 3 for both.
        rate_divisor: the packet rate is `IMU_RATE` divided by this.
        layout: what to send, None for nothing.
    """

    async_mode: int
    rate_divisor: int
    layout: OutputLayout | None

    @property
    def bits_per_second(self) -> float:
        """Load of the serial line [bit/s]."""
        if self.layout is None or not self.async_mode:
            return 0.0
        return self.layout.size * BITS_PER_BYTE * IMU_RATE / self.rate_divisor

    def to_fields(self) -> tuple[str, ...]:
        """Return the register's fields as text: mode, divisor, groups and masks (hexadecimal)."""
        masks = self.layout.masks if self.layout is not None else ()
        groups = sum(1 << bit for bit, mask in enumerate(masks) if mask)
        selected = [f"{mask:04X}" for mask in masks if mask]
        return (str(self.async_mode), str(self.rate_divisor), f"{groups:02X}", *selected)

    @staticmethod
    def from_fields(fields: Sequence[str]) -> BinaryOutput:
        """Return the register's content; raises ProtocolError for too few, many or bad fields."""
        if len(fields) < 3:
            raise ProtocolError(ErrorCode.NOT_ENOUGH_PARAMETERS, "a binary output needs 3 fields")
        async_mode, divisor, groups = decimal(fields[0]), decimal(fields[1]), hexadecimal(fields[2])
        if async_mode > 3 or not 1 <= divisor <= 0xFFFF or groups >> len(GROUPS):
            raise ProtocolError(ErrorCode.INVALID_PARAMETER, f"binary output {','.join(fields)}")
        given = [hexadecimal(field) for field in fields[3:]]
        if len(given) < groups.bit_count():
            raise ProtocolError(ErrorCode.NOT_ENOUGH_PARAMETERS, "a mask for each group is needed")
        if len(given) > groups.bit_count():
            raise ProtocolError(ErrorCode.TOO_MANY_PARAMETERS, "more masks than groups")
        if not groups:
            return BinaryOutput(async_mode, divisor, None)
        masks = iter(given)
        return BinaryOutput(
            async_mode,
            divisor,
            OutputLayout([next(masks) if groups >> bit & 1 else 0 for bit in range(len(GROUPS))]),
        )


IMU_LAYOUT = OutputLayout([0x0131])
"""The driver's packet: TimeStartup, Quaternion, AngularRate, Accel; 54 bytes."""
