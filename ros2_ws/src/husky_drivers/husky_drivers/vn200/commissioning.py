"""Registers of a VN-200 that the driver sets or checks, whatever somebody else has saved in them.

Changes go into the device's RAM and are gone after a power cycle: nothing is saved, because a save
keeps everybody's settings, takes 0.5 s and wants a device at rest (UM001, section 5.1.3).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from husky_drivers.vn200 import requests
from husky_drivers.vn200.binary import BinaryOutput
from husky_drivers.vn200.protocol import (
    IMU_RATE,
    AsciiMessage,
    AsyncType,
    ProtocolError,
    Register,
    decimal,
)
from husky_drivers.vn200.requests import Request

IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
"""Reference frame rotation of a device that nobody has turned, row by row."""
_FRAME_TOLERANCE = 1e-3
"""Greatest difference of an element of the rotation: 0.06 deg, below the attitude's accuracy."""

Fields = tuple[str, ...]


class RegisterRefused(ValueError):
    """A register holds what the driver must not change; says what, and how to correct it."""


@dataclass(frozen=True)
class RegisterRule:
    """Content that a register must have.

    Attributes:
        register: its number.
        wanted: returns the fields wanted for those read; raises `RegisterRefused` when a person
            must decide, ProtocolError for an answer that is none.
        describe: says in words what was changed, from the fields before and after.
    """

    register: Register
    wanted: Callable[[Fields], Fields]
    describe: Callable[[Fields, Fields], str] = lambda before, after: ""


class Vn200Commissioning:
    """Reads each register, writes it when it differs, and keeps what was changed.

    Attributes:
        model: what register 1 says, "" before.
        refusal: why the device cannot be used as it is, "" when it can.
        changes: what was changed last, in words, by register.
    """

    def __init__(self, output: BinaryOutput, frame: tuple[float, ...] = IDENTITY):
        """Start with nothing known.

        Args:
            output: what binary output 1 shall send.
            frame: what register 26 must hold (9,), row by row.
        """
        self.model = ""
        self.refusal = ""
        self.changes: dict[Register, str] = {}
        self._frame = frame
        self._read: Fields = ()
        self._wanted: Fields = ()
        # Outputs that are not ours go first: all together must fit into the baud rate.
        self._others = (
            RegisterRule(Register.ASYNC_TYPE, lambda fields: ("0", *fields[1:]), _ascii_off),
            _port_1_off(Register.BINARY_OUTPUT_2),
            _port_1_off(Register.BINARY_OUTPUT_3),
        )
        self._ours = RegisterRule(
            Register.BINARY_OUTPUT_1, lambda fields: output.to_fields(), _output_set
        )

    def before_slower_baud(self) -> Iterator[Request]:
        """Yield the requests that turn all output off, so that a slower line can carry it."""
        return self._requests((*self._others, _port_1_off(Register.BINARY_OUTPUT_1)))

    def before_streaming(self) -> Iterator[Request]:
        """Yield the requests until the device is as the driver needs it."""
        return self._requests(
            (
                RegisterRule(Register.MODEL, self._check_model),
                RegisterRule(Register.PROTOCOL_CONTROL, _protocol, _protocol_set),
                RegisterRule(Register.FRAME_ROTATION, self._check_frame),
                *self._others,
                self._ours,
            )
        )

    def _requests(self, rules: tuple[RegisterRule, ...]) -> Iterator[Request]:
        for rule in rules:
            message = requests.read(rule.register).message
            yield Request(message, partial(self._take_register, rule))
            before, wanted = self._read, self._wanted
            if not requests.same_fields(before, wanted):
                yield requests.write(rule.register, wanted)
                self.changes[rule.register] = rule.describe(before, wanted)

    def _take_register(self, rule: RegisterRule, message: AsciiMessage) -> bool:
        """Keep what a register holds; return whether that, or what is wanted, can be used."""
        if message.command != "RRG" or requests.register_of(message) != rule.register:
            return False
        self._read = message.fields[1:]
        try:
            self._wanted = rule.wanted(self._read)
        except RegisterRefused as error:
            self.refusal = str(error)
            return False
        except (ProtocolError, IndexError):
            self.refusal = f"register {rule.register:d} holds {','.join(self._read)!r}"
            return False
        self.refusal = ""
        return True

    def _check_model(self, fields: Fields) -> Fields:
        self.model = ",".join(fields)
        if not self.model.startswith("VN-"):
            raise RegisterRefused(f"model {self.model!r} is no VectorNav IMU")
        return fields

    def _check_frame(self, fields: Fields) -> Fields:
        """Refuse a turned frame: it takes a save and a reset to change it, and a person to know.

        The rotation acts on all vectors before the filter; a new one counts after a save and a
        reset (UM004, section 5.10). It may be right for the way this device is mounted.
        """
        try:
            held = tuple(float(field) for field in fields)
        except ValueError:
            held = ()
        if len(held) == len(self._frame) and all(
            abs(a - b) <= _FRAME_TOLERANCE for a, b in zip(held, self._frame, strict=True)
        ):
            return fields
        wanted = ",".join(f"{value:g}" for value in self._frame)
        raise RegisterRefused(
            f"reference frame rotation (register 26) is {','.join(fields)}, expected {wanted}: "
            "all samples would be turned. If the device is mounted so, set the parameter "
            f"frame_rotation; if not, send $VNWRG,26,{wanted}*XX, $VNWNV*57, $VNRST*4D"
        )


