"""Registers of the emulated VN-200: what they hold, what they accept, what they say."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from husky_drivers.vn200.binary import BinaryOutput
from husky_drivers.vn200.commissioning import IDENTITY, check_frame
from husky_drivers.vn200.protocol import (
    ASYNC_RATES,
    BAUDS,
    BITS_PER_BYTE,
    FACTORY_BAUD,
    OUTPUTS,
    AsciiMessage,
    AsyncType,
    Checksum,
    ErrorCode,
    ProtocolError,
    Register,
    decimal,
)

Measurement = tuple[int, float, float, float, float, float, float, float, float, float, float]
"""What the driver's `Values` are: time [ns], quaternion (x, y, z, w) FRD body to NED, angular rate
[rad/s] and specific force [m/s^2] in FRD body axes."""

_NO_OUTPUT = BinaryOutput(0, 1, None)
_CHECKSUMS = (Checksum.NONE, Checksum.XOR, Checksum.CRC16)


@dataclass(frozen=True)
class Vn200Settings:
    """What the flash memory keeps; the defaults are the factory's.

    Attributes:
        tag: the user's 20 characters.
        baud: [baud].
        async_type: ASCII message that is sent unasked.
        async_rate: its rate [Hz].
        protocol: register 30: serial count, status, SPI count, status, checksum, SPI checksum,
            error mode.
        outputs: the three binary outputs.
        frame: reference frame rotation, row by row; it acts after the next start.
    """

    tag: str = ""
    baud: int = FACTORY_BAUD
    async_type: int = AsyncType.YPR
    async_rate: int = 40
    protocol: tuple[int, ...] = (0, 0, 0, 0, 1, 0, 1)
    outputs: tuple[BinaryOutput, ...] = (_NO_OUTPUT, _NO_OUTPUT, _NO_OUTPUT)
    frame: tuple[float, ...] = IDENTITY

    @property
    def bits_per_second(self) -> float:
        """Load of the serial line by all that is sent unasked [bit/s]."""
        load = sum(output.bits_per_second for output in self.outputs if output.async_mode & 1)
        encode = ascii_output(self)
        if encode is not None:
            load += BITS_PER_BYTE * self.async_rate * len(encode(_LONGEST))
        return load


FACTORY = Vn200Settings()
"""Settings of a device from the factory."""


class Registers:
    """Reads and writes registers by their numbers."""

    def __init__(self, model: str, saved: Vn200Settings):
        """Start with the settings that somebody has saved in flash memory."""
        self._flash = saved
        self.settings = self._flash
        self._fixed = {
            Register.MODEL: model,
            Register.HARDWARE_REVISION: "2",
            Register.SERIAL_NUMBER: "0100017134",
            Register.FIRMWARE: "1.1.0.1",
        }

    def load(self) -> None:
        """Take the settings of the flash memory."""
        self.settings = self._flash

    def save(self) -> None:
        """Keep the settings in flash memory."""
        self._flash = self.settings

    def factory_reset(self) -> None:
        """Put the factory's settings into flash memory."""
        self._flash = FACTORY

    @property
    def error_mode(self) -> int:
        """0 ignore errors, 1 send them, 2 send them and stop ASCII output."""
        return self.settings.protocol[6]

    def stop_ascii_output(self) -> None:
        """Set register 6 to "off"."""
        self.settings = dataclasses.replace(self.settings, async_type=AsyncType.OFF)

    def error(self, code: ErrorCode) -> bytes:
        """Return the message of an error."""
        checksum = _CHECKSUMS[self.settings.protocol[4]]
        return AsciiMessage("ERR", (f"{code:02X}",), checksum).encode()

    def reply(self, request: AsciiMessage, fields: tuple[str, ...]) -> bytes:
        """Return the reply to a request, secured as the request was."""
        secured = request.checksum is not Checksum.NONE
        checksum = request.checksum if secured else _CHECKSUMS[self.settings.protocol[4]]
        return AsciiMessage(request.command, fields, checksum).encode()

    # Reading ------------------------------------------------------------------------------------
    def read(self, fields: Sequence[str], measurement: Measurement) -> tuple[str, ...]:
        """Return the register's number as it was given, and its content.

        Raises:
            ProtocolError: no register, or more than one.
        """
        register = _register(fields)
        port = fields[1:]
        if len(port) > (1 if register in _PORT_REGISTERS else 0):
            raise ProtocolError(ErrorCode.TOO_MANY_PARAMETERS, f"read of {','.join(fields)}")
        _check_port(port)
        return (fields[0], *self._content(register, measurement), *port)

    def _content(self, register: Register, measurement: Measurement) -> tuple[str, ...]:
        settings = self.settings
        if register in self._fixed:
            return (self._fixed[register],)
        if register in OUTPUTS:
            return settings.outputs[OUTPUTS.index(register)].to_fields()
        if register in _ASCII_REGISTERS:
            return _ascii_fields(_ASCII_REGISTERS[register], measurement)
        return {
            Register.USER_TAG: (settings.tag,),
            Register.BAUD: (str(settings.baud),),
            Register.ASYNC_TYPE: (str(int(settings.async_type)),),
            Register.ASYNC_RATE: (str(settings.async_rate),),
            Register.FRAME_ROTATION: tuple(f"{number:g}" for number in settings.frame),
            Register.PROTOCOL_CONTROL: tuple(str(number) for number in settings.protocol),
        }[register]

    # Writing ------------------------------------------------------------------------------------
    def write(self, fields: Sequence[str]) -> tuple[str, ...]:
        """Set a register; return its number as it was given, and its new content.

        Raises:
            ProtocolError: the register or its content is refused; nothing has changed.
        """
        register = _register(fields)
        if register in self._fixed or register in _ASCII_REGISTERS:
            raise ProtocolError(ErrorCode.UNAUTHORIZED_ACCESS, f"register {register.name}")
        given = list(fields[1:])
        port: list[str] = []
        if register in _PORT_REGISTERS and len(given) == 2:
            port = [given.pop()]
            _check_port(port)
        if register not in OUTPUTS:
            count = {Register.PROTOCOL_CONTROL: 7, Register.FRAME_ROTATION: 9}.get(register, 1)
            if len(given) < count:
                raise ProtocolError(ErrorCode.NOT_ENOUGH_PARAMETERS, register.name)
            if len(given) > count:
                raise ProtocolError(ErrorCode.TOO_MANY_PARAMETERS, register.name)
        if port == ["2"]:  # Port 2 is not on this wire: accepted, and of no effect here.
            return (fields[0], *given, *port)
        changed = dataclasses.replace(self.settings, **self._change(register, given))
        if changed.bits_per_second > changed.baud:
            raise ProtocolError(ErrorCode.INSUFFICIENT_BAUD_RATE, f"{changed.bits_per_second}")
        self.settings = changed
        return (fields[0], *self._content(register, _LONGEST), *port)

    def _change(self, register: Register, given: Sequence[str]) -> dict[str, Any]:
        """Return the fields of the settings that a write changes."""
        if register is Register.USER_TAG:
            _require(len(given[0]) <= 20, given[0])
            return {"tag": given[0]}
        if register in OUTPUTS:
            output = BinaryOutput.from_fields(given)
            if output.layout is not None:
                binary_values(output.layout.fields, _LONGEST)
            outputs = list(self.settings.outputs)
            outputs[OUTPUTS.index(register)] = output
            return {"outputs": tuple(outputs)}
        if register is Register.FRAME_ROTATION:
            return {"frame": _rotation(given)}
        numbers = [decimal(field) for field in given]
        if register is Register.BAUD:
            _require(numbers[0] in BAUDS, given[0])
            return {"baud": numbers[0]}
        if register is Register.ASYNC_TYPE:
            _require(numbers[0] == AsyncType.OFF or numbers[0] in _ASCII, given[0])
            return {"async_type": numbers[0]}
        if register is Register.ASYNC_RATE:
            _require(numbers[0] in ASYNC_RATES, given[0])
            return {"async_rate": numbers[0]}
        limits = (4, 2, 4, 2, 2, 2, 2)
        _require(all(n <= m for n, m in zip(numbers, limits, strict=True)), ",".join(given))
        return {"protocol": tuple(numbers)}


