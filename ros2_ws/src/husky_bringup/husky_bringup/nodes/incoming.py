"""Messages that come from outside as bytes, let in by the same rules as those of the graph."""

from __future__ import annotations

from functools import cache
from typing import Any

from rclpy.serialization import deserialize_message
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from husky_runtime import graph
from husky_runtime.nodes.message_rules import make_check, most_bytes

_MOST = 4_000_000
"""Bytes of one message of a robot that is shown."""
_check_of = cache(make_check)
_deserialize_lists = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr
_LISTS = {
    TFMessage: "tf2_msgs/msg/TFMessage",
    MarkerArray: "visualization_msgs/msg/MarkerArray",
}
"""Lists of messages, in the making of which rosbags takes a third to a half of rclpy's time."""


def decode(data: bytes, kind: Any, encoding: str = "cdr", most: int | None = None) -> Any:
    """Return the message that bytes are.

    Args:
        data: CDR with its header of 4 bytes.
        kind: class of the message.
        encoding: that whoever has sent it claims.
        most: bytes that are allowed; by default as many as the rules of its kind say.

    Raises:
        ValueError: they are none, or it holds what no message may.
    """
    if encoding != "cdr":
        raise ValueError(f"encoding is {encoding!r}, it must be cdr")
    most = most_bytes(kind) if most is None else most
    if most is not None and len(data) > most:
        raise ValueError(f"{len(data)} bytes, {most} are allowed")
    message = _deserialize(data, kind)
    reason = _check_of(kind)(message)
    if reason:
        raise ValueError(reason)
    return message


def decode_shown(topic: str, data: bytes, kind: Any) -> Any:
    """Return a message that is shown, not obeyed: it may be longer than others.

    Args:
        topic: its name in the graph; the text of a description has no bound of its own.
        data: CDR with its header of 4 bytes.
        kind: class of the message.

    Raises:
        ValueError: as `decode`.
    """
    if topic != graph.ROBOT_DESCRIPTION:
        return decode(data, kind, most=_MOST)
    if len(data) > _MOST:
        raise ValueError(f"{len(data)} bytes, {_MOST} are allowed")
    return _deserialize(data, kind)


def _deserialize(data: bytes, kind: Any) -> Any:
    """Return what bytes are, of a kind of `_LISTS` an object with the same attributes."""
    try:
        if kind in _LISTS:
            return _deserialize_lists(data, _LISTS[kind])
        return deserialize_message(data, kind)
    except (RuntimeError, SerdeError, IndexError) as error:
        raise ValueError(f"{len(data)} bytes are no {kind.__name__}") from error
