"""Requests to a VN-200, how their answers are recognised, and where to look for the device."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from husky_drivers.vn200.binary import BinaryOutput
from husky_drivers.vn200.protocol import (
    BAUDS,
    BITS_PER_BYTE,
    FACTORY_BAUD,
    AsciiMessage,
    ProtocolError,
    Register,
    decimal,
)


@dataclass(frozen=True)
class Request:
    """A request and the test for its echo.

    Attributes:
        message: the frame to send.
        answered_by: whether a message of the device is the answer.
    """

    message: bytes
    answered_by: Callable[[AsciiMessage], bool]


def pause(paused: bool) -> Request:
    """Stop the device's unasked output, or let it go on."""
    fields = ("0" if paused else "1",)
    return Request(
        AsciiMessage("ASY", fields).encode(),
        lambda message: message.command == "ASY" and message.fields == fields,
    )


def write_number(register: Register, value: int) -> Request:
    """Set a register that holds one number."""

    def answered_by(message: AsciiMessage) -> bool:
        if message.command != "WRG" or register_of(message) != register:
            return False
        try:
            return decimal(message.fields[1]) == value
        except (ProtocolError, IndexError):
            return False

    return Request(AsciiMessage("WRG", (f"{register:02d}", str(value))).encode(), answered_by)


def write(register: Register, wanted: tuple[str, ...]) -> Request:
    """Set a register to these fields; the echo may write its numbers with more or fewer zeros."""

    def answered_by(message: AsciiMessage) -> bool:
        if message.command != "WRG" or register_of(message) != register:
            return False
        return same_fields(message.fields[1:], wanted)

    return Request(AsciiMessage("WRG", (f"{register:02d}", *wanted)).encode(), answered_by)


def read(register: Register) -> Request:
    """Ask for a register."""
    return Request(
        AsciiMessage("RRG", (f"{register:02d}",)).encode(),
        lambda message: message.command == "RRG" and register_of(message) == register,
    )


def register_of(message: AsciiMessage) -> int:
    """Return the register that a message is about, -1 for none."""
    try:
        return decimal(message.fields[0])
    except (ProtocolError, IndexError):
        return -1


def same_fields(some: Sequence[str], others: Sequence[str]) -> bool:
    """Return whether fields of whole numbers, decimal or hexadecimal, mean the same."""
    return [number_text(field) for field in some] == [number_text(field) for field in others]


def number_text(field: str) -> str:
    """Return a whole number's digits without the zeros in front."""
    return field.lstrip("0").upper() or "0"


def output_in(message: AsciiMessage) -> BinaryOutput | None:
    """Return the content of register 75 that a message carries, None when it carries none."""
    if register_of(message) != Register.BINARY_OUTPUT_1:
        return None
    try:
        return BinaryOutput.from_fields(message.fields[1:])
    except ProtocolError:
        return None


def scan_order(first: int, wanted: int) -> list[int]:
    """Return the baud rates in the order of probing.

    The rate that worked last comes first; the wanted one and the device's factory setting, the two
    that a device has in practice, come again after every few others.
    """
    likely = list(dict.fromkeys((wanted, FACTORY_BAUD)))
    others = [baud for baud in sorted(BAUDS, reverse=True) if baud not in likely]
    order = [first]
    for index in range(0, len(others), 3):
        order += [*likely, *others[index : index + 3]]
    return [baud for i, baud in enumerate(order) if i == 0 or baud != order[i - 1]]


def answer_time(baud: int) -> float:
    """Return how long a request, an ASCII output in front of the echo and the echo take [s]."""
    return 80.0 * BITS_PER_BYTE / baud