def check_frame(frame: tuple[float, ...]) -> None:
    """Raise ValueError when numbers are not the nine of a rotation matrix, row by row."""
    right = len(frame) == 9
    if right:
        x, y, z = frame[:3], frame[3:6], frame[6:]
        # The third row of a rotation is the cross product of the others, which have length 1.
        cross = (
            x[1] * y[2] - x[2] * y[1],
            x[2] * y[0] - x[0] * y[2],
            x[0] * y[1] - x[1] * y[0],
        )
        errors = (math.hypot(*x) - 1.0, math.hypot(*y) - 1.0, math.dist(cross, z), _dot(x, y))
        right = all(abs(error) < _FRAME_TOLERANCE for error in errors)  # false for NaN
    if not right:
        raise ValueError(
            f"frame_rotation is {list(frame)}, it must be nine numbers of a rotation matrix, row "
            "by row"
        )


def _dot(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    return sum(p * q for p, q in zip(a, b, strict=True))


# Wanted contents --------------------------------------------------------------------------------
def _protocol(fields: Fields) -> Fields:
    """Keep SPI's fields; no counter, no status behind messages; XOR; errors are sent."""
    return ("0", "0", *fields[2:4], "1", fields[5], "1", *fields[7:])


def _port_1_off(register: Register) -> RegisterRule:
    return RegisterRule(register, _without_port_1, partial(_output_off, register))


def _without_port_1(fields: Fields) -> Fields:
    """Keep an output, but for port 1; what port 2 gets is somebody else's."""
    return (str(decimal(fields[0]) & 2), *fields[1:])


# Words ------------------------------------------------------------------------------------------
def _protocol_set(before: Fields, after: Fields) -> str:
    return f"protocol control was {','.join(before)}: set to {','.join(after)}"


def _ascii_off(before: Fields, after: Fields) -> str:
    known = {str(kind.value): f"VN{kind.name}" for kind in AsyncType}
    name = known.get(requests.number_text(before[0]), f"of type {before[0]}")
    return f"ASCII output {name} was on: turned off"


def _output_off(register: Register, before: Fields, after: Fields) -> str:
    try:
        rate = f"{IMU_RATE / decimal(before[1]):g} Hz"
    except (ProtocolError, ZeroDivisionError):
        rate = "an unknown rate"
    number = register - Register.BINARY_OUTPUT_1 + 1
    return f"binary output {number} was on at {rate} ({','.join(before)}): turned off"


def _output_set(before: Fields, after: Fields) -> str:
    return f"binary output 1 was {','.join(before)}: set to {','.join(after)}"
