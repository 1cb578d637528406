"""Codec of the VectorNav VN-200's ASCII frames; registers, error codes and limits of the device.

Sources: VN-200 user manual UM004, VN-100 user manual UM001, VectorNav C++ library 1.2.0.
"""

from __future__ import annotations

import re
from binascii import crc_hqx
from dataclasses import dataclass
from enum import Enum, IntEnum

BAUDS = (9600, 19200, 38400, 57600, 115200, 128000, 230400, 460800, 921600)
"""Rates that register 5 accepts [baud]."""
FACTORY_BAUD = 115200
ASYNC_RATES = (1, 2, 4, 5, 10, 20, 25, 40, 50, 100, 200)
"""Rates that register 7 accepts [Hz]."""
IMU_RATE = 800
"""Rate of the device's own loop, which the rate divisor of a binary output divides [Hz]."""
BITS_PER_BYTE = 10
"""Start bit, 8 data bits, stop bit."""
MAX_LINE = 256
"""Longest ASCII line [bytes]."""
MAX_PACKET = 600
"""Longest binary packet [bytes]."""
SYNC = 0xFA
"""First byte of a binary packet."""


class Register(IntEnum):
    """Numbers of the registers that this project touches."""

    USER_TAG = 0
    MODEL = 1
    HARDWARE_REVISION = 2
    SERIAL_NUMBER = 3
    FIRMWARE = 4
    BAUD = 5
    ASYNC_TYPE = 6
    ASYNC_RATE = 7
    YAW_PITCH_ROLL = 8
    QUATERNION = 9
    ACCELERATION = 18
    ANGULAR_RATE = 19
    FRAME_ROTATION = 26
    PROTOCOL_CONTROL = 30
    BINARY_OUTPUT_1 = 75
    BINARY_OUTPUT_2 = 76
    BINARY_OUTPUT_3 = 77


OUTPUTS = (Register.BINARY_OUTPUT_1, Register.BINARY_OUTPUT_2, Register.BINARY_OUTPUT_3)
"""Registers of the binary outputs."""


class AsyncType(IntEnum):
    """Codes of register 6 that this project touches: the ASCII message sent unasked."""

    OFF = 0
    YPR = 1
    QTN = 2
    ACC = 11
    GYR = 12


class ErrorCode(IntEnum):
    """What the device says with `$VNERR,NN` (NN in hexadecimal)."""

    HARD_FAULT = 0x01
    SERIAL_BUFFER_OVERFLOW = 0x02
    INVALID_CHECKSUM = 0x03
    INVALID_COMMAND = 0x04
    NOT_ENOUGH_PARAMETERS = 0x05
    TOO_MANY_PARAMETERS = 0x06
    INVALID_PARAMETER = 0x07
    INVALID_REGISTER = 0x08
    UNAUTHORIZED_ACCESS = 0x09
    WATCHDOG_RESET = 0x0A
    OUTPUT_BUFFER_OVERFLOW = 0x0B
    INSUFFICIENT_BAUD_RATE = 0x0C
    ERROR_BUFFER_OVERFLOW = 0xFF


class ProtocolError(ValueError):
    """A frame or parameter is refused; `code` is what the device would answer."""

    def __init__(self, code: ErrorCode, reason: str):
        super().__init__(f"{reason} ({code.name.lower()})")
        self.code = code


# ASCII frames -----------------------------------------------------------------------------------
class Checksum(Enum):
    """How an ASCII frame is secured."""

    NONE = "none"
    XOR = "xor"
    CRC16 = "crc16"


@dataclass(frozen=True)
class AsciiMessage:
    """One ASCII frame `$VN<command>,<field>,...*<checksum>`.

    Attributes:
        command: three letters, e.g. "WRG".
        fields: text of the fields as sent.
        checksum: how the frame was secured.
    """

    command: str
    fields: tuple[str, ...] = ()
    checksum: Checksum = Checksum.XOR

    def encode(self) -> bytes:
        """Return the frame with its checksum and line end."""
        return encode_ascii(",".join((f"VN{self.command}", *self.fields)), self.checksum)


def xor_checksum(body: bytes) -> int:
    """Return the 8-bit XOR of the bytes between `$` and `*`."""
    checksum = 0
    for byte in body:
        checksum ^= byte
    return checksum


def crc16(data: bytes) -> int:
    """Return the CRC-16/XMODEM (polynomial 0x1021, initial 0); 0 when data ends with its CRC."""
    return crc_hqx(data, 0)


def encode_ascii(body: str, checksum: Checksum = Checksum.XOR) -> bytes:
    """Return the frame around a body such as "VNRRG,1"."""
    raw = body.encode("ascii")
    if checksum is Checksum.NONE:
        return b"$%b*XX\r\n" % raw
    if checksum is Checksum.CRC16:
        return b"$%b*%04X\r\n" % (raw, crc16(raw))
    return b"$%b*%02X\r\n" % (raw, xor_checksum(raw))


_FRAME = re.compile(rb"\$VN([A-Z]{3})((?:,[ -)+-~]*)?)\*(XX|XXXX|[0-9A-Fa-f]{2}|[0-9A-Fa-f]{4})")


def decode_ascii(line: bytes) -> AsciiMessage:
    """Return the message of a line; raises ProtocolError for no frame or a wrong checksum."""
    match = _FRAME.fullmatch(line.rstrip(b"\r\n"))
    if match is None:
        raise ProtocolError(ErrorCode.INVALID_COMMAND, f"{line!r} is no VectorNav frame")
    command, fields, given = match.groups()
    body = line[1 : match.end(2)]
    if given.startswith(b"X"):
        checksum = Checksum.NONE
    else:
        checksum = Checksum.XOR if len(given) == 2 else Checksum.CRC16
        right = xor_checksum(body) if checksum is Checksum.XOR else crc16(body)
        if int(given, 16) != right:
            raise ProtocolError(ErrorCode.INVALID_CHECKSUM, f"{line!r} has a wrong checksum")
    parts = tuple(fields.decode("ascii").split(",")[1:])
    return AsciiMessage(command.decode("ascii"), parts, checksum)


def decimal(text: str) -> int:
    """Return the value of a field of decimal digits; raises ProtocolError for anything else."""
    if not re.fullmatch(r"[0-9]{1,9}", text):
        raise ProtocolError(ErrorCode.INVALID_PARAMETER, f"{text!r} is no decimal number")
    return int(text)


def hexadecimal(text: str) -> int:
    """Return the value of hexadecimal digits; raises ProtocolError for anything else."""
    if not re.fullmatch(r"[0-9A-Fa-f]{1,8}", text):
        raise ProtocolError(ErrorCode.INVALID_PARAMETER, f"{text!r} is no hexadecimal number")
    return int(text, 16)
