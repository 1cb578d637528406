"""What a message must not be: mutations of a genuine one, by its type alone."""

from __future__ import annotations

import copy
import math
import struct
from collections.abc import Iterator
from typing import Any

from rclpy.serialization import serialize_message
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractString,
    Array,
    BasicType,
)

_BAD_FLOATS = (math.nan, math.inf, -math.inf, 1e300, -1e300)
_LONG_TEXT = "x" * 100_000
_STAMPS = ((-5, 0), (0, 4_000_000_000), (100_000, 0))
"""Before 0, with more nanoseconds than a second has, a day ahead."""


def mutations(message: Any) -> Iterator[tuple[str, Any]]:
    """Yield labels and messages, each with one thing wrong; and the empty message of the kind."""
    yield "empty", type(message)()
    yield from _of_fields(message, message, "")


def broken_bytes(message: Any) -> Iterator[tuple[str, bytes]]:
    """Yield labels and serialised messages that are damaged."""
    data = serialize_message(message)
    yield "no bytes", b""
    yield "header only", data[:4]
    yield "half", data[: len(data) // 2]
    yield "big-endian", b"\x00\x00" + data[2:]
    for offset in range(4, min(len(data) - 3, 40), 4):
        huge = struct.pack("<I", 2**32 - 1)
        yield f"huge length at {offset}", data[:offset] + huge + data[offset + 4 :]


def _of_fields(root: Any, part: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Yield copies of `root` with one field of its `part` at `path` wrong."""
    for name, slot in zip(part.get_fields_and_field_types(), part.SLOT_TYPES, strict=True):
        here = f"{path}.{name}" if path else name
        value = getattr(part, name)
        for label, wrong in _wrong_values(slot, value):
            changed = copy.deepcopy(root)
            target = changed
            for step in path.split(".") if path else ():
                target = getattr(target, step)
            try:
                setattr(target, name, wrong)
            except (AssertionError, OverflowError, ValueError):
                continue  # such a value cannot be put on the wire
            yield f"{here} {label}", changed
        if hasattr(value, "SLOT_TYPES"):
            yield from _of_fields(root, value, here)


def _wrong_values(slot: Any, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(slot, BasicType) and slot.typename in ("float", "double"):
        yield from ((str(bad), bad) for bad in _BAD_FLOATS)
    elif isinstance(slot, AbstractString):
        yield "of 100 000 characters", _LONG_TEXT
    elif isinstance(slot, AbstractNestedType):
        yield from _wrong_lists(slot, value)
    elif hasattr(value, "nanosec"):
        for sec, nanosec in _STAMPS:
            yield f"at {sec} s {nanosec} ns", type(value)(sec=sec, nanosec=nanosec)
    elif hasattr(value, "w") and hasattr(value, "z"):
        yield "zero", type(value)(x=0.0, y=0.0, z=0.0, w=0.0)
        yield "not unit", type(value)(x=2.0, y=0.0, z=0.0, w=0.0)


def _wrong_lists(slot: Any, value: Any) -> Iterator[tuple[str, Any]]:
    entries = list(value)
    element = slot.value_type
    if isinstance(element, BasicType) and element.typename in ("float", "double") and entries:
        for bad in _BAD_FLOATS:
            yield f"[-1] {bad}", [*entries[:-1], bad]
    if isinstance(element, BasicType) and element.typename.startswith("uint") and entries:
        yield "[0] greatest", [2 ** int(element.typename[4:]) - 1, *entries[1:]]
    if not isinstance(slot, Array) and entries:
        yield "none", []
        yield "one short", entries[:-1]
        yield "5000", entries[:1] * 5000
