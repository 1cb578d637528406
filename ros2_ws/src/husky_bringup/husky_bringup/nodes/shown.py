"""Messages that are shown, not obeyed: they may be long, and need only look like what they are."""

from __future__ import annotations

from typing import Any

from grid_map_msgs.msg import GridMap
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from husky_bringup.nodes.incoming import check_length, checked, deserialize
from husky_runtime import graph

_MOST, _MOST_OF_MAP = 4_000_000, 32_000_000
"""Bytes of one message, and of an elevation map."""
_STORE = get_typestore(Stores.ROS2_JAZZY)
_LISTS = {
    TFMessage: "tf2_msgs/msg/TFMessage",
    MarkerArray: "visualization_msgs/msg/MarkerArray",
}
"""Lists of messages, in the making of which rosbags takes a third to a half of rclpy's time."""


def decode_shown(topic: str, data: bytes, kind: Any) -> Any:
    """Return what is shown, not obeyed: the message, or an object with the same attributes.

    Args:
        topic: its name in the graph; the text of a description has no bound of its own.
        data: CDR with its header of 4 bytes; they may be more than of other messages.
        kind: class of the message.

    Raises:
        ValueError: as `decode`.
    """
    check_length(data, _MOST_OF_MAP if kind is GridMap else _MOST)
    if topic == graph.ROBOT_DESCRIPTION:
        return deserialize(data, kind)
    if kind in _LISTS:
        return checked(_deserialize_list(data, kind), kind)
    if kind is GridMap:
        return _decode_map(data)
    return checked(deserialize(data, kind), kind)


def _deserialize_list(data: bytes, kind: Any) -> Any:
    try:
        return _STORE.deserialize_cdr(data, _LISTS[kind])
    except (SerdeError, IndexError) as error:
        raise ValueError(f"{len(data)} bytes are no {kind.__name__}") from error


def _decode_map(data: bytes) -> GridMap:
    """Return a map whose layers are not looked through: the drawing leaves out what is no height.

    They are a quarter of a million numbers, of which most are NaN.
    """
    message = deserialize(data, GridMap)
    layers, message.data = message.data, []
    checked(message, GridMap)
    message.data = layers
    return message
