"""Control table of the X series: what stands at which address of a servo, and in which unit.

Source: ROBOTIS e-manual, XM430-W210 (emanual.robotis.com/docs/en/dxl/x/xm430-w210); XM430-W350,
XM540-W150 and XM540-W270 have the same addresses. Limits are those of the XM430. Indirect
addresses and the backup are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag


@dataclass(frozen=True)
class ServoRegister:
    """One item of the control table, little endian; two's complement when it may be negative.

    Attributes:
        address: of its first byte.
        size: bytes.
        name: as the e-manual writes it.
        initial: value after power on (RAM) or from the factory (EEPROM).
        least, greatest: range of a value that is written.
        writable: whether it may be written.
        signed: whether it may be negative.
    """

    address: int
    size: int
    name: str
    initial: int = 0
    least: int = 0
    greatest: int = 0
    writable: bool = True
    signed: bool = False

    @property
    def title(self) -> str:
        """Name and address."""
        return f"{self.name} ({self.address})"

    @property
    def in_eeprom(self) -> bool:
        """Whether it outlives a power cycle, and is locked while torque is on."""
        return self.address < TORQUE_ENABLE.address

    @property
    def end(self) -> int:
        """Address behind its last byte."""
        return self.address + self.size

    def pack(self, value: int) -> bytes:
        """Return the bytes of a value."""
        return value.to_bytes(self.size, "little", signed=self.signed)

    def unpack(self, data: bytes | bytearray) -> int:
        """Return the value of bytes."""
        return int.from_bytes(data, "little", signed=self.signed)


def _read_only(address: int, size: int, name: str, *, signed: bool = False) -> ServoRegister:
    return ServoRegister(address, size, name, writable=False, signed=signed)


MODEL_NUMBER = _read_only(0, 2, "model number")
MODEL_INFORMATION = _read_only(2, 4, "model information")
FIRMWARE_VERSION = _read_only(6, 1, "firmware version")
ID = ServoRegister(7, 1, "id", 1, 0, 252)
BAUD_RATE = ServoRegister(8, 1, "baud rate", 1, 0, 7)
RETURN_DELAY = ServoRegister(9, 1, "return delay time", 250, 0, 254)  # 2 us
DRIVE_MODE = ServoRegister(10, 1, "drive mode", 0, 0, 13)
OPERATING_MODE = ServoRegister(11, 1, "operating mode", 3, 0, 16)
SECONDARY_ID = ServoRegister(12, 1, "secondary id", 255, 0, 255)
PROTOCOL_TYPE = ServoRegister(13, 1, "protocol type", 2, 1, 2)
HOMING_OFFSET = ServoRegister(20, 4, "homing offset", 0, -1_044_479, 1_044_479, signed=True)
MOVING_THRESHOLD = ServoRegister(24, 4, "moving threshold", 10, 0, 1023)
TEMPERATURE_LIMIT = ServoRegister(31, 1, "temperature limit", 80, 0, 100)  # deg C
MAX_VOLTAGE_LIMIT = ServoRegister(32, 2, "max voltage limit", 160, 95, 160)  # 0.1 V
MIN_VOLTAGE_LIMIT = ServoRegister(34, 2, "min voltage limit", 95, 95, 160)  # 0.1 V
PWM_LIMIT = ServoRegister(36, 2, "pwm limit", 885, 0, 885)
CURRENT_LIMIT = ServoRegister(
    38, 2, "current limit", 1193, 0, 2047
)  # 2.69 mA; XM430 1193, XM540 2047
VELOCITY_LIMIT = ServoRegister(44, 4, "velocity limit", 330, 0, 1023)
MAX_POSITION_LIMIT = ServoRegister(48, 4, "max position limit", 4095, 0, 4095)
MIN_POSITION_LIMIT = ServoRegister(52, 4, "min position limit", 0, 0, 4095)
STARTUP = ServoRegister(60, 1, "startup configuration", 0, 0, 3)  # from STARTUP_FIRMWARE on
SHUTDOWN = ServoRegister(63, 1, "shutdown", 0x34, 0, 0x3D)
TORQUE_ENABLE = ServoRegister(64, 1, "torque enable", 0, 0, 1)
LED = ServoRegister(65, 1, "led", 0, 0, 1)
STATUS_RETURN_LEVEL = ServoRegister(68, 1, "status return level", 2, 0, 2)
REGISTERED_INSTRUCTION = _read_only(69, 1, "registered instruction")
HARDWARE_ERROR = _read_only(70, 1, "hardware error status")
VELOCITY_I_GAIN = ServoRegister(76, 2, "velocity i gain", 1920, 0, 16383)
VELOCITY_P_GAIN = ServoRegister(78, 2, "velocity p gain", 100, 0, 16383)
POSITION_D_GAIN = ServoRegister(80, 2, "position d gain", 0, 0, 16383)
POSITION_I_GAIN = ServoRegister(82, 2, "position i gain", 0, 0, 16383)
POSITION_P_GAIN = ServoRegister(84, 2, "position p gain", 800, 0, 16383)
FEEDFORWARD_2ND_GAIN = ServoRegister(88, 2, "feedforward 2nd gain", 0, 0, 16383)
FEEDFORWARD_1ST_GAIN = ServoRegister(90, 2, "feedforward 1st gain", 0, 0, 16383)
BUS_WATCHDOG = ServoRegister(98, 1, "bus watchdog", 0, 0, 127, signed=True)  # 20 ms
GOAL_PWM = ServoRegister(100, 2, "goal pwm", 885, -885, 885, signed=True)
GOAL_CURRENT = ServoRegister(102, 2, "goal current", 1193, -2047, 2047, signed=True)
GOAL_VELOCITY = ServoRegister(104, 4, "goal velocity", 0, -1023, 1023, signed=True)
PROFILE_ACCELERATION = ServoRegister(108, 4, "profile acceleration", 0, 0, 32767)
PROFILE_VELOCITY = ServoRegister(112, 4, "profile velocity", 0, 0, 32767)
GOAL_POSITION = ServoRegister(116, 4, "goal position", 0, -1_048_575, 1_048_575, signed=True)
REALTIME_TICK = _read_only(120, 2, "realtime tick")  # 1 ms
MOVING = _read_only(122, 1, "moving")
MOVING_STATUS = _read_only(123, 1, "moving status")
PRESENT_PWM = _read_only(124, 2, "present pwm", signed=True)
PRESENT_CURRENT = _read_only(126, 2, "present current", signed=True)
PRESENT_VELOCITY = _read_only(128, 4, "present velocity", signed=True)
PRESENT_POSITION = _read_only(132, 4, "present position", signed=True)
VELOCITY_TRAJECTORY = _read_only(136, 4, "velocity trajectory", signed=True)
POSITION_TRAJECTORY = _read_only(140, 4, "position trajectory", signed=True)
PRESENT_INPUT_VOLTAGE = _read_only(144, 2, "present input voltage")  # 0.1 V
PRESENT_TEMPERATURE = _read_only(146, 1, "present temperature")  # deg C

TABLE = tuple(value for value in tuple(globals().values()) if isinstance(value, ServoRegister))
"""Every register, by rising address."""
TABLE_SIZE = 147
"""Bytes from address 0 to the last register's end."""

