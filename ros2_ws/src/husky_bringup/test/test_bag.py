"""Bags are what ROS 2 Jazzy expects, by three readers: two libraries and rosbag2's own rules."""

from __future__ import annotations

import json
import time
import tracemalloc
from pathlib import Path
from typing import Any

import pytest
import yaml
from rosbags.highlevel import AnyReader

from husky_bringup.bag import _EARLY, MISSING_KEY, BagWriter
from husky_runtime import graph

CLOCK = graph.absolute(graph.CLOCK)
CMD_VEL = graph.absolute(graph.CMD_VEL)
DIAGNOSTICS = graph.absolute(graph.DIAGNOSTICS)
JOINT_STATES = graph.absolute(graph.JOINT_STATES)
ROBOT_DESCRIPTION = graph.absolute(graph.ROBOT_DESCRIPTION)

TICK = graph.TICK_PERIOD_NS
ZEROS = [0.0] * 12


def joint(messages: Any, stamp: int) -> tuple[str, bytes]:
    return JOINT_STATES, messages.joint_states(stamp, ZEROS, ZEROS, ZEROS)


def text(messages: Any, words: str) -> tuple[str, bytes]:
    return ROBOT_DESCRIPTION, messages.pack("std_msgs/msg/String", data=words)


def twist(messages: Any, typestore: Any) -> tuple[str, bytes]:
    vector = typestore.types["geometry_msgs/msg/Vector3"]
    message = messages.pack(
        "geometry_msgs/msg/Twist", linear=vector(0.5, 0.0, 0.0), angular=vector(0.0, 0.0, 0.1)
    )
    return CMD_VEL, message


def diagnostics(messages: Any, stamp: int) -> tuple[str, bytes]:
    message = messages.pack(
        "diagnostic_msgs/msg/DiagnosticArray", header=messages.header(stamp), status=[]
    )
    return DIAGNOSTICS, message


def read(path: Path) -> list[tuple[str, int, bytes]]:
    with AnyReader([path]) as reader:
        return [(c.topic, stamp, data) for c, stamp, data in reader.messages()]


