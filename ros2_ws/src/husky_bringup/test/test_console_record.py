"""What of a bag is kept for the page, and what is told of the rest."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from bag_fixtures import types_of_the_graph
from rclpy.serialization import serialize_message
from replay_bench import BEGIN, LENGTH, MAPPING, read, stamp, told

from husky_bringup.bag import BagWriter
from husky_bringup.console.record import Record, Recorded
from husky_bringup.nodes.replay import decode
from husky_msgs.msg import ControllerState
from husky_runtime import graph


def topics(messages: Iterable[Recorded]) -> dict[str, int]:
    found: dict[str, int] = {}
    for each in messages:
        found[each.topic] = found.get(each.topic, 0) + 1
    return found


def test_what_is_faster_than_plots_is_thinned_out_and_nothing_else(record: Record) -> None:
    count = topics(record.between(-1.0, 1000.0))
    assert count[graph.TF] == 50 * LENGTH and count[graph.DIAGNOSTICS] == LENGTH
    assert count[graph.ODOM] == count[graph.CONTROLLER_STATE] == math.ceil(50 * LENGTH / 3)
    assert record.left_out == [] and (record.start, record.end) == (BEGIN, BEGIN + LENGTH - 0.02)


def test_messages_come_in_their_order_each_once(record: Record) -> None:
    parts = [record.between(at, at + 1.7) for at in (99.0, 100.7, 102.4, 104.1)]
    joined = [each for part in parts for each in part]
    assert joined == record.between(99.0, 105.8)
    assert [each.time for each in joined] == sorted(each.time for each in joined)


def test_of_maps_the_newest_alone_counts(record: Record) -> None:
    count = topics(record.between(-1.0, 1000.0))
    assert count[graph.ELEVATION_MAP] == len(range(MAPPING, LENGTH, 3))
    maps = [m for m in record.standing(BEGIN + 19.5) if m.topic == graph.ELEVATION_MAP]
    assert [m.time for m in maps] == [BEGIN + 18.0]
    message = decode(graph.ELEVATION_MAP, maps[0].data)
    assert message.header.stamp == stamp(18.0) and set(message.data[0].data) == {18.0}


def test_a_type_that_has_changed_since_is_left_out_by_name(tmp_path: Path, profiles: Any) -> None:
    store = types_of_the_graph({"ControllerState": "float64 of_old"})
    writer = BagWriter(tmp_path / "bag", graph.TOPICS, profiles, store)
    channels = {channel.topic.relative: channel for channel in writer.channels}
    for topic, message in told(1.0):
        writer.write(channels[topic], serialize_message(message))
    writer.close()
    record = read(tmp_path / "bag")
    state = graph.absolute(graph.CONTROLLER_STATE)
    why = f"{state}: husky_msgs/msg/ControllerState is not what it is today"
    assert record.left_out == [why]
    assert set(topics(record.standing(BEGIN + 1.5))) == {
        graph.ODOM,
        graph.TF,
        graph.MARKERS,
        graph.DIAGNOSTICS,
    }


def test_of_several_robots_the_one_that_is_named(
    tmp_path: Path, profiles: Any, typestore: Any
) -> None:
    rows = [
        replace(graph.topic(topic), relative=f"/{robot}/{topic}")
        for robot in ("a", "b")
        for topic in (graph.CONTROLLER_STATE, graph.TF)
    ]
    writer = BagWriter(tmp_path / "bag", rows, profiles, typestore)
    for channel in writer.channels:
        if channel.topic.relative.endswith("state"):
            mode = channel.topic.relative[1]
            state = ControllerState(stamp=stamp(1.0), mode=mode)
            writer.write(channel, serialize_message(state))
    writer.close()
    for robot in ("a", "b"):
        (message,) = read(tmp_path / "bag", f"/{robot}").standing(BEGIN + 2.0)
        assert decode(message.topic, message.data).mode == robot
    with pytest.raises(ValueError, match=r"nothing of a robot in /; it has /a/controller/state"):
        Record(tmp_path / "bag")


def test_what_is_no_bag_is_told(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        Record(tmp_path / "nothing")