STARTUP_FIRMWARE = 45
"""First firmware with a startup configuration."""
CYCLE_DATA = (PRESENT_CURRENT, PRESENT_VELOCITY, PRESENT_POSITION)
"""What is read of every servo in every cycle: neighbours, 10 bytes."""
ALL_DATA = (FIRMWARE_VERSION, PRESENT_TEMPERATURE)
"""First and last of one read that has every setting, and what two servos never have in common."""
HEALTH_DATA = (TORQUE_ENABLE, HARDWARE_ERROR, PRESENT_INPUT_VOLTAGE, PRESENT_TEMPERATURE)
"""What is read of one servo between two cycles, in one read from the first to the last."""


class ServoOperatingMode(IntEnum):
    """Operating modes (register 11) that are used here."""

    CURRENT = 0
    VELOCITY = 1
    POSITION = 3
    EXTENDED_POSITION = 4
    CURRENT_BASED_POSITION = 5
    PWM = 16


class HardwareError(IntFlag):
    """Bits of hardware error status (70) and of shutdown (63)."""

    INPUT_VOLTAGE = 0x01
    OVERHEATING = 0x04
    MOTOR_ENCODER = 0x08
    ELECTRICAL_SHOCK = 0x10
    OVERLOAD = 0x20


class StatusError(IntEnum):
    """Error numbers of a status packet."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


class Instruction(IntEnum):
    """Instructions of protocol 2.0."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93


ALERT = 0x80
"""Bit of a status packet's error: the servo has a hardware error."""
BROADCAST = 0xFE
"""Id that every servo hears."""
WATCHDOG_UNIT = 0.02
"""Unit of the bus watchdog [s]."""
BAUD_RATES = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
"""Rates by the value of register 8 [baud]."""


def describe_errors(bits: int) -> str:
    """Return the names of hardware error bits, "" for none."""
    known = HardwareError(bits & 0x3D)
    return ", ".join(str(error.name).lower().replace("_", " ") for error in known)