def metadata(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load((path / "metadata.yaml").read_text())
    return found


# Round trip -----------------------------------------------------------------------------------
def test_rosbags_reads_back_what_was_written(tmp_path: Path, write_bag: Any, messages: Any) -> None:
    content = [joint(messages, i * TICK) for i in range(3000)]
    write_bag(tmp_path / "bag", content)
    back = read(tmp_path / "bag")
    assert [(topic, data) for topic, _, data in back] == content
    assert [stamp for _, stamp, _ in back] == [i * TICK for i in range(3000)]


def test_definitions_of_all_types_are_inside(
    tmp_path: Path, write_bag: Any, messages: Any, typestore: Any
) -> None:
    write_bag(tmp_path / "bag", [joint(messages, 0)])
    with AnyReader([tmp_path / "bag"]) as reader:  # its typestore starts empty
        assert {c.topic: c.msgtype for c in reader.connections} == {
            topic.name: topic.type for topic in graph.TOPICS
        }
        for topic in graph.TOPICS:
            assert reader.typestore.fielddefs[topic.type] == typestore.fielddefs[topic.type]


def test_the_mcap_library_reads_it(tmp_path: Path, write_bag: Any, messages: Any) -> None:
    reader_module = pytest.importorskip("mcap.reader")
    content = [joint(messages, i * TICK) for i in range(2000)]
    write_bag(tmp_path / "bag", [text(messages, "<robot/>"), *content])
    with (tmp_path / "bag" / "bag.mcap").open("rb") as stream:
        reader = reader_module.make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary.statistics.message_count == 2001
        assert summary.statistics.chunk_count == len(summary.chunk_indexes)
        assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
        schema = next(s for s in summary.schemas.values() if s.name.endswith("DriveStatusArray"))
        assert b"MSG: husky_msgs/DriveStatus" in schema.data
        assert reader.get_header().profile == "ros2"
        found = [
            (channel.topic, message.log_time, message.data)
            for _, channel, message in reader.iter_messages(topics=[JOINT_STATES])
        ]
    assert found == [(JOINT_STATES, i * TICK, data) for i, (_, data) in enumerate(content)]


# Metadata -------------------------------------------------------------------------------------
def test_metadata_is_what_rosbag2_decodes(tmp_path: Path, write_bag: Any, messages: Any) -> None:
    """Fields and types are those that rosbag2_storage/yaml.hpp (branch jazzy, version 9) reads."""
    content = [joint(messages, i * TICK) for i in range(100, 601)]
    write_bag(tmp_path / "bag", content)
    info = metadata(tmp_path / "bag")["rosbag2_bagfile_information"]
    assert info["version"] == 9
    assert info["storage_identifier"] == "mcap"
    assert info["duration"] == {"nanoseconds": 500 * TICK}
    assert info["starting_time"] == {"nanoseconds_since_epoch": 100 * TICK}
    assert info["message_count"] == 501
    assert info["compression_format"] == info["compression_mode"] == ""
    assert info["relative_file_paths"] == ["bag.mcap"]
    assert info["files"] == [
        {
            "path": "bag.mcap",
            "starting_time": {"nanoseconds_since_epoch": 100 * TICK},
            "duration": {"nanoseconds": 500 * TICK},
            "message_count": 501,
        }
    ]
    assert all(isinstance(value, str) for value in info["custom_data"].values())
    assert isinstance(info["ros_distro"], str)
    topics = {entry["topic_metadata"]["name"]: entry for entry in info["topics_with_message_count"]}
    assert set(topics) == {topic.name for topic in graph.TOPICS}
    assert topics[JOINT_STATES]["message_count"] == 501
    assert topics[CLOCK]["message_count"] == 0
    for entry in topics.values():
        row = entry["topic_metadata"]
        assert row["serialization_format"] == "cdr"
        assert row["type_description_hash"].startswith("RIHS01_")
        assert len(row["type_description_hash"]) == len("RIHS01_") + 64


def test_qos_is_spelled_as_rosbag2_does(tmp_path: Path, write_bag: Any, messages: Any) -> None:
    """As in a metadata.yaml that `ros2 bag record` of Jazzy has written."""
    write_bag(tmp_path / "bag", [joint(messages, 0)])
    info = metadata(tmp_path / "bag")["rosbag2_bagfile_information"]
    offered = {
        entry["topic_metadata"]["name"]: entry["topic_metadata"]["offered_qos_profiles"]
        for entry in info["topics_with_message_count"]
    }
    forever = {"sec": 9223372036, "nsec": 854775807}
    assert offered[JOINT_STATES] == [
        {
            "history": "keep_last",
            "depth": 16,
            "reliability": "best_effort",
            "durability": "volatile",
            "deadline": forever,
            "lifespan": forever,
            "liveliness": "automatic",
            "liveliness_lease_duration": forever,
            "avoid_ros_namespace_conventions": False,
        }
    ]
    assert offered[ROBOT_DESCRIPTION][0]["durability"] == "transient_local"


def test_type_hash_is_the_one_that_ros_publishes(
    tmp_path: Path, write_bag: Any, messages: Any
) -> None:
    """std_msgs/msg/String, from a bag recorded with `ros2 bag record`."""
    write_bag(tmp_path / "bag", [text(messages, "")])
    info = metadata(tmp_path / "bag")["rosbag2_bagfile_information"]
    hashes = {
        entry["topic_metadata"]["type"]: entry["topic_metadata"]["type_description_hash"]
        for entry in info["topics_with_message_count"]
    }
    assert hashes["std_msgs/msg/String"] == (
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    )


# Log times ------------------------------------------------------------------------------------
def test_what_comes_before_the_first_stamp_is_logged_at_it(
    tmp_path: Path, write_bag: Any, messages: Any, typestore: Any
) -> None:
    now = time.time_ns()
    early = [text(messages, "<robot/>"), diagnostics(messages, now), twist(messages, typestore)]
    write_bag(tmp_path / "bag", [*early, joint(messages, 3 * TICK), joint(messages, 4 * TICK)])
    back = read(tmp_path / "bag")
    assert {topic: stamp for topic, stamp, _ in back[:4]} == {
        ROBOT_DESCRIPTION: 3 * TICK,
        DIAGNOSTICS: 3 * TICK,
        CMD_VEL: 3 * TICK,
        JOINT_STATES: 3 * TICK,
    }


def test_what_a_stranger_sends_without_a_time_is_kept_too(
    tmp_path: Path, write_bag: Any, messages: Any
) -> None:
    """Its stamp is before 0, or it is cut short: it is logged at the present."""
    good, bad = joint(messages, 3 * TICK), joint(messages, -7 * TICK)
    short = CLOCK, good[1][:7]
    write_bag(tmp_path / "bag", [good, bad, short, (JOINT_STATES, b"\0\1")])
    assert [stamp for _, stamp, _ in read(tmp_path / "bag")] == [3 * TICK] * 4


def test_a_reset_world_does_not_disorder_the_bag(
    tmp_path: Path, write_bag: Any, messages: Any
) -> None:
    stamps = [*range(1000), *range(500)]
    content = [joint(messages, stamp * TICK) for stamp in stamps]
    writer = write_bag(tmp_path / "bag", content)
    assert writer.resets == 1
    assert [(topic, data) for topic, _, data in read(tmp_path / "bag")] == content


def test_without_any_clock_wall_time_is_used(
    tmp_path: Path, profiles: Any, typestore: Any, messages: Any
) -> None:
    before = time.time_ns()
    writer = BagWriter(tmp_path / "bag", [graph.topic(CMD_VEL)], profiles, typestore)
    writer.write(writer.channels[0], twist(messages, typestore)[1])
    writer.close()
    (_, stamp, _), *rest = read(tmp_path / "bag")
    assert not rest
    assert before <= stamp <= time.time_ns()


def test_messages_without_a_clock_are_kept(tmp_path: Path, write_bag: Any, messages: Any) -> None:
    """The world never started: what was said is in the bag, at the wall time of its coming."""
    before = time.time_ns()
    writer = write_bag(tmp_path / "bag", [text(messages, "<robot/>")])
    ((topic, stamp, _),) = read(tmp_path / "bag")
    assert topic == ROBOT_DESCRIPTION and before <= stamp <= time.time_ns()
    counts = {channel.topic.name: channel.count for channel in writer.channels}
    assert counts[ROBOT_DESCRIPTION] == 1


def test_not_everything_is_held_back_for_a_clock_that_may_never_come(
    tmp_path: Path, write_bag: Any, messages: Any
) -> None:
    """Wall time then; when the world starts after all, its time goes on from there."""
    before = time.time_ns()
    long = [text(messages, "x" * (_EARLY // 4))] * 5
    write_bag(tmp_path / "bag", [*long, joint(messages, 3 * TICK), joint(messages, 5 * TICK)])
    stamps = [stamp for _, stamp, _ in read(tmp_path / "bag")]
    assert len(stamps) == 7 and stamps == sorted(stamps)
    assert before <= stamps[0] and stamps[-2] <= time.time_ns()
    assert stamps[-1] - stamps[-2] == 2 * TICK


def test_topics_may_be_added_while_it_is_written(
    tmp_path: Path, profiles: Any, typestore: Any, messages: Any
) -> None:
    """Also behind chunks that do not know them."""
    path = tmp_path / "bag"
    writer = BagWriter(path, [graph.topic(JOINT_STATES)], profiles, typestore)
    writer.write(writer.channels[0], joint(messages, 0)[1])
    writer.flush()
    mine = graph.Topic("/mine", "std_msgs/msg/String", (), "", 0.0)
    channel = writer.add(mine, profiles["STATUS"])
    writer.write(channel, text(messages, "hello")[1])
    writer.write(writer.channels[0], joint(messages, TICK)[1])
    with pytest.raises(LookupError):
        writer.add(graph.Topic("/odd", "nobody_msgs/msg/Odd", (), "", 0.0), profiles["STATUS"])
    writer.close()
    assert [topic for topic, _, _ in read(path)] == [
        JOINT_STATES,
        "/mine",
        JOINT_STATES,
    ]
    info = metadata(path)["rosbag2_bagfile_information"]
    counts = [entry["message_count"] for entry in info["topics_with_message_count"]]
    assert counts == [2, 1]


def test_an_empty_bag_can_be_opened(tmp_path: Path, write_bag: Any) -> None:
    write_bag(tmp_path / "bag", [])
    assert read(tmp_path / "bag") == []


# Missing messages -----------------------------------------------------------------------------
def test_gaps_between_stamps_are_counted(tmp_path: Path, write_bag: Any, messages: Any) -> None:
    stamps = [i for i in range(1000) if i not in (17, 500, 501, 502)]
    writer = write_bag(tmp_path / "bag", [joint(messages, i * TICK) for i in stamps])
    assert writer.missing == {JOINT_STATES: 4}
    info = metadata(tmp_path / "bag")["rosbag2_bagfile_information"]
    assert json.loads(info["custom_data"][MISSING_KEY]) == {JOINT_STATES: 4}
    assert "4" in next(line for line in writer.report().splitlines() if "/joint_states" in line)


# Where it goes --------------------------------------------------------------------------------
def test_nothing_is_overwritten_unasked(
    tmp_path: Path, write_bag: Any, messages: Any, profiles: Any, typestore: Any
) -> None:
    path = tmp_path / "bag"
    write_bag(path, [joint(messages, 0)])
    with pytest.raises(FileExistsError, match="overwrite"):
        BagWriter(path, graph.TOPICS, profiles, typestore)
    assert len(read(path)) == 1
    BagWriter(path, graph.TOPICS, profiles, typestore, overwrite=True).close()
    assert read(path) == []


@pytest.mark.parametrize("name", ["notes.txt", "more"])
def test_only_a_bag_is_ever_replaced(
    tmp_path: Path, profiles: Any, typestore: Any, name: str
) -> None:
    path = tmp_path / "home"
    path.mkdir()
    foreign = path / name
    foreign.mkdir() if name == "more" else foreign.write_text("mine")
    with pytest.raises(FileExistsError, match="not a bag"):
        BagWriter(path, graph.TOPICS, profiles, typestore, overwrite=True)
    assert foreign.exists()


def test_what_is_kept_of_a_chunk_until_the_index_is_written(
    tmp_path: Path, profiles: Any, typestore: Any, messages: Any
) -> None:
    """Ten minutes of the whole graph are some 1300 chunks of 25 topics."""
    topics = [graph.Topic(f"/t{k}", "std_msgs/msg/String", (), "STATUS", 0.0) for k in range(25)]
    writer = BagWriter(tmp_path / "bag", topics, profiles, typestore)

    def write(chunks: int) -> int:
        for _ in range(chunks):
            for channel in writer.channels:
                writer.write(channel, text(messages, "hello")[1])
            writer.flush()
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        before = write(64)
        kept = (write(256) - before) / 256
    finally:
        tracemalloc.stop()
    writer.close()
    assert len(read(tmp_path / "bag")) == 320 * 25
    assert kept < 250.0  # bytes
