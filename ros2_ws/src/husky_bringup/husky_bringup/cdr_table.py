"""Many serialized messages of one type as columns of numpy arrays.

Messages of one topic mostly have their fields at the same offsets: joint names and frame names do
not change, arrays keep their length. So the layout is worked out once per layout that occurs, not
once per message, and the columns are cut out of one block of bytes. A 60 s recording of joint
states takes tens of milliseconds instead of seconds.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype

Columns = dict[str, NDArray[Any]]
"""Column name to values, one per message in the first axis. Nested fields are joined by dots."""

_HEADER = 4
"""Bytes of the encapsulation header; alignment counts from behind it."""
_NUMPY = {
    "bool": "?",
    "byte": "u1",
    "char": "u1",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float32": "f4",
    "float64": "f8",
}


@dataclass(frozen=True)
class _Leaf:
    """A field at its place: numbers of one type and shape, or one string (dtype None)."""

    name: str
    offset: int
    dtype: np.dtype[Any] | None
    shape: tuple[int, ...]
    size: int


def decode(messages: Sequence[bytes], typestore: Any, message_type: str) -> Columns:
    """Decode messages of one type into columns.

    Vectors whose fields are all of one number type (Vector3, Quaternion, ...) become one column
    with an axis more; fixed arrays and sequences of numbers likewise. Strings become arrays of str.
    Sequences of strings or messages are numbered: `drives[3].state`.

    Args:
        messages: CDR with encapsulation header.
        typestore: definitions of the types.
        message_type: e.g. "sensor_msgs/msg/JointState".

    Raises:
        ValueError: messages that differ in the length of a sequence: they have no common columns.
    """
    by_length: dict[int, list[int]] = defaultdict(list)
    for index, message in enumerate(messages):
        by_length[len(message)].append(index)
    columns: Columns = {}
    groups = 0
    for length, indices in by_length.items():
        block = np.frombuffer(b"".join(messages[i] for i in indices), np.uint8)
        rows, where = block.reshape(-1, length), np.array(indices)
        while len(rows):
            layout = _Layout(typestore, rows[0].tobytes())
            leaves = list(layout.walk_message(message_type, ""))
            same = layout.fits(rows)
            _fill(columns, leaves, rows[same], where[same], len(messages), groups)
            groups += 1
            rows, where = rows[~same], where[~same]
    return columns


class _Layout:
    """Finds where the fields of one message are."""

    def __init__(self, typestore: Any, message: bytes):
        self._typestore = typestore
        self._message = message
        self._order = "<" if message[1] & 1 else ">"
        self._position = _HEADER
        self._lengths: list[int] = []

    def fits(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return which messages (rows of bytes) have the layout of this one."""
        places = [1, *(byte for place in self._lengths for byte in range(place, place + 4))]
        template = np.frombuffer(self._message, np.uint8)
        same: NDArray[np.bool_] = np.all(rows[:, places] == template[places], axis=1)
        return same

    def walk_message(self, message_type: str, prefix: str) -> Iterator[_Leaf]:
        """Yield the leaves of a message from the present position on."""
        for name, description in self._typestore.fielddefs[message_type][1]:
            yield from self._walk(description, f"{prefix}{name}")

    def _walk(self, description: Any, name: str) -> Iterator[_Leaf]:
        uniform = self._uniform(description)
        if uniform is not None:
            yield self._numbers(name, *uniform)
            return
        kind, inner = description
        if kind == Nodetype.BASE:
            yield self._string(name)
        elif kind == Nodetype.NAME:
            yield from self.walk_message(inner, f"{name}.")
        else:
            element, count = inner
            if kind == Nodetype.SEQUENCE:
                count = self._length()
                uniform = self._uniform(element)
                if uniform is not None:
                    yield self._numbers(name, uniform[0], (count, *uniform[1]))
                    return
            for index in range(count):
                yield from self._walk(element, f"{name}[{index}]")

    def _uniform(self, description: Any) -> tuple[np.dtype[Any], tuple[int, ...]] | None:
        """Return type and shape of a field that is nothing but numbers of one type, else None."""
        kind, inner = description
        if kind == Nodetype.BASE:
            code = _NUMPY.get(inner[0])
            return None if code is None else (np.dtype(self._order + code), ())
        if kind == Nodetype.ARRAY:
            element = self._uniform(inner[0])
            return None if element is None else (element[0], (inner[1], *element[1]))
        if kind == Nodetype.NAME:
            fields = self._typestore.fielddefs[inner][1]
            parts = {self._uniform(field) for _, field in fields}
            if len(parts) == 1 and (part := parts.pop()) is not None and part[1] == ():
                return part[0], (len(fields),)
        return None

    def _align(self, size: int) -> None:
        self._position += -(self._position - _HEADER) % size

    def _numbers(self, name: str, dtype: np.dtype[Any], shape: tuple[int, ...]) -> _Leaf:
        count = int(np.prod(shape))
        if count:
            self._align(dtype.itemsize)
        size = count * dtype.itemsize
        leaf = _Leaf(name, self._position, dtype, shape, size)
        self._position += size
        return leaf

    def _length(self) -> int:
        """Read the length of a string or sequence and remember where it stands."""
        self._align(4)
        self._lengths.append(self._position)
        length = np.frombuffer(self._message, f"{self._order}u4", 1, self._position)[0]
        self._position += 4
        return int(length)

    def _string(self, name: str) -> _Leaf:
        length = self._length()
        leaf = _Leaf(name, self._position, None, (), max(0, length - 1))
        self._position += length
        return leaf


def _fill(
    columns: Columns,
    leaves: list[_Leaf],
    rows: NDArray[np.uint8],
    where: NDArray[np.intp],
    total: int,
    groups: int,
) -> None:
    """Write the fields of some messages into the columns."""
    if groups and {leaf.name for leaf in leaves} != columns.keys():
        raise ValueError("messages differ in the length of a sequence, they have no common columns")
    for leaf in leaves:
        cut = np.ascontiguousarray(rows[:, leaf.offset : leaf.offset + leaf.size])
        if leaf.dtype is None:
            values: NDArray[Any] = _strings(cut)
        else:
            values = cut.view(leaf.dtype).reshape(len(cut), *leaf.shape)
        if leaf.name not in columns:
            columns[leaf.name] = np.empty((total, *leaf.shape), values.dtype.newbyteorder("="))
        elif columns[leaf.name].shape[1:] != leaf.shape:
            raise ValueError(f"messages differ in the length of {leaf.name}")
        columns[leaf.name][where] = values


def _strings(cut: NDArray[np.uint8]) -> NDArray[np.object_]:
    """Return rows of UTF-8 as strings."""
    values = np.empty(len(cut), np.object_)
    if len(cut) and np.all(cut == cut[0]):
        values[:] = cut[0].tobytes().decode("utf-8", "replace")
    else:
        values[:] = [row.tobytes().decode("utf-8", "replace") for row in cut]
    return values
