"""The objects of a Gold Twitter that the master and the emulator speak of, with their types.

Names, types and access rights are those of a slave dump (firmware 01.01.15.00); per mille of torque
means per mille of rated current, as a public SDK uses these drives (0x6076 is given the value of
0x6075).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

Number = int | float


@dataclass(frozen=True)
class ObjectEntry:
    """An entry of the object dictionary.

    Attributes:
        index, subindex: its address.
        format: `struct` format of its value.
        writable: whether a master may write it.
        name: name and unit.
    """

    index: int
    subindex: int
    format: str
    writable: bool
    name: str

    @property
    def title(self) -> str:
        """Name and address."""
        address = f"0x{self.index:04X}" + (f":{self.subindex}" if self.subindex else "")
        return f"{self.name} ({address})"

    def pack(self, value: Number) -> bytes:
        """Return the value's bytes; raises struct.error when it does not fit."""
        return struct.pack(self.format, value if "f" in self.format else int(value))

    def unpack(self, data: bytes) -> Number:
        """Return the value of some bytes; raises struct.error when the length is wrong."""
        value: Number = struct.unpack(self.format, data)[0]
        return value


VENDOR = ObjectEntry(0x1018, 1, "<I", False, "vendor")
PRODUCT = ObjectEntry(0x1018, 2, "<I", False, "product code")
REVISION = ObjectEntry(0x1018, 3, "<I", False, "revision")
SERIAL_NUMBER = ObjectEntry(0x1018, 4, "<I", False, "serial number")
RX_COUNT = ObjectEntry(0x1C12, 0, "<B", True, "number of output mappings")
TX_COUNT = ObjectEntry(0x1C13, 0, "<B", True, "number of input mappings")
STO_STATUS = ObjectEntry(0x2086, 0, "<I", False, "STO status, 0 while released")
INTEGRAL_GAIN = ObjectEntry(0x2110, 1, "<f", True, "KI of the inner loop")
VELOCITY_GAIN = ObjectEntry(0x2111, 1, "<f", True, "KP of the inner loop [A s/count]")
POSITION_GAIN = ObjectEntry(0x2112, 1, "<f", True, "KP of the outer loop [1/s]")
ABORT_CONNECTION_OPTION = ObjectEntry(0x6007, 0, "<h", True, "abort connection option")
ERROR_CODE = ObjectEntry(0x603F, 0, "<H", False, "error code")
CONTROLWORD = ObjectEntry(0x6040, 0, "<H", False, "controlword")
STATUSWORD = ObjectEntry(0x6041, 0, "<H", False, "statusword")
QUICK_STOP_OPTION = ObjectEntry(0x605A, 0, "<h", True, "quick stop option")
SHUTDOWN_OPTION = ObjectEntry(0x605B, 0, "<h", True, "shutdown option")
DISABLE_OPTION = ObjectEntry(0x605C, 0, "<h", True, "disable operation option")
HALT_OPTION = ObjectEntry(0x605D, 0, "<h", True, "halt option")
FAULT_OPTION = ObjectEntry(0x605E, 0, "<h", True, "fault reaction option")
MODE_DISPLAY = ObjectEntry(0x6061, 0, "<b", False, "mode of operation display")
POSITION = ObjectEntry(0x6064, 0, "<i", False, "position [count]")
FOLLOWING_WINDOW = ObjectEntry(0x6065, 0, "<I", True, "following error window [count]")
FOLLOWING_TIME = ObjectEntry(0x6066, 0, "<H", True, "following error time-out [ms]")
VELOCITY = ObjectEntry(0x606C, 0, "<i", False, "velocity [count/s]")
MAX_CURRENT = ObjectEntry(0x6073, 0, "<H", True, "peak current [per mille of rated]")
RATED_CURRENT = ObjectEntry(0x6075, 0, "<I", True, "rated (continuous) current [mA]")
RATED_TORQUE = ObjectEntry(0x6076, 0, "<I", True, "rated torque, as current [mA]")
BUS_VOLTAGE = ObjectEntry(0x6079, 0, "<I", False, "DC link voltage [mV]")
RANGE_LOWER = ObjectEntry(0x607B, 1, "<i", True, "least position before it wraps [count]")
RANGE_UPPER = ObjectEntry(0x607B, 2, "<i", True, "greatest position before it wraps [count]")
LIMIT_LOWER = ObjectEntry(0x607D, 1, "<i", True, "least software position limit [count]")
LIMIT_UPPER = ObjectEntry(0x607D, 2, "<i", True, "greatest software position limit [count]")
POLARITY = ObjectEntry(0x607E, 0, "<B", True, "polarity")
MAX_MOTOR_SPEED = ObjectEntry(0x6080, 0, "<I", True, "max motor speed [count/s]")
DECELERATION = ObjectEntry(0x6084, 0, "<I", True, "profile deceleration [count/s^2]")
QUICK_STOP_DECELERATION = ObjectEntry(0x6085, 0, "<I", True, "quick stop deceleration [count/s^2]")
GEAR_MOTOR = ObjectEntry(0x6091, 1, "<I", True, "gear ratio, turns of the motor")
GEAR_SHAFT = ObjectEntry(0x6091, 2, "<I", True, "gear ratio, turns of the shaft")
POSITION_OFFSET = ObjectEntry(0x60B0, 0, "<i", True, "position offset [count]")
VELOCITY_OFFSET = ObjectEntry(0x60B1, 0, "<i", True, "velocity offset [count/s]")
INTERPOLATION_VALUE = ObjectEntry(0x60C2, 1, "<B", True, "interpolation period, value")
INTERPOLATION_EXPONENT = ObjectEntry(0x60C2, 2, "<b", True, "interpolation period, power of 10")
MAX_ACCELERATION = ObjectEntry(0x60C5, 0, "<I", True, "max acceleration [count/s^2]")
MAX_DECELERATION = ObjectEntry(0x60C6, 0, "<I", True, "max deceleration [count/s^2]")
FOLLOWING_ERROR = ObjectEntry(0x60F4, 0, "<i", False, "following error [count]")
SUPPORTED_MODES = ObjectEntry(0x6502, 0, "<I", False, "supported modes")


def mapping_slots(count: ObjectEntry, slots: int = 8) -> tuple[ObjectEntry, ...]:
    """Return the entries of an assignment object (0x1C12, 0x1C13) after its count."""
    return tuple(
        ObjectEntry(count.index, slot, "<H", True, f"mapping {slot}")
        for slot in range(1, slots + 1)
    )


def mapped_count(index: int) -> ObjectEntry:
    """Return the entry of a mapping object that says how many objects it maps."""
    return ObjectEntry(index, 0, "<B", True, f"objects mapped by 0x{index:04X}")


def mapped_slots(index: int, slots: int) -> tuple[ObjectEntry, ...]:
    """Return the entries of a mapping object behind its count: index, subindex and bits of each."""
    return tuple(
        ObjectEntry(index, slot, "<I", True, f"object {slot} mapped by 0x{index:04X}")
        for slot in range(1, slots + 1)
    )