def _register(fields: Sequence[str]) -> Register:
    if not fields:
        raise ProtocolError(ErrorCode.NOT_ENOUGH_PARAMETERS, "no register")
    try:
        return Register(decimal(fields[0]))
    except ProtocolError:
        raise
    except ValueError as error:
        raise ProtocolError(ErrorCode.INVALID_REGISTER, f"register {fields[0]}") from error


def _rotation(given: Sequence[str]) -> tuple[float, ...]:
    try:
        frame = tuple(float(field) for field in given)
        check_frame(frame)
    except ValueError as error:
        raise ProtocolError(ErrorCode.INVALID_PARAMETER, str(error)) from error
    return frame


def _require(condition: bool, what: str) -> None:
    if not condition:
        raise ProtocolError(ErrorCode.INVALID_PARAMETER, what)


def _check_port(port: Sequence[str]) -> None:
    _require(not port or port[0] in ("1", "2"), ",".join(port))


# What a measurement looks like on the wire ------------------------------------------------------
def yaw_pitch_roll(measurement: Measurement) -> tuple[float, float, float]:
    """Return the Euler angles of a measurement, FRD body to NED [deg]."""
    _, x, y, z, w, *_ = measurement
    return (
        math.degrees(math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))),
        math.degrees(math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))),
        math.degrees(math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))),
    )


