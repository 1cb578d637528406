"""What a message must not be: mutations of a genuine one, by its type alone."""

from __future__ import annotations

import copy
import functools
import importlib
import math
import struct
from collections.abc import Iterator
from typing import Any

import hypothesis.strategies as st
import numpy as np
from rclpy.serialization import serialize_message
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractString,
    Array,
    BasicType,
    BoundedSequence,
)
from sensor_msgs.msg import JointState

from husky_msgs.msg import DriveStatus, DriveStatusArray

_BAD_FLOATS = (math.nan, math.inf, -math.inf, 1e300, -1e300)
_LONG_TEXT = "x" * 100_000
_STAMPS = ((-5, 0), (0, 4_000_000_000), (100_000, 0))
"""Before 0, with more nanoseconds than a second has, a day ahead."""


def genuine(message_type: Any) -> Any:
    """Return a message of a kind as a node of ours may send it."""
    message = message_type()
    if isinstance(message, JointState):
        message.position = message.velocity = message.effort = [0.1] * 12
    if isinstance(message, DriveStatusArray):
        message.drives = [DriveStatus() for _ in range(12)]
    for name, slot in zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True):
        if isinstance(slot, BoundedSequence):  # of the fans: our messages have no other
            nothing = {"boolean": False, "double": 0.0}.get(slot.value_type.typename, 0)
            setattr(message, name, [nothing] * 4)
    if isinstance(getattr(message, "orientation", None), np.ndarray):
        message.orientation[3] = 1.0
    return message


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
        most = slot.maximum_size if isinstance(slot, BoundedSequence) else 5000
        yield f"{most}", entries[:1] * most  # more cannot be put on the wire


# What Hypothesis makes of a definition ------------------------------------------------------------
class Anything:
    """Makes whatever can be on the wire where a definition has a field; the odd more often."""

    def __init__(self, *words: str):
        """Take words that texts may be: names that somebody knows."""
        text = st.text(st.characters(codec="utf-8"), max_size=20)
        self._text = st.sampled_from(words) | text if words else text

    def altered(self, genuine: Any) -> st.SearchStrategy[Any]:
        """Return messages of a genuine one's kind, one to three of whose fields are anything."""
        # Made once: to make them takes longer than to draw from them.
        fields = [(path, self._field(slot)) for path, slot in _fields(genuine, "")]
        chosen = st.lists(st.sampled_from(fields), min_size=1, max_size=3)

        @st.composite
        def make(draw: st.DrawFn) -> Any:
            message = copy.deepcopy(genuine)
            for path, values in draw(chosen):
                *steps, name = path.split(".")
                setattr(functools.reduce(getattr, steps, message), name, draw(values))
            return message

        return make() if fields else st.just(genuine)

    def _field(self, slot: Any) -> st.SearchStrategy[Any]:
        if isinstance(slot, AbstractString):
            return self._text
        if isinstance(slot, BasicType):
            return _number(slot.typename)
        if isinstance(slot, AbstractNestedType):
            return self._list(slot)
        return self._message(slot)

    def _message(self, slot: Any) -> st.SearchStrategy[Any]:
        kind = getattr(importlib.import_module(".".join(slot.namespaces)), slot.name)
        fields = zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True)
        made = st.builds(kind, **{name: self._field(field) for name, field in fields})
        if slot.name != "Quaternion":
            return made
        turned = st.floats(-math.pi, math.pi).map(lambda a: kind(x=math.sin(a), w=math.cos(a)))
        return st.just(kind(w=0.0)) | turned | made

    def _list(self, slot: Any) -> st.SearchStrategy[Any]:
        element = self._field(slot.value_type)
        if isinstance(slot, Array):
            return st.lists(element, min_size=slot.size, max_size=slot.size)
        if not isinstance(slot.value_type, BasicType):
            return st.lists(element, max_size=3)
        for_joints = st.lists(element, min_size=12, max_size=12)
        return st.lists(element, max_size=40) | for_joints


def _fields(part: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Yield path and definition of every field, of those in a nested message too."""
    for name, slot in zip(part.get_fields_and_field_types(), part.SLOT_TYPES, strict=True):
        yield path + name, slot
        value = getattr(part, name)
        if hasattr(value, "SLOT_TYPES"):
            yield from _fields(value, f"{path}{name}.")


def _number(kind: str) -> st.SearchStrategy[Any]:
    if kind == "boolean":
        return st.booleans()
    if kind == "octet":
        return st.binary(min_size=1, max_size=1)
    if kind in ("float", "double"):
        width = 32 if kind == "float" else 64
        return st.floats(-10.0, 10.0, width=width) | st.floats(width=width)
    bits, signed = int(kind.lstrip("uint")), kind[0] == "i"
    lower, upper = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)
    return st.integers(max(lower, -3), 20) | st.integers(lower, upper)
