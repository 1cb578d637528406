"""Bags of a full disk, of a killed recorder, of a disk that lost bits: what is whole is read.

Where a chunk ends is known from the `mcap` library, not from our reader.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader, AnyReaderError

from husky_bringup.bag import BagWriter
from husky_experiments.recordings.recording import Recording
from husky_experiments.run import Run
from husky_experiments.session import SessionError
from husky_runtime import graph

JOINT_STATES = graph.absolute(graph.JOINT_STATES)

TICK = graph.TICK_PERIOD_NS
COUNT, WIDTH = 400, 330
"""Messages, and joints in each: some three chunks."""
VALUES = np.random.default_rng(3).normal(size=(COUNT, 3, WIDTH))
VALUES[:, 0, 0] = np.arange(COUNT)
"""Position, velocity and effort of each message; numbers that do not compress much. The first
position is the number of the message."""


@pytest.fixture(scope="module")
def content(messages: Any) -> list[bytes]:
    return [messages.joint_states(i * TICK, *rows) for i, rows in enumerate(VALUES)]


@pytest.fixture
def writer(tmp_path: Path, profiles: Any, typestore: Any) -> BagWriter:
    return BagWriter(tmp_path / "bag", [graph.topic(JOINT_STATES)], profiles, typestore)


@pytest.fixture(scope="module")
def bag(
    tmp_path_factory: pytest.TempPathFactory, profiles: Any, typestore: Any, content: list[bytes]
) -> tuple[bytes, bytes, list[tuple[int, int]]]:
    """A whole bag: its file, its metadata, and where its chunks end after how many messages."""
    reader = pytest.importorskip("mcap.reader")
    path = tmp_path_factory.mktemp("whole") / "bag"
    writer = BagWriter(path, [graph.topic(JOINT_STATES)], profiles, typestore)
    for message in content:
        writer.write(writer.channels[0], message)
    writer.close()
    with (path / "bag.mcap").open("rb") as stream:
        chunks = reader.make_reader(stream, validate_crcs=True).get_summary().chunk_indexes
    ends, times = [], np.arange(COUNT) * TICK
    for chunk in chunks:
        known = int(np.searchsorted(times, chunk.message_end_time, side="right"))
        ends.append((chunk.chunk_start_offset + chunk.chunk_length, known))
    assert len(ends) >= 3
    return (path / "bag.mcap").read_bytes(), (path / "metadata.yaml").read_bytes(), ends


def numbers(recording: Recording) -> list[int]:
    """Of the messages that a recording has, each checked to be the one that was written."""
    if not recording.has(JOINT_STATES):
        return []
    found = recording.joints
    kept = found.position[:, 0].astype(int)
    np.testing.assert_allclose(found.time, kept * graph.TICK_PERIOD, atol=1e-9)
    np.testing.assert_array_equal(found.position[:, 1:], VALUES[kept, 0, 1:])
    np.testing.assert_array_equal(found.torque, VALUES[kept, 2])
    numbers: list[int] = kept.tolist()
    return numbers


def lengths(size: int, ends: list[tuple[int, int]]) -> Iterator[int]:
    """Every class of place at which a file may be cut, and some more."""
    yield from range(10)
    for end, _ in ends:
        yield from (end - 1, end, end + 1)
    yield from (size - 1, size - 8, size - 9, size - 37, size - 38)
    yield from np.random.default_rng(4).integers(0, size, 12).tolist()


def test_a_bag_that_is_cut_anywhere_is_read_up_to_there(
    tmp_path: Path, bag: tuple[bytes, bytes, list[tuple[int, int]]]
) -> None:
    """As a recorder leaves it that is killed: no index, no metadata.yaml."""
    whole, _, ends = bag
    path = tmp_path / "bag"
    path.mkdir()
    for length in lengths(len(whole), ends):
        (path / "bag.mcap").write_bytes(whole[:length])
        recording = Recording(path)
        known = max((count for end, count in ends if end <= length), default=0)
        assert numbers(recording) == list(range(known)), length
        assert recording.counts.get(JOINT_STATES, 0) == known
        assert recording.damage.startswith(f"{path} is not whole")
        assert "\n" not in recording.damage
        if known:
            assert (recording.start, recording.end) == (0.0, (known - 1) * TICK / 1e9)
            stamps = recording.stamps([JOINT_STATES])[JOINT_STATES]
            assert len(stamps) == known


def test_a_flipped_bit_never_makes_another_message(
    tmp_path: Path, bag: tuple[bytes, bytes, list[tuple[int, int]]]
) -> None:
    """The chunk that it is in is left out; one that is in no message takes none along."""
    whole, metadata, ends = bag
    path = tmp_path / "bag"
    path.mkdir()
    (path / "metadata.yaml").write_bytes(metadata)
    rng = np.random.default_rng(5)
    index = ends[-1][0]  # indices of messages and chunks, and what else stands at the end
    places = [*rng.integers(0, len(whole), 15), *rng.integers(index, len(whole), 15), 0, 8]
    for place in places:
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(rng.integers(8))
        (path / "bag.mcap").write_bytes(damaged)
        try:
            recording = Recording(path)
        except AnyReaderError:
            assert place < 8, "no MCAP file any more"
            continue
        found = numbers(recording)
        assert found == sorted(set(found))
        lost = COUNT - len(found)
        assert lost == 0 or recording.damage, place
        chunks = np.diff([0, *(count for _, count in ends)])
        behind = next((c for (end, _), c in zip(ends, chunks, strict=True) if place < end), 0)
        # The length of a record is no part of a chunk: behind a wrong one all is lost.
        assert lost in (0, behind) or lost >= COUNT - ends[-1][1], place


def test_metadata_that_is_missing_or_damaged_is_told(
    tmp_path: Path, bag: tuple[bytes, bytes, list[tuple[int, int]]]
) -> None:
    whole, metadata, _ = bag
    path = tmp_path / "bag"
    path.mkdir()
    (path / "bag.mcap").write_bytes(whole)
    assert Recording(path).damage.endswith("metadata.yaml is missing or damaged")
    for damaged in (b"", metadata[:100], b"\xff" + metadata, b"[" + metadata):
        (path / "metadata.yaml").write_bytes(damaged)
        recording = Recording(path)
        assert recording.damage.endswith("metadata.yaml is missing or damaged")
        assert recording.counts[JOINT_STATES] == COUNT
    (path / "metadata.yaml").write_bytes(metadata)
    assert Recording(path).damage == ""


@pytest.mark.parametrize("share", [0.0003, 0.02, 0.3, 0.5, 0.7, 0.97, 0.999, 0.9999])
def test_a_full_disk_closes_the_bag(
    tmp_path: Path,
    bag: tuple[bytes, bytes, list[tuple[int, int]]],
    content: list[bytes],
    writer: BagWriter,
    small_files: Any,
    share: float,
) -> None:
    """At any length of the file: in a chunk, in the index behind the last one, in metadata.yaml."""
    (channel,) = writer.channels
    with small_files(int(share * len(bag[0]))):
        for message in content:
            writer.write(channel, message)
        writer.close()
    assert writer.problem == f"{tmp_path / 'bag'}: File too large"
    assert channel.count + writer.dropped == COUNT
    recording = Recording(tmp_path / "bag")
    assert numbers(recording) == list(range(channel.count))
    assert recording.damage
    if share > 0.3:
        assert recording.damage == writer.problem
        assert channel.count >= 0.3 * share * COUNT
        with AnyReader([tmp_path / "bag"]) as reader:  # as anybody else reads a bag that was closed
            assert reader.message_count == channel.count
            assert [data for _, _, data in reader.messages()] == content[: channel.count]


def test_a_bag_can_be_closed_twice(tmp_path: Path, writer: BagWriter, content: list[bytes]) -> None:
    writer.write(writer.channels[0], content[0])
    writer.close()
    writer.close()
    writer.flush()
    writer.write(writer.channels[0], content[1])
    assert (writer.problem, writer.dropped) == ("", 1)
    assert Recording(tmp_path / "bag").damage == ""


def test_what_was_flushed_outlasts_the_recorder(
    tmp_path: Path, writer: BagWriter, content: list[bytes]
) -> None:
    """However few the messages are."""
    (channel,) = writer.channels
    writer.flush()
    for message in content[:10]:
        writer.write(channel, message)
    writer.flush()
    writer.write(channel, content[10])
    assert numbers(Recording(tmp_path / "bag")) == list(range(10))
    writer.close()
    assert numbers(Recording(tmp_path / "bag")) == list(range(11))


def test_an_experiment_does_not_judge_by_half_a_recording(
    tmp_path: Path, bag: tuple[bytes, bytes, list[tuple[int, int]]]
) -> None:
    run = Run("some", argparse.Namespace(output=tmp_path / "out", set=[]))
    path = run.output / "bag"
    path.mkdir()
    (path / "bag.mcap").write_bytes(bag[0][: len(bag[0]) // 2])
    with pytest.raises(SessionError, match=r"recording is not whole.*bag"):
        run.recording()


def test_what_is_no_bag_is_no_bag(tmp_path: Path) -> None:
    (tmp_path / "bag.mcap").write_bytes(b"something else")
    with pytest.raises(AnyReaderError):
        Recording(tmp_path)
