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
_STORE = get_typestore(Stores.ROS2_JAZZY)
_LISTS = {
    TFMessage: "tf2_msgs/msg/TFMessage",
    MarkerArray: "visualization_msgs/msg/MarkerArray",
}
"""Lists of messages, in the making of which rosbags takes a third to a half of rclpy's time."""


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
        _check_length(data, most)
    return _checked(_deserialize(data, kind), kind)


def decode_shown(topic: str, data: bytes, kind: Any) -> Any:
    """Return what is shown, not obeyed: the message, or an object with the same attributes.

    Args:
        topic: its name in the graph; the text of a description has no bound of its own.
        data: CDR with its header of 4 bytes; they may be more than of other messages.
        kind: class of the message.

    Raises:
        ValueError: as `decode`.
    """
    _check_length(data, _MOST)
    if topic == graph.ROBOT_DESCRIPTION:
        return _deserialize(data, kind)
    if kind in _LISTS:
        return _checked(_deserialize_list(data, kind), kind)
    return _checked(_deserialize(data, kind), kind)


def _check_length(data: bytes, most: int) -> None:
    if len(data) > most:
        raise ValueError(f"{len(data)} bytes, {most} are allowed")


def _deserialize(data: bytes, kind: Any) -> Any:
    try:
        return deserialize_message(data, kind)
    except RuntimeError as error:
        raise ValueError(f"{len(data)} bytes are no {kind.__name__}") from error


def _deserialize_list(data: bytes, kind: Any) -> Any:
    try:
        return _STORE.deserialize_cdr(data, _LISTS[kind])
    except (SerdeError, IndexError) as error:
        raise ValueError(f"{len(data)} bytes are no {kind.__name__}") from error


def _checked(message: Any, kind: Any) -> Any:
    reason = _check_of(kind)(message)
    if reason:
        raise ValueError(reason)
    return message
