"""Many serialized messages of one type as columns of NumPy arrays."""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype

Columns = dict[str, NDArray[Any]]
"""Column name to values, one per message in the first axis. Nested fields are joined by dots."""


def decode(messages: Sequence[bytes], typestore: Any, message_type: str) -> Columns:
    """Decode messages of one type into columns.

    Vectors whose fields are all of one number type (Vector3, Quaternion, ...) become one column
    with an axis more; fixed arrays and sequences of numbers or of such vectors likewise. Strings
    become arrays of str. Sequences of strings or messages are numbered: `drives[3].state`.

    Args:
        messages: CDR with encapsulation header.
        typestore: definitions of the types.
        message_type: e.g. "sensor_msgs/msg/JointState".

    Raises:
        ValueError: messages that differ in the length of a sequence: they have no common columns.
    """
    values = [typestore.deserialize_cdr(message, message_type) for message in messages]
    columns: Columns = {}
    _add_fields(columns, typestore, "", message_type, values)
    return columns


def _add_fields(columns: Columns, store: Any, prefix: str, kind: str, values: list[Any]) -> None:
    """Add the columns of all fields of messages."""
    for name, description in store.fielddefs[kind][1]:
        _add(columns, store, f"{prefix}{name}", description, list(map(attrgetter(name), values)))


def _add(columns: Columns, store: Any, name: str, description: Any, values: list[Any]) -> None:
    """Add the columns of one field, as rosbags describes it."""
    node, inner = description
    if node == Nodetype.BASE:
        columns[name] = np.array(values, object if inner[0] == "string" else None)
    elif node == Nodetype.NAME:
        parts = _vector(store, inner)
        if parts is None:
            _add_fields(columns, store, f"{name}.", inner, values)
        else:
            columns[name] = np.array([parts(value) for value in values])
    else:
        _add_sequence(columns, store, name, inner[0], values)


def _add_sequence(columns: Columns, store: Any, name: str, element: Any, values: list[Any]) -> None:
    """Add the columns of an array or a sequence."""
    length = len(values[0])
    if any(len(value) != length for value in values):
        raise ValueError(f"messages differ in the length of {name}, they have no common columns")
    node, inner = element
    parts = _vector(store, inner) if node == Nodetype.NAME else None
    if parts is not None:
        columns[name] = np.array([[parts(item) for item in value] for value in values])
    elif node == Nodetype.BASE and inner[0] != "string":
        columns[name] = np.array(values)
    else:
        for index in range(length):
            _add(columns, store, f"{name}[{index}]", element, [value[index] for value in values])


def _vector(store: Any, kind: str) -> attrgetter[tuple[float, ...]] | None:
    """Return what reads a message that is nothing but numbers of one type; None for another."""
    fields = store.fielddefs[kind][1]
    types = {inner[0] if node == Nodetype.BASE else "" for _, (node, inner) in fields}
    if len(fields) < 2 or len(types) != 1 or types & {"", "string"}:
        return None
    return attrgetter(*(name for name, _ in fields))
