"""Bytes from outside: what is obeyed is a message of ROS, what is shown need only look like it."""

from __future__ import annotations

import math
import random
from array import array
from typing import Any

import pytest
from geometry_msgs.msg import Point, TransformStamped
from rclpy.serialization import serialize_message
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from husky_bringup.nodes.incoming import decode
from husky_bringup.nodes.shown import decode_shown
from husky_runtime import graph


def transforms(x: float = 0.25) -> TFMessage:
    """Two transforms, of a chain."""
    message = TFMessage()
    for parent, child in (("odom", "base_link"), ("base_link", "hip")):
        each = TransformStamped(child_frame_id=child)
        each.header.frame_id, each.transform.translation.x = parent, x
        message.transforms.append(each)
    return message


def markers(x: float = 0.25) -> MarkerArray:
    """A line, a deleted marker."""
    line = Marker(ns="way", id=3, type=Marker.LINE_STRIP, points=[Point(x=x), Point(y=0.5)])
    line.header.frame_id, line.color.a = "odom", 1.0
    return MarkerArray(markers=[line, Marker(ns="way", id=4, action=Marker.DELETE)])


KINDS = [(graph.TF, transforms), (graph.MARKERS, markers)]


@pytest.mark.parametrize(("topic", "make"), KINDS)
def test_what_is_obeyed_can_be_published(topic: str, make: Any) -> None:
    message = decode(serialize_message(make()), type(make()))
    assert message == make()


@pytest.mark.parametrize(("topic", "make"), KINDS)
def test_what_is_shown_has_the_same_attributes(topic: str, make: Any) -> None:
    def same(shown: Any, message: Any) -> bool:
        if isinstance(message, list | array):
            return len(shown) == len(message) and all(map(same, shown, message))
        if hasattr(message, "get_fields_and_field_types"):
            names = message.get_fields_and_field_types()
            return all(same(getattr(shown, name), getattr(message, name)) for name in names)
        return bool(shown == message)

    shown = decode_shown(topic, serialize_message(make()), type(make()))
    assert same(shown, make()) and not same(shown, make(0.5))


@pytest.mark.parametrize(("topic", "make"), KINDS)
def test_what_no_message_may_hold_is_not_shown(topic: str, make: Any) -> None:
    with pytest.raises(ValueError, match=r"\.x|longer than"):
        decode_shown(topic, serialize_message(make(math.inf)), type(make()))


@pytest.mark.parametrize(("topic", "make"), KINDS)
def test_bytes_that_are_none_are_a_value_error(topic: str, make: Any) -> None:
    data, kind = serialize_message(make()), type(make())
    for end in range(len(data) - 8):
        with pytest.raises(ValueError, match=f"bytes are no {kind.__name__}"):
            decode_shown(topic, data[:end], kind)
    dice = random.Random(1)
    refused = 0
    for _ in range(2000):
        damaged = bytearray(data)
        for _ in range(4):
            damaged[dice.randrange(len(data))] = dice.choice((0, 255, dice.randrange(256)))
        try:
            decode_shown(topic, bytes(damaged), kind)
        except ValueError:
            refused += 1
    assert 0 < refused < 2000


def test_more_bytes_may_be_shown_than_obeyed() -> None:
    message = markers()
    message.markers[0].points *= 2000
    data = serialize_message(message)
    assert len(decode_shown(graph.MARKERS, data, MarkerArray).markers[0].points) == 4000
    with pytest.raises(ValueError, match="65536 are allowed"):
        decode(data, MarkerArray)
    with pytest.raises(ValueError, match="4000000 are allowed"):
        decode_shown(graph.MARKERS, bytes(4_000_001), MarkerArray)
