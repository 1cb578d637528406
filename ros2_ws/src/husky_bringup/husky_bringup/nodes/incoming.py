"""Messages that come from outside as bytes, let in by the same rules as those of the graph."""

from __future__ import annotations

from functools import cache
from typing import Any

from rclpy.serialization import deserialize_message

from husky_runtime.nodes.message_rules import make_check, most_bytes

_check_of = cache(make_check)


def decode(data: bytes, kind: Any, encoding: str = "cdr") -> Any:
    """Return the message that bytes are.

    Args:
        data: CDR with its header of 4 bytes.
        kind: class of the message.
        encoding: that whoever has sent it claims.

    Raises:
        ValueError: they are none, they are more than the rules of its kind allow, or it holds what
            no message may.
    """
    if encoding != "cdr":
        raise ValueError(f"encoding is {encoding!r}, it must be cdr")
    most = most_bytes(kind)
    if most is not None:
        check_length(data, most)
    return checked(deserialize(data, kind), kind)


def check_length(data: bytes, most: int) -> None:
    """Raise ValueError for bytes that are more than are allowed."""
    if len(data) > most:
        raise ValueError(f"{len(data)} bytes, {most} are allowed")


def deserialize(data: bytes, kind: Any) -> Any:
    """Return the message that bytes are, whatever it holds; raises ValueError for none."""
    try:
        return deserialize_message(data, kind)
    except RuntimeError as error:
        raise ValueError(f"{len(data)} bytes are no {kind.__name__}") from error


def checked(message: Any, kind: Any) -> Any:
    """Return a message; raises ValueError for one that holds what none of its kind may."""
    reason = _check_of(kind)(message)
    if reason:
        raise ValueError(reason)
    return message