_VALUES: dict[str, Callable[[Measurement], tuple[float, ...]]] = {
    "common.time_startup": lambda m: m[:1],
    "common.yaw_pitch_roll": yaw_pitch_roll,
    "common.quaternion": lambda m: m[1:5],
    "common.angular_rate": lambda m: m[5:8],
    "common.accel": lambda m: m[8:11],
    "common.imu": lambda m: m[8:11] + m[5:8],
    "time.time_startup": lambda m: m[:1],
    "imu.uncomp_accel": lambda m: m[8:11],
    "imu.uncomp_gyro": lambda m: m[5:8],
    "imu.accel": lambda m: m[8:11],
    "imu.angular_rate": lambda m: m[5:8],
    "attitude.yaw_pitch_roll": yaw_pitch_roll,
    "attitude.quaternion": lambda m: m[1:5],
}
"""The binary fields that are emulated. Uncompensated and compensated measurements are alike."""


def binary_values(fields: Sequence[str], measurement: Measurement) -> list[float]:
    """Return a packet's payload; raises ProtocolError for a field that is not emulated."""
    values: list[float] = []
    for field in fields:
        if field not in _VALUES:
            raise ProtocolError(ErrorCode.INVALID_PARAMETER, f"{field} is not emulated")
        values += _VALUES[field](measurement)
    return values


_ASCII: dict[int, tuple[str, str, Callable[[Measurement], tuple[float, ...]]]] = {
    AsyncType.YPR: ("YPR", "%+08.3f", yaw_pitch_roll),
    AsyncType.QTN: ("QTN", "%+09.6f", lambda m: m[1:5]),
    AsyncType.ACC: ("ACC", "%+07.3f", lambda m: m[8:11]),
    AsyncType.GYR: ("GYR", "%+010.6f", lambda m: m[5:8]),
}
_ASCII_REGISTERS = {
    Register.YAW_PITCH_ROLL: AsyncType.YPR,
    Register.QUATERNION: AsyncType.QTN,
    Register.ACCELERATION: AsyncType.ACC,
    Register.ANGULAR_RATE: AsyncType.GYR,
}
_PORT_REGISTERS = (Register.BAUD, Register.ASYNC_TYPE, Register.ASYNC_RATE)
_LONGEST: Measurement = (0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""Any measurement: all have the same length on the wire."""


def _ascii_fields(kind: AsyncType, measurement: Measurement) -> tuple[str, ...]:
    _, form, values = _ASCII[kind]
    return tuple(form % value for value in values(measurement))


def ascii_output(settings: Vn200Settings) -> Callable[[Measurement], bytes] | None:
    """Return what makes the ASCII message that is sent unasked, None when there is none."""
    if settings.async_type == AsyncType.OFF:
        return None
    kind = AsyncType(settings.async_type)
    checksum = _CHECKSUMS[settings.protocol[4]]
    # Nothing is connected to its synchronisation inputs, and its status is good.
    behind = ("T0000000",) * (settings.protocol[0] > 0) + ("S0000",) * (settings.protocol[1] > 0)
    return lambda measurement: AsciiMessage(
        _ASCII[kind][0], _ascii_fields(kind, measurement) + behind, checksum
    ).encode()
